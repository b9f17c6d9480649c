"""Meshes: the user's own solids as hidden objects, seen from a random side (needs the extra ``mesh``).

Bodies are matt and white (Lambert), seen from infinitely far: the brightness of a pixel is the mean over it of |cos| of
the angle between the light and the surface, 0 in shadow. Light comes from where the body is looked at (`Meshes`), or
from a lamp aside (`LitMesh`). Lines of sight and shadows are rays of `specklegen.wavetracing`.
"""

import hashlib
import warnings
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.units import RADIAN
from specklegen.core.values import IDENTITY
from specklegen.datasets.distributions import Draw, Uniform, drawn, ends
from specklegen.datasets.objects.family import DrawnFamily, Source
from specklegen.datasets.objects.files import FileFamily

if TYPE_CHECKING:
    from specklegen.wavetracing import Geometry

_FINE = 4  # lines of sight along each side of a pixel
_TURNS = 100  # of a mesh, until a part that is seen is lit


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


class LitMesh(DrawnFamily):
    """Views of one mesh beside a lamp: each sample from another side, under light from another direction.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    scene
        The file (PLY, OBJ, STL, OFF, GLB). It counts by its content, not by its path.
    size
        Diameter of the smallest ball about the middle of the mesh's box that holds it, over the frame's shorter side.
    lamp
        Angle between the directions to the camera and to the lamp, which is infinitely far; from 0, the light of
        `Meshes`, to 5 pi / 6, against the light. Its direction about the line of sight is drawn evenly; where nothing
        seen is lit, side and light are drawn again.
    """

    type: Literal["LitMesh"] = "LitMesh"
    scene: str
    size: Annotated[float, Field(gt=0, le=1)] = 0.95
    lamp: Annotated[Draw, RADIAN] = Uniform(uniform=(0.0, 1.2))

    @model_validator(mode="after")
    def _check(self) -> Self:
        low, high = ends(self.lamp)
        if not 0 <= low <= high <= 5 * np.pi / 6:
            reject("LitMesh.lamp", "from 0 to 5 pi / 6 (radians)", self.lamp, "From behind, nothing seen is lit.")
        return self

    @cached_property
    def _content(self) -> str:
        if not Path(self.scene).expanduser().is_file():
            reject("LitMesh.scene", "an existing file", self.scene, "Check the path.", "objects.scene")
        return _digest(self.scene)

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Fields less the path, and the hash of the file instead."""
        return self.model_dump(mode="json", exclude={"scene"}, context=context) | {"mesh": self._content}

    def propose(self, rng: np.random.Generator) -> Source:
        """Draw a side and a direction of light, by a number that both follow from."""
        return (int(rng.integers(2**62)),)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """Lit mesh in the middle of the frame, float64[h, w]."""
        numbers, scene = np.random.default_rng(int(source[0])), _loaded(self.scene, self._content)
        view = np.zeros(self.shape)
        for _ in range(_TURNS):
            turn, angle, about = random_rotation(numbers), drawn(self.lamp, numbers), numbers.uniform(0, 2 * np.pi)
            lamp = np.array([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about), np.cos(angle)])
            if (view := lambert_view(scene, turn, self.shape, self.size, lamp)).any():
                break
        return view


def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).expanduser().read_bytes()).hexdigest()


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation float64[3, 3], every one as likely: that of a random unit quaternion (Shoemake, 1992)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def lambert_view(
    scene: "Geometry", rotation: np.ndarray, shape: tuple[int, int], size: float, lamp: np.ndarray | None = None
) -> np.ndarray:
    """Brightness float64[h, w], 0 to 1, of a turned scene seen along -z; the first row is at the top, largest y.

    lamp : unit vector float64[3] towards the light; by default the light comes from the camera
    """
    from specklegen.wavetracing.pictures import cosines, sights

    vertices = scene.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    rows, columns = (side * _FINE for side in shape)
    pitch = 2 * radius / (size * min(rows, columns))
    x = (np.arange(columns) - (columns - 1) / 2) * pitch
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch
    start = np.stack(np.broadcast_arrays(x, y[:, None], 2 * radius), axis=-1).reshape(-1, 3)
    sight = np.array([0.0, 0.0, -1.0]) @ rotation  # the scene stays, and who looks turns the other way
    seen, bright = sights(scene, start @ rotation + middle, sight, threads=1), np.zeros(rows * columns)
    if lamp is None:
        bright[seen.met] = -(seen.normals @ sight)
    else:
        towards = np.broadcast_to(4 * radius * (lamp @ rotation), seen.points.shape)
        bright[seen.met] = cosines(scene, seen, towards, threads=1)
    return bright.reshape(shape[0], _FINE, shape[1], _FINE).mean(axis=(1, 3))


@lru_cache(maxsize=64)
def _scene(meshes: Meshes, source: Source) -> "Geometry":
    return _loaded(*map(str, meshes.unchanged(source)))


@lru_cache(maxsize=64)
def _loaded(path: str, digest: str) -> "Geometry":
    """Read the mesh of a file of these contents."""
    from specklegen.wavetracing import Geometry, load_mesh

    if _digest(path) != digest:
        reject("mesh file", "unchanged since it was first read", path,
               "Restore the file, or generate the data set again in a new folder.")  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)  # slivers and duplicates do not matter to who looks
        return Geometry(load_mesh(Path(path).expanduser()))
