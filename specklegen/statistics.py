"""Statistics of speckle: its covariance, its correlations in tilt, shift and time, and its mean field.

Examples
--------
>>> import specklegen as sg
>>> medium = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.Isotropic())
>>> sg.statistics.reflectance_transmittance(medium, paths=1000, seed=0).transmittance > 0
True
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
