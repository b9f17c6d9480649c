"""Results that functions return, what they may spend, and results larger than memory.

Examples
--------
>>> import specklegen as sg
>>> medium = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.Isotropic())
>>> isinstance(sg.memory_effect(medium, wavelength=0.5, tilts=[0.0], paths=100), sg.results.MemoryEffect)
True
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
