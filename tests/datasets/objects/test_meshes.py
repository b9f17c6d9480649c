"""Solids as hidden objects: their brightness from any side, their files, and a stream that shows them."""

import numpy as np
import pytest
import trimesh
from refusals import assert_refused
from wavetracing.solids import box, sphere
from zscore import assert_z, refute_z

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.objects import Folder, LitMesh, Meshes
from specklegen.datasets.objects.meshes import lambert_view, random_rotation
from specklegen.wavetracing import Geometry, Mesh


def save(mesh, path):
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(str(path))


@pytest.fixture
def solids(tmp_path):
    for n, mesh in enumerate((box((2, 1, 1)), sphere(2), box((1, 1, 3)), box((1, 2, 3)))):
        save(mesh, tmp_path / f"{n}.{('ply', 'stl', 'obj', 'off')[n]}")
    return tmp_path


def test_a_sphere_is_bright_in_the_middle():
    """|cos| = sqrt(1 - r^2) at any rotation, within the angle of a triangle, 2 degrees."""
    view = lambert_view(Geometry(sphere(5)), random_rotation(np.random.default_rng(0)), (32, 40), 0.8)
    x, y = np.meshgrid(np.arange(40) - 19.5, np.arange(32) - 15.5)
    r = np.hypot(x, y) / (0.8 * 16)
    inner = r < 0.9
    assert np.abs(view[inner] - np.sqrt(1 - r[inner] ** 2)).max() < 0.02
    assert not view[r > 1.1].any()


def test_a_sphere_beside_a_lamp():
    """max(0, n.l), at any rotation; from the camera's side it is the view of `Meshes`."""
    ball, turn = Geometry(sphere(5)), random_rotation(np.random.default_rng(0))
    lamp = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
    view = lambert_view(ball, turn, (32, 32), 0.8, lamp)
    x, y = np.meshgrid(np.arange(32) - 15.5, 15.5 - np.arange(32))
    r = np.hypot(x, y) / (0.8 * 16)
    inner = r < 0.9
    at = np.stack([x, y, np.sqrt(np.maximum(12.8**2 - x**2 - y**2, 0))], axis=-1) / 12.8
    assert np.abs(view - np.maximum(at @ lamp, 0))[inner].max() < 0.03  # a triangle is 2 degrees wide
    front = lambert_view(ball, turn, (32, 32), 0.8, np.array([0, 0, 1.0]))
    assert front == pytest.approx(lambert_view(ball, turn, (32, 32), 0.8), abs=1e-12)


def test_shadows_of_a_lamp():
    """A plate above another, in light from the left: its shadow lies to the right of it."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    two = Geometry([Mesh(v, np.array([[0, 1, 2], [0, 2, 3]])) for v in (square, 0.2 * square + [0, 0, 0.4])])
    lamp = np.array([-np.sqrt(0.5), 0, np.sqrt(0.5)])
    view = lambert_view(two, np.eye(3), (100, 100), 1.0, lamp)
    radius = float(np.linalg.norm([1, 1, 0.2]))  # about the middle of the box
    column = lambda x: int(50 + x / radius * 50)  # noqa: E731
    row = view[50]
    assert row[column(-0.15)] == pytest.approx(np.sqrt(0.5))  # of the plate above
    assert row[column(0.3)] == row[column(0.5)] == 0
    assert row[column(0.7)] == row[column(-0.5)] == pytest.approx(np.sqrt(0.5))


def test_one_mesh_in_many_lights(solids, tmp_path):
    """Sides and lights are dealt to the splits; the file counts by its content."""
    family = LitMesh(scene=str(solids / "2.obj"), shape=(16, 16))
    shown = [family.image(0, split, n) for split in ("train", "test") for n in range(3)]
    assert all(image.max() == 1 for image in shown)
    assert len({image.tobytes() for image in shown}) == 6
    rng = np.random.default_rng()
    front, aside = (
        sum(family.replace(lamp=angle).picture((n,), rng).sum() for n in range(20)) for angle in (0.0, 1.2)
    )
    assert aside < 0.8 * front  # the same sides, less lit
    (tmp_path / "moved.obj").write_bytes((solids / "2.obj").read_bytes())
    assert LitMesh(scene=str(tmp_path / "moved.obj"), shape=(16, 16)).identity() == family.identity()
    assert family.replace(lamp=0.5).identity() != family.identity()
    assert_refused(lambda: LitMesh(scene=str(tmp_path / "none.ply")).identity(), "an existing file")
    assert_refused(lambda: family.replace(lamp=3.1), "from 0 to 5 pi / 6")


def test_views_against_the_light_show_something_lit(solids):
    """A third of the views of a box are dark here; they are drawn again."""
    family = LitMesh(scene=str(solids / "2.obj"), shape=(8, 8), lamp=2.5)
    assert all(family.image(0, "train", n).max() == 1 for n in range(12))


def test_sides_are_where_they_are():
    """Seen along -z: x to the right, y up, the nearer in front; a quarter turn about z brings x to the top."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    leaning = np.array([[0.2, 0.2, 0.2], [0.8, 0.2, 0.2], [0.8, 0.8, 0.8], [0.2, 0.8, 0.8]])
    two = Geometry([Mesh(v, np.array([[0, 1, 2], [0, 2, 3]])) for v in (square, leaning)])
    view = lambert_view(two, np.eye(3), (30, 30), 1.0)
    top_left, top_right, bottom_right = view[8:12, 8:12], view[8:12, 18:22], view[18:22, 18:22]
    assert top_left == pytest.approx(1) == bottom_right
    assert top_right == pytest.approx(np.sqrt(0.5))
    turned = lambert_view(two, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]), (30, 30), 1.0)
    assert np.rot90(view) == pytest.approx(turned, abs=1e-12)


