"""Reconstruction: phase retrieval, networks, and their evaluation.

Public names stand in ``__init__.pyi`` and load when they are first used.
"""

import lazy_loader

if __name__ == "models":
    raise ImportError(
        "`import models` found the folder of specklegen's clone, where Python was started: write "
        "`import specklegen.models`, or start Python in another folder to import another package of that name"
    )

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
