"""What the packages export, for tests that look at all of it."""

import importlib
from dataclasses import is_dataclass
from inspect import ismodule

from specklegen import SUBJECTS

ROOMS = (*SUBJECTS, "datasets", "models", "fdtd", "instrument", "wavetracing")
PACKAGES = ("specklegen", *(f"specklegen.{name}" for name in ROOMS))
NAMES = sorted(
    f"{package.__name__}.{name}" for package in map(importlib.import_module, PACKAGES) for name in package.__all__
    if not ismodule(getattr(package, name)) or name == "materials"
)  # fmt: skip


def public(name: str) -> object:
    """Return what a public name stands for."""
    package, _, last = name.rpartition(".")
    return getattr(importlib.import_module(package), last)


TYPES = [kind for kind in map(public, NAMES) if isinstance(kind, type)]
RESULTS = [kind for kind in TYPES if is_dataclass(kind) or hasattr(kind, "_fields")]
