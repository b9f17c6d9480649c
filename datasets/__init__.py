"""Data sets: recipes, and samples of them streamed or stored.

Public names stand in ``__init__.pyi`` and load when they are first used: neither torch nor zarr is needed to read a
recipe.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
