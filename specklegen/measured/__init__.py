"""Measurements of a laboratory, from the files on its disk: camera frames with their setups, and curves.

Public names stand in ``__init__.pyi``.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
