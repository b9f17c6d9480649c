"""Wide fields of view in tiles: the same field as the direct sum, refused early where tiles are too wide."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scenes import slab as slab_of_depth
from slab_sums import beam_layout, direct, roulette_threshold
from threadpoolctl import threadpool_info, threadpool_limits

import specklegen as sg
from specklegen.core.nanoseconds import seconds
from specklegen.kernels import sums
from specklegen.paths.chunks import Chunks
from specklegen.paths.layout import scene_layout
from specklegen.paths.phases import random_phases
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.proposal import beam_proposal
from specklegen.paths.slab_tracer import trace
from specklegen.samplers.path_sums import nufft, summation, view_factor
from specklegen.samplers.path_sums.cost import nufft_operations
from specklegen.samplers.path_sums.nufft import build_nufft_plan, nufft_field
from specklegen.samplers.path_sums.summation import scene_nufft
from specklegen.samplers.path_sums.tiling import Tiling, tilings
from specklegen.samplers.path_sums.view_factor import sagitta
from specklegen.scene.illumination import directions_of_sines

TILTS = [[0.0, 0.0], [1e-3, -2e-3], [0.1, 0.05]]


slab = partial(slab_of_depth, thickness=500.0)


def wide(full_angle: float, shape=(60, 45), **kwargs) -> sg.FarFieldGrid:
    """A grid that spans ``full_angle`` degrees along its longer side."""
    return sg.FarField.grid(shape=shape, pitch=2 * np.sin(np.deg2rad(full_angle / 2)) / max(max(shape) - 1, 1),
                            **kwargs)  # fmt: skip


def fields(grid, tiling, medium, tolerance, *, connections=150):
    """Field in tiles and by the direct sum of connections that the decomposition never saw; None where refused."""
    beams = sg.CollimatedBeams.tilts(TILTS, width=0.4 / grid.pitch)
    layout = beam_layout(1.0, medium, beams, grid.sign)
    proposal = beam_proposal(medium, beams, np.concatenate([grid.center_direction[None], grid.corner_directions]))
    proposal = replace(proposal, threshold=roulette_threshold(medium, proposal, layout, proposal.reference, 7))
    summation = build_nufft_plan(layout, trace(medium, proposal, 1, 6000), grid, tolerance, tiling)
    if summation is None:
        return None
    bank = trace(medium, proposal, 2, 2000).select(slice(0, connections))
    phases = random_phases(bank, 3)
    found = nufft_field(layout, bank, phases, summation)
    expected = direct(bank, layout, phases, grid.directions.reshape(-1, 3)).reshape(found.shape)
    return found, expected


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def test_tiles_cover_every_view_with_one_shape():
    for grid in (wide(10.0), wide(3.0, (7, 100)), wide(3.0, (1, 33)), wide(1.0, (1, 1))):
        for tiling in tilings(grid):
            times = np.zeros(grid.shape, int)
            for tile in tiling.tiles:
                times[tile.rows, tile.columns] += 1
                transform = np.zeros(tiling.shape)
                assert transform[tile.kept].shape == times[tile.rows, tile.columns].shape
                row = tile.rows.start - tile.kept[0].start + tiling.shape[0] // 2
                column = tile.columns.start - tile.kept[1].start + tiling.shape[1] // 2
                np.testing.assert_allclose(tile.middle, grid.directions[row, column], atol=1e-15)
            assert (times == 1).all()
            assert len(tiling.tiles) == np.prod(tiling.counts)


def test_the_sagitta_is_that_of_unit_vectors():
    """Exact in long double; the naive difference of cosines would lose all digits at the small step."""
    for middle in directions_of_sines("v", [[0.0, 0.0], [0.3, -0.2]], -1.0):
        steps = np.array([[1e-9, 2e-9], [1e-4, 0.0], [0.05, 0.1]])
        sines = middle[:2].astype(np.longdouble) + steps
        z = -np.sqrt(1 - np.square(sines).sum(-1))
        z0 = -np.sqrt(1 - np.square(middle[:2].astype(np.longdouble)).sum())
        expected = (np.square(steps).sum(-1) + np.square(z - z0)) / (2 * z0)
        np.testing.assert_allclose(sagitta(steps, middle), expected.astype(float), rtol=1e-9)


@pytest.mark.parametrize(("angle", "tolerance", "g", "optical_depth", "albedo"), [
    (5.0, 1e-3, 0.9, 10.0, 1.0), (10.0, 1e-3, 0.9, 10.0, 1.0), (20.0, 1e-3, 0.9, 10.0, 1.0),
    (10.0, 1e-6, 0.9, 10.0, 0.9), (20.0, 1e-3, 0.0, 2.0, 0.8),
])  # fmt: skip
def test_tiles_are_the_direct_sum_within_the_tolerance(angle, tolerance, g, optical_depth, albedo):
    grid = wide(angle, (40, 27))
    side = int(40 / angle * (1.0 if tolerance == 1e-3 else 0.5)) + 1  # a degree or half of one
    medium = slab(g=g, optical_depth=optical_depth, albedo=albedo)
    found, expected = fields(grid, Tiling(grid, (side, side)), medium, tolerance)
    assert found.dtype == (np.complex64 if tolerance == 1e-3 else np.complex128)
    assert relative(found, expected) < 1.5 * tolerance


def test_tiles_in_reflection_off_the_axis():
    grid = wide(10.0, (30, 41), center=(-0.3, 0.2), side="reflection")
    found, expected = fields(grid, Tiling(grid, (10, 12)), slab(g=0.3, optical_depth=5.0), 1e-3)
    assert relative(found, expected) < 1.5e-3


@pytest.mark.parametrize("wrong", ["projection", "depth of the face"])
def test_a_wrong_phase_of_a_tile_is_caught(wrong, monkeypatch):
    """One per cent off in what a tile's middle makes of a depth; five in the depth of the face."""
    if wrong == "projection":
        points = sums.grid_points
        tilted = lambda records, pitch, x, y, *rest: points(records, pitch, 1.01 * x, 1.01 * y, *rest)  # noqa: E731
        monkeypatch.setattr(sums, "grid_points", tilted)
    else:
        monkeypatch.setattr(nufft, "sagitta", lambda *known: 0.95 * sagitta(*known))
    grid = wide(10.0)
    found, expected = fields(grid, Tiling(grid, (12, 12)), slab(g=0.9), 1e-3)
    assert relative(found, expected) > 5e-3


