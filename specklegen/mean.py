"""The mean (ballistic, coherent) field of collimated beams behind a slab.

The total transmitted mean of a wide beam is e^(-OD/2) times the diffraction pattern of its window
(physics.md 3): at v = i its amplitude is (k / 2 pi) A e^(-OD/2), and for a square window its first zero
lies lambda / W away. The constant phase is chosen such that the field on the exit face is real and positive
at the window's centre for a beam along the axis.
"""

import numpy as np
from scipy.special import j1

from specklegen.illumination import CollimatedBeams, Profile
from specklegen.scene import Scene
from specklegen.values import reject


def window_transform(profile: Profile, width: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Fourier transform of an amplitude profile b, an area, at lateral frequencies in cycles per length."""
    if profile == "square":
        return width**2 * np.sinc(width * x) * np.sinc(width * y)
    r = np.hypot(x, y)
    if profile == "disc":
        t = np.pi * width * r
        return np.pi / 4 * width**2 * np.where(t < 1e-8, 1.0, 2 * j1(t) / np.where(t < 1e-8, 1.0, t))
    # b = exp(-4 r^2 / width^2), whose square falls to 1/e^2 at half the width.
    return np.pi / 4 * width**2 * np.exp(-((np.pi * width * r / 2) ** 2))


def mean_field(scene: Scene) -> np.ndarray:
    """Mean field of a scene, complex128[T, *sensor.shape]; |m|^2 in area per steradian like |u|^2.

    [Bar19] Eqs. 20, 46-48; physics.md 3. Zero in reflection: the layer is index-matched.

    Raises
    ------
    RuleError
        For illumination without a field of its own (an incoherent object).
    """
    beams = scene.illumination
    if not isinstance(beams, CollimatedBeams):
        reject("mean_field scene.illumination", "CollimatedBeams", type(beams).__name__)
    views = scene.view_directions
    medium = scene.slab
    field = np.empty((len(beams.directions), *scene.sensor.shape), np.complex128)
    forward = views[..., 2] > 0
    for tilt, direction in zip(field, beams.directions, strict=True):
        difference = (direction[:2] - views[..., :2]) / scene.wavelength
        # On the exit face the beam has walked off by its slope times the thickness.
        walk = medium.thickness * (direction[:2] / direction[2])
        turns = difference @ walk + (direction[2] - views[..., 2]) * medium.thickness / scene.wavelength
        pattern = window_transform(beams.profile, beams.width, difference[..., 0], difference[..., 1])
        attenuation = np.exp(-0.5 * medium.optical_depth / direction[2])
        obliquity = np.sqrt(direction[2])  # face area to cross section
        tilt[...] = np.where(
            forward, obliquity * attenuation / scene.wavelength * pattern * np.exp(2j * np.pi * turns), 0
        )
    return field


def ballistic_fraction(scene: Scene) -> float:
    """e^(-OD), the share of the light that crosses the slab without a collision, at the steepest tilt."""
    steepest = scene.beams.directions[:, 2].max(initial=0.0) or 1.0
    return float(np.exp(-scene.slab.optical_depth / steepest))
