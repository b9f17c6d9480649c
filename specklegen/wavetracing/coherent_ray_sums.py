"""Fields by rays with phases: images in plane facets, and edges by the uniform theory of diffraction.

All paths from a point source to given points are found, none is sampled: up to R reflections, and up to two edges,

    u = sum over paths of a e^{ik |path|},   |u|^2 the power flux,

a = sqrt(P / 4 pi) / |path| for images, times -1 for each reflection if soft (u = 0 there), +1 if hard (du/dn = 0).
A path by an edge carries u_i(Q) D A e^{iks}, with reflections before and behind; one by two edges, perhaps with
reflections in between, D of `specklegen.wavetracing.double_edges`, uniform where both edges are nearly in line. A wave
of radius r in the plane of ray and edge spreads behind it as A = sqrt(r / (s (r + s))); at a first edge r is s', at a
second one 1/r = cos^2 psi / (s' + s) + sin^2 psi / s, psi between the edges across the ray. Paths are reciprocal.

Surfaces are perfect, or of their material: reflection by Fresnel's coefficients, TE for "soft" and TM for "hard", and
the images' parts of D multiplied by those of the faces, as `lossy_wedge_field` has it. Black and diffuse surfaces have
no images; nothing goes through walls.

Sources: J. B. Keller, J. Opt. Soc. Am. 52, 116 (1962); R. G. Kouyoumjian, P. H. Pathak, Proc. IEEE 62, 1448 (1974);
S. Steinberg, M. Pharr, *Wave Tracing*, section on bilinear path tracing. Left out: corners. Light is there or not by
ray queries, but within 1e-12 rad of a boundary of light and shadow by the angles that the edge's coefficient sees, so
that nothing is lost or doubled there. Light by two edges may see either side of such a boundary.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, instance, real_array, whole_number
from specklegen.core.errors import reject, warn_user
from specklegen.wavetracing.double_edges import Bend, double_diffraction
from specklegen.wavetracing.edges import normals
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.facets import facets_of
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.wedges import wedge_terms
from specklegen.wavetracing.materials import CONDUCTOR, reflected
from specklegen.wavetracing.wedge import NEAREST, geometric_shares

_CLEAR = 1e-7  # of a leg's length or, if less, of the scene's size: nothing blocks it so near to its ends
_ROUNDED = 1e-6  # of the whole length from source to points: what is less counts as this much, for rounding's sake
_ON_FACE = 1e-9  # radians
_ALONG = 1e-7  # radians from a face, within which a leg from edge to edge runs along it
_RAISED = 4e-7  # of the scene's size, above _CLEAR: how far a point on a surface is taken off it to see what it sees
_ROUNDING = 1e-12  # radians from a boundary at which its angle, not a query of the ray, says what is seen
_ON_SURFACE = 1e-8  # of the scene's size, within which a point lies on a surface
_MOST = 50_000  # combinations of facets and edges
_ROUNDS = 60  # of unfolding at one edge, then the other
_STILL = 1e-14  # of an edge's length: a step of that unfolding that is none


@dataclass(frozen=True)
class _Mirrors:
    """Plane facets of a scene as mirrors."""

    scene: Geometry
    normal: np.ndarray  # float64[F, 3]
    point: np.ndarray  # float64[F, 3]
    facet: np.ndarray  # int32[faces], of each face by its number
    size: float  # of the scene, not of the way that light comes from
    rows: np.ndarray  # float64[F, 4], what kernels know of the material of each
    mesh: np.ndarray  # int32[F]
    hard: bool

    def sequences(self, most: int) -> Iterator[tuple[int, ...]]:
        """All sequences of up to ``most`` facets without one twice in turn."""
        for length in range(most + 1):
            for sequence in product(range(len(self.normal)), repeat=length):
                if all(a != b for a, b in zip(sequence, sequence[1:], strict=False)):
                    yield sequence

    def images(self, point: np.ndarray, sequence: tuple[int, ...]) -> list[np.ndarray]:
        """The point and its images in the facets in turn; float64[..., 3] each."""
        images = [point]
        for f in sequence:
            last = images[-1]
            images.append(last - 2 * ((last - self.point[f]) @ self.normal[f])[..., None] * self.normal[f])
        return images

    def turned(self, direction: np.ndarray, sequence: tuple[int, ...]) -> np.ndarray:
        """Directions float64[..., 3] behind reflection in the facets in turn."""
        for f in sequence:
            direction = direction - 2 * (direction @ self.normal[f])[..., None] * self.normal[f]
        return direction

    def reflected(self, facet: int, cosine: np.ndarray) -> np.ndarray:
        """Coefficients complex128[P] of reflection at a facet, at cosines float64[P] of incidence."""
        return reflected(self.rows[facet], cosine)[int(self.hard)]

    def along(self, start: np.ndarray, end: np.ndarray, sequence: tuple[int, ...]) -> np.ndarray:
        """Coefficients complex128[P] of all reflections from ``start`` to ``end`` at the facets in turn."""
        ray, coefficients = end - self.images(start, sequence)[-1], np.ones(len(end), complex)
        if sequence:
            ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        for f in sequence[::-1]:
            across = ray @ self.normal[f]
            coefficients *= self.reflected(f, np.abs(across))
            ray = ray - 2 * across[:, None] * self.normal[f]
        return coefficients

    def clear(self, start: np.ndarray, end: np.ndarray, sequence: tuple[int, ...]) -> np.ndarray:
        """Whether light from ``start`` gets to ``end``, float64[P, 3] each, by reflection in the facets in turn."""
        images = self.images(start, sequence)
        good, here = np.ones(len(end), bool), end
        for f, image, before in zip(sequence[::-1], images[:0:-1], images[-2::-1], strict=True):
            step = image - here
            rate = step @ self.normal[f]
            t = np.divide((self.point[f] - here) @ self.normal[f], rate, out=np.full(len(here), -1.0), where=rate != 0)
            ends = self._share(step)
            good &= (t > ends) & (t < 1 - ends)
            there = here + np.where(good, t, 0.5)[:, None] * step
            good &= self._hits(here, there - here, f)
            # The other end must lie on the side that the light came to.
            good &= ((here - self.point[f]) @ self.normal[f]) * ((before - self.point[f]) @ self.normal[f]) > 0
            here = there
        return good & self._free(here, start - here)

    def _hits(self, origin: np.ndarray, step: np.ndarray, facet: int) -> np.ndarray:
        """Whether the first thing beyond the start is a facet, at the end of the step."""
        distance, face = self._nearest(origin, step)
        met = np.where(face >= 0, self.facet[face] if len(self.facet) else -1, -1)
        return (met == facet) & (np.abs(distance - 1) < self._share(step))

    def _free(self, origin: np.ndarray, step: np.ndarray) -> np.ndarray:
        distance, _ = self._nearest(origin, step)
        return distance > 1 - self._share(step)

    def _share(self, step: np.ndarray) -> np.ndarray:
        """Share of each leg in which nothing blocks it: a source far away makes no surface transparent."""
        return _CLEAR * np.minimum(1, self.size / np.maximum(np.linalg.norm(step, axis=1), 1e-300))

    def _nearest(self, origin: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        safe = np.where((step != 0).any(axis=1)[:, None], step, 1.0)
        ends = self._share(step)
        distance, face = self.scene.ray(origin + ends[:, None] * safe, safe, threads=1)
        return distance + ends, face

    def raised(self, points: np.ndarray, source: np.ndarray) -> np.ndarray:
        """Points float64[P, 3], those that lie on a facet a little off it, towards the side of the source."""
        out, size = points.copy(), self.size
        if not len(self.normal) or not len(points):
            return out
        for normal, at in zip(self.normal, self.point, strict=True):
            near = np.flatnonzero(np.abs((points - at) @ normal) <= _ON_SURFACE * size)
            side = 1.0 if (source - at) @ normal >= 0 else -1.0
            step = side * _RAISED * size * normal
            if len(near):
                distance, _ = self.scene.ray(points[near] + step, np.broadcast_to(-step, (len(near), 3)), threads=1)
                out[near[np.abs(distance - 1) < 0.1]] += step
        return out


def _mirrors(scene: Geometry, ends: np.ndarray, wavelength: float | None, hard: bool) -> _Mirrors:
    facets = facets_of(scene)
    of = np.full(int(scene.number.max(initial=-1)) + 1, -1, np.int32)
    of[scene.number[scene.order]] = facets.facet
    first = np.unique(facets.facet, return_index=True)[1]
    rows = np.full((len(facets.normals), 4), float(CONDUCTOR))
    if wavelength is not None and scene.meshes:
        rows = np.array([mesh.material.row(wavelength) for mesh in scene.meshes])[facets.material[first]]
    own, whole = (np.ptp(some, axis=0).max(initial=0.0) if len(some) else 0.0
                  for some in (scene.vertices, np.vstack([scene.vertices, ends])))  # fmt: skip
    size = max(float(own), _ROUNDED * float(whole))
    return _Mirrors(scene, facets.normals, scene.tree.corners[first, :3], of, size, rows, facets.material[first], hard)


@dataclass(frozen=True)
class _Edge:
    """An edge as UTD sees it: its line, its length, its wedge, and the 0-face's plane."""

    start: np.ndarray
    along: np.ndarray
    length: float
    n: float
    normal: np.ndarray
    inward: np.ndarray
    facets: frozenset[int]  # in whose planes it lies: none of them mirrors light that comes from it
    faces: tuple[int, int]  # facets of the 0-face and the n-face; one twice where it ends

    def leaves(self, facets: tuple[int, ...]) -> bool:
        """Whether light may run between the edge and each of the facets."""
        return self.facets.isdisjoint(facets)

    def crossing(self, source: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the shortest path by the edge's line meets it, float64[P, 3]; whether that is within the edge."""
        a, b = source - self.start, point - self.start
        ta, tb = a @ self.along, b @ self.along
        ra = np.linalg.norm(a - ta[..., None] * self.along, axis=-1)
        rb = np.linalg.norm(b - tb[..., None] * self.along, axis=-1)
        both = ra + rb
        t = ta + (tb - ta) * np.divide(ra, both, out=np.full(np.shape(both), 0.5), where=both > 0)
        return self.start + t[..., None] * self.along, (t > 0) & (t < self.length)

    def angle(self, direction: np.ndarray) -> np.ndarray:
        """Angles of directions float64[P, 3] from the edge, from the 0-face through the air."""
        phi = np.arctan2(direction @ self.normal, direction @ self.inward) % (2 * np.pi)
        top = self.n * np.pi
        # Rounding around the faces: those beyond are inside the wedge, and blocked anyway.
        return np.where(phi > top, np.where(phi - top < 2 * np.pi - phi, top, 0.0), phi)

    def in_air(self, direction: np.ndarray) -> np.ndarray:
        """Whether directions float64[P, 3] lead from the edge into the air, or along a face; not into its wedge."""
        phi = np.arctan2(direction @ self.normal, direction @ self.inward) % (2 * np.pi)
        return (phi <= self.n * np.pi + _ON_FACE) | (phi >= 2 * np.pi - _ON_FACE)

    def boundaries(
        self, came: np.ndarray, goes: np.ndarray
    ) -> Iterator[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
        """Geometric waves that end here: the facets that mirror them, which directions are there, how much is seen."""
        phi, incidence, (zero, last) = self.angle(goes), self.angle(came), self.faces
        angles = np.abs(phi - incidence) - np.pi, phi + incidence - np.pi, phi + incidence - (2 * self.n - 1) * np.pi
        shares = geometric_shares(self.n, phi, incidence)
        for facets, angle, share in zip(((), (zero,), (last,)), angles, shares.T, strict=True):
            yield facets, np.abs(angle) <= _ROUNDING, share


def _edges(mirrors: _Mirrors) -> list[_Edge]:
    scene = mirrors.scene
    wedges, unit = scene.edges, normals(scene.vertices, scene.faces)
    edges = []
    for ends, (face, other), n in zip(wedges.ends, wedges.faces, wedges.wedge, strict=True):
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = (ends[1] - ends[0]) / length
        inward = scene.vertices[scene.faces[face]].mean(axis=0) - ends[0]
        inward = inward - (inward @ along) * along
        heights = np.abs(((ends[:, None] - mirrors.point) * mirrors.normal).sum(axis=2)).max(axis=0)
        facets = frozenset(np.flatnonzero(heights <= _CLEAR * length).tolist())
        zero, last = (int(mirrors.facet[scene.number[f]]) for f in (face, other if other >= 0 else face))
        edges.append(
            _Edge(ends[0], along, length, float(n), unit[face], inward / np.linalg.norm(inward), facets, (zero, last))
        )
    return edges


def coherent_rays(
    geometry: Geometry,
    source: PointEmitter,
    points: ArrayLike,
    reflections: int = 1,
    diffractions: int = 2,
    polarisation: Literal["soft", "hard"] = "soft",
    surfaces: Literal["perfect", "material"] = "perfect",
) -> np.ndarray:
    """Return the field of a point source at points, by all paths of a number of reflections and diffractions.

    Parameters
    ----------
    geometry
        The scene.
    source
        Its place, wavelength and power; the beam angle plays no part.
    points : float64[..., 3]
    reflections
        Most reflections on a path.
    diffractions
        Most edges on a path: 0, 1 or 2.
    polarisation
        "soft": u = 0 on perfect surfaces, TE on others; "hard": du/dn = 0, TM.
    surfaces
        "perfect": whatever their material; "material": by it, without what goes through walls.

    Returns
    -------
    complex128[...]
        |u|^2 is the power flux, P / 4 pi r^2 in free space.

    Raises
    ------
    RuleError
        For arguments out of range; points or a source nearer to an edge on a path than 1 / k, where there is no ray
        yet; more than 50000 combinations of facets and edges.

    A `DoubtWarning` says where edges are shorter than the Fresnel zone of the nearest point: corners matter there, from
    which there are no rays.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, perforated_screen, coherent_rays
    >>> mirror = perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], material=Conductor())
    >>> lamp = PointEmitter(position=[0, 0, 10], wavelength=1.0)
    >>> abs(coherent_rays(Geometry([mirror]), lamp, [[3.0, 0.0, 20.0]], diffractions=0)).round(5)
    array([0.03075])
    """
    name = "coherent_rays"
    points = real_array(f"{name} points", points)
    if points.ndim < 1 or points.shape[-1] != 3 or not np.isfinite(points).all():
        reject(f"{name} points", "finite, float64[..., 3]", points)
    parts = contributions(
        name, geometry, source, points.reshape(-1, 3), reflections, diffractions, polarisation, surfaces
    )
    u = np.zeros(points.size // 3, complex)
    for part in parts:
        u += part.field
    return u.reshape(points.shape[:-1])


class Contribution(NamedTuple):
    """What one sequence of facets and edges brings to points.

    Attributes
    ----------
    field, length : complex128[P], float64[P]
        u, 0 where there is no such path, and the length of the ray.
    towards, back : float64[P, 3]
        What the source, and the point, look at: images of what comes next, and before.
    met : tuple
        In order, ("reflection", mesh) and ("diffraction", edge).
    """

    field: np.ndarray
    length: np.ndarray
    towards: np.ndarray
    back: np.ndarray
    met: tuple[tuple[str, int], ...]


def contributions(
    name: str,
    geometry: Geometry,
    source: PointEmitter,
    flat: np.ndarray,
    reflections: int,
    diffractions: int,
    polarisation: str,
    surfaces: str,
) -> Iterator[Contribution]:
    """Yield the paths to points float64[P, 3]; arguments as of `coherent_rays`, for the function ``name``."""
    instance(f"{name} geometry", geometry, Geometry)
    if not isinstance(source, PointEmitter):
        reject(f"{name} source", "a PointEmitter", source)
    reflections = whole_number(f"{name} reflections", reflections, 0, 4)
    diffractions = whole_number(f"{name} diffractions", diffractions, 0, 2)
    choice(f"{name} polarisation", polarisation, ("soft", "hard"))
    choice(f"{name} surfaces", surfaces, ("perfect", "material"))
    ends = np.vstack([flat, source.position])
    mirrors = _mirrors(geometry, ends, source.wavelength if surfaces == "material" else None, polarisation == "hard")
    edges = _edges(mirrors) if diffractions else []
    facets = len(mirrors.normal)
    # Of r reflections, C(r + m, m) ways to fall before, between and behind m edges.
    count = sum(
        len(edges) ** m * sum(math.comb(r + m, m) * facets**r for r in range(reflections + 1))
        for m in range(diffractions + 1)
    )
    if count > _MOST:
        reject(
            f"{name} reflections, diffractions", f"few enough for {_MOST} combinations of facets and edges",
            count, "Ask for fewer, or use trace for such scenes.",
        )  # fmt: skip
    k = 2 * np.pi / source.wavelength
    _doubt_corners(edges, flat, source.wavelength)
    start = np.broadcast_to(source.position, flat.shape)
    if len(flat) and (k * np.linalg.norm(flat - start, axis=1)).min() < NEAREST:
        reject(
            f"{name} points", "1 / k away from the source at least",
            float(np.linalg.norm(flat - start, axis=1).min()), "Nearer by there is no power flux of a ray.",
        )  # fmt: skip
    seen_from = mirrors.raised(flat, source.position)
    sequences = list(mirrors.sequences(reflections))
    size = np.sqrt(source.power / (4 * np.pi))

    def found(u: np.ndarray, stations: list[np.ndarray], legs: list[tuple[int, ...]], bent: tuple[int, ...]):
        """A contribution by points in turn, float64[P, 3] each, with the facets of each leg between them."""
        back = mirrors.images(stations[-2], legs[-1])[-1]
        towards = mirrors.images(stations[1], legs[0][::-1])[-1]
        length, met = np.zeros(len(u)), []
        for n, leg in enumerate(legs):
            length += np.linalg.norm(mirrors.images(stations[n], leg)[-1] - stations[n + 1], axis=1)
            met += [("reflection", int(mirrors.mesh[f])) for f in leg]
            met += [("diffraction", edge) for edge in bent[n : n + 1]]
        return Contribution(size * u, length, towards, back, tuple(met))

    seen = {sequence: mirrors.clear(start, seen_from, sequence).astype(float) for sequence in sequences}
    for number, edge in enumerate(edges):
        for before in sequences:
            for behind in sequences:
                if len(before) + len(behind) <= reflections and edge.leaves(before[-1:] + behind[-1:]):
                    u, q = _by_edge(mirrors, edge, start, flat, seen_from, before, behind, k, seen)
                    if u.any():
                        yield found(u, [start, q, flat], [before, behind[::-1]], (number,))
    for sequence, share in seen.items():
        r, good = np.linalg.norm(mirrors.images(start, sequence)[-1] - flat, axis=1), share > 0
        u = np.zeros(len(flat), complex)
        u[good] = share[good] * mirrors.along(start[good], flat[good], sequence) * np.exp(1j * k * r[good]) / r[good]
        if u.any():
            yield found(u, [start, flat], [sequence], ())
    if diffractions == 2:
        for (n, one), (m, two) in product(enumerate(edges), repeat=2):
            for before, between, behind in product(sequences, repeat=3):
                count = len(before) + len(between) + len(behind)
                apart = one.leaves(before[-1:] + between[:1]) and two.leaves(between[-1:] + behind[-1:])
                if count <= reflections and apart and (one is not two or between):
                    u, p, q = _by_two(mirrors, one, two, start, flat, seen_from, before, between, behind, k)
                    if u.any():
                        yield found(u, [start, p, q, flat], [before, between, behind[::-1]], (n, m))


def _doubt_corners(edges: list[_Edge], points: np.ndarray, wavelength: float) -> None:
    """Warn of edges shorter than the Fresnel zone of the nearest of the points."""
    short = 0
    for edge in edges if len(points) else []:
        nearest = np.linalg.norm(points - edge.start - edge.length / 2 * edge.along, axis=1).min()
        short += bool(edge.length < 2 * np.sqrt(wavelength * nearest))
    if short:
        warn_user(
            f"{short} of {len(edges)} edges are shorter than the Fresnel zone of the nearest point: corners matter, "
            "from which coherent_rays has no rays; use field_on_plane for openings, or trace for power",
        )  # fmt: skip


def _bend(
    mirrors: _Mirrors, edge: _Edge, inner: np.ndarray, outer: np.ndarray, k: float, on_face: float | None = None
) -> Bend:
    """A ray's bend at an edge, from steps float64[P, 3] along both of its legs; the inner one's angle ``on_face``."""
    r = np.linalg.norm(inner, axis=1), np.linalg.norm(outer, axis=1)
    nearest = float(min(r[0].min(), r[1].min()))
    if k * nearest < NEAREST:
        reject(
            "coherent_rays points", "1 / k away from edges at least", nearest,
            "The theory describes a ray from the edge, and nearer by there is none.",
        )  # fmt: skip
    sine = np.sqrt(np.maximum(1 - ((inner @ edge.along) / r[0]) ** 2, 1e-24))
    phi, other = edge.angle(inner), edge.angle(outer)
    if on_face is not None:
        phi = np.full_like(phi, on_face)
    across = np.cos(phi)[:, None] * edge.normal - np.sin(phi)[:, None] * edge.inward
    first, last = np.minimum(phi, other), edge.n * np.pi - np.maximum(phi, other)
    images = [mirrors.reflected(f, np.abs(sine * np.sin(a))) for f, a in zip(edge.faces, (first, last), strict=True)]
    return Bend(edge.n, phi, other, across, sine, np.stack([np.ones_like(images[0]), *images], axis=1))


def _by_edge(mirrors, edge, start, end, seen_from, before, behind, k, seen) -> tuple[np.ndarray, np.ndarray]:
    """Field by one edge, with reflections before and behind it, and where; corrects what is ``seen`` of waves there."""
    source, point = mirrors.images(start, before)[-1], mirrors.images(end, behind)[-1]
    at, good = edge.crossing(source, point)
    q, towards = at, mirrors.images(seen_from, behind)[-1] - at  # off the surface that a point may lie on
    good &= edge.in_air(source - q) & edge.in_air(towards)
    for here, sequence in ((start, before), (seen_from, behind)):
        good[good] = mirrors.clear(here[good], q[good], sequence)
    u = np.zeros(len(end), complex)
    if good.any():
        back = mirrors.along(start[good], q[good], before) * mirrors.along(end[good], q[good], behind)
        q, source, point, towards = q[good], source[good], point[good], towards[good]
        r, s = np.linalg.norm(source - q, axis=1), np.linalg.norm(point - q, axis=1)
        bend, terms = _bend(mirrors, edge, towards, source - q, k), np.empty((len(q), 3), complex)
        wedge_terms(bend.n, bend.angle, bend.outer, s * r / (s + r) * bend.sine**2, k, terms)
        spread = np.exp(1j * k * (r + s)) / np.sqrt(r * s * (r + s))
        u[good] = back * (terms * bend.weights).sum(axis=1) / bend.sine * spread
        for facets, there, share in edge.boundaries(source - q, towards):
            sequence = (*before, *facets, *behind[::-1])
            if there.any() and sequence in seen:
                seen[sequence][np.flatnonzero(good)[there]] = share[there]
    return u, at


def _sides(edge: _Edge, step: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Faces of an edge's wedge that a leg along ``step`` float64[3] runs along: angle, and the way into the air."""
    sides, top = [], edge.n * np.pi
    across = step - (step @ edge.along) * edge.along
    across = across / max(float(np.linalg.norm(across)), 1e-300)
    for angle, turn in ((0.0, 1.0), (top, -1.0)):
        face = np.cos(angle) * edge.inward + np.sin(angle) * edge.normal
        if np.linalg.norm(across - face) < _ALONG:
            sides.append((angle, turn * (np.cos(angle) * edge.normal - np.sin(angle) * edge.inward)))
    return sides


def _by_two(
    mirrors, one, two, start, end, seen_from, before, between, behind, k
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Field by two edges in turn, with reflections before, between and behind them; and where on both."""
    source, point = mirrors.images(start, before)[-1], mirrors.images(end, behind)[-1]
    p, first = np.broadcast_to(one.start + one.length / 2 * one.along, end.shape), np.ones(len(end), bool)
    q, second = point, first
    for _ in range(_ROUNDS):
        before_p = p
        q, second = two.crossing(mirrors.images(p, between)[-1], point)
        p, first = one.crossing(source, mirrors.images(q, between[::-1])[-1])
        if np.abs(p - before_p).max() <= _STILL * one.length:
            break
    good = first & second & (np.linalg.norm(mirrors.images(p, between)[-1] - q, axis=1) * k > NEAREST)
    if between:  # along a face it meets a mirror at the rim of both: rounding decides, and an edge is there, no mirror
        for edge, image, at in ((one, mirrors.images(q, between[::-1]), p), (two, mirrors.images(p, between), q)):
            phi = edge.angle(image[-1] - at)
            good = good & (phi > _ON_FACE) & (phi < edge.n * np.pi - _ON_FACE)
    u = np.zeros(len(end), complex)
    # Light along a face is there on its every side in the air, half of it what the face reflects.
    faces: list[tuple[float | None, float | None, np.ndarray]] = [(None, None, np.zeros(3))]
    n = int(good.argmax())
    if not between and good.any() and one.facets & two.facets:
        step = q[n] - p[n]
        both = product(_sides(one, step), _sides(two, -step))
        faces = [(a, b, side) for (a, side), (b, other) in both if side @ other > 0.5] or faces
    for here, there, side in faces:
        raised = _RAISED * mirrors.size * side
        seen = good.copy()
        for a, b, sequence in ((start, p, before), (p + raised, q + raised, between), (seen_from, q, behind)):
            if seen.any():
                seen[seen] = mirrors.clear(a[seen], b[seen], sequence)
        ends = start, end, seen_from, p, q
        part = _double(mirrors, one, two, ends, seen, before, between, behind, k, here, there)
        u += part if here is None else part / 2
    return u, p, q


def _double(mirrors, one, two, ends, good, before, between, behind, k, here, there) -> np.ndarray:
    """Field by two edges of the ``good`` paths by p and q; ``here`` and ``there``, angles of a leg along a face."""
    start, end, seen_from, p, q = ends
    u = np.zeros(len(end), complex)
    source, point = mirrors.images(start, before)[-1], mirrors.images(end, behind)[-1]
    if good.any():
        towards = (mirrors.images(seen_from, behind)[-1] - q)[good]
        p, q, source, point = p[good], q[good], source[good], point[good]
        back = mirrors.along(start[good], p, before) * mirrors.along(p, q, between)
        back *= mirrors.along(end[good], q, behind)
        seen, ahead = mirrors.images(p, between)[-1], mirrors.images(q, between[::-1])[-1]
        r, s, t = (np.linalg.norm(step, axis=1) for step in (source - p, seen - q, point - q))
        first = _bend(mirrors, one, ahead - p, source - p, k, here)
        second = _bend(mirrors, two, seen - q, towards, k, there)
        first = first._replace(across=mirrors.turned(first.across, between))
        share = (first.across * second.across).sum(axis=1) ** 2
        within = 1 / (share / (r + s) + (1 - share) / s)
        spread = np.sqrt(within / (r * s * (r + s) * t * (within + t)))
        u[good] = back * double_diffraction(first, second, r, s, t, k) * spread * np.exp(1j * k * (r + s + t))
    return u
