"""Assumptions of the physics about a scene, and doubts about them."""

import math
from typing import cast

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import warn_user
from specklegen.scene.illumination import IncoherentObject
from specklegen.scene.media import Medium
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ThinMedium

WIDE = 0.15
"""Rms angle behind screens from which the paraxial model is doubtful."""
_THIN, _COVERED = 5, 10  # wavelengths in a medium, correlation lengths of a diffuser in a beam: fewer are seldom meant


def independence_doubt(mean_free_path: float, wavelength: float) -> str | None:
    """Why the particles' independence, which every estimate assumes, is doubtful; None where it is not."""
    if mean_free_path >= wavelength:
        return None
    return f"the mean free path {mean_free_path:g} is below the wavelength {wavelength:g}"


def warn_of_dependence(mean_free_path: float, wavelength: float) -> None:
    """Issue a :class:`DoubtWarning` where independent scattering is doubtful, for results that have no scene."""
    doubt = independence_doubt(mean_free_path, wavelength)
    if doubt:
        warn_user(f"independent scattering is assumed, but doubtful: {doubt}")


def warn_of_doubts(scene: Scene) -> None:
    """Issue a :class:`DoubtWarning` for all that :func:`validity_decisions` doubts: for results without a plan."""
    for each in validity_decisions(scene):
        warn_user(f"{each.part}: {each.reason}")


def implausible(
    medium: Medium | ThinMedium, wavelength: float, width: float = math.inf, size: float = math.inf
) -> list[str]:  # fmt: skip
    """List numbers that are seldom meant, since most come of a length in another unit.

    Parameters
    ----------
    medium, wavelength
        Of a scene.
    width
        Of its beams.
    size
        Of its object, in direction sines.
    """
    texts = []
    stack, volume = medium.stack, cast("Medium", medium)
    if stack is not None:
        covered = width / stack.correlation_lengths.max()
        if covered < _COVERED:
            texts.append(f"the beam covers {covered:.2g} correlation lengths of a diffuser, so images are not Gaussian")
    else:
        if doubt := independence_doubt(volume.mean_free_path, wavelength):
            texts.append(doubt)
        if 0 < volume.thickness < _THIN * wavelength:
            texts.append(f"the medium is {volume.thickness:.3g} thick, {volume.thickness / wavelength:.2g} wavelengths")
        ballistic = math.exp(-volume.optical_depth)
        if 0.5 < ballistic < 1:
            texts.append(f"{ballistic:.0%} of the light passes the medium unscattered")
    if size < wavelength / width:
        grain = wavelength / width
        texts.append(f"the object, {size:.3g} wide in direction sines, is smaller than a speckle, {grain:.3g}")
    return texts


def implausible_in(scene: Scene) -> list[str]:
    """List numbers of a scene that are seldom meant."""
    light = scene.illumination
    if not light.limited or light.focused:
        return implausible(scene.medium, scene.wavelength)
    source = cast("IncoherentObject", light)
    extended = not light.coherent and source.brightness.size > 1
    size = max(source.brightness.shape) * source.pitch if extended else math.inf
    return implausible(scene.medium, scene.wavelength, scene.beams.width, size)


def idealisations(
    scene: Scene, *, refractive_index: float | None = None, band: bool = False, halves: int = 1
) -> list[Decision]:
    """Parts of a real setup that a scene leaves out: "faces", "polarisation", "bandwidth" and "aperture".

    Parameters
    ----------
    scene
        The scene.
    refractive_index
        Of the medium against its surroundings, where it is known.
    band
        Whether a band of wavelengths is modelled beside the scene.
    halves
        Independent polarisations that are added up beside it.
    """
    decisions = []
    if scene.thin is None and not scene.volume.refracts and refractive_index != 1:
        index = "" if refractive_index is None else f" although the refractive index is {refractive_index:g}"
        remedy = "Slab.faces, or refractive_index of a lab" if not scene.volume.has_sides else "of a Slab alone"
        decisions.append(Decision(
            "faces", False, f"idealised: no refractive-index mismatch{index}; in air or water, faces reflect and halve "
            f"the memory-effect range or more ({remedy})",
        ))  # fmt: skip
    if scene.polarisers is None:
        scalar = "idealised: light is a scalar in the medium"
        alone = "; light that a thick medium depolarises has a contrast of 0.71, unless an analyser selects one"
        reason = scalar + (alone if halves == 1 else " and leaves it depolarised")
        decisions.append(Decision("polarisation", False, reason))
    else:
        decisions.append(Decision("polarisation", True, "followed along every path, then passed through an analyser"))
    if not band:
        decisions.append(Decision(
            "bandwidth", False, "idealised: light of one wavelength; a bandwidth lowers the contrast where path "
            "lengths differ by more than the coherence length",
        ))  # fmt: skip
    if scene.illumination.limited:
        decisions.append(Decision(
            "pupil", False, "idealised: no aperture between medium and camera, which collects light from the whole "
            "exit face; an aperture smaller than the illuminated area makes larger speckle grains",
        ))  # fmt: skip
    return decisions


IDEALISED = ("faces", "polarisation", "bandwidth", "pupil")
"""Parts of :func:`idealisations`."""


def validity_decisions(scene: Scene) -> list[Decision]:
    """Doubtful assumptions of the physics about a scene."""
    decisions = []
    wavelength = scene.wavelength
    width = scene.beams.width if scene.illumination.limited else np.inf
    doubt = None if scene.thin is not None else independence_doubt(scene.volume.mean_free_path, wavelength)
    if doubt:
        decisions.append(Decision("independent scattering", True, f"assumed, but doubtful: {doubt}"))
    if width**2 < 10 * wavelength * scene.thickness:
        decisions.append(
            Decision(
                "diffraction of the beam inside the slab",
                False,
                f"not modelled, and doubtful here: width^2 / wavelength = {width**2 / wavelength:.3g} is not far "
                f"above the thickness {scene.thickness:g}",
                doubt=True,
            )  # fmt: skip
        )
    angle = 0.0 if scene.thin is None else scene.thin.rms_angle(wavelength)
    if angle > WIDE:
        decisions.append(
            Decision(
                "angles beyond the paraxial regime", False,
                f"not modelled, and doubtful here: an rms angle of {angle:.2g} lengthens the walk between screens by "
                f"some {150 * angle**2:.2g} %",
            )  # fmt: skip
        )
    return decisions
