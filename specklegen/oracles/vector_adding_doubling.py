"""Transfer of polarised light through a plane slab by adding and doubling: exact, without a random number.

A layer is two operators on the Stokes vectors (I, Q, U, V) of all directions: what it sends back, what it sends on.
Around the axis of the slab they depend on differences of azimuths alone, so that each harmonic e^(im phi) is
transferred by itself; those of one layer so thin that light scatters in it at most once come from the phase matrix by
sums over azimuths. Two layers on top of each other are added as scalar ones are. Nodes of weight 0 are directions in
which light arrives or is seen, and into which it never scatters.

Stokes vectors belong to the frame (theta, phi) of their direction: Q is what lies along theta, in the plane of
direction and axis, minus what lies along phi; U what lies at 45 degrees between the two, minus the rest.

Sources: van de Hulst, *Multiple Light Scattering* (1980), ch. 15; de Haan, Bosma, Hovenier, Astron. Astrophys.
183, 371 (1987); for the frames Bohren and Huffman, *Absorption and Scattering of Light by Small Particles* (1983), ch.
3.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre

PhaseMatrix = Callable[[np.ndarray], np.ndarray]
"""F11, F12, F33, F34 of cosines of the scattering angle, float64[4, ...], in the frame of the scattering plane."""
THINNEST = 1e-8
"""Optical depth from which layers are doubled; a layer's double scattering is left out there."""


def rayleigh(cosine: np.ndarray) -> np.ndarray:
    """Phase matrix of small spheres, float64[4, ...], of mean 1 over the sphere."""
    squared = np.square(cosine)
    return np.array([0.75 * (1 + squared), -0.75 * (1 - squared), 1.5 * cosine, 0 * cosine])


def projected(lobe: Callable[[np.ndarray], np.ndarray]) -> PhaseMatrix:
    """Phase matrix of particles that scatter by a scalar phase function and project the field: S2 = cos(theta) S1.

    ``lobe`` gives F11 of mean 1 over the sphere; of ``3/4 (1 + cos^2)`` it makes :func:`rayleigh`.
    """

    def matrix(cosine: np.ndarray) -> np.ndarray:
        share, squared = lobe(cosine), np.square(cosine)
        return share * np.array([1 + 0 * cosine, (squared - 1) / (1 + squared), 2 * cosine / (1 + squared), 0 * cosine])

    return matrix


@dataclass(frozen=True)
class PolarisedLight:
    """Scattered light of a slab, for an irradiance of pi on planes across the incident beam.

    Attributes
    ----------
    transmitted, reflected : float64[views, azimuths, 4, 4]
        Matrices from the Stokes vector of the beam to that of the radiance behind and before the slab.
    """

    transmitted: np.ndarray
    reflected: np.ndarray


