"""What the physics itself assumes of a scene, and where that is doubtful."""

import warnings

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import DoubtWarning
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject
from specklegen.scene.scene import Scene

WIDE = 0.15
"""Rms angle behind screens from which the paraxial model is doubtful."""


def independence_doubt(mean_free_path: float, wavelength: float) -> str | None:
    """Why the particles' independence, which every estimate assumes, is doubtful; None where it is not."""
    if mean_free_path >= wavelength:
        return None
    return f"the mean free path {mean_free_path:g} is below the wavelength {wavelength:g}"


def warn_of_dependence(mean_free_path: float, wavelength: float) -> None:
    """Issue a :class:`DoubtWarning` where independent scattering is doubtful, for results that have no decisions."""
    doubt = independence_doubt(mean_free_path, wavelength)
    if doubt:
        warnings.warn(f"independent scattering is assumed, but doubtful: {doubt}", DoubtWarning, stacklevel=3)



def validity_decisions(scene: Scene) -> list[Decision]:
    """What the physics itself assumes of a scene, where it is doubtful."""
    found = []
    wavelength = scene.wavelength
    limited = isinstance(scene.illumination, CollimatedBeams | IncoherentObject)
    width = scene.beams.width if limited else np.inf
    doubt = None if scene.thin is not None else independence_doubt(scene.volume.mean_free_path, wavelength)
    if doubt:
        found.append(Decision("independent scattering", True, f"assumed, but doubtful: {doubt}"))
    if width**2 < 10 * wavelength * scene.thickness:
        found.append(
            Decision(
                "diffraction of the beam inside the slab",
                False,
                f"not modelled, and doubtful here: width^2 / wavelength = {width**2 / wavelength:.3g} is not far "
                f"above the thickness {scene.thickness:g}",
            )  # fmt: skip
        )
    angle = 0.0 if scene.thin is None else scene.thin.rms_angle(wavelength)
    if angle > WIDE:
        found.append(
            Decision(
                "angles beyond the paraxial regime", False,
                f"not modelled, and doubtful here: an rms angle of {angle:.2g} lengthens the walk between screens by "
                f"some {150 * angle**2:.2g} %",
            )  # fmt: skip
        )
    return found
