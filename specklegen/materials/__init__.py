"""Materials that people really have, by name: what their particles do to light, each number with where it comes from.

``list()`` names them, ``about(name)`` tells their numbers, ranges and sources, ``get(name, wavelength=...)`` makes one,
``draw(name, wavelength=..., seed=...)`` makes one with numbers from the ranges of the literature;
``memory_range(name, wavelength=..., thickness=...)`` says how far its memory effect reaches, and how well that is
known. A new material is one file and one line of ``PRESETS`` in :mod:`specklegen.materials.registry`.

Examples
--------
>>> from specklegen import materials
>>> materials.list()[:3]
['bone', 'brain', 'dermis']
>>> milk = materials.get("milk", wavelength=0.633)  # in vacuum, micrometres
>>> round(milk.scatterer.g, 1)
0.9
"""

from specklegen.materials.memory_range import MemoryRange, memory_range
from specklegen.materials.preset import BulkMaterial, Number, Preset
from specklegen.materials.registry import about, draw, get
from specklegen.materials.registry import names as list

__all__ = ["BulkMaterial", "MemoryRange", "Number", "Preset", "about", "draw", "get", "list", "memory_range"]