def vector_adding_doubling(
    optical_depth: float | Sequence[float], matrix: PhaseMatrix | Sequence[PhaseMatrix], *, albedo: float = 1.0,
    incidence: float = 1.0, views: Sequence[float] = (1.0,), azimuths: Sequence[float] = (0.0,), nodes: int = 16,
    orders: int = 3, index: float = 1.0,
) -> PolarisedLight:  # fmt: skip
    """Scattered light of a slab of particles that are spheres, or turned at random.

    Parameters
    ----------
    optical_depth, albedo
        Of the slab, or depths of several layers, the first one first.
    matrix
        Phase matrix of its particles, of mean 1 over the sphere; one for each of several layers.
    incidence, views
        Cosines, above 0, of the angles to the axis of the beam, which travels at azimuth 0, and of the views.
    azimuths
        Of the views, radians.
    nodes
        Gauss nodes of the cosine, from 0 to 1; between faces half of them beyond the critical angle.
    orders
        Harmonics of the azimuth, m = 0, ..., orders - 1: 3 are all of Rayleigh's; narrower phase functions have more.
        Light along the axis, seen along the axis, needs no more than 3.
    index
        Of refraction inside over outside, of both faces. Cosines are those inside, the light is that inside the slab
        before it leaves, times what the face lets through of it; echoes add up as intensities.
    """
    depths = np.atleast_1d(np.asarray(optical_depth, np.float64))
    matrices = [matrix] * len(depths) if callable(matrix) else [*matrix]
    if not ((depths > 0) & (depths < np.inf)).all() or not len(depths):
        reject("vector_adding_doubling optical_depth", "greater than 0 and finite", optical_depth)
    for cosine in (incidence, *views):
        if not 0 < cosine <= 1:
            reject("vector_adding_doubling cosines", "above 0 and at most 1", cosine)
    inside, share = _nodes(nodes, index)
    nodes = len(inside)
    mu = np.concatenate([inside, [incidence], views])
    weight = np.concatenate([2 * share * inside, np.zeros(1 + len(views))])  # 2 mu dmu over [0, 1]
    scattered = np.zeros((2, len(views), len(azimuths), 4, 4))
    mirrored, crossed = _face(mu, index)
    harmonics = [_harmonics(each, mu, orders) for each in matrices]
    for m in range(orders):
        each = [_layer(one[m], mu, np.repeat(weight, 4), depth, albedo)
                for one, depth in zip(harmonics, depths, strict=True)]  # fmt: skip
        layer = reduce(lambda above, below: _added(above, below, np.repeat(weight, 4)), each)
        through, back = layer[:2]
        if index != 1:
            through, back = _between_faces(layer, np.repeat(weight, 4), mirrored, crossed, nodes)
        phase = np.exp(1j * m * np.asarray(azimuths, np.float64)) * (1 if m == 0 else 2)  # -m is the conjugate of m
        for n, kernel in enumerate((through, back)):
            seen = kernel.reshape(len(mu), 4, len(mu), 4)[nodes + 1 :, :, nodes] * (_TURN[:, None] / _TURN)
            scattered[n] += (phase[:, None, None] * seen[:, None]).real
    return PolarisedLight(*(mu[nodes] * scattered))


_TURN = np.array([1, 1, 1j, 1j])
"""Harmonics of I and Q are those of cosines, of U and V those of sines, which are imaginary: times i all are real."""
_SPINS = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
"""Matrices of I, Q, U and V."""


def backscattering(
    optical_depth: float, matrix: PhaseMatrix, *, albedo: float = 1.0, nodes: int = 16
) -> tuple[np.ndarray, np.ndarray]:
    """Light sent straight back along the axis: the sum of intensities, and what interference adds to it.

    A path and its reverse have fields J e and J^T e, so that of the multiple scattering E[J_ac J_bd*] interference adds
    E[J_ac J_db*]: Mishchenko, J. Opt. Soc. Am. A 9, 978 (1992), sec. 3. Both are matrices float64[4, 4] between the
    Stokes vectors of fields along x and y, of light and view, as ``reflected`` is.
    """
    straight = vector_adding_doubling(optical_depth, matrix, albedo=albedo, nodes=nodes).reflected[0, 0]
    seen = np.diag([1.0, 1.0, -1.0, -1.0]) @ straight  # theta is -x there
    f11, _, f33, _ = matrix(np.array(-1.0))
    once = -albedo / 8 * np.expm1(-2 * optical_depth) * np.diag([f11, f11, -f33, -f33])
    products = np.einsum("ij,iab,jdc->abcd", seen - once, _SPINS, _SPINS) / 2
    added = np.einsum("iba,abcd,jcd->ij", _SPINS, products.transpose(0, 3, 2, 1), _SPINS) / 2
    return seen, added.real


