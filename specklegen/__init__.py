"""Correlated speckle image stacks from bulk material parameters.

Scene -> plan -> sampler -> fields: one page, ``specklegen.rendering``. Ten names and the submodules stand in
``__init__.pyi``; they load when they are first used, so that importing the package stays light. Names that were here
before are in the submodules by subject.
"""

from importlib import import_module

from specklegen.core.extras import lazy_names

SUBJECTS = ("media", "light", "sensors", "results", "fit", "statistics", "coherence")
"""Submodules that hold the names which stood here before."""


def _moved(name: str) -> str | None:
    """Return the new place of a name that stood here before."""
    places = (f"specklegen.{subject}" for subject in SUBJECTS)
    return next((f"{place}.{name}" for place in places if name in import_module(place).__all__), None)


__getattr__, __dir__, __all__ = lazy_names(__name__, __file__, _moved, unlisted=("DoubtWarning", "RuleError"))

__version__ = "0.1.0"
