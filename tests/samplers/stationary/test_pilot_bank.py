"""The pilot that judges the stationary model: its sums against literal ones, and a glance against many paths."""

from dataclasses import replace

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.statistics import batch_sums
from specklegen.paths.endpoint_factors import contributions_of_pairs, multiple_amplitudes, single_amplitudes
from specklegen.paths.kept_angles import advance, depth_between
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.stationary import stationarity
from specklegen.samplers.stationary.pilot_bank import Pair, PilotBank, keeps_angle
from specklegen.samplers.stationary.stationarity import pilot_error
from specklegen.scene.illumination import directions_of_sines

PATHS = 512


def scene(scatterer, tilt=1e-4, pitch=2e-5, aside=0.2, **fields):
    medium = sg.Slab(thickness=100.0, mean_free_path=25.0, scatterer=scatterer, **fields)
    light = sg.CollimatedBeams.tilts(aside + np.arange(3) * tilt, width=2000.0)
    sensor = sg.FarField.grid((16, 16), pitch, center=(0.15, -0.1))
    return sg.Scene(wavelength=0.5, medium=medium, illumination=light, sensor=sensor)


def axial(scatterer):
    medium = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=scatterer)
    light = sg.CollimatedBeams.tilts(np.arange(3) * 2e-4, width=2e4)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sg.FarField.grid((80, 80), 1e-5))


SCENES = {"oblique": scene(sg.HenyeyGreenstein(0.8)), "absorbing": scene(sg.Isotropic(), albedo=0.9),
          "faces": scene(sg.HenyeyGreenstein(0.5), faces=sg.Faces(inside=1.4)),
          "mixture": scene(sg.Mixture(types=(sg.HenyeyGreenstein(0.8), sg.Isotropic()), fractions=(0.6, 0.4))),
          "narrow": scene(sg.VonMisesFisher(300.0), tilt=0.03, aside=0.0)}  # fmt: skip


def bank_of(some):
    return PilotBank(some, slab_tracer(some, False, aside=False), 7, PATHS)


def weights(bank, light, view):
    """|amplitude|^2 float64[M] of connections, singles and the others, in their order."""
    layout, found = replace(bank._layout.at(light, view), middle=None), np.empty(len(bank.bank))
    once = bank.bank.orders == 1
    found[once] = np.square(np.abs(single_amplitudes(layout, bank.bank.single)[0]))
    many = multiple_amplitudes(layout, bank.bank.multiple, bidirectional=False, reverse=False)
    found[~once] = np.square(np.abs(many[0]))
    return found


@pytest.mark.parametrize("name", SCENES)
def test_correlations_are_those_of_each_connection(name):
    """Of five pairs of waves, in blocks; a depth that is forgotten is seen."""
    bank = bank_of(SCENES[name])
    some, drawn = bank.scene, np.random.default_rng(3)
    tilt = np.array([0.03, 0.01]) if name == "narrow" else np.array([2e-3, -1e-3])
    kept = keeps_angle(some, np.hypot(*tilt))
    assert kept == (name == "narrow")
    pairs = [Pair(view, view - tilt - 1e-4 * n, tilt, kept) for n, view in enumerate(drawn.uniform(-0.2, 0.2, (5, 2)))]
    exact, one, two = bank.correlations(pairs)
    paths, wavenumber = bank.bank, some.wavenumber
    for n, (view, other, _, _) in enumerate(pairs):
        here, there = (directions_of_sines("view", sines, some.side) for sines in (view, other))
        tilted = directions_of_sines("light", bank.light[:2] - tilt)
        first, second = (weights(bank, bank.light, each) for each in (here, here if kept else there))
        way = (paths.exit - [0, 0, 100.0]) @ (there - here) + paths.entry @ (bank.light - tilted)
        # The window's part, of the entrance, is not among them: both waves lose tilt and mismatch alike there.
        way -= paths.entry[:, :2] @ (there - here + bank.light - tilted)[:2]
        if kept:
            way -= advance(bank.light, tilted) * depth_between(bank._layout, paths)
        literal = np.sqrt(first * second) * np.exp(1j * wavenumber * way)
        for found, expected in ((exact, literal), (one, first), (two, second)):
            sums = batch_sums(expected, paths.paths, PATHS)
            np.testing.assert_allclose(found[:, n], sums, rtol=1e-9, atol=1e-9 * np.abs(expected).sum())
        wrong = batch_sums(literal * np.exp(1j * wavenumber * 1e-4 * paths.entry[:, 2]), paths.paths, PATHS)
        assert np.abs(exact[:, n] - wrong).max() > 1e-5 * np.abs(exact[:, n]).max()


