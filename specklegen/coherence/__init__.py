"""Partially coherent light: sources and their coherent modes, a focus by rays, and scattering scenes lit by them.

Public names stand in ``__init__.pyi``.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
