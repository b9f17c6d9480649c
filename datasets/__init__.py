"""Data sets: recipes, and samples of them streamed or stored.

Public names stand in ``__init__.pyi`` and load when they are first used: neither torch nor zarr is needed to read a
recipe.
"""

from specklegen.core.extras import lazy_names

if __name__ == "datasets":
    raise ImportError(
        "`import datasets` found the folder of specklegen's clone, where Python was started: write "
        "`import specklegen.datasets`, or start Python in another folder to import another package of that name"
    )

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
