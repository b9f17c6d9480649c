"""Meshes: the user's own solids as hidden objects, seen from a random side (needs the extra ``mesh``).

A solid glows as a matt white body lit from where it is looked at: the brightness of a pixel is the mean over it of
|cos| of the angle between the line of sight and the surface (Lambert), seen from infinitely far. Lines of sight are the
rays of `specklegen.wavetracing.Geometry`.
"""

import warnings
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from specklegen.core.errors import DoubtWarning, reject
from specklegen.datasets.objects.family import Source
from specklegen.datasets.objects.files import FileFamily

if TYPE_CHECKING:
    from specklegen.wavetracing import Geometry

_FINE = 4  # lines of sight along each side of a pixel


class Meshes(FileFamily):
    """Meshes of a folder and its subfolders (PLY, OBJ, STL, OFF, GLB), each sample from another side.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    path
        The folder.
    size
        Diameter of the smallest ball about the middle of a mesh's box that holds it, over the frame's shorter side.
    """

    type: Literal["Meshes"] = "Meshes"
    size: Annotated[float, Field(gt=0, le=1)] = 0.95
    _suffixes: ClassVar[tuple[str, ...]] = (".glb", ".obj", ".off", ".ply", ".stl")
    _noun: ClassVar[str] = "mesh"
    _plural: ClassVar[str] = "meshes"

    def require_readable(self, path: Path) -> None:
        """Raise an error if a file holds no mesh, or one of no extent."""
        from specklegen.wavetracing import load_mesh

        mesh = load_mesh(path)
        if not np.ptp(mesh.vertices, axis=0).max() > 0:
            reject("mesh", "of some extent", float(np.ptp(mesh.vertices)))

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Mesh under a random rotation, every one as likely, in the middle of the frame; float64[h, w]."""
        return lambert_view(_scene(self, source), random_rotation(rng), self.shape, self.size)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation float64[3, 3], every one as likely: that of a random unit quaternion (Shoemake, 1992)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def lambert_view(scene: "Geometry", rotation: np.ndarray, shape: tuple[int, int], size: float) -> np.ndarray:
    """Brightness float64[h, w], 0 to 1, of a turned scene seen along -z; the first row is at the top, largest y."""
    vertices = scene.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    rows, columns = (side * _FINE for side in shape)
    pitch = 2 * radius / (size * min(rows, columns))
    x = (np.arange(columns) - (columns - 1) / 2) * pitch
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch
    start = np.stack(np.broadcast_arrays(x, y[:, None], 2 * radius), axis=-1)
    sight = np.array([0.0, 0.0, -1.0]) @ rotation  # the scene stays, and who looks turns the other way
    _, face = scene.ray(start @ rotation + middle, sight, threads=1)
    corners = vertices[scene.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    cosine = np.zeros(int(scene.number.max()) + 1)
    cosine[scene.number] = np.abs(normal @ sight) / np.where(length > 0, length, 1)
    bright = np.where(face >= 0, cosine[face], 0.0)
    return bright.reshape(shape[0], _FINE, shape[1], _FINE).mean(axis=(1, 3))


@lru_cache(maxsize=64)
def _scene(meshes: Meshes, source: Source) -> "Geometry":
    from specklegen.wavetracing import Geometry, load_mesh

    path, _ = meshes.unchanged(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)  # slivers and duplicates do not matter to who looks
        return Geometry(load_mesh(path))