@pytest.mark.parametrize("name", SCENES)
def test_intensities_are_those_of_each_connection(name):
    bank = bank_of(SCENES[name])
    lights = np.array([bank.light[:2], bank.light[:2], bank.light[:2] + 0.04, bank.light[:2] - 1e-3])
    views = np.array([[0.1, 0.0], [0.15, -0.1], [0.1, 0.0], [0.2, 0.1]])
    found = bank.intensities(lights, views)
    for n, (light, view) in enumerate(zip(lights, views, strict=True)):
        moved = light if not bank.is_rigid_shift(light) else bank.light[:2]
        view = directions_of_sines("view", view - (light - moved), bank.scene.side)
        literal = weights(bank, directions_of_sines("light", moved), view)
        sums = batch_sums(literal, bank.bank.paths, PATHS).real
        np.testing.assert_allclose(found[:, n], sums, rtol=1e-9, atol=1e-9 * literal.sum())


def test_contributions_of_pairs_are_powers_of_amplitudes():
    for some in SCENES.values():
        tracer = slab_tracer(some, False)
        bank, layout = tracer.trace(3, 64).multiple, tracer.layout.probed()
        found = contributions_of_pairs(layout, bank).reshape(len(layout.lights) * len(layout.views), -1)
        amplitudes = multiple_amplitudes(replace(layout, middle=None), bank, bidirectional=False, reverse=False)
        np.testing.assert_allclose(found, np.square(np.abs(amplitudes)), rtol=1e-12)


def test_a_glance_decides_where_the_answer_is_clear(monkeypatch):
    """As more paths do; where it is not, they are asked."""
    counts, plain = [], stationarity.pilot_error

    def noted(some, tracer, paths, **named):
        counts.append(paths)
        return plain(some, tracer, paths, **named)

    monkeypatch.setattr(stationarity, "pilot_error", noted)
    for scatterer in (sg.HenyeyGreenstein(0.8), sg.Isotropic()):
        some = axial(scatterer)
        tracer = slab_tracer(some, False, aside=False)
        glance = plain(some, tracer, stationarity.GLANCE_PATHS, every=True)
        many = plain(some, tracer, stationarity.FIRST_PATHS)
        width = 6 * max(glance.correlation_error, glance.intensity_error)
        for tolerance, asked in (
            (glance.largest + width, [stationarity.GLANCE_PATHS]),
            (glance.largest - width, [stationarity.GLANCE_PATHS]),
            (glance.largest, [stationarity.GLANCE_PATHS, stationarity.FIRST_PATHS]),
        ):
            counts.clear()
            found = stationarity.stationary_error(some, tracer, tolerance, most=stationarity.FIRST_PATHS, glance=True)
            assert counts == asked, (scatterer, tolerance)
            assert tolerance == glance.largest or found.accepts(tolerance) == many.accepts(tolerance)


def test_a_glance_counts_beams_that_it_cannot_know():
    """Light of narrow lobes is not taken for even by too few paths to see that it is not."""
    some = SCENES["narrow"]
    tracer = slab_tracer(some, False, aside=False)
    every, seen = (pilot_error(some, tracer, 1024, every=each) for each in (True, False))
    assert every.intensity >= seen.intensity