@pytest.mark.parametrize(("tiles", "rank"), [((47, 47), 20), ((12, 12), 7)])
def test_layers_of_unlike_particles_take_the_terms_that_single_scattering_needs(tiles, rank):
    """The layers of the recipe refocus-stack: fewer terms serve multiple scattering alone."""
    layers = [sg.Layer(thickness=20.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(g=0.8)),
              sg.Layer(thickness=60.0, mean_free_path=15.0, scatterer=sg.HenyeyGreenstein(g=0.9))]  # fmt: skip
    grid = sg.FarField.grid(shape=(94, 94), pitch=0.2 / 94)
    beams = sg.CollimatedBeams.tilts([0.0], width=20.0)
    scene = sg.Scene(wavelength=0.4, medium=sg.Layers(layers=layers), illumination=beams, sensor=grid)
    pilot = scene_pilot(scene, False)
    layout, bank = pilot.tracer.layout, pilot.bank.select(slice(0, 400))
    plan = build_nufft_plan(layout, pilot.bank, grid, 1e-3, Tiling(grid, tiles))
    assert plan.rank >= rank
    phases = random_phases(bank, 3)
    field = nufft_field(layout, bank, phases, plan)
    expected = direct(bank, layout, phases, grid.directions.reshape(-1, 3)).reshape(field.shape)
    assert relative(field, expected) < 1e-3


