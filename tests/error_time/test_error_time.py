"""Benchmarking: slopes and crossings of synthetic curves, what runs imply, the reported errors, the compare command."""

import csv
import mmap
import re
from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_refused
from slab_sums import direct
from typer.testing import CliRunner
from zscore import assert_z, limit, refute_z

import specklegen as sg
from scripts.error_time import calibration, references, tables
from scripts.error_time.runs import Row, judged, quantities
from scripts.error_time.scenes import SCENES
from specklegen.cli.commands import app
from specklegen.error_time import SAMPLERS, Estimate, Probes, compare, crossover, fit_trend, measured
from specklegen.error_time.estimates import connection_amplitudes, paths_estimate, stationary_estimate
from specklegen.memory_effects.cached import estimated_anew
from specklegen.paths.layout import scene_layout
from specklegen.paths.phases import random_phases
from specklegen.planning.planning import plan
from specklegen.rendering import render

PITCH = 0.45e-3


def small(side="transmission", views=9, center=(0.0, 0.0)) -> sg.Scene:
    return sg.Scene(wavelength=1.0,
                    medium=sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(g=0.3)),
                    illumination=sg.CollimatedBeams.tilts(np.arcsin(2 * PITCH * np.array([-1, 0, 1])), width=1000.0),
                    sensor=sg.FarField.grid((views, views), PITCH, side=side, center=center))  # fmt: skip


# ---- Slopes and crossings ----------------------------------------------------------------------------------
def synthetic(slope: float, rng, floor: float = 0.0, points: int = 7, freedom=16):
    """Times a factor 4 apart and root mean squares of ``freedom`` normal errors of a power law over a floor."""
    freedom = np.broadcast_to(freedom, points).astype(float)
    seconds = 1e-3 * 4.0 ** np.arange(points)
    sigma = np.hypot(0.02 * seconds**slope, floor)
    return seconds, sigma * np.sqrt(rng.chisquare(freedom) / freedom), freedom


@pytest.mark.parametrize("freedom", [16, (16, 16, 16, 8, 4, 2, 1)])
def test_slope_of_independent_samples_is_found(freedom):
    rng = np.random.default_rng(1)
    fits = [fit_trend(*synthetic(-0.5, rng, freedom=freedom)) for _ in range(400)]
    error = np.std([fit.slope for fit in fits], ddof=1)
    assert_z(np.mean([fit.slope for fit in fits]), -0.5, error / 20)
    # The spread of 400 slopes is known to 1/sqrt(2 * 399).
    assert error == pytest.approx(fits[0].slope_error, rel=limit() / np.sqrt(2 * 399))
    assert fits[0].decades == pytest.approx(6 * np.log10(4))


@pytest.mark.parametrize(("slope", "floor"), [(-0.25, 0.0), (-1.0, 0.0), (-0.5, 0.1)])
def test_a_wrong_error_model_is_caught(slope, floor):
    fit = fit_trend(*synthetic(slope, np.random.default_rng(2), floor))
    assert abs(fit.slope + 0.5) > limit() * fit.slope_error


@pytest.mark.parametrize("bad", [([1, 1], [1, 2], [1, 1]), ([1, 2], [0, 2], [1, 1]), ([1, 2], [1, 2], [1, np.nan])])
def test_trend_refuses(bad):
    assert_refused(lambda: fit_trend(*bad), "fit_trend")


def test_crossing_of_two_power_laws():
    seconds = np.geomspace(1e-2, 1e2, 9)
    level = np.full(9, 0.03)
    falling = 0.02 * seconds**-0.5
    time, error = crossover((seconds, level), (1.5 * seconds, falling / 1.5**0.5))
    assert time == pytest.approx((0.02 / 0.03) ** 2, rel=1e-9)
    assert error == pytest.approx(0.03, rel=1e-9)


def test_no_crossing():
    seconds = np.geomspace(1e-2, 1e2, 9)
    falling = 0.02 * seconds**-0.5
    assert crossover((seconds, falling), (seconds, 1.5 * falling)) is None
    assert crossover((seconds, falling), (1e5 * seconds, falling)) is None
    wiggle = falling * (1 + 0.05 * (-1.0) ** np.arange(9))
    assert crossover((seconds, falling), (seconds, wiggle)) is not None
    assert crossover((seconds, falling), (seconds, wiggle), margin=1.25) is None


# ---- What a run implies ------------------------------------------------------------------------------------
@pytest.mark.parametrize(("side", "reverse"), [("transmission", False), ("reflection", True)])
def test_connection_amplitudes_are_those_of_the_field(side, reverse):
    scene = small(side)
    made = sg.plan(scene, paths=500, sampler="paths", reverse=reverse)
    tracer = made.chosen.tracer
    bank = tracer.trace(3, 500)
    phases, layout = random_phases(bank, 3), scene_layout(scene)
    points = np.array([(0, 5), (2, 40), (1, 77)])
    single = bank.orders == 1
    ours = sum(
        connection_amplitudes(tracer, bank.select(part), points, reverse=reverse) @ phases[part]
        for part in (single, ~single)
    ) / np.sqrt(bank.count)
    field = direct(bank, layout, phases, scene.views, reverse=reverse)
    np.testing.assert_allclose(ours, field[points[:, 0], points[:, 1]], rtol=1e-10)


