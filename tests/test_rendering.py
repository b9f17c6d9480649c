"""Rendering end to end: Gaussian statistics, purity, mean field, promised error, messages, threads and forks."""

import os
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scenes import slab
from scipy.stats import kstest
from slab_sums import direct
from zscore import FALSE_ALARM, assert_mean, assert_z, limit, refute_mean, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.paths import pilot, proposal
from specklegen.paths.chunks import Chunks
from specklegen.paths.layout import scene_layout
from specklegen.paths.reversal import reversal_decision
from specklegen.samplers.path_sums import summation
from specklegen.samplers.stationary import rule
from specklegen.scene.illumination import directions_of_sines
from specklegen.synthesis import gaussian_noise, stacks

WAVELENGTH, WIDTH = 0.5, 4000.0
GRAIN = WAVELENGTH / WIDTH


def scene(*, tilts=(0.0, 2.0), shape=(8, 9), pitch=0.5, medium=None, profile="square", side="transmission", **where):
    """Tilts and pitch in speckle grains."""
    return sg.Scene(
        wavelength=WAVELENGTH, medium=medium or slab(2.0),
        illumination=sg.light.CollimatedBeams.tilts(np.arcsin(np.array(tilts) * GRAIN), width=WIDTH, profile=profile),
        sensor=sg.sensors.FarField.grid(shape=shape, pitch=pitch * GRAIN, side=side, **where),
    )  # fmt: skip


def sparse_scene(medium=None, views=6) -> sg.Scene:
    """Views 300 speckles apart: independent. That is several lambda / L: closer by, vertices of one path interfere, and
    the excess is above the promise (0.39 for 0.25 at 20 speckles in the second case of the test of the promise)."""
    line = np.stack([300 * GRAIN * np.arange(views), np.zeros(views)], 1)
    return scene(tilts=[0.0],
                 medium=medium).replace(sensor=sg.sensors.FarField(directions=directions_of_sines("v", line)))


SAMPLERS = ["paths", "stationary"]


# ---- Gaussianity (A05) ---------------------------------------------------------------------------------
def assert_gaussian(u: np.ndarray) -> None:
    """A zero-mean circular Gaussian field: <u> = <u^2> = 0, <|u|^4> = 2 <|u|^2>^2, exponential intensity. ``u``
    complex[R, V], independent along both axes, unit mean intensity in expectation at most up to a common factor."""
    count = u.size
    flat = u.ravel() / np.sqrt(np.square(np.abs(u)).mean())
    assert_mean(np.stack([flat.real, flat.imag, (flat**2).real, (flat**2).imag], 1), 0)
    power = np.square(np.abs(u)).ravel()
    sums = np.stack([power, power**2, np.ones(count)], 1).reshape(100, -1, 3).sum(axis=1)
    contrast, error = jackknife(sums, lambda s: s[1] * s[2] / s[0] ** 2 - 1)
    assert_z(contrast, 1.0, error, degrees=99)
    # The scale is estimated from the same data, which makes the test a little more lenient, not less.
    assert kstest(power / power.mean(), "expon").pvalue > FALSE_ALARM


def test_fields_are_circular_gaussian_by_paths():
    """At 2000 paths the finite-count excess is some 4/2000, inside the bounds; see the test of the promise below."""
    u = sg.render(sparse_scene(slab(1.0)), paths=2000, seed=1, realizations=500, sampler="paths").field[:, 0]
    assert_gaussian(u.astype(complex))


def test_fields_are_circular_gaussian_by_the_stationary_sampler():
    grid = scene(tilts=[0.0], shape=(5, 5), pitch=0.5)
    u = sg.render(grid, paths=2000, seed=1, realizations=800, sampler="stationary").field[:, 0, ::4, ::4]
    assert_gaussian(u.reshape(800, -1).astype(complex))


