"""What the packages export, for tests that look at all of it."""

import importlib
from dataclasses import is_dataclass

ROOMS = ("datasets", "models", "fdtd", "coherence", "instrument", "wavetracing")
PACKAGES = ("specklegen", *(f"specklegen.{name}" for name in ROOMS))
NAMES = sorted({f"{package}.{name}" for package in PACKAGES for name in importlib.import_module(package).__all__})


def public(name: str) -> object:
    """Return what a public name stands for."""
    package, _, last = name.rpartition(".")
    return getattr(importlib.import_module(package), last)


TYPES = [kind for kind in map(public, NAMES) if isinstance(kind, type)]
RESULTS = [kind for kind in TYPES if is_dataclass(kind) or hasattr(kind, "_fields")]
