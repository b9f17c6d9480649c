"""Single scattering in closed form, where it is all that a scene shows: [Bar19] Eq. 41 instead of Monte Carlo."""

from typing import Literal

import numpy as np

from specklegen.core.arguments import choice
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.paths.pilot import volume_pilot
from specklegen.scene.media import Box
from specklegen.scene.scatterers import Dimensions
from specklegen.scene.scene import Scene
from specklegen.theory.single_scattering import box_covariance

Orders = Literal["auto", "all", "single"]
_MOST_ENTRIES = {2: 20_000, 3: 200}  # beyond which Monte Carlo at its default count is the cheaper way


def single_decision(scene: Scene, orders: Orders, entries: int, tolerance: float, reverse: bool) -> Decision:
    """Return whether multiple scattering takes part in a covariance of so many entries."""
    part = "multiple scattering"
    choice("covariance orders", orders, ("auto", "all", "single"))
    if orders == "all":
        return Decision(part, True, "as asked")
    light, medium = scene.illumination, scene.medium
    closed = medium.has_sides and medium.homogeneous and not (light.limited or light.near or scene.sensor.near)
    if orders == "single":
        if not closed:
            reject(
                "covariance orders", '"auto" or "all" for this scene', orders,
                "The closed form is for a Box, PlaneWaves and a far-field sensor; for other scenes use .single.",
            )  # fmt: skip
        return Decision(part, False, "as asked")
    if not closed or not entries:
        return Decision(part, True, "single scattering of this scene has no closed form")
    if entries > _MOST_ENTRIES[scene.dimension]:
        return Decision(part, True, f"{entries} entries take longer in closed form than by Monte Carlo")
    share = volume_pilot(scene, reverse).multiple_share
    if share > tolerance:
        return Decision(part, True, f"up to {share:.2g} of the intensity")
    return Decision(part, False, f"at most {share:.2g} of the intensity; single scattering in closed form")


def single_covariance(scene: Scene, quadruples: np.ndarray) -> np.ndarray:
    """Eq. 41 at rows (light, view, light, view) int[P, 4], complex128[P]; every type of particle with its share."""
    medium = scene.medium
    assert isinstance(medium, Box)
    dimensions: Dimensions = 2 if scene.dimension == 2 else 3
    i1, v1, i2, v2 = quadruples.T
    total = np.zeros(len(quadruples), np.complex128)
    for particle, share in medium.scatterer.components:
        total += share * box_covariance(
            medium.lower, medium.upper, extinction=medium.extinction, albedo=medium.albedo,
            wavelength=scene.wavelength, amplitude=lambda cos, s=particle: s.amplitude(cos, dimensions),
            lights=(scene.lights[i1], scene.lights[i2]), views=(scene.views[v1], scene.views[v2]),
        )  # fmt: skip
    return total


def all_quadruples(t: int, v: int) -> np.ndarray:
    """Every (light, view, light, view), int[(t v)^2, 4] in C order."""
    return np.stack(np.meshgrid(*(np.arange(n) for n in (t, v, t, v)), indexing="ij"), axis=-1).reshape(-1, 4)
