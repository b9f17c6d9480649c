"""Far field of scatterers: when a narrow phase function may be evaluated along a path's directions.

Endpoint factors hold s(i . w_1): light of every tilt i arrives at x_1 and goes on along the *same* w_1, from point to
point. That is the field far from x_1, beyond 1/(k theta^2) for a phase function of width theta. Nearer by, a scatterer
is a thin screen that adds the same transverse momentum to light of any tilt: the ladder of multiple scattering
conserves the difference k t of two waves at every collision; both keep their angle to the phase function, s(k_1 -> k_1
+ p) s*(k_2 -> k_2 + p); what is left of their correlation is the lateral way of the path alone, K = E[w e^(-i k t .
R)] / E[w].

The two agree while tilts are small beside the phase function. Beyond, the first loses the overlap of the phase
functions of both tilts,

    A(t) = int s(w) s*(w_t) dw,      |C|^2 too low by 1 - |A|^4 at most (both ends)

which is no physics where the mean free path l is below 1/(k theta^2); where it is far above, K is at its floor long
before, since k t l theta = k l theta^2 for t = theta. docs/physics.md 10.
"""

from typing import NamedTuple

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.values import remembered
from specklegen.scene.illumination import reference_direction
from specklegen.scene.media import PlaneMedium
from specklegen.scene.scatterers import Scatterer
from specklegen.scene.scene import Scene

FAR = 100.0
"""k l theta^2 from which segments are in the far field of their scatterers, and K at its floor where lobes part."""
SLANT = 0.01
"""Tilt squared, from the middle of all, up to which keeping the angle to the lobe leaves slants and depths as are."""
NEGLIGIBLE = 2e-3
"""1 - |A|^4 up to which it does not matter which of the two is asked."""
_ALONG, _AROUND = 512, 96  # nodes of the angle to the lobe, by its logarithm, and on the circle about it


class LobeLoss(NamedTuple):
    """Error of endpoint factors for a tilt that is not small beside the phase function.

    Attributes
    ----------
    loss : float
        1 - |A|^4: how much too low |C|^2 comes out at most.
    far_field : float
        k l theta^2, the mean free path over the distance from which the phase function is in its far field.
    """

    loss: float
    far_field: float

    @property
    def negligible(self) -> bool:
        """True if the phase functions of both tilts are one."""
        return self.loss <= NEGLIGIBLE

    @property
    def spurious(self) -> bool:
        """True if that loss is none that light has."""
        return not self.negligible and self.far_field < FAR


def steepest(medium: PlaneMedium, tilts: np.ndarray) -> float:
    """Largest of some tilts, radians: where it is steepest, in the layer of the least refractive index."""
    largest = float(np.abs(tilts).max(initial=0.0))
    if not medium.indices:
        return largest
    return float(np.arcsin(min(np.sin(largest) * medium.faces.inside / min(medium.indices), 1.0)))


def lobe_loss(medium: PlaneMedium, wavelength: float, tilt: float) -> LobeLoss:
    """Loss of endpoint factors between two lights a ``tilt`` (radians) apart."""
    scatterer, apart = medium.scatterer, float(f"{abs(tilt):.9g}")
    shared = cached_result(float, ("overlap of phase functions", scatterer, apart), lambda: overlap(scatterer, apart))
    loss = 1 - shared**4
    turns = 2 * np.pi * medium.mean_free_path / wavelength
    turns *= max(medium.indices, default=medium.faces.inside) / medium.faces.inside
    return LobeLoss(loss, turns * lobe_width(medium.scatterer) ** 2)


@remembered(256)
def overlap(scatterer: Scatterer, tilt: float) -> float:
    """|A| of two phase functions a ``tilt`` apart, 1 at 0: of all types of particle, by their shares, to some 1e-4."""
    if tilt == 0:
        return 1.0
    return abs(sum(share * _overlap(each, tilt) for each, share in scatterer.components))


