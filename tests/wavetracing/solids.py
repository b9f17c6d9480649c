"""Meshes made by hand for the tests, and random ones."""

import numpy as np

from specklegen.wavetracing import Mesh


def box(size=(1.0, 1.0, 1.0), centre=(0.0, 0.0, 0.0), **options) -> Mesh:
    """A closed box, normals outwards."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = []
    for quad in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        faces += [(quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3])]
    return Mesh(corners * size + centre, np.array(faces), **options)


def sphere(subdivisions: int, radius=1.0, **options) -> Mesh:
    """A geodesic sphere of 8 * 4^n triangles."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    for _ in range(subdivisions):
        sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        unique, place = np.unique(sides[:, 0] * len(points) + sides[:, 1], return_inverse=True)
        middle = points[unique // len(points)] + points[unique % len(points)]
        ab, bc, ca = (len(points) + place).reshape(3, -1)
        points = np.concatenate([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = faces.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return Mesh(points * radius, faces, **options)


def soup(count: int, seed: int, size=0.1) -> Mesh:
    """Random triangles in the unit cube, of sizes over two decades."""
    rng = np.random.default_rng(seed)
    spread = size * 10 ** rng.uniform(-2, 0, (count, 1, 1))
    corners = rng.uniform(size=(count, 1, 3)) + spread * rng.normal(size=(count, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
