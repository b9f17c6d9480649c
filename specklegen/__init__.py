"""Correlated speckle image stacks from bulk material parameters.

Scene -> plan -> sampler -> fields: one page, ``specklegen.rendering``. Public names stand in ``__init__.pyi``; they
load when they are first used, so that importing the package stays light.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

__version__ = "0.1.0"
