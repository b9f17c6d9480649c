"""The mean field that a finite medium scatters to the far field: physics.md 3, [Bar19] Eq. 48.

    m = P (k / 2 pi)^((d-1)/2) int (sigma_t / 2) f(i . v) b(x) e^(ik(i - v).x) tau(x, v) dx,    f = s(i . v) / s(1)

with one attenuation factor, from x to the surface along v. It is ``N sqrt(c_s) s`` of docs/physics.md by the optical
theorem, which fixes ``N sqrt(c_s) s(1) = P (k / 2 pi)^((d-1)/2) sigma_t / 2`` whatever the albedo: the wave scattered
forward is the shadow. Behind a face A at v = i the modulus is ``(k / 2 pi)^((d-1)/2) A (1 - e^(-OD/2))``. The phase P,
i in space and ``e^(3 i pi / 4)`` in flatland, is that of Kirchhoff's far field of an aperture that takes
``e^(-OD/2) - 1`` times the wave. Mixtures have the mean of their types' f; b is a beam's profile on its ray, per area
of the entrance face. Of polarised light f is what the analyser passes of s times the Jones matrix of one scattering,
which forward is 1.
"""

from itertools import count
from typing import NoReturn

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks
from specklegen.kernels import mean_integrals
from specklegen.mean.quadrature import Nodes, beam_nodes
from specklegen.paths.jones import Analysed, require_ends
from specklegen.paths.volumes import materials, spatial, volume_of
from specklegen.scene.scatterers import Scatterer
from specklegen.scene.scene import Scene

TOLERANCE = 1e-3  # of a numerical integral, relative to what it would be if all the medium scattered in phase
_VIEWS_AT_ONCE = 32


def scattered_mean(scene: Scene, most_nodes: float) -> np.ndarray:
    """complex128[T, V]: to rounding for plane waves on a box, else within ``TOLERANCE``."""
    lights, views = scene.lights, scene.views
    if not len(lights) or not len(views):
        return np.zeros((len(lights), len(views)), np.complex128)
    turned = 1j if scene.dimension == 3 else np.exp(0.75j * np.pi)
    scale = turned / scene.wavelength ** ((scene.dimension - 1) / 2)
    shapes = np.stack([forward_ratio(s, lights @ views.T, scene.dimension) for s in materials(scene.volume)])
    if scene.polarisers is not None:
        ends = require_ends(scene.volume)
        shapes *= np.stack([Analysed(ends, *scene.polarisers.fields).single(lights, views, kind=n)
                            for n in range(len(shapes))])  # fmt: skip
    if scene.medium.homogeneous and not scene.illumination.limited:
        return scale * shapes[0] * _box(scene, most_nodes)
    rows = []
    for t, light in enumerate(lights):
        row = _integral(scene, light, shapes[:, t], most_nodes / len(lights))
        if row is None:
            _refuse(most_nodes, f"one not known within {TOLERANCE:g} by then")
        rows.append(scale * row)
    return np.stack(rows)


def forward_ratio(scatterer: Scatterer, cosines: np.ndarray, dimension: int) -> np.ndarray:
    """s(cos) / s(1), of the shape of ``cosines``; the mean over a mixture's types."""
    ratio = np.zeros(np.shape(cosines), np.complex128)
    space = 3 if dimension == 3 else 2
    for particle, share in scatterer.components:
        forward = np.asarray(particle.amplitude(1.0, space)).item()
        if forward == 0:
            reject(
                "mean_field scatterer's amplitude", "other than 0 forward", f"{particle.type} with s(1) = 0",
                "By the optical theorem such a particle does not attenuate a wave, so the mean field is undefined.",
            )  # fmt: skip
        ratio += share * particle.amplitude(cosines, space) / forward
    return ratio


def _box(scene: Scene, most_nodes: float) -> np.ndarray:
    """complex128[T, V], the integral over a homogeneous box of a plane wave."""
    box = scene.volume
    sides, center = box.upper - box.lower, (box.upper + box.lower) / 2
    geometry = (sides, scene.lights, scene.views, scene.wavelength, box.extinction / 2)
    nodes = mean_integrals.overlap_panels(*geometry) * mean_integrals.NODES
    if nodes > most_nodes:
        _refuse(most_nodes, f"{nodes:.2g}")
    out = np.empty((len(scene.lights), len(scene.views)), np.complex128)

    def part(start: int) -> None:
        views = slice(start, start + _VIEWS_AT_ONCE)
        some = np.empty_like(out[:, views])
        mean_integrals.overlap(sides, scene.lights, scene.views[views], scene.wavelength, box.extinction / 2, some)
        out[:, views] = some

    map_blocks(part, range(0, len(scene.views), _VIEWS_AT_ONCE))
    turns = ((scene.lights @ center)[:, None] - scene.views @ center) / scene.wavelength
    return out * np.exp(2j * np.pi * (turns - np.rint(turns)))


def _integral(scene: Scene, light: np.ndarray, shapes: np.ndarray, most_nodes: float) -> np.ndarray | None:
    """complex128[V], the integral for one light, its panels doubled along each axis until it stands still.

    None where that would take more than ``most_nodes``.
    """
    spent, before = 0.0, None
    for level in count():
        nodes = beam_nodes(scene, light, level, (most_nodes - spent) / len(scene.views))
        if nodes is None:
            return None
        spent += len(nodes.points) * len(scene.views)
        value, bound = _sum(scene, light, nodes, shapes)
        if before is not None and (np.abs(value - before) <= TOLERANCE * bound).all():
            return value
        before = value


def _sum(scene: Scene, light: np.ndarray, nodes: Nodes, shapes: np.ndarray) -> tuple[np.ndarray, float]:
    """(complex128[V], the largest sum of moduli at any view)."""
    volume, views = volume_of(scene.volume, scene.dimension), spatial(scene.views)
    out, bound = np.empty(len(views), np.complex128), np.empty(len(views))

    def part(start: int) -> None:
        some = slice(start, start + _VIEWS_AT_ONCE)
        mean_integrals.scattered(
            volume, nodes.points, nodes.weights, nodes.kinds, spatial(light), views[some], scene.wavelength,
            np.ascontiguousarray(shapes[:, some]), out[some], bound[some],
        )  # fmt: skip

    map_blocks(part, range(0, len(views), _VIEWS_AT_ONCE))
    return out, float(bound.max())


def _refuse(most: float, got: str) -> NoReturn:
    reject("mean_field", f"an integral of at most {most:.2g} nodes over the lights and views asked for", got,
           "Use fewer views or lights, views nearer to the light, or a smaller medium.")  # fmt: skip
