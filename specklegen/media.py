"""Media: volumes, layers, screens, particles, and how they move.

Examples
--------
>>> import specklegen as sg
>>> sg.Slab(thickness="1 mm", mean_free_path="0.1 mm", scatterer=sg.media.HenyeyGreenstein(0.9)).optical_depth
10.0
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
