"""Partially coherent light: sources and their coherent modes, a focus by rays, and scattering scenes lit by them.

Public names stand in ``__init__.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
