"""Light that falls on a medium: plane waves, beams, point sources, objects, and polarisers.

Examples
--------
>>> import specklegen as sg
>>> sg.light.CollimatedBeams.tilts(["0 deg", "0.1 deg"], width="5 mm").width
5000.0
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
