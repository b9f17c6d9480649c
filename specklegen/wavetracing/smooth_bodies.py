"""Smooth bodies of a scene: which sides of triangles stand for a curved surface, and its curvature there.

The flat parts beside a smooth side meet at less than `SMOOTH`, and at less than half the angle over which a shadow
begins. At least one of them is so narrow that it differs from the curved surface by less than `_SAGITTA`. Only convex
sides of closed surfaces are smooth. The second fundamental form of a flat part is a sum over its sides, of angles
between normals times lengths over twice the area; it is averaged over faces that share a corner.

Source: D. Cohen-Steiner, J.-M. Morvan, *Restricted Delaunay triangulations and normal cycle*, SoCG 2003.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from specklegen.wavetracing.edges import normals
from specklegen.wavetracing.fock import LOWEST, MIDDLE, STEP, fock_tables
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels.creeping import Bodies

SMOOTH = np.deg2rad(12.0)
"""Angle between the normals of two faces from which on they are not one smooth surface."""
_BENT = 1e-5  # radians below which two faces are a plane
_SAGITTA = 0.25  # of 1 / k: how far a face may lie from the curved surface that it stands for


class SmoothParts(NamedTuple):
    """Smooth bodies; bool[F] of faces that are curved, and bool[3 F] of sides that are smooth."""

    bodies: Bodies
    faces: np.ndarray
    sides: np.ndarray


def smooth_parts(scene: Geometry, k: float) -> SmoothParts:
    """Find the smooth bodies of a scene at a wavenumber."""
    topology, solid, faces = scene.topology, scene.solids.solid[np.argsort(scene.order)], scene.faces
    corners = scene.vertices[faces]
    side = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(side, axis=2)
    normal = normals(scene.vertices, faces)
    flat, other = _flat_parts(topology.neighbour.reshape(-1, 3), topology.interior.reshape(-1, 3))
    area = np.maximum(np.bincount(flat, np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1) / 2), 1e-300)[flat]
    across = np.cross(side / np.maximum(length, 1e-300)[..., None], normal[:, None])  # out of the face, in its plane
    turn = np.where(topology.neighbour < 0, np.pi, np.pi - topology.interior).reshape(-1, 3)
    bends = (solid >= 0)[:, None] & (turn > _BENT) & (turn < SMOOTH)
    share = np.where(bends, turn * length, 0.0) / (2 * area)[:, None]
    count = int(flat.max(initial=-1)) + 1
    form = np.zeros((count, 3, 3))
    np.add.at(form, flat, np.einsum("fi,fia,fib->fab", share, across, across))
    # Breadth along the strongest curvature, and how far the flat part is from an arc of it.
    strongest = np.linalg.eigh(form)
    along = (corners * strongest.eigenvectors[flat][:, None, :, 2]).sum(axis=2)
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, flat, along.min(axis=1))
    np.maximum.at(most, flat, along.max(axis=1))
    curved = k * (most - least) ** 2 * strongest.eigenvalues[:, 2] / 8 < _SAGITTA
    curved = (curved & (np.bincount(flat, bends.any(axis=1), count) > 0))[flat]
    form = _averaged(form[flat], scene.welded[faces], area, curved)
    either = np.where(curved[:, None, None, None], form[:, None], form[other])
    either = np.where((curved[:, None] & curved[other])[..., None, None], (form[:, None] + form[other]) / 2, either)
    radius = 1 / np.maximum(np.einsum("fiab,fia,fib->fi", either, across, across), 1e-300)
    smooth = bends & (curved[:, None] | curved[other]) & (turn < 0.5 * (k * radius / 2) ** (-1 / 3))
    curved &= (np.bincount(flat, (smooth != bends).any(axis=1), count) == 0)[flat]
    smooth &= curved[:, None] | curved[other]
    return SmoothParts(_laid_out(scene, solid, turn, smooth, either, normal), curved, smooth.ravel())


def _flat_parts(neighbour: np.ndarray, interior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of the flat part that each face belongs to, int[F], and each side's neighbour, 0 at a border.

    A facet that is cut in triangles is one part, so that the cut changes no curvature.
    """
    other = np.where(neighbour < 0, 0, neighbour)
    own, at = np.nonzero((neighbour >= 0) & (np.abs(interior - np.pi) <= _BENT))
    graph = coo_array((np.ones(len(own)), (own, other[own, at])), shape=(len(neighbour), len(neighbour)))
    return connected_components(graph, directed=False)[1] if len(neighbour) else np.empty(0, np.int64), other


def _averaged(form: np.ndarray, corner: np.ndarray, area: np.ndarray, curved: np.ndarray) -> np.ndarray:
    """Mean float64[F, 3, 3] of the forms of curved faces around the corners of each."""
    weight = np.where(curved, area, 0.0)
    count = int(corner.max(initial=0)) + 1
    total, sums = np.zeros(count), np.zeros((count, 3, 3))
    for i in range(3):
        np.add.at(total, corner[:, i], weight)
        np.add.at(sums, corner[:, i], weight[:, None, None] * form)
    return (sums / np.maximum(total, 1e-300)[:, None, None])[corner].mean(axis=1)


def _laid_out(scene, solid, turn, smooth, form, normal) -> Bodies:
    """Arrays of all solids with smooth sides."""
    place = np.argsort(scene.order)
    neighbour = scene.topology.neighbour.reshape(-1, 3)
    starts, balls, rows = [np.zeros(3, np.int64)], [], []
    for body in np.unique(solid[smooth.any(axis=1)]):
        own = np.flatnonzero(solid == body)
        corners = np.unique(scene.faces[own])
        number = np.zeros(len(scene.vertices), np.int64)
        number[corners] = np.arange(len(corners)) + starts[-1][0]
        f, i = np.nonzero((turn[own] > _BENT) & ((neighbour[own] < 0) | (neighbour[own] > own[:, None])))
        f = own[f]
        points = scene.vertices[corners]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        balls.append([*middle, np.linalg.norm(points - middle, axis=1).max()])
        ends = number[np.stack([scene.faces[f, i], scene.faces[f, (i + 1) % 3]], axis=1)]
        outward = normal[f] + np.where((neighbour[f, i] >= 0)[:, None], normal[neighbour[f, i]], 0.0)
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
        rows.append((points, number[scene.faces[own]], ends, smooth[f, i], form[f, i], outward, place[f]))
        starts.append(starts[-1] + [len(points), len(own), len(f)])
    empty = (
        np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty((0, 2), np.int64), np.empty(0, bool),
        np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0, np.int64),
    )  # fmt: skip
    vertices, faces, sides, flags, forms, outward, places = (
        np.concatenate(parts) for parts in zip(empty, *rows, strict=True)
    )
    upper = np.triu_indices(3)
    principal = np.linalg.eigvalsh(forms)
    near, far = fock_tables() if rows else (np.empty((0, 6), complex), np.empty((0, 4)))
    return Bodies(
        np.array(starts), np.array(balls).reshape(-1, 4), vertices, faces, sides, flags,
        np.column_stack([forms[:, *upper], principal[:, 1] * principal[:, 2]]), outward, places, near, far,
        np.array([STEP, LOWEST, MIDDLE]),
    )  # fmt: skip
