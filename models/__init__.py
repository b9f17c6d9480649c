"""Reconstruction: phase retrieval, networks, and their evaluation.

Public names stand in ``__init__.pyi`` and load when they are first used.
"""

from specklegen.core.extras import lazy_names

if __name__ == "models":
    raise ImportError(
        "`import models` found the folder of specklegen's clone, where Python was started: write "
        "`import specklegen.models`, or start Python in another folder to import another package of that name"
    )

_MOVED = {"reconstruct_and_assess": "specklegen.models.reconstruct"}

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__, _MOVED.get)
