"""Layers whose refractive indices differ, and what goes straight through them and their echoes.

Light that is not scattered meets the faces j = 0 ... n of n layers with reflectances R_j, and passes layer k with
b_k = e^(-OD_k / mu_k). Its echoes add up as powers. What all that lies before layer k sends back to light on its way
up, at the layer's upper end; of light on its way down at its lower end what leaves by the far face:

    rho_0 = R_0,     rho_k = R_k + (1 - R_k)^2 b_(k-1)^2 rho_(k-1) / (1 - R_k b_(k-1)^2 rho_(k-1)),
    P_k (1 - R_(k+1) b_k^2 rho_k) = (1 - R_(k+1)) b_(k+1) P_(k+1),     b_n P_n = 1.

Of light on its way up, at the upper end of layer k, rho_k b_k P_k leaves there. Of one layer these are the sums of a
slab between its faces (:mod:`specklegen.mean.reflectance`). R is that of one polarisation, of which unpolarised light
has two, and the mean of both sums; mu_k follows from n_k sin theta_k, which all faces keep. Born and Wolf, *Principles
of Optics*, sec. 1.5 and 1.6.
"""

from typing import NamedTuple

import numpy as np

from specklegen.core.values import remembered
from specklegen.kernels.fresnel import reflectances
from specklegen.scene.layers import Layers, merged
from specklegen.scene.media import Medium, PlaneMedium, as_slab


class Optics(NamedTuple):
    """Layers as unscattered light meets them, alike ones as one.

    Attributes
    ----------
    indices, depths : float64[n]
        Refractive index and optical depth of each.
    edges : float64[n + 1]
        Depths of their faces, 0 first.
    walls : (float, float)
        Index of the wall over either outer face; of the layer behind it, where there is none.
    outside : float
    """

    indices: np.ndarray
    depths: np.ndarray
    edges: np.ndarray
    walls: tuple[float, float]
    outside: float


@remembered(16)
def optics(medium: PlaneMedium) -> Optics:
    """Lay out the layers of a medium, in the order of :func:`specklegen.paths.volumes.volume_of`."""
    layers, faces = merged(medium.layers), medium.faces
    indices = np.array([faces.inside if layer.index is None else layer.index for layer in layers])
    return Optics(
        indices, np.array([layer.optical_depth for layer in layers]),
        np.append(0.0, np.cumsum([layer.thickness for layer in layers])),
        (float(indices[0]), float(indices[-1])) if faces.wall is None else (faces.wall, faces.wall), faces.outside,
    )  # fmt: skip


def refracting_layers(medium: PlaneMedium) -> bool:
    """True if a medium has steps of the refractive index, and is no slab: only light that is not aimed knows them."""
    return medium.refracts and as_slab(medium) is None


def inside_share(medium: PlaneMedium) -> float:
    """Light per steradian in the index ``faces.inside`` over that per steradian outside, (n / n')^2."""
    return (medium.faces.inside / medium.faces.outside) ** 2


def without_steps(medium: PlaneMedium) -> Layers:
    """Layers of the same particles, and no step of the refractive index anywhere."""
    return Layers(layers=tuple(layer.replace(index=None) for layer in medium.layers))


class Straight(NamedTuple):
    """Optics of straight light through layers.

    Attributes
    ----------
    let_through : float64[n]
        Share of it that all faces let through at the first pass.
    depth : float64[n]
        Optical depth; infinite where a layer holds it back.
    slope : float64[n]
        How far it comes to one side, over its sine.
    """

    let_through: np.ndarray
    depth: np.ndarray
    slope: np.ndarray