def test_tiles_do_not_depend_on_threads():
    grid = wide(5.0, (37, 29))
    medium, beams = slab(g=0.9), sg.CollimatedBeams.tilts(TILTS, width=0.4 / grid.pitch)
    layout = beam_layout(1.0, medium, beams)
    bank = trace(medium, beam_proposal(medium, beams, grid.center_direction), 1, 600)
    summation = build_nufft_plan(layout, bank, grid, 1e-3, Tiling(grid, (10, 10)))
    assert summation is not None
    assert summation.tiles == 12
    one, two = (nufft_field(layout, bank, random_phases(bank, 3), summation, threads=n) for n in (1, 2))
    assert one.tobytes() == two.tobytes()


def test_wide_tiles_are_refused_before_any_decomposition(monkeypatch):
    """The lattice itself is judged first: 40 degrees never reach the QR."""

    def unreachable(*_args, **_kwargs):
        raise AssertionError("decomposed")

    grid = wide(40.0)
    monkeypatch.setattr(view_factor, "qr", unreachable)
    assert fields(grid, None, slab(g=0.9), 1e-3) is None
    with pytest.raises(AssertionError, match="decomposed"):
        fields(grid, Tiling(grid, (8, 8)), slab(g=0.9, thickness=50.0), 1e-3)


def scene(full_angle: float, views: int, tilts: int = 1) -> sg.Scene:
    grid = wide(full_angle, (views, views))
    return sg.Scene(wavelength=1.0, medium=slab(g=0.9, thickness=2000.0), sensor=grid,
                    illumination=sg.CollimatedBeams.tilts(1e-4 * np.arange(tilts), width=0.4 / grid.pitch))  # fmt: skip


def test_the_planner_cuts_wide_views_and_leaves_narrow_ones_whole():
    one, few, none = (scene_nufft(s, False, 1e-3) for s in (scene(0.5, 64), scene(8.0, 96, 2), scene(60.0, 16)))
    assert one is not None
    assert one.tiles == 1
    assert few is not None
    assert few.tiles > 1
    assert none is None
    text = sg.plan(scene(8.0, 96, 2), paths=1000, sampler="paths").explain()
    assert f"rank {few.rank} in {few.tiling.counts[0]}x{few.tiling.counts[1]} tiles" in text


def test_tiles_that_are_not_tried_would_not_pay(monkeypatch):
    """And those that are tried are judged on one thread of linear algebra, whose last bits would else depend on it."""
    this, tried = scene(0.5, 65), []
    pilot, layout = scene_pilot(this, False), scene_layout(this)

    def build(layout, bank, grid, tolerance, tiling, most):
        tried.append(tiling)
        assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {1}
        return build_nufft_plan(layout, bank, grid, tolerance, tiling, most)

    def cost(found) -> float:
        per_path = pilot.connections_per_path
        chunks = Chunks(100_000, per_path, found.points).count
        return seconds(nufft_operations(found, 1, 1e5 * per_path, chunks), 1)

    monkeypatch.setattr(summation, "build_nufft_plan", build)
    with threadpool_limits(2):
        best = scene_nufft(this, False, 1e-3)
    left_out = [tiling for tiling in tilings(this.sensor) if tiling not in tried]
    assert left_out
    for tiling in left_out[:3]:
        other = build_nufft_plan(layout, pilot.bank, this.sensor, 1e-3, tiling)
        assert other is None or cost(other) > cost(best)


def test_a_render_in_tiles_is_the_render_summed_directly():
    wide_view = scene(8.0, 96, tilts=2)
    assert scene_nufft(wide_view, False, 1e-3).tiles > 1
    rendered = sg.render(wide_view, paths=300, seed=1, sampler="paths")
    assert rendered.report.summation == "nufft"
    chosen = np.random.default_rng(0).choice(96 * 96, 400, replace=False)
    few = wide_view.replace(sensor=sg.FarField(directions=wide_view.views[chosen]))
    bank = sg.plan(wide_view, paths=300, sampler="paths").chosen.tracer.trace(1, 300)
    expected = direct(bank, scene_layout(few), random_phases(bank, 1), few.views)
    assert relative(rendered.field.reshape(2, -1)[:, chosen], expected) < 1.5e-3
