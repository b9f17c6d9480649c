"""Gates judge a grid at its extremes: the same decisions as at every view, and nothing as large as the grid."""

import tracemalloc

import numpy as np
import pytest

import specklegen as sg
from specklegen.core import memory
from specklegen.mean.rule import _strongest_mean
from specklegen.paths.reversal import reversal_decision, scene_reversal
from specklegen.scene.illumination import directions_of_sines

WIDTH = 4000.0
RNG = np.random.default_rng(20)


def scene(
    shape, side="transmission", *, tilts=((0.0, 0.0),), center=(0.0, 0.0), pitch=0.5, profile="square", width=WIDTH
):
    """Sines of tilts and of the grid's centre; pitch in speckle grains."""
    return sg.Scene(
        wavelength=1.0, medium=sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.Isotropic()),
        illumination=sg.CollimatedBeams(directions=directions_of_sines("tilt", np.array(tilts)), width=width,
                                        profile=profile),
        sensor=sg.FarField.grid(shape=shape, pitch=pitch / width, side=side, center=center),
    )  # fmt: skip


def random_directions(count: int) -> np.ndarray:
    vectors = RNG.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
@pytest.mark.parametrize(
    ("shape", "pitch"), [((1, 1), 0.1), ((7, 1), 0.11), ((1, 9), 0.11), ((10, 13), 0.08), ((5, 4), 0.001)]
)
def test_the_nearest_view_is_found_without_the_others(side, shape, pitch):
    """To every direction of the sphere, those on the other side and those within the grid included."""
    for center in ((0.0, 0.0), (0.2, -0.15)):
        grid = sg.FarField.grid(shape=shape, pitch=pitch, side=side, center=center)
        views = grid.directions.reshape(-1, 3)
        directions = np.concatenate([random_directions(300), views[:3], grid.corner_directions, np.diag([1.0, 1, -1])])
        best = (directions @ views.T).max(axis=1)
        found = grid.nearest(directions)
        np.testing.assert_allclose((directions * found).sum(axis=1), best, rtol=0, atol=1e-14)


@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_the_strongest_mean_is_that_of_all_views(profile):
    """Grids that hold the tilt, and grids beside it by fractions of a grain up to hundreds of grains. Of a disc seen
    from far beside it a lobe a grain further may be the higher one, for it is sampled by chance."""
    for _ in range(60):
        center = RNG.choice([0.3, 3.0, 30.0, 300.0]) / WIDTH * RNG.normal(size=2)
        this = scene(RNG.integers(1, 150, 2), center=tuple(center), pitch=RNG.uniform(0.05, 0.5), profile=profile)
        everywhere = np.square(np.abs(sg.mean_field(this))).max()
        found = _strongest_mean(this)
        assert found <= everywhere * (1 + 1e-9)
        assert found >= everywhere * (0.8 if profile == "disc" else 1 - 1e-6)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_reversal_is_judged_as_at_every_view(side):
    needed = []
    for _ in range(60):
        tilts = 0.3 * RNG.uniform(-1, 1, (3, 2))
        center = tuple(0.6 * RNG.uniform(-1, 1, 2))
        this = scene((9, 12), side, tilts=tilts, center=center, width=RNG.choice([30.0, WIDTH]))
        found = scene_reversal(this, "auto", 0.02)
        full = reversal_decision(this.medium, 1.0, this.lights, this.views, "auto", 0.02)
        assert found == full
        needed.append(found.needed)
    assert any(needed) == (side == "reflection")
    assert not all(needed)


def test_light_that_comes_back_meets_a_transmission_grid():
    """A wave along -z is backscattered into the views at +z, the middle of the grid most of all."""
    this = sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=(-50, -50, 0), upper=(50, 50, 100), mean_free_path=40.0, scatterer=sg.Isotropic()),
        illumination=sg.PlaneWaves(directions=np.array([[0.0, 0.0, -1.0]])),
        sensor=sg.FarField.grid(shape=(21, 21), pitch=0.03),
    )
    found = scene_reversal(this, "auto", 0.02)
    assert found.needed
    assert found == reversal_decision(this.medium, 1.0, this.lights, this.views, "auto", 0.02)


def test_a_grid_of_many_views_and_tilts_is_planned_without_them(monkeypatch):
    """4096 x 4096 views of 100 tilts: 400 MB of views, 13 GB of fields, none of which a plan needs."""
    this = scene((4096, 4096), tilts=np.stack([1e-6 * np.arange(100), np.zeros(100)], 1), width=1e5)
    monkeypatch.setattr(memory, "available_memory", lambda: 2**50)
    sg.plan(scene((8, 8), width=1e5), sampler="paths")  # compiles
    for options in ({}, {"sampler": "paths"}):
        tracemalloc.start()
        made = sg.plan(this, paths=1000, **options)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < 100e6
        assert made.memory_bytes > 13e9
    assert "directions" not in vars(this.sensor)
    # Power: views are seen by this measurement, were there any.
    tracemalloc.start()
    views = this.sensor.replace(shape=(2048, 2048)).directions.nbytes
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most > views > 100e6