def test_paths_imply_what_their_renders_scatter_about():
    """The mean of |u|^2 over many renders is the mean of what each render's own paths imply."""
    scene = small(views=3)
    probes = Probes.among([(0, 4), (2, 4)])
    implied = np.array([paths_estimate(scene, probes, 200, seed).value for seed in range(300)])
    fields = np.array([render(scene, paths=200, sampler="paths", seed=s, threads=1).field for s in range(300)])
    at = fields.reshape(300, 3, -1)[:, probes.points[:, 0], probes.points[:, 1]]
    p, q = probes.ends.T
    gap = at[:, p] * at[:, q].conj() - implied
    assert_z(gap.mean(axis=0).real, 0, gap.real.std(axis=0, ddof=1) / np.sqrt(300))
    refute_z((gap + implied).mean(axis=0).real, 0, gap.real.std(axis=0, ddof=1) / np.sqrt(300))


@pytest.mark.parametrize(("center", "kernel"), [((0.0, 0.0), "axial"), ((0.5, 0.2), "oblique")])
def test_stationary_model_is_that_of_its_stacks(center, kernel):
    scene = small(center=center)
    assert plan(scene, sampler="stationary").chosen.form == kernel
    probes = Probes(np.array([(0, 38), (2, 42), (0, 39)]), np.array([(0, 1), (0, 2)]))
    model = stationary_estimate(scene, probes, 2000, 1).value
    with estimated_anew(1):  # as the estimate is; a render alone has the medium's own paths
        fields = render(scene, paths=2000, sampler="stationary", seed=1, realizations=4000).field.reshape(4000, 3, -1)
    at = fields[:, probes.points[:, 0], probes.points[:, 1]].astype(np.complex128)
    products = at[:, probes.ends[:, 0]] * at[:, probes.ends[:, 1]].conj()
    for part in (np.real, np.imag):
        spread = part(products).std(axis=0, ddof=1) / np.sqrt(4000)
        assert_z(part(products.mean(axis=0))[spread > 0], part(model)[spread > 0], spread[spread > 0])


def test_stationary_fields_have_the_phases_of_path_sums(monkeypatch):
    """Between tilts at views that move with them, seen at 20 degrees."""
    scene = sg.Scene(wavelength=1.0,
                     medium=sg.Slab(thickness=400.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=0.9)),
                     illumination=sg.CollimatedBeams.tilts(np.arcsin(16e-5 * np.arange(3)), width=4e4),
                     sensor=sg.FarField.grid((3, 65), 1e-5, center=(0.34, 0.0)))  # fmt: skip
    probes = Probes.among([(t, 65 + 16 + 16 * t) for t in range(3)])
    exact = paths_estimate(scene, probes, 20_000, 1)

    def z() -> np.ndarray:
        model = stationary_estimate(scene, probes, 20_000, 2)
        return np.abs(model.value - exact.value) / np.hypot(model.standard_error, exact.standard_error)

    assert_z(z(), 0, 1, degrees=63)
    monkeypatch.setattr("specklegen.synthesis.stacks.SMALL_PHASE", np.inf)
    refute_z(z(), 0, 1, degrees=63)


def test_samplers_agree_on_a_tiny_scene():
    scene = small(views=3)
    probes = Probes.among([(0, 3), (2, 5)])
    found = {
        s.name: s.estimate(scene, probes, 20_000, 7, s.work(scene, probes, 20_000, 7))
        for s in SAMPLERS if s.obstacle(scene, probes) is None and s.name != "stationary"
    }  # fmt: skip
    assert len(found) >= 3
    first = found.pop("paths")
    for name, other in found.items():
        if name != "paths, direct sum":
            error = np.hypot(other.standard_error, first.standard_error)
            assert_z(np.abs(other.value - first.value), 0, error, degrees=63)


def test_measured_sees_memory():
    def fill() -> float:
        # Pages of its own: the heap may hold free memory of earlier tests, and then a new array makes no process grow.
        with mmap.mmap(-1, 2**27) as pages:
            for _ in range(128):
                pages.write(b"\x01" * 2**20)
            return float(len(pages))

    result, cost = measured(fill)
    assert result == 2**27
    assert cost.cpu_seconds > 0
    if cost.memory_bytes is not None:
        assert cost.memory_bytes > 0.9 * 2**27
        assert measured(lambda: None)[1].memory_bytes < 2**26, "the peak counts from the last call"


# ---- References, judgement, page ---------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["transmission-g0-od1", "backscatter", "wide-field"])
def test_frozen_closed_forms_are_what_is_computed(name):
    case = SCENES[name]()
    pair = case.probes.crossings[-1]
    cut = replace(case, probes=Probes(case.probes.points[pair], np.array([(0, 1)])))
    np.testing.assert_allclose(references.load(name).value[[*pair, -1]], references.transfer(cut), rtol=1e-9)


