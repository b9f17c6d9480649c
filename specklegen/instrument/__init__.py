"""The laboratory: distances and pixels to directions, and the camera that counts photons.

Public names stand in ``__init__.pyi``.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
