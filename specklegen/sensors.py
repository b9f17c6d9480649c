"""Sensors: where speckle is looked at, and the optics before them.

Examples
--------
>>> import specklegen as sg
>>> sg.sensors.FarField.grid((64, 64), pitch="1 mrad").shape
(64, 64)
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
