"""Twelve combinations of features that few other tests hold together, beside a walk of their own (literal_walk.py)."""

import numpy as np
import pytest
from references.literal_walk import BATCHES, walk
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.synthesis.spectrum import estimate_spectral_correlation

WAVELENGTH = 1e-3
K = 2 * np.pi / WAVELENGTH
LAYERS = [(1.0, 2.0, 0.95, 0.8), (0.7, 2.0, 1.0, 0.0)]  # thickness, extinction, albedo, g
ASIDE = np.array([0.3, 0.2, np.sqrt(1 - 0.13)])
BACK = ASIDE * [1, 1, -1]
TILT, LOSS = 2e-4, 0.07  # of light; 2 k^2 D lag
FLOW = np.array([1.4, 0.6, -1.0])  # k V lag
OBLIQUE, SPECTRUM = 1.1, 0.6
CROSSED = 0.4 * TILT  # faint light


def layers(motions=(None, None), polarisation="scalar"):
    return sg.Layers([
        sg.media.Layer(thickness=depth, mean_free_path=1 / extinction, albedo=albedo, motion=motion,
                       scatterer=sg.media.HenyeyGreenstein(g))
        for (depth, extinction, albedo, g), motion in zip(LAYERS, motions, strict=True)
    ], polarisation=polarisation)  # fmt: skip


def box(motion):
    return sg.media.Box(lower=[-1.5, -1.5, 0.0], upper=[1.5, 1.5, 2.0], mean_free_path=1.0, albedo=0.9, motion=motion,
                        scatterer=sg.media.HenyeyGreenstein(0.6))  # fmt: skip


BOX = [(2.0, 1.0, 0.9, 0.6)]


def brownian(loss):
    """Of a lag of 1."""
    return sg.media.Brownian(diffusion=loss / (2 * K**2))


def drift(flow):
    return sg.media.Drift(velocity=flow / K)


def row(flow, shear=0.0):
    return [*flow, shear]


def turned(view, tilt):
    """Wavenumber times the change of light and view."""
    sine, side = np.sin(tilt), np.sign(view[2])
    moved = view[:2] + [sine, 0.0]
    light = np.array([sine, 0.0, np.cos(tilt) - 1.0])
    return {"d_in": K * light, "d_out": K * (np.array([*moved, side * np.sqrt(1 - moved @ moved)]) - view)}


def across(view):
    """x and y, turned as the axis is, the shortest way into a view (to either side)."""
    x, y, z = view * np.sign(view[2])
    return np.array([[1 - x * x / (1 + z), -x * y / (1 + z), -x], [-x * y / (1 + z), 1 - y * y / (1 + z), -y]])


def memory(medium, view, tilt=TILT, **options):
    """C_I, its error and K at shares of one tilt."""

    def found(shares, **budget):
        curve = sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=shares * tilt, view=view, reverse=False,
                                 mode="transmission" if view[2] > 0 else "reflection", **options, **budget)  # fmt: skip
        return curve.intensity, curve.standard_error, curve.field

    return found


def time(medium, view, tilt=0.0, **options):
    def found(shares, **budget):
        curve = sg.statistics.temporal_correlation(
            medium, wavelength=WAVELENGTH, lags=shares, tilts=shares * tilt, view=view, reverse=False,
            mode="transmission" if view[2] > 0 else "reflection", **options, **budget)  # fmt: skip
        return curve.intensity, curve.standard_error, curve.field

    return found


def plain(parts, paths, view, **options):
    """C_I, its error and K of the walk."""
    sums, *_ = walk(parts, paths, 1, view=view, **options)
    (value,), (error,) = jackknife(sums[:, :2], lambda total: np.square(np.abs(total[1:] / total[0])))
    total = sums.sum(axis=0)
    return value, error, total[1] / total[0]


def polarised(paths, view, seen, **options):
    return plain(LAYERS, paths, view, field=(1, 0, 0), analyser=across(view)[seen], **options)


