"""Measurements of a laboratory, from the files on its disk: camera frames with their setups, and curves.

Public names stand in ``__init__.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