def _overlap(particle: Scatterer, tilt: float) -> complex:
    """A(t) from nodes about one phase function, weighted against those about the other by squared distances."""
    theta, weights = _quadrature()
    angle = (np.arange(_AROUND) + 0.5) * np.pi / _AROUND
    own = np.sin(theta / 2)[:, None] ** 2  # (1 - cos) / 2 from either axis, without cancellation
    other = np.sin((theta - tilt) / 2)[:, None] ** 2 + np.outer(np.sin(theta), np.sin(tilt) * np.sin(angle / 2) ** 2)
    here, there = particle.amplitude(1 - 2 * own, 3), particle.amplitude(1 - 2 * other, 3)
    product = other / (own + other) * (here * np.conj(there) + np.conj(here) * there)
    return complex((weights[:, None] * product).sum() * 2 * np.pi / _AROUND)


def _quadrature() -> tuple[np.ndarray, np.ndarray]:
    """Angles float64[n] dense towards the axis, and weights for sin(theta) d theta."""
    t, weights = gauss_legendre(_ALONG)
    low, high = np.log(1e-9), np.log(np.pi)
    theta = np.exp(low + (t + 1) / 2 * (high - low))
    return theta, weights * (high - low) / 2 * theta * np.sin(theta)


@remembered(64)
def lobe_width(scatterer: Scatterer) -> float:
    """Tilt in radians at which ``|A|^2`` is a half; pi, more than a phase function has, where it never falls so low."""
    return cached_result(float, ("width of the phase function", scatterer), lambda: _lobe_width(scatterer))


def _lobe_width(scatterer: Scatterer) -> float:
    """Halving of :func:`lobe_width`."""
    low, high = 1e-9, np.pi
    if overlap(scatterer, high) ** 2 > 0.5:
        return high
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if overlap(scatterer, float(f"{middle:.9g}")) ** 2 > 0.5 else (low, middle)
    return float(high)


def middle_light(scene: Scene) -> np.ndarray | None:
    """Light float64[3] whose angles to phase functions all lights of path sums keep; None if each has its own.

    The direction in the middle of the lights, where they are apart beside narrow phase functions in whose near field
    paths go on (:mod:`specklegen.paths.kept_angles`), and near enough for slants and depths to stay. A film has that of
    its rest.
    """
    apart = _apart(scene)
    if apart is None or not apart[1].spurious or scene.polarisers is not None or scene.slab.indices:
        return None
    lights = scene.at_rest.lights
    middle = reference_direction(lights)
    aside = float(np.square(lights[:, :2] - middle[:2]).sum(axis=1).max())
    return middle if aside <= SLANT * (1 + 1e-9) else None  # sines of the limit itself, rounded


def far_field_decision(scene: Scene) -> Decision | None:
    """Decide how path sums of several tilts treat narrow phase functions; None where nothing is lost.

    Views of one tilt do not matter: their grains are far finer than any phase function.
    """
    apart = _apart(scene)
    if apart is None or not apart[1].spurious:
        return None
    reach, lost = apart
    part = "far field of the scatterers"
    reason = (
        f"not reached within a mean free path, only {lost.far_field:.2g} of the distance: the tilts span {reach:.2g}, "
        f"the phase function {lobe_width(scene.slab.scatterer):.2g} rad; "
    )
    if middle_light(scene) is not None:
        return Decision(part, False, reason + "light keeps its angle to the phase function")
    return Decision(
        part, False,
        reason + f"path sums underestimate the intensity correlation by up to {lost.loss:.2g}, since lights lie more "
        f"than {SLANT**0.5:g} rad from their middle", doubt=True, error=lost.loss,
    )  # fmt: skip


def _apart(scene: Scene) -> tuple[float, LobeLoss] | None:
    """Largest distance of the lights, in sines, and the loss that it causes; None where it is negligible."""
    if scene.medium.has_sides or scene.dimension == 2 or scene.illumination.near or len(scene.lights) < 2:
        return None
    if scene.slab.albedo == 0:
        return None
    reach = float(np.linalg.norm(np.ptp(scene.lights[:, :2], axis=0)))
    return reach, lobe_loss(scene.slab, scene.wavelength, reach)