def test_orientations_are_even():
    """Over all sides a convex body shows int |cos| dA = surface / 6: the mean of cos^2 over a hemisphere, halved."""
    rng, body = np.random.default_rng(3), Geometry(box((2, 1, 1)))
    radius, count = np.sqrt(6) / 2, 700
    shown = np.array([lambert_view(body, random_rotation(rng), (20, 20), 1.0).sum() for _ in range(count)])
    shown *= (2 * radius / 20) ** 2
    error = shown.std() / np.sqrt(count)
    assert_z(shown.mean(), 10 / 6, error)
    turned = np.array([random_rotation(rng) for _ in range(20_000)])
    assert_z(turned.mean(axis=0), 0, np.sqrt(1 / 3 / 20_000))
    refute_z(shown.mean() * 1.05, 10 / 6, error)


def test_files_are_known_by_their_bytes(solids, tmp_path):
    family = Meshes(path=str(solids), shape=(16, 16))
    assert len(family.sources()) == 4
    assert {split: len(found) for split, found in family.by_split.items()} == {"train": 2, "validation": 1, "test": 1}
    (solids / "copy.ply").write_bytes((solids / "0.ply").read_bytes())
    assert Meshes(path=str(solids), shape=(16, 16)).identity() == family.identity()
    save(sphere(1), solids / "new.ply")
    assert Meshes(path=str(solids), shape=(16, 16)).identity() != family.identity()
    image = family.image(0, "train", 3)
    assert image.dtype == np.float32
    assert image.max() == 1
    assert (image == family.image(0, "train", 3)).all()
    assert (family.image(0, "train", 5) != image).any()
    (solids / "broken.ply").write_text("ply\nformat ascii 1.0\nelement vertex 1\n")
    assert_refused(lambda: Meshes(path=str(solids)).sources(), "Meshes mesh must be readable")
    with pytest.raises(RuleError, match="a folder with meshes"):
        Meshes(path=str(tmp_path / "..")[:0] or str(_empty(tmp_path))).sources()
    assert_refused(lambda: Folder(path=str(tmp_path / "none")).sources(), "an existing folder")


def _empty(folder):
    (folder / "empty").mkdir()
    return folder / "empty"


def test_a_mesh_that_changes_is_noticed(solids):
    family = Meshes(path=str(solids), shape=(16, 16))
    family.sources()
    for n, suffix in enumerate(("ply", "stl", "obj", "off")):
        save(box((1, 1, 1 + n)), solids / f"{n}.{suffix}")
    assert_refused(lambda: family.image(0, "train", 0), "unchanged since")
    lit = LitMesh(scene=str(solids / "0.ply"), shape=(16, 16))
    lit.identity()
    save(box((1, 1, 7)), solids / "0.ply")
    assert_refused(lambda: lit.image(0, "train", 0), "unchanged since")


@pytest.mark.parametrize("table", [{"type": "Meshes", "path": "."}, {"type": "LitMesh", "scene": "0.ply"}])
def test_a_recipe_streams_them(solids, table, monkeypatch):
    monkeypatch.chdir(solids)
    changes = {"objects": table | {"shape": [16, 16]}, "camera": {"shape": [32, 32]},
               "material": {"kernel_paths": 500}, "media": 2,
               "samples": {"train": 4, "validation": 2, "test": 2}}  # fmt: skip
    recipe = load_recipe("through-slab", changes)
    batch = next(iter(SpeckleStream(recipe, batch_size=4)))
    assert batch["object"].shape == (4, 16, 16)
    assert batch["image"].shape == (4, 32, 32)
    assert not {"path", "scene"} & set(recipe.physics()["objects"])
