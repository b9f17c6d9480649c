"""Films of a medium that moves, by path sums and by the stationary sampler, against temporal_correlation."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.kernels.displacements import COLUMNS, add_step
from specklegen.memory_effects.film import causal_root
from specklegen.paths.displacements import film_roots, frames
from specklegen.paths.tracer import scene_tracer
from specklegen.planning.planning import Options, planned

K = 2 * np.pi
FLUID = sg.Brownian(diffusion=1 / K**2)  # of wavelength 1: times are x
LOBE = sg.HenyeyGreenstein(0.5)
THIN = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=FLUID)
WIDE = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=FLUID)
TIMES = np.array([0.0, 0.02, 0.1, 0.3])


def film(times=TIMES, medium=THIN, width=200.0, shape=(16, 16), pitch=0.002, sines=None, **view):
    tilts = np.zeros(len(times)) if sines is None else np.arcsin(sines)
    beams = sg.CollimatedBeams.tilts(tilts, width=width, times=times)
    grid = sg.FarField.grid(shape, pitch, **view)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=beams, sensor=grid)


def correlated(fields):
    """g1 of frames complex[R, T, ...] with the first one, and its standard error, both [T - 1]."""
    u = fields.astype(complex).reshape(*fields.shape[:2], -1)
    t = u.shape[1]
    sums = np.concatenate([(u[:, :1].conj() * u).sum(-1), np.square(np.abs(u)).sum(-1)], axis=1)
    value, error = jackknife(sums, lambda s: (s[:t] / np.sqrt(s[t:] * s[t]).real).real)
    return value[1:], error[1:]


def expected(medium, times=TIMES, **asked):
    found = sg.temporal_correlation(medium, wavelength=1.0, lags=times, paths=20_000, seed=9, **asked)
    return found.field.real[1:], (found.standard_error / 2 / np.abs(found.field))[1:]


BOX = sg.Box(lower=[-100, -100, 0], upper=[100, 100, 10], mean_free_path=5.0, scatterer=LOBE, motion=FLUID)
STILL, MOVING = (sg.Layer(thickness=5.0, mean_free_path=5.0, scatterer=LOBE, motion=m) for m in (None, FLUID))
GRID = sg.VoxelGrid(lower=[-100, -100, 0], upper=[100, 100, 10], extinction=np.full((2, 1, 1), 0.2),
                    material=[[[0]], [[1]]], scatterers=[LOBE, LOBE], motion=(None, FLUID))  # fmt: skip
SLOW = np.array([0.0, 0.1, 0.5, 2.0])
SMALL = {"times": SLOW, "width": 60.0, "shape": (8, 8), "pitch": 0.005, "center": (0.2, 0.0)}
CASES = {
    "slab": (film(), THIN), "off the axis": (film(center=(0.3, 0.0)), THIN),
    "faces": (film(medium=THIN.replace(faces=sg.Faces(inside=1.33))), THIN.replace(faces=sg.Faces(inside=1.33))),
    "box": (film(medium=BOX, **SMALL), sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=LOBE, motion=FLUID)),
    "voxels": (film(medium=GRID, **SMALL), sg.Layers(layers=[STILL, MOVING])),
    "layers": (film(medium=sg.Layers(layers=[STILL, MOVING]), **SMALL), sg.Layers(layers=[STILL, MOVING])),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_frames_by_path_sums_forget_as_the_medium_does(name):
    scene, medium = CASES[name]
    stack = sg.render(scene, sampler="paths", paths=1000, seed=2, realizations=40, reverse=False)
    g1, error = correlated(stack.field)
    right, its = expected(medium, scene.beams.times, view=scene.sensor.center_direction)
    assert_z(g1, right, np.hypot(error, its), degrees=39)


def test_the_comparison_has_power():
    scene, _ = CASES["slab"]
    g1, error = correlated(sg.render(scene, sampler="paths", paths=1000, seed=2, realizations=40, reverse=False).field)
    right, its = expected(THIN, 1.6 * TIMES)
    refute_z(g1, right, np.hypot(error, its), degrees=39)


def test_both_ways_of_a_path_move_together():
    """At exact backscattering, where the beam is much wider than the slab is thick."""
    medium = sg.Slab(thickness=5.0, mean_free_path=5.0, scatterer=sg.Isotropic(), motion=FLUID)
    scene = film([0.0, 0.05, 0.2], medium, 200.0, (1, 1), 0.002, side="reflection")
    stack = sg.render(scene, sampler="paths", paths=150, seed=2, realizations=250, reverse=True)
    g1, error = correlated(stack.field)
    right, its = expected(medium, np.array([0.0, 0.05, 0.2]), view=[0, 0, -1.0], mode="reflection", reverse=True)
    assert_z(g1, right, np.hypot(error, its))


def test_flatland_keeps_4_d_tau():
    """Single scattering at 90 degrees and nothing else: e^(-2 x)."""
    thin = sg.Box(lower=[-20.0, 0.0], upper=[20.0, 0.02], mean_free_path=10.0, scatterer=sg.Isotropic(), motion=FLUID)
    beams = sg.CollimatedBeams(directions=[[0.0, 1.0]] * 3, width=20.0, times=[0.0, 0.1, 0.4])
    angles = np.deg2rad(np.linspace(88, 92, 3))
    views = np.stack([np.sin(angles), np.cos(angles)], -1)
    scene = sg.Scene(wavelength=1.0, medium=thin, illumination=beams, sensor=sg.FarField(directions=views))
    g1, error = correlated(sg.render(scene, sampler="paths", paths=100, seed=3, realizations=400).field)
    assert_z(g1, np.exp(-2 * np.array([0.1, 0.4])), error, slack=0.01)


@pytest.mark.parametrize("sampler", ["paths", "stationary"])
def test_a_longer_film_keeps_its_frames_and_the_first_is_the_medium_at_rest(sampler):
    medium, grid = (THIN, {}) if sampler == "paths" else (WIDE, {"width": 20_000.0, "pitch": 2.5e-5})
    asked = {"sampler": sampler, "paths": 2000, "seed": 1}
    short = sg.render(film(TIMES, medium, **grid), **asked).field
    longer = sg.render(film([*TIMES, 0.5, 0.5], medium, **grid), **asked).field
    np.testing.assert_allclose(longer[:4], short, atol=1e-6 * np.abs(short).max())  # sums are grouped otherwise
    np.testing.assert_allclose(longer[5], longer[4], atol=1e-6 * np.abs(short).max())
    still = film([0.0], medium.replace(motion=FLUID), **grid)
    still = still.replace(medium=medium.replace(motion=None), illumination=still.beams.replace(times=None))
    np.testing.assert_array_equal(sg.render(still, **asked).field[0], short[0])


@pytest.mark.parametrize("sampler", ["paths", "stationary"])
def test_at_one_time_the_bits_are_those_of_rest(sampler):
    medium, grid = (THIN, {}) if sampler == "paths" else (WIDE, {"width": 20_000.0, "pitch": 2.5e-5})
    scene = film([3.0, 3.0], medium, sines=[0.0, grid.get("pitch", 0.002)], **grid)
    rest = scene.replace(medium=medium.replace(motion=None), illumination=scene.beams.replace(times=None))
    asked = {"sampler": sampler, "paths": 1000, "seed": 1}
    np.testing.assert_array_equal(sg.render(scene, **asked).field, sg.render(rest, **asked).field)


def test_realizations_and_tiles_are_those_of_the_whole():
    scene = film()
    whole = sg.render(scene, sampler="paths", paths=500, seed=1, realizations=2).field
    np.testing.assert_array_equal(sg.render(scene, sampler="paths", paths=500, seed=1).field, whole[0])
    chosen = planned(scene, sg.Budget(paths=500), Options("paths")).chosen
    pieces = np.zeros_like(whole[0])
    for where, part in chosen.prepare(1, 1).fields(0):
        pieces[where] = part
    np.testing.assert_allclose(pieces, whole[0], atol=1e-6 * np.abs(whole).max())


def test_the_transform_and_the_direct_sum_draw_one_film():
    scene = film(center=(0.1, 0.0))
    chosen = planned(scene, sg.Budget(paths=1000), Options("paths")).chosen
    assert chosen.nufft is not None
    direct = replace(chosen, work=replace(chosen.work, nufft=None))
    fast, slow = (next(iter(each.prepare(1, 1).media(1))).image for each in (chosen, direct))
    for one, other in zip(fast, slow, strict=True):
        assert np.abs(one - other).std() < 2e-3 * np.abs(other).std()  # field_tolerance, and a tile's curvature


def test_frames_of_the_stationary_sampler_forget_as_the_medium_does_tilts_and_all():
    """Frames that are tilted too, seen where their pattern has moved to, have K(q, x) and no product."""
    pitch, step, times = 2.5e-5, 4, np.array([0.0, 0.5, 1.5, 4.0])
    for sines in (np.zeros(4), np.arange(4) * step * pitch):
        scene = film(times, WIDE, 20_000.0, (48, 64), pitch, sines)
        stack = sg.render(scene, seed=3, paths=40_000, realizations=12)
        assert stack.report.sampler == "stationary"
        moved = int(sines.any()) * step
        seen = np.stack([stack.field[:, t, :, t * moved : t * moved + 48] for t in range(4)], axis=1)
        g1, error = correlated(seen)
        found = sg.temporal_correlation(WIDE, wavelength=1.0, lags=times, tilts=np.arcsin(sines), paths=40_000, seed=4)
        its = np.hypot(found.standard_error / 2 / np.abs(found.field), 0.01)[1:]  # and that of the sampler's own paths
        assert_z(g1, found.field.real[1:], np.hypot(error, its), degrees=11)


SHIFTS, LONG = 4 * np.array([0, 0, 5, 7]), np.array([0.0, 0.5, 2.0, 4.0])
"""Pixels by which tilts move the pattern of frames, and their times."""
PITCH, PAIRS = 2.5e-5, np.triu_indices(4, 1)


def tilting(sampler, paths):
    """A film whose frames are tilted too, each seen where its pattern has moved to, complex[R, T, V] of power 1."""
    scene = film(LONG, WIDE, 20_000.0, (48, 76), PITCH, SHIFTS * PITCH)
    u = sg.render(scene, sampler=sampler, seed=3, paths=paths, realizations=64, reverse=False).field
    seen = np.stack([u[:, t, :, by : by + 48] for t, by in enumerate(SHIFTS)], axis=1).astype(complex)
    return seen.reshape(64, 4, -1) / np.sqrt(np.square(np.abs(seen)).mean((0, 2, 3)))[:, None]


def matrices(u):
    """E[u_a* u_b] of every realization, complex[R, T, T]."""
    return np.einsum("rav,rbv->rab", u.conj(), u) / u.shape[-1]


def test_both_samplers_draw_one_film():
    """K(q, x) between all frames by path sums and by the stationary sampler; K(q) g1(x) is another law, and told."""
    both = [matrices(tilting(*each)).real[(..., *PAIRS)] for each in (("paths", 8000), ("stationary", 40_000))]
    (paths, error), (classes, its) = ((k.mean(0), k.std(0, ddof=1) / 8) for k in both)
    assert_z(paths, classes, np.hypot(error, its), degrees=63)
    lags, tilts = np.abs(LONG - LONG[:, None])[PAIRS], np.arcsin(PITCH * np.abs(SHIFTS - SHIFTS[:, None]))[PAIRS]

    def law(lags, tilts):
        found = sg.temporal_correlation(WIDE, wavelength=1.0, lags=lags, tilts=tilts, paths=40_000, seed=4)
        return found.field.real, found.standard_error / 2 / np.abs(found.field)

    right, noise = law(lags, tilts)
    (time, late), (tilt, aside) = law(lags, np.zeros(6)), law(np.zeros(6), tilts)
    for k, e in ((paths, error), (classes, its)):
        assert_z(k, right, np.hypot(e, noise), degrees=63)
        refute_z(k, time * tilt, np.hypot(e, np.hypot(late, aside)), degrees=63)


def fourth_cumulants(u):
    """E[u_a u_b* u_c u_d*] less both products of pairs, 0 of joint Gaussian frames: value, 0, error, [T, T, T, T]."""
    two = matrices(u)
    four = np.array([np.einsum("av,bv,cv,dv->abcd", w, w.conj(), w, w.conj(), optimize=True) for w in u]) / u.shape[-1]
    sums = np.concatenate([two.reshape(len(u), -1), four.reshape(len(u), -1), np.ones((len(u), 1))], axis=1)

    def cumulants(total):
        k, m = (total[:16] / total[-1]).reshape(4, 4), (total[16:-1] / total[-1]).reshape(4, 4, 4, 4)
        return (m - np.einsum("ba,dc->abcd", k, k) - np.einsum("da,bc->abcd", k, k)).real

    value, error = jackknife(sums, cumulants)
    return value, 0.0, error


@pytest.mark.parametrize(("sampler", "paths"), [("paths", 8000), ("stationary", 40_000)])
def test_frames_are_jointly_gaussian_across_times_and_tilts(sampler, paths):
    """All 256 joint cumulants of fourth order vanish; of frames whose pixels jump or stay they do not."""
    u = tilting(sampler, paths)
    assert_z(*fourth_cumulants(u), degrees=63)
    jumps = np.where(np.random.default_rng(1).random(u.shape) < 0.7, u[:, :1], np.roll(u, 1, axis=0))
    refute_z(*fourth_cumulants(jumps), degrees=63)


def test_a_causal_root_of_a_correlation():
    rng = np.random.default_rng(1)
    some = rng.normal(size=(6, 4)) + 1j * rng.normal(size=(6, 4))
    some[3] = some[1]  # a frame that another determines
    matrix = some @ some.conj().T
    root = causal_root(matrix)
    np.testing.assert_allclose(root @ root.conj().T, matrix, atol=1e-9)
    assert not np.triu(root, 1).any()
    np.testing.assert_array_equal(causal_root(matrix[:4, :4]), root[:4, :4])


def test_steps_are_normal_and_addressed():
    paths, orders = np.arange(20_000), np.full(20_000, 3, np.int32)
    out = np.zeros((20_000, COLUMNS))
    add_step(1, 2, 0, orders, paths, 2.0, out)
    assert_z(out.mean(0), 0.0, 2 / np.sqrt(20_000))
    assert_z(np.cov(out.T), 4 * np.eye(COLUMNS), 4 * np.sqrt(2 / 20_000))
    some = np.zeros((10, COLUMNS))
    add_step(1, 2, 0, orders[:10], paths[50:60], 2.0, some)
    np.testing.assert_array_equal(some, out[50:60])


def test_ends_move_by_the_law():
    """Both ends by 2 x along each axis, and what is between them by 4 x Y; 5 % less would be seen."""
    tracer = scene_tracer(film(), False)
    bank, roots = tracer.trace(1, 50_000).multiple, film_roots(film())
    *_, moved = frames(tracer.layout, bank, roots, TIMES, 3, 0)
    x, turned = TIMES[-1], bank.transfer > 0
    between = moved.between[turned, None] / np.sqrt(2 * bank.transfer[turned, None])
    for walked in (moved.first, moved.last, between):
        squares = np.square(walked).mean(axis=1)
        assert_mean(squares, 2 * x)
        refute_mean(squares, 1.9 * x)
