"""Data sets of speckle images: rendered on the fly, stored, and read back."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from specklegen.datasets.cache import SpeckleCache
    from specklegen.datasets.stream import SpeckleStream

__all__ = ["SpeckleCache", "SpeckleStream"]

_HOMES = {"SpeckleCache": "cache", "SpeckleStream": "stream"}
"""Public names that need torch, and the modules that are imported when they are first used."""


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