def test_gaussianity_test_has_power():
    generator = np.random.default_rng(0)
    u = (generator.normal(size=(500, 6)) + 1j * generator.normal(size=(500, 6))) / np.sqrt(2)
    assert_gaussian(u)
    for wrong in (u + 0.2, u.real + 0.7j * u.imag, u * np.sqrt(generator.exponential(size=u.shape)), u / np.abs(u)):
        with pytest.raises(AssertionError):
            assert_gaussian(wrong)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_seeds_and_realizations_are_uncorrelated(sampler):
    """Correlation of fields between seeds, and between realizations of one seed: zero by z over independent pairs."""
    one = scene(tilts=[0.0], shape=(3, 3))
    stacks = [sg.render(one, paths=300, seed=s, realizations=300, sampler=sampler).field[:, 0] for s in (0, 1, (0, 1))]
    pairs = [(stacks[0], stacks[1]), (stacks[0], stacks[2]), (stacks[0][0::2], stacks[0][1::2])]
    for a, b in pairs:
        product = (a.astype(complex) * b.conj()).mean(axis=(1, 2))
        assert_mean(np.stack([product.real, product.imag], 1), 0)
    intensity = [np.square(np.abs(s)).astype(float).mean(axis=(1, 2)) for s in stacks[:2]]
    assert_mean((intensity[0] - intensity[0].mean()) * (intensity[1] - intensity[1].mean()), 0)
    refute_mean(np.square(np.abs(stacks[0])).astype(float).mean(axis=(1, 2)), 0)


# ---- The promised error --------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize(("medium", "rel_error"), [(slab(1.0), 0.3), (slab(5.0, 0.8), 0.5)])
def test_the_promised_excess_correlation_is_kept(medium, rel_error):
    """Far-apart views have Cov(I1, I2)/(I1 I2) = Var w / (N (E w)^2) = expected_error^2 (docs/physics.md)."""
    realizations = 3000
    made = sg.plan(sparse_scene(medium), rel_error=rel_error)
    assert made.expected_error < made.image_error <= rel_error * 1.0001
    paths = int(np.ceil(made.paths * (made.expected_error / rel_error) ** 2))  # that leave it between far-apart views
    stack = sg.render(sparse_scene(medium), paths=paths, seed=3, realizations=realizations, sampler="paths")
    assert stack.report.sampler == "paths"
    assert stack.report.expected_error <= rel_error * 1.0001
    power = stack.intensity[:, 0].astype(float)
    first, second = power[:, :3].mean(axis=1), power[:, 3:].mean(axis=1)
    sums = np.stack([first * second, first, second, np.ones(realizations)], 1).reshape(100, -1, 4).sum(axis=1)
    # The spread itself: what the package states is wider, for the sake of heavy tails.
    total = sums.sum(axis=0)
    left = np.array([s[0] * s[3] / (s[1] * s[2]) - 1 for s in total - sums])
    excess = total[0] * total[3] / (total[1] * total[2]) - 1
    error = float(np.sqrt(99 / 100 * np.square(left - left.mean()).sum()))
    # The promise comes from 6000 pilot paths: its relative standard error is a few per cent, 10 % with its tail.
    promised = stack.report.expected_error**2
    assert_z(excess, promised, error, degrees=99, slack=0.1 * promised)
    with pytest.raises(AssertionError, match="z ="):  # a promise of half or twice the error is refused
        assert_z(excess, 2 * promised, error, degrees=99, slack=0.1 * promised)


FAINT = slab(0.02, 0.0, albedo=1e-3)  # scatters once, to 1e-5
FAINT_INTENSITY = 1e-3 / (4 * np.pi) * FAINT.optical_depth * WIDTH**2 * np.exp(-FAINT.optical_depth)
"""E|u|^2 is an area per steradian: Eq. 41, forward rho sigma_s A L e^-OD."""


