"""Meshes from files, their fingerprints and places."""

import numpy as np
import pytest
from wavetracing.solids import box

from specklegen.core.errors import RuleError
from specklegen.wavetracing import Absorber, Conductor, Geometry, Mesh, load_mesh


@pytest.mark.parametrize("ending", ["ply", "obj", "stl", "off", "glb"])
def test_round_trip_through_files(tmp_path, ending):
    """The same triangles, scaled; formats that store single precision keep seven digits."""
    trimesh = pytest.importorskip("trimesh")
    mesh = box((1.5, 1, 2), (0.3, 0, 0))
    path = tmp_path / f"box.{ending}"
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    loaded = load_mesh(path, scale=10.0, material=Conductor())
    assert loaded.vertices[loaded.faces] == pytest.approx(10 * mesh.vertices[mesh.faces], abs=1e-5)
    assert loaded.material == Conductor()
    assert len(Geometry(loaded).edges) == 12  # STL has three vertices a face: welded


def test_a_file_with_nan_is_refused(tmp_path):
    """A loader that processes drops the vertex and says nothing."""
    pytest.importorskip("trimesh")
    path = tmp_path / "bad.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n")
    with pytest.raises(RuleError, match="finite everywhere"):
        load_mesh(path)
    path.write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(RuleError, match="holds triangles"):
        load_mesh(path)
    with pytest.raises(RuleError, match="scale"):
        load_mesh(path, scale=-1)


def test_fingerprint_is_of_the_content():
    mesh = box()
    assert mesh.fingerprint == box().fingerprint
    others = [box((1, 1, 1.0000001)), box(material=Conductor()), Mesh(mesh.vertices, mesh.faces[::-1])]
    assert len({mesh.fingerprint, *(other.fingerprint for other in others)}) == 4
    assert mesh.material == Absorber()
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1


def test_placed():
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    mesh = box((2, 1, 1)).placed([5, 0, 0], turn)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([1, 2, 1])
    assert mesh.vertices.mean(axis=0) == pytest.approx([5, 0, 0])
    with pytest.raises(RuleError, match="proper rotation"):
        box().placed(rotation=-np.eye(3))
