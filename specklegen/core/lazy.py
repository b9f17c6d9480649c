"""Modules that are imported when they are first used: torch takes a second, and a recipe that is read needs none."""

from importlib import import_module
from typing import TYPE_CHECKING, Any


class LazyModule:
    """Stands for a module; each of its names is looked up there once.

    For the type checker a file imports the module under ``TYPE_CHECKING``; annotations must not be evaluated.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        value = getattr(import_module(self._name), attribute)
        setattr(self, attribute, value)
        return value


if TYPE_CHECKING:
    import torch as torch
    from scipy import optimize as optimize
    from scipy import special as special
    from scipy import stats as stats
else:
    torch, optimize, special, stats = map(LazyModule, ("torch", "scipy.optimize", "scipy.special", "scipy.stats"))