def straight_light(medium: PlaneMedium, sines: np.ndarray) -> Straight:
    """Follow light of sines float64[n], in the index ``faces.inside``, straight through layers without an echo."""
    known, inside = optics(medium), medium.faces.inside
    own = np.multiply.outer(inside / known.indices, np.asarray(sines, np.float64))
    cosines = np.sqrt(np.maximum(1 - own**2, 0.0))
    left, reflected = np.ones((2, own.shape[1])), np.empty((2, own.shape[1]))
    for j in range(len(own) + 1):
        k, wall, beyond = _face(known, j)
        reflectances(cosines[k], known.indices[k], wall, beyond, reflected)
        left *= 1 - reflected
    crosses = (own < 1).all(axis=0)
    slant = np.where(crosses, cosines, 1.0)
    depth = np.where(crosses, (known.depths[:, None] / slant).sum(axis=0), np.inf)
    slope = ((np.diff(known.edges) * inside / known.indices)[:, None] / slant).sum(axis=0)
    return Straight(left.mean(axis=0), depth, slope)


def end_indices(medium: Medium) -> tuple[float, float]:
    """Refractive indices of the first and of the last layer."""
    indices = medium.indices or (medium.faces.inside,)
    return indices[0], indices[-1]


def unscattered(known: Optics, sine: float) -> tuple[float, float]:
    """Shares of light of a sine outside that layers throw back and let through unscattered, echoes included."""
    both, passed = _met(known, sine)
    back, through = 0.0, 0.0
    for steps in both:
        ahead, _ = _shares(steps, passed)
        sent_back = steps[-1]
        for r, b in zip(steps[-2::-1], passed[::-1], strict=True):
            sent_back = _behind(r, b * b * sent_back)
        back += float(sent_back) / 2
        through += float((1 - steps[0]) * passed[0] * ahead[0]) / 2
    return back, through


def crossed(known: Optics) -> tuple[np.ndarray, np.ndarray]:
    """P down and up the axis, float64[n] each, over the square of each layer's index beside that outside.

    Times what the first face lets in, so that paths that are in stand for light that comes from outside.
    """
    (steps, _), passed = _met(known, 0.0)
    down, sent_down = _shares(steps, passed)
    gain = (1 - steps[0]) * np.square(known.outside / known.indices) * down
    return gain, sent_down * passed * gain


def _met(known: Optics, sine: float) -> tuple[np.ndarray, np.ndarray]:
    """R_s and R_p float64[2, n + 1] at the faces, b float64[n] of layers, of light of a sine outside; b is 0 beyond."""
    sines = sine * known.outside / known.indices
    cosines = np.sqrt(np.maximum(1 - sines**2, 0.0))
    steps = np.empty((2, len(known.indices) + 1))
    for j in range(steps.shape[1]):
        k, wall, beyond = _face(known, j)
        reflectances(cosines[k : k + 1], known.indices[k], wall, beyond, steps[:, j : j + 1])
    with np.errstate(divide="ignore"):
        passed = np.where(sines < 1, np.exp(-known.depths / np.where(sines < 1, cosines, 1.0)), 0.0)
    return steps, passed


def _face(known: Optics, j: int) -> tuple[int, float, float]:
    """Layer from which the face j is met, and the indices of its wall and beyond.

    From the denser side or the other, R is the same; the outer faces are met from inside, with their walls.
    """
    last = len(known.indices)
    k = max(j - 1, 0)
    beyond = known.outside if j in (0, last) else known.indices[j]
    return k, known.walls[0] if j == 0 else known.walls[1] if j == last else known.indices[k], beyond


def _shares(steps: np.ndarray, passed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P down float64[n], and rho float64[n]."""
    n = len(passed)
    rho, down = np.empty(n), np.empty(n)
    rho[0] = steps[0]
    for k in range(1, n):
        rho[k] = _behind(steps[k], passed[k - 1] ** 2 * rho[k - 1])
    onward = 1.0
    for k in range(n - 1, -1, -1):
        let = (1 - steps[k + 1]) * onward
        down[k] = let / (1 - steps[k + 1] * passed[k] ** 2 * rho[k]) if let > 0 else 0.0
        onward = passed[k] * down[k]
    return down, rho


def _behind(r: float, echo: float) -> float:
    """Light that a face of reflectance r sends back, with the ``echo`` of all that lies behind it."""
    return r + ((1 - r) ** 2 * echo / (1 - r * echo) if r < 1 else 0.0)