def contrast(medium):
    """Contrast in light of a Gaussian spectrum; its error from sixteen seeds."""

    def found(shares, paths, seed, threads):
        n = 16
        some = [estimate_spectral_correlation(medium, paths // n, n * seed + m, threads=threads) for m in range(n)]
        values = np.square([[each.contrast(share * SPECTRUM) for share in shares] for each in some])
        return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(n), np.ones(len(shares))

    return found


def plain_contrast(paths):
    """The same: the mean of |C|^2 over differences of the wavenumber."""
    place, weight = np.polynomial.hermite_e.hermegauss(20)
    spread = SPECTRUM / (2 * np.sqrt(np.log(2)))
    sums, *_ = walk(LAYERS, paths, 1, dk=spread * place)

    def squared(total):
        return np.array([np.square(np.abs(total[2:] / total[0])) @ weight / weight.sum()])

    (value,), (error,) = jackknife(sums, squared)
    return value, error, 1.0


def energy(shares, **budget):
    """Light let through at an angle, over that sent back."""
    found = [sg.statistics.reflectance_transmittance(layers(), angle=each * OBLIQUE, **budget) for each in shares]
    ratio = np.array([each.transmittance / each.reflectance for each in found])
    error = [np.hypot(each.transmittance_error / each.transmittance, each.reflectance_error / each.reflectance)
             for each in found]  # fmt: skip
    return ratio, ratio * error, np.ones(len(shares))


def plain_energy(paths):
    _, left, _ = walk(LAYERS, paths, 1, light=(np.sin(OBLIQUE), 0.0, np.cos(OBLIQUE)))
    (value,), (error,) = jackknife(left, lambda total: total[1:] / total[0])
    return value, error, 1.0


def mueller(shares, **budget):
    """Shares of M_11 / M_00 of light sent back aside."""
    found = sg.statistics.mueller_matrix(layers(polarisation="projector"), wavelength=WAVELENGTH, mode="reflection",
                                         view=BACK, reverse=False, **budget)  # fmt: skip
    one = np.ones(len(shares))
    return shares * found.matrix[1, 1] / found.matrix[0, 0], found.standard_error[1, 1] / found.matrix[0, 0] * one, one


def plain_mueller(paths):
    _, _, passed = walk(LAYERS, paths, 1, view=BACK, field=np.eye(3)[:2], analyser=across(BACK))
    sums = np.stack([passed.sum(axis=(1, 2)), np.einsum("bij,i,j->b", passed, [1, -1], [1, -1])], axis=1)
    (value,), (error,) = jackknife(sums, lambda total: total[1:] / total[0])
    return value, error, 1.0


POLARISED = layers(polarisation="projector")
AWAKE = (brownian(LOSS), brownian(3 * LOSS))
LOSSES = (LOSS, 3 * LOSS)
CASES = {
    "tilts of absorbing layers seen aside": (
        memory(layers(), ASIDE), lambda n: plain(LAYERS, n, ASIDE, **turned(ASIDE, TILT))),
    "tilts of absorbing layers sent back aside": (
        memory(layers(), BACK), lambda n: plain(LAYERS, n, BACK, **turned(BACK, TILT))),
    "layers of unlike diffusion sent back aside": (
        time(layers(AWAKE), BACK), lambda n: plain(LAYERS, n, BACK, loss=LOSSES)),
    "times and tilts at once, seen aside": (
        time(layers(AWAKE), ASIDE, tilt=TILT), lambda n: plain(LAYERS, n, ASIDE, loss=LOSSES, **turned(ASIDE, TILT))),
    "a sheared layer under one at rest, sent back aside": (
        time(layers((None, sg.media.Shear(rate=1.5 / K))), BACK),
        lambda n: plain(LAYERS, n, BACK, flow=[row([0, 0, 0]), row([0, 0, 0], 1.5)])),
    "a drifting layer under a diffusing one, seen aside": (
        time(layers((brownian(LOSS), drift(FLOW))), ASIDE),
        lambda n: plain(LAYERS, n, ASIDE, loss=(LOSS, 0.0), flow=[row([0, 0, 0]), row(FLOW)])),
    "tilts of polarised absorbing layers sent back aside, crossed": (
        memory(POLARISED, BACK, CROSSED, channel="crossed"), lambda n: polarised(n, BACK, 1, **turned(BACK, CROSSED))),
    "times of polarised absorbing layers sent back aside, along": (
        time(layers(AWAKE, "projector"), BACK, channel="co"), lambda n: polarised(n, BACK, 0, loss=LOSSES)),
    "Mueller matrix of absorbing layers sent back aside": (mueller, plain_mueller),
    "a sheared absorbing box seen aside": (
        time(box(sg.media.Shear(rate=0.8 / K)), ASIDE),
        lambda n: plain(BOX, n, ASIDE, half=1.5, flow=[row([0, 0, 0], 0.8)])),
    "contrast behind absorbing layers": (contrast(layers()), plain_contrast),
    "oblique light through absorbing layers": (energy, plain_energy),
}


PATHS, FEWER = 200_000, 50_000
CAUGHT = {
    "tilts of absorbing layers seen aside": (0.06, PATHS, 0.01, 5.3, 6.9),
    "tilts of absorbing layers sent back aside": (0.1, PATHS, 0.03, 3.2, 6.4),
    "layers of unlike diffusion sent back aside": (0.06, PATHS, 0.01, 5.3, 5.2),
    "times and tilts at once, seen aside": (0.06, PATHS, 0.01, 5.6, 8.0),
    "a sheared layer under one at rest, sent back aside": (0.06, PATHS, 0.01, 7.8, 6.5),
    "a drifting layer under a diffusing one, seen aside": (0.06, PATHS, 0.03, 0.8, 1.6),
    "tilts of polarised absorbing layers sent back aside, crossed": (0.2, PATHS, 0.05, 3.2, 6.4),
    "times of polarised absorbing layers sent back aside, along": (0.1, PATHS, 0.03, 3.2, 6.4),
    "Mueller matrix of absorbing layers sent back aside": (0.1, PATHS, 0.03, 3.2, 6.4),
    "a sheared absorbing box seen aside": (0.04, FEWER, 0.01, 0.8, 2.0),
    "contrast behind absorbing layers": (0.06, PATHS, 0.03, 0.8, 1.6),
    "oblique light through absorbing layers": (0.04, FEWER, 0.01, 1.0, 2.0),
}
"""Relative error, of the tilt, time, width of a spectrum, angle or element, that the fast test catches, and its paths
(the walk takes twice as many); that of the weekly test, and millions of paths of the engine and of the walk.

Where 1 % is caught, both share the time so that their errors together are least. For all to catch 1 % would take some
35 CPU minutes, half of them behind crossed polarisers.
"""


def require_agreement(name, caught, paths, photons):
    """C_I, and the sign of K's phase where it has one; a share more of what changes it is caught."""
    found, walked = CASES[name]
    value, error, field = found(np.array([1.0, 1 + caught, 1 - caught]), paths=paths, seed=1, threads=1)
    expected, noise, by_hand = walked(photons)
    both = np.hypot(error, noise)
    assert_z(value[0], expected, both[0], degrees=BATCHES - 1)
    assert abs(np.angle(field[0] / by_hand)) < 0.15
    for wrong in (1, 2):
        refute_z(value[wrong], expected, both[wrong], degrees=BATCHES - 1)


@pytest.mark.parametrize("name", CASES)
def test_a_literal_walk_agrees(name):
    caught, paths, *_ = CAUGHT[name]
    require_agreement(name, caught, paths, 2 * paths)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_long_literal_walk_agrees(name):
    *_, caught, paths, photons = CAUGHT[name]
    require_agreement(name, caught, int(1e6 * paths), int(1e6 * photons))