def test_every_scene_has_a_reference_and_ten_kinds():
    assert len(SCENES) >= 10
    for name in SCENES:
        frozen = references.load(name)
        assert np.isfinite(frozen.value).all()
        assert re.search(r"at [0-9a-f]{7}$", frozen.source)


def test_judgement():
    probes = Probes.among([(0, 0), (1, 1)])
    right = references.Reference(np.array([4.0, 1.0, 0.5]), np.array([0.04, 0.01, 0.02]), "")
    found = [Estimate(right.value + [0.4, 0, 0.2j], np.array([0.2, 0.05, 0.1]))]
    parts = quantities(probes)
    assert judged(probes, parts["intensity"], found, right) == pytest.approx((0.1 / np.sqrt(2), 0.05, 0.01))
    assert judged(probes, parts["tilt covariance"], found, right) == pytest.approx((0.1, 0.05, 0.01))


def synthetic_rows(scene="transmission-g0-od10", bias=0.0) -> list[Row]:
    rows = []
    for quantity in tables.QUANTITIES:
        for method, price, bent in (("paths", 1e-6, 0.0), ("stationary", 5e-7, bias)):
            for n in range(6):
                count = 1024 * 4**n
                error = 3 / np.sqrt(count)
                true, cpu = float(np.hypot(error, bent)), 5e-3 + price * count
                rows.append(Row(scene, method, quantity, count, 16, true, error, 0.0, cpu, 1e-2, 2**20))
    return rows


def test_page_finds_slope_and_crossing():
    rows = synthetic_rows(bias=0.01)
    fitted = tables.trends(tables.curves(rows, "transmission-g0-od10", "intensity")["paths"])
    assert fitted is not None
    assert fitted[1].slope == pytest.approx(-0.5, abs=0.05)
    crossed = tables.found_crossings(rows, "transmission-g0-od10", "intensity")
    assert [each[:2] for each in crossed] == [("paths", "stationary")]
    level = [
        name
        for name, found in tables.curves(rows, "transmission-g0-od10", "intensity").items()
        if tables.ends_level(found)
    ]
    assert level == ["stationary"]
    assert not tables.found_crossings(synthetic_rows(), "transmission-g0-od10", "intensity")


def test_truths_of_the_calibration_are_ten_times_sharper_than_its_runs():
    samplers = {sampler.name: sampler for sampler in SAMPLERS}
    for name, scene, paths in calibration.CASES:
        case, truth, sampler = SCENES[scene](), references.load(scene), samplers[name]
        if truth.standard_error.any():
            done = sampler.work(case.scene, case.probes, paths, 0)
            run = sampler.estimate(case.scene, case.probes, paths, 0, done)
            assert (truth.standard_error < 0.1 * run.standard_error).all(), (name, scene)


@pytest.mark.slow
def test_reported_errors_cover_the_true_ones():
    """Every sampler: the variance of 200 z-scores lies within the chi-square limits at 1e-6."""
    for found in calibration.calibrate():
        assert found.passed, found


@pytest.mark.slow
def test_a_reported_error_that_is_wrong_is_caught():
    sampler = next(s for s in SAMPLERS if s.name == "stationary")
    right, _ = calibration.sampler_scores(sampler, "transmission-g0-od1", 2048, 100)
    wrong, _ = calibration.sampler_scores(sampler, "transmission-g0-od1", 2048, 100, factor=0.7)
    assert right.passed
    assert not wrong.passed


# ---- The command -------------------------------------------------------------------------------------------
def test_bench_rows_fall_with_the_count():
    rows = list(compare(small(views=3), seconds=0.05))
    names = {row.sampler for row in rows}
    assert {"paths", "covariance, few points", "covariance, eigen-sampling"} <= names
    for name in names:
        mine = [row for row in rows if row.sampler == name]
        assert len(mine) >= 2
        assert all(b.count == 4 * a.count for a, b in zip(mine, mine[1:], strict=False))
        assert mine[-1].standard_error < mine[0].standard_error


def test_closed_forms_count_no_paths():
    scene = sg.Scene(wavelength=1.0,
                     medium=sg.Box(lower=(-2.0, -2.0), upper=(2.0, 2.0), mean_free_path=20.0, scatterer=sg.Isotropic()),
                     illumination=sg.PlaneWaves.tilts([0.0], dimensions=2),
                     sensor=sg.FarField.angles([0.3]))  # fmt: skip
    counts = {row.sampler: row.count for row in compare(scene, seconds=0.01)}
    assert counts.pop("single scattering, closed form") == 0
    assert min(counts.values()) > 0


def test_bench_refuses():
    assert_refused(lambda: next(compare(small(), seconds=0.0)), "compare seconds")


def test_compare_command(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(small(views=3).to_toml())
    table, figure = tmp_path / "compare.csv", tmp_path / "compare.png"
    command = ["check", "compare", str(scene), "--seconds", "0.05", "--csv", str(table), "--out", str(figure)]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    lines = list(csv.reader(table.open()))
    assert lines[0][0] == "sampler"
    assert len(lines) > 6
    assert figure.stat().st_size > 5_000
    assert "left out" in result.output
