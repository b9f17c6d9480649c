"""Fits to measurements: of a camera, a material, a setup; how far simulated images are from measured ones.

Examples
--------
>>> import specklegen as sg
>>> print(*dir(sg.fit))
Advice CameraFit MaterialFit SetupFit Twin advise fit_camera fit_material fit_setup twin
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
