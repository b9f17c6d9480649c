"""Materials that people really have, by name: what their particles do to light, each number with where it comes from.

``list()`` names them, ``about(name)`` tells their numbers, ranges and sources, ``get(name, wavelength=...)`` makes one,
``draw(name, wavelength=..., seed=...)`` makes one with numbers from the ranges of the literature. A new material is one
file and one line of ``PRESETS`` in :mod:`specklegen.materials.registry`.
"""

from specklegen.materials.preset import BulkMaterial, Number, Preset
from specklegen.materials.registry import about, draw, get
from specklegen.materials.registry import names as list

__all__ = ["BulkMaterial", "Number", "Preset", "about", "draw", "get", "list"]