def _nodes(nodes: int, index: float) -> tuple[np.ndarray, np.ndarray]:
    """Cosines from 0 to 1 and their weights; half of them beyond the angle from which a face sends all back."""
    edge = np.sqrt(max(1 - index**-2, 0.0)) if index > 1 else 0.0
    x, w = gauss_legendre(nodes // 2 if edge else nodes)
    parts = [(0.0, edge), (edge, 1.0)] if edge else [(0.0, 1.0)]
    ends = [(low + (high - low) * (1 + x) / 2, (high - low) * w / 2) for low, high in parts]
    return np.concatenate([each[0] for each in ends]), np.concatenate([each[1] for each in ends])


def _face(mu: np.ndarray, index: float) -> tuple[np.ndarray, np.ndarray]:
    """Reflection and transmission of a face for Stokes vectors from inside at n cosines, float64[4 n, 4 n].

    Born and Wolf, *Principles of Optics*, sec. 1.5, of fields along theta and phi: what is sent back is seen in the
    frame of its own direction, in which theta points the other way.
    """
    beyond = np.emath.sqrt(1 - (1 - mu**2) * index**2)
    across = (index * mu - beyond) / (index * mu + beyond)
    along = (mu - index * beyond) / (mu + index * beyond)
    out = np.zeros((2, 4 * len(mu), 4 * len(mu)))
    for n, (p, s) in enumerate(zip(along.astype(complex), across.astype(complex), strict=True)):
        lets = 0 if abs(s) > 1 - 1e-12 else 1
        through = [lets * np.sqrt(max(1 - abs(r) ** 2, 0.0)) for r in (p, s)]
        for into, one, two in ((out[0], p, s), (out[1], *through)):
            mean, less = (abs(one) ** 2 + abs(two) ** 2) / 2, (abs(one) ** 2 - abs(two) ** 2) / 2
            both = one * np.conj(two)
            into[4 * n : 4 * n + 4, 4 * n : 4 * n + 4] = [
                [mean, less, 0, 0], [less, mean, 0, 0], [0, 0, both.real, both.imag], [0, 0, -both.imag, both.real],
            ]  # fmt: skip
    return out[0], out[1]


def _between_faces(
    layer: "Layer", weight: np.ndarray, mirrored: np.ndarray, crossed: np.ndarray, beam: int
) -> tuple[np.ndarray, np.ndarray]:
    """Reflection and transmission of a layer between two faces, of light on the first at the node ``beam``."""
    on, back, on_up, back_up, straight = layer
    size, part = len(weight), slice(4 * beam, 4 * beam + 4)
    # Unscattered light at the upper face, downwards, and at the lower one, upwards.
    way, echo, one = straight[4 * beam], mirrored[part, part], np.eye(4)
    down = np.linalg.solve(one - echo @ echo * way**2, crossed[part, part])
    up = echo @ down * way
    lit_below, lit_above = on[:, part] @ down + back_up[:, part] @ up, back[:, part] @ down + on_up[:, part] @ up
    # Scattered light: what comes down to the lower face, and up to the upper one.
    way_on = np.diag(straight)
    lower = np.block([[on * weight + way_on, back_up * weight], [back * weight, on_up * weight + way_on]])
    turned = np.kron(np.array([[0, 1], [1, 0]]), mirrored)  # what was up goes down at the upper face
    source = np.concatenate([lit_below, lit_above])
    arriving = np.linalg.solve(np.eye(2 * size) - lower @ turned, source)
    leaving = np.zeros((2, size, size))
    leaving[0][:, part], leaving[1][:, part] = crossed @ arriving[:size], crossed @ arriving[size:]
    return leaving[0], leaving[1]


def _harmonics(matrix: PhaseMatrix, mu: np.ndarray, orders: int) -> np.ndarray:
    """Harmonics of the phase matrix, float64[orders, 4, n, 4, n, 4]: down to down, to up; up to down, to up.

    U and V are those times i, as ``_TURN`` has it.
    """
    count = 2 * 2 ** int(np.ceil(np.log2(4 * orders + 2 * len(mu))))  # of azimuths
    azimuth = 2 * np.pi * np.arange(count) / count
    harmonics = np.empty((orders, 4, len(mu), 4, len(mu), 4), complex)
    for n, (arriving, leaving) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        for j, cosine in enumerate(mu):
            turned = _turned(matrix, arriving * cosine, leaving * mu[:, None], azimuth)  # [n, azimuths, 4, 4]
            harmonics[:, n, :, :, j] = np.moveaxis(np.fft.fft(turned, axis=1)[:, :orders], 1, 0) / count
    return (harmonics * _TURN / _TURN[:, None, None]).real


def _frame(cosine: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direction, and unit vectors along theta and phi there, float64[..., 3]."""
    cosine, azimuth = np.broadcast_arrays(cosine, azimuth)
    sine, zero = np.sqrt(np.maximum(1 - np.square(cosine), 0)), np.zeros(cosine.shape)
    east, north = np.cos(azimuth), np.sin(azimuth)
    along = (sine * east, sine * north, cosine), (cosine * east, cosine * north, -sine), (-north, east, zero)
    direction, theta, phi = (np.stack(parts, axis=-1) for parts in along)
    return direction, theta, phi


def _turned(matrix: PhaseMatrix, arriving: float, leaving: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Phase matrix float64[..., 4, 4] between the frames of two directions, the first at azimuth 0."""
    before, theta, phi = _frame(np.asarray(arriving), np.asarray(0.0))
    after, theta_after, phi_after = _frame(leaving, azimuth)
    cosine = np.clip(after @ before, -1, 1)
    plane = after - cosine[..., None] * before  # across the incident light, in the scattering plane
    length = np.linalg.norm(plane, axis=-1, keepdims=True)
    plane = np.where(length > 1e-9, plane / np.maximum(length, 1e-300), theta)  # straight on and back: any plane
    normal = np.cross(before, plane)
    f11, f12, f33, f34 = matrix(cosine)
    phase = np.zeros((*cosine.shape, 4, 4))
    phase[..., 0, 0] = phase[..., 1, 1] = f11
    phase[..., 0, 1] = phase[..., 1, 0] = f12
    phase[..., 2, 2] = phase[..., 3, 3] = f33
    phase[..., 2, 3], phase[..., 3, 2] = f34, -f34
    into = _rotation((plane * theta).sum(-1), (plane * phi).sum(-1))
    plane = np.cross(normal, after)
    outof = _rotation((plane * theta_after).sum(-1), (plane * phi_after).sum(-1))
    return np.swapaxes(outof, -1, -2) @ phase @ into


def _rotation(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Stokes vectors of a frame turned by an angle, float64[..., 4, 4]."""
    rotation = np.zeros((*np.shape(cosine), 4, 4))
    rotation[..., 0, 0] = rotation[..., 3, 3] = 1
    rotation[..., 1, 1] = rotation[..., 2, 2] = np.square(cosine) - np.square(sine)
    rotation[..., 1, 2] = 2 * sine * cosine
    rotation[..., 2, 1] = -rotation[..., 1, 2]
    return rotation


Layer = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Sent on and back of light from above, the same of light from below, and what goes straight on."""


def _layer(harmonic: np.ndarray, mu: np.ndarray, weight: np.ndarray, depth: float, albedo: float) -> Layer:
    """One harmonic of a layer, by doubling."""
    doublings = int(np.ceil(np.log2(max(depth / THINNEST, 1.0))))
    thin, size = depth / 2**doublings, 4 * len(mu)
    out, into = mu[:, None], mu[None]
    both = -np.expm1(-thin * (1 / out + 1 / into)) / (out + into)
    middle = thin * (1 / out + 1 / into) / 2  # (e^(-d/a) - e^(-d/b)) / (a - b), which is d / a^2 e^(-d/a) for a = b
    half = thin * (1 / into - 1 / out) / 2
    ratio = np.divide(np.sinh(half), half, out=np.ones_like(half), where=half != 0)
    along = np.exp(-middle) * thin / (out * into) * ratio
    down, up, fall, rise = (albedo / 4 * each for each in harmonic)
    on, back = along[:, None, :, None], both[:, None, :, None]
    kernels = [(k * share).reshape(size, size) for k, share in ((down, on), (up, back), (rise, on), (fall, back))]
    straight = np.repeat(np.exp(-thin / mu), 4)
    layer = (*kernels, straight)
    for _ in range(doublings):
        layer = _added(layer, layer, weight)
    return layer


def _added(top: Layer, below: Layer, weight: np.ndarray) -> Layer:
    """One layer on top of another."""
    on, back, on_up, back_up, straight = top
    onward, returned, onward_up, returned_up, further = below

    def sent(first: tuple[np.ndarray, ...], second: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
        (on, back, inside, way), (onward, returned, out, further) = first, second
        twice = (inside * weight) @ returned  # down again after two reflections between the layers
        again = np.linalg.solve(np.eye(len(weight)) - twice * weight, twice)
        down = on + (again * weight) @ on + again * way
        up = (returned * weight) @ down + returned * way
        return (
            (onward * weight) @ down + onward * way + further[:, None] * down,
            back + (out * weight) @ up + way[:, None] * up,
        )

    through = sent((on, back, back_up, straight), (onward, returned, on_up, further))
    upward = sent((onward_up, returned_up, returned, further), (on_up, back_up, onward, straight))
    return (*through, *upward, straight * further)