def test_stationary_stacks_hold_mean_and_contrast_to_three_in_a_thousand():
    """Of 6.6 million independent speckles, every second view: standard errors of 4e-4, and 1e-4 of the 4000 paths."""
    grid = scene(tilts=[0.0], medium=FAINT, shape=(512, 512), pitch=0.5)
    moments = []
    for seed in range(4):
        stack = sg.render(grid, paths=4000, seed=seed, realizations=25, sampler="stationary")
        power = stack.intensity[:, 0, ::2, ::2].astype(float) / FAINT_INTENSITY
        moments += [[each.mean(), np.square(each).mean()] for each in power]
    mean, square = np.mean(moments, axis=0)
    found = np.array([mean, np.sqrt(square / mean**2 - 1)])
    error = np.hypot(1 / np.sqrt(power.size * 4), stack.report.expected_error)
    assert_z(found, 1.0, error)
    assert limit(2) * error < 0.003
    for wrong in ([1.005, 1.0], [1.0, 1.005]):
        refute_z(found * wrong, 1.0, error)


# ---- Purity --------------------------------------------------------------------------------------------
CASES = {
    "nufft": (scene(shape=(40, 41)), {"sampler": "paths"}), "direct": (sparse_scene(), {"sampler": "paths"}),
    "reversed": (scene(side="reflection"), {"reverse": True}), "stationary": (scene(), {"sampler": "stationary"}),
    "object": (
        scene().replace(illumination=sg.light.IncoherentObject(brightness=[[1.0, 0.0], [0.5, 2.0]], pitch=1e-5,
                                                               width=WIDTH)),
        {"sampler": "stationary"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_threads_and_the_number_of_realizations_do_not_matter(case):
    this, options = CASES[case]
    paths = 5000
    three = sg.render(this, paths=paths, seed=7, realizations=3, threads=1, **options)
    two = sg.render(this, paths=paths, seed=7, realizations=2, threads=2, **options)
    one = sg.render(this, paths=paths, seed=7, **options)
    assert three.intensity[:2].tobytes() == two.intensity.tobytes()
    assert two.intensity[0].tobytes() == one.intensity.tobytes()
    assert one.intensity.dtype == np.float32
    shape = this.sensor.shape if case == "object" else (len(this.beams.directions), *this.sensor.shape)
    assert one.intensity.shape == shape
    assert three.intensity.shape == (3, *shape)
    assert (sg.render(this, paths=paths, seed=8, **options).intensity != one.intensity).any()
    assert (three.intensity[0] != three.intensity[1]).any()
    if case != "object":
        assert one.field.dtype == np.complex64
        np.testing.assert_array_equal(one.intensity, one.field.real**2 + one.field.imag**2)


def test_chunks_join_as_one_bank(monkeypatch):
    this = sparse_scene()
    whole = sg.render(this, paths=3000, seed=1, sampler="paths").field
    monkeypatch.setattr(Chunks, "count", 5)
    parts = sg.render(this, paths=3000, seed=1, sampler="paths").field
    # Only the order of the float64 sums differs, and the rounding to complex64.
    np.testing.assert_allclose(parts, whole, rtol=1e-6, atol=1e-6 * np.abs(whole).max())


def test_nufft_and_direct_render_the_same_field(monkeypatch):
    this = scene(shape=(40, 41))
    by_nufft = sg.render(this, paths=2000, seed=1, sampler="paths")
    assert by_nufft.report.summation == "nufft"
    views = this.replace(sensor=sg.sensors.FarField(directions=this.sensor.directions))
    # The pilots of the two scenes have different keys and so different thresholds: share the grid's proposal.
    made = sg.plan(this, paths=2000, sampler="paths")
    from specklegen.paths.phases import random_phases
    from specklegen.paths.slab_tracer import trace

    bank = trace(this.medium, made.chosen.tracer.proposal, 1, 2000)
    layout = scene_layout(views)
    exact = direct(bank, layout, random_phases(bank, 1), views.sensor.directions.reshape(-1, 3))
    difference = by_nufft.field - exact.reshape(by_nufft.field.shape)
    assert np.linalg.norm(difference) < 1.5e-3 * np.linalg.norm(exact)


def test_a_plan_is_a_pure_function_and_says_what_it_does():
    this = scene()
    pilot.pilot_by_walk.cache_clear()
    first = sg.plan(this, paths=1000)
    pilot.pilot_by_walk.cache_clear()
    summation.scene_nufft.cache_clear()
    rule.scene_stationary_error.cache_clear()
    again = sg.plan(this, paths=1000)
    assert first.explain() == again.explain()
    assert first.chosen.pilot.tracer.proposal.threshold == again.chosen.pilot.tracer.proposal.threshold
    for word in ("Sampler", "reversed paths", "mean (ballistic) field", "stationary sampler", "MiB", "Ballistic"):
        assert word in first.explain()
    report = sg.render(this, paths=1000).report
    assert (report.sampler, report.paths, report.mean_added) == (first.sampler, 1000, False)
    assert report.decisions == first.decisions


# ---- The mean field ------------------------------------------------------------------------------------
@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_mean_field_carries_the_ballistic_power(profile):
    """The integral of |m|^2 over views is e^-OD times the power of the window, in area."""
    from specklegen.scene.window import Window

    this = scene(tilts=[0.0], shape=(801, 801), pitch=0.45, profile=profile)
    total = np.square(np.abs(sg.statistics.mean_field(this))).sum() * (0.45 * GRAIN) ** 2
    # The tails beyond 180 grains hold 2/(pi^2 180) of a square's power along each axis, and less of the others'.
    assert total == pytest.approx(Window(profile, WIDTH).area * np.exp(-2.0), rel=3e-3)


def test_mean_field_follows_the_tilt_and_is_dark_in_reflection():
    this = scene(tilts=[0.0, 3.0], shape=(1, 21), pitch=0.5)
    peaks = np.abs(sg.statistics.mean_field(this))[:, 0].argmax(axis=1)
    assert peaks.tolist() == [10, 16]
    assert not sg.statistics.mean_field(scene(side="reflection")).any()
    obliquely = sg.light.CollimatedBeams.tilts([1.0], width=WIDTH)
    there = sg.sensors.FarField(directions=obliquely.directions)
    power = np.abs(sg.statistics.mean_field(this.replace(illumination=obliquely, sensor=there))).item() ** 2
    # Unit irradiance per area of the face: power A e^{-OD/cos} through a face of projected area A cos.
    assert power == pytest.approx((WIDTH**2 / WAVELENGTH) ** 2 * np.cos(1.0) * np.exp(-2.0 / np.cos(1.0)), rel=1e-9)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_mean_is_added_only_when_asked(sampler):
    this = scene()
    without = sg.render(this, paths=500, seed=1, realizations=2, sampler=sampler)
    added = sg.render(this, paths=500, seed=1, realizations=2, sampler=sampler, mean=True)
    mean = sg.statistics.mean_field(this)
    np.testing.assert_allclose(added.field - without.field, np.stack([mean, mean]), atol=1e-6 * np.abs(mean).max())
    assert added.report.mean_added
    assert not without.report.mean_added
    said = next(v for v in without.report.decisions if v.part.startswith("mean"))
    assert "mean=True adds it" in said.reason


def test_no_warning_of_the_mean_where_it_is_weak():
    weak = scene(medium=slab(30.0), tilts=[0.0])
    strong = scene(medium=slab(10.0), tilts=[0.0])
    said = [next(v for v in sg.plan(s, paths=10).decisions if v.part.startswith("mean")).reason for s in (weak, strong)]
    peak = np.square(np.abs(sg.statistics.mean_field(weak))).max()
    assert "at most" in said[0], (said, peak)
    assert "mean=True adds it" in said[1]


def test_a_mean_at_a_later_tilt_is_warned_of():
    """The first tilt's beam passes beside the grid, the second one's straight through it."""
    this = scene(tilts=[-4000.0, 0.0], shape=(4, 4), medium=slab(10.0))
    reason = next(v for v in sg.plan(this, paths=10).decisions if v.part.startswith("mean")).reason
    assert "mean=True adds it" in reason


# ---- Gates ---------------------------------------------------------------------------------------------
def test_reversed_paths_take_part_only_near_backscattering():
    medium = slab(5.0)  # mean free path 20, k l = 251
    light = directions_of_sines("light", [[0.0, 0.0], [0.1, 0.0]])

    def needed(sines, sign=-1.0, tolerance=0.02):
        views = directions_of_sines("v", sines, sign)
        return reversal_decision(medium, WAVELENGTH, light, views, "auto", tolerance).needed

    # pi/2 / (k l |i + v|) of single scattering at large distances: 0.02 at |i + v| = 0.313, and a quarter more.
    assert needed([[0.0, 0.0]])
    assert needed([[0.28, 0.0]])
    assert needed([[-0.1 - 0.28, 0.0]])  # v = -i of the second light has sine -0.1
    assert not needed([[0.45, 0.0]])
    assert not needed([[-0.1 - 0.45, 0.0]])
    assert needed([[0.9, 0.0], [0.0, 0.0]])  # any view counts
    assert not needed([[0.28, 0.0]], tolerance=0.1)
    assert not needed([[0.0, 0.0]], sign=1.0)
    for asked in (True, False):
        views = directions_of_sines("v", [[0.0, 0.0]], -1.0)
        assert reversal_decision(medium, WAVELENGTH, light, views, asked, 0.02).needed is asked


def test_doubtful_assumptions_are_said():
    dense = scene(medium=slab(300.0))  # mean free path 0.33 below the wavelength 0.5
    assert "doubtful: the mean free path" in sg.plan(dense, paths=10).explain()
    narrow = scene(medium=slab(2.0, thickness=1e7))
    assert "diffraction of the beam" in sg.plan(narrow, paths=10).explain()
    assert "doubtful" not in sg.plan(scene(), paths=10).explain()


VERBS = {"render": lambda seen: sg.render(seen, paths=64, seed=0),
         "render_tiles": lambda seen: sg.results.render_tiles(seen, paths=64, seed=0),
         "render_partially_coherent": lambda seen: sg.coherence.render_partially_coherent(seen, 3 * WAVELENGTH / GRAIN,
                                                                                          paths=64),
         "transmission_matrix": lambda seen: sg.statistics.transmission_matrix(seen, paths=64),
         "covariance": lambda seen: sg.statistics.covariance(seen, pairs=[[0, 0, 0, 0]], paths=64),
         "covariance_blocks": lambda seen: sg.statistics.covariance_blocks(seen, rows=1, paths=64)}  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*standard errors rest on")
@pytest.mark.parametrize("verb", VERBS)
def test_a_window_that_diffraction_widens_is_warned_of(verb):
    """A beam of width W spreads by lambda L / W on its way, which no verb models; a wide one is said nothing of."""
    length = WIDTH**2 / WAVELENGTH
    media = (slab(2.0, thickness=length / n) for n in (9.9, 10.1))  # the bound is W^2 = 10 lambda L
    narrow, wide = (scene(tilts=[0.0], shape=(2, 2), medium=medium) for medium in media)
    with pytest.warns(sg.DoubtWarning, match="diffraction of the beam inside the slab"):
        VERBS[verb](narrow)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*diffraction of the beam")
        VERBS[verb](wide)


def test_paths_ended_early_are_reported(monkeypatch):
    pilot.pilot_by_walk.cache_clear()
    monkeypatch.setattr(proposal, "default_max_order", lambda medium: 3)
    report = sg.render(sparse_scene(slab(8.0)), paths=500, sampler="paths").report
    pilot.pilot_by_walk.cache_clear()
    assert 50 < report.unfinished <= 500


# ---- Errors --------------------------------------------------------------------------------------------
def test_a_grid_that_undersamples_is_refused_with_the_remedy():
    with pytest.raises(
        sg.RuleError, match=r"FarFieldGrid.pitch must be at most half the speckle size .*use a pitch <="
    ):
        sg.render(scene(pitch=0.6))
    # The remedy's own pitch is good.
    assert sg.plan(scene(pitch=0.5), paths=10).paths == 10


def test_an_object_has_no_field_and_says_why():
    this, options = CASES["object"]
    stack = sg.render(this, paths=500, **options)
    with pytest.raises(sg.RuleError, match=r"SpeckleStack.field .*IncoherentObject.*incoherent.*use \.intensity"):
        _ = stack.field
    assert_refused(lambda: sg.render(this, paths=500, mean=True), "mean must be False for an incoherent object")
    assert_refused(lambda: sg.statistics.mean_field(this), "mean_field scene.illumination must be CollimatedBeams")


# ---- Threads and forks ---------------------------------------------------------------------------------
def test_two_python_threads_may_render_at_once():
    jobs = [(case, seed) for seed in range(3) for case in ("nufft", "stationary", "object", "direct")]

    def job(what):
        case, seed = what
        this, options = CASES[case]
        return sg.render(this, paths=3000, seed=seed, threads=2, **options).intensity.tobytes()

    alone = [job(what) for what in jobs]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(job, jobs))
    assert together == alone


FORK = """
import numpy as np, torch, specklegen as sg
from torch.utils.data import DataLoader, Dataset

def scene(sampler):
    return sg.Scene(
        wavelength=0.5, medium=sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.media.Isotropic()),
        illumination=sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=4000.0),
        sensor=sg.sensors.FarField.grid(shape=(32, 33), pitch=6e-5),
    )

class Stacks(Dataset):
    def __len__(self):
        return 4
    def __getitem__(self, index):
        sampler = ("paths", "stationary")[index % 2]
        return sg.render(scene(sampler), paths=3000, seed=index, sampler=sampler, threads=2).intensity

if __name__ == "__main__":
    data = Stacks()
    parent = [data[n] for n in range(len(data))]          # two threads, in the parent, before the fork
    for context in ("fork",):
        loader = DataLoader(data, batch_size=None, num_workers=2, multiprocessing_context=context)
        for mine, theirs in zip(parent, loader, strict=True):
            assert np.array_equal(mine, np.asarray(theirs))
    print("done")
"""


def test_a_fork_after_a_parallel_render_completes(tmp_path):
    program = tmp_path / "fork.py"
    program.write_text(FORK)
    root = Path(sg.__file__).parents[1]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run([sys.executable, str(program)], env=os.environ | {"PYTHONPATH": path}, capture_output=True,
                          text=True, timeout=120)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "done"


def test_the_bounds_used_here_are_those_stated():
    """limit() at a false-alarm rate of 1e-6: 4.89 for one Gaussian, 5.4 for 64 batches (physics.md 5)."""
    assert limit() == pytest.approx(4.892, abs=1e-3)
    assert limit(degrees=63) == pytest.approx(5.4, abs=0.05)


def test_a_seed_names_a_medium_within_one_call():
    """What the docstring of render says: with one tilt more, path sums stay near, stationary stacks are others."""
    found = {}
    for sampler in ("paths", "stationary"):
        two, three = (
            sg.render(scene(tilts=tilts, shape=(32, 32)), paths=2000, sampler=sampler, seed=1).field[0]
            for tilts in ((0.0, 0.5), (0.0, 0.5, 1.0))
        )
        found[sampler] = abs(np.vdot(two, three)) / (np.linalg.norm(two) * np.linalg.norm(three))
    assert found["paths"] > 0.95
    assert found["stationary"] < 0.4


@pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")
def test_stationary_stacks_are_drawn_on_one_thread(monkeypatch):
    """Whatever torch is set to: its sums differ in the last bit between one thread and two."""
    seen = []
    draw = gaussian_noise.complex_normals

    def watched(*arguments):
        seen.append(torch.get_num_threads())
        return draw(*arguments)

    monkeypatch.setattr(stacks, "complex_normals", watched)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        many = sg.render(scene(), paths=2000, sampler="stationary", realizations=3, threads=1)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert seen == [1, 1, 1]
    assert many.field.shape[0] == 3
    alone = sg.render(scene(), paths=2000, sampler="stationary", threads=1)
    np.testing.assert_array_equal(many.field[0], alone.field)


def test_more_realizations_than_memory_holds_are_refused():
    """Before one is drawn: 1e9 of 512 views each; a raw MemoryError came when the first was there."""
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    assert_refused(lambda: sg.render(scene, realizations=10**9), "render realizations must be held within")
