"""Paths that are drawn across an absorbing slab: the same light, next to no variance, from another random walk."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.core.statistics import BATCHES, batch_sums
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.paths import slab_tracer, stretching
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.paths.slab_tracer import events_across, stretches
from specklegen.paths.stretching import decay, relative_variance, stretch_along
from specklegen.paths.tracer import plane_tracer


def slab(albedo: float, optical_depth: float, g: float = 0.0, scatterer: sg.Scatterer | None = None) -> sg.Slab:
    scatterer = scatterer or (sg.HenyeyGreenstein(g=g) if g else sg.Isotropic())
    return sg.Slab(thickness=25.0 * optical_depth, mean_free_path=25.0, albedo=albedo, scatterer=scatterer)


def light(medium: sg.Slab, paths: int, seed: int = 3, view=AXIS, entering=AXIS) -> np.ndarray:
    """Light behind a slab per area and steradian, means of 64 batches; and its relative variance a path."""
    tracer = plane_tracer(medium, 1.0, np.atleast_2d(entering), np.atleast_2d(view), False)
    tracer = replace(tracer, proposal=replace(tracer.proposal, reference=np.asarray(entering)))
    bank = tracer.trace(seed, paths)
    assert bank.unfinished == 0
    return batch_sums(contributions(tracer.layout, bank), bank.paths, paths).real * BATCHES / paths


def relative(batches: np.ndarray, paths: int) -> float:
    return float(batches.var(ddof=1) / batches.mean() ** 2 * paths / BATCHES)


def unit(*vector: float) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


# ---- The mode ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("albedo", [0.3, 0.5, 0.9, 0.99])
def test_isotropic_light_falls_as_the_closed_form_says(albedo):
    """nu solves albedo/nu artanh(nu) = 1."""
    nu = decay(slab(albedo, 1.0))
    assert albedo / nu * np.arctanh(nu) == pytest.approx(1, abs=2e-3)
    assert decay(slab(1.0, 1.0)) == 0


@pytest.mark.parametrize("g", [0.5, 0.9, 0.99])
def test_little_absorption_is_diffusion(g):
    """nu^2 = 3 (1 - a)(1 - a g) to first order in (1 - a)/(1 - g)."""
    albedo = 1 - 1e-3 * (1 - g)
    assert decay(slab(albedo, 1.0, g)) == pytest.approx(np.sqrt(3 * (1 - albedo) * (1 - albedo * g)), rel=1e-3)


@pytest.mark.parametrize(("albedo", "g"), [(0.5, 0.0), (0.9, 0.9), (0.5, 0.5), (0.05, 0.0)])
def test_the_importance_solves_the_transfer_equation(albedo, g):
    """H is the mean of h over the phase function, by a quadrature over directions about the incident one."""
    stretch = stretch_along(slab(albedo, 1.0, g), 1.0)
    s = np.linspace(0, 1, len(stretch.rows))

    def h(mu):
        return np.interp(np.sqrt((1 - mu) / 2), s, stretch.rows[:, 0]) / (1 - stretch.rate * mu)

    x, w = np.polynomial.legendre.leggauss(400)
    azimuth = 2 * np.pi * (np.arange(256) + 0.5) / 256
    drop = 1 + x  # 1 - cos of the scattering angle
    density = w * (1 - g * g) / 2 / ((1 - g) ** 2 + 2 * g * drop) ** 1.5
    for z in (-1.0, -0.3, 0.4, 0.95, 1.0):
        sine = np.sqrt(np.maximum(drop * (2 - drop), 0.0))
        turned = (1 - drop)[:, None] * z + sine[:, None] * np.cos(azimuth) * np.sqrt(1 - z * z)
        mean = density @ h(turned).mean(axis=1)
        # Linear interpolation between the nodes costs 1e-6.
        assert albedo / stretch.survival * mean == pytest.approx((1 - stretch.rate * z) * h(z), rel=1e-5)


def test_what_cannot_be_drawn_is_drawn_by_a_slower_mode():
    """Next to no direction would be taken at rate 0.9999: paths walk a brighter medium and absorb by a coin."""
    stretch = stretch_along(slab(0.05, 40.0), 1.0)
    assert stretch.rate == pytest.approx(0.98, abs=1e-3)
    assert 0.1 < stretch.survival < 0.13
    assert stretch_along(slab(0.9, 40.0), 1.0).survival == 1


# ---- The light -----------------------------------------------------------------------------------------

PATHS = 64 * 60
DEEP = [(0.5, 40.0, 0.0), (0.9, 30.0, 0.0), (0.9, 100.0, 0.0), (0.5, 100.0, 0.0), (0.05, 30.0, 0.0), (0.9, 30.0, -0.5),
        (0.5, 30.0, 0.5), (0.5, 100.0, 0.9), (0.99, 200.0, 0.9)]  # fmt: skip


@pytest.mark.parametrize(("albedo", "depth", "g"), DEEP)
def test_light_is_that_of_adding_and_doubling(albedo, depth, g):
    medium = slab(albedo, depth, g)
    assert relative_variance(medium) > 100
    found = light(medium, PATHS)
    assert_mean(found, adding_doubling(depth, albedo=albedo, g=g).transmitted)
    # 64 batches know a variance to 18 %: within 5.5 of that it is below 25, where analog paths had 1e4 to 1e40.
    assert relative(found, PATHS) < 25


def test_a_wrong_mode_is_caught(monkeypatch):
    """H of an albedo 1 % off leaves every step a little off; light is off by far more than its error."""
    medium = slab(0.9, 100.0)
    off = stretch_along(slab(0.891, 100.0), 1.0)
    monkeypatch.setattr(slab_tracer, "stretch_along", lambda *_: off._replace(survival=0.9 / 0.9))
    refute_mean(light(medium, PATHS), adding_doubling(100.0, albedo=0.9, g=0.0).transmitted)


@pytest.mark.parametrize("medium", [
    slab(0.9, 6.0, 0.8), slab(0.6, 5.0, scatterer=sg.VonMisesFisher(concentration=8.0)),
    slab(0.9, 6.0, scatterer=sg.Mixture(types=(sg.Isotropic(), sg.HenyeyGreenstein(g=0.7)), fractions=(0.3, 0.7))),
], ids=["closed", "table", "mixture"])  # fmt: skip
@pytest.mark.parametrize(("entering", "view"), [(AXIS, AXIS), (unit(0.5, 0.1, 0.8), unit(-0.2, 0.3, 0.9))])
def test_it_is_the_light_of_paths_that_are_not_drawn(medium, entering, view, monkeypatch):
    """Where both can be had: any phase function, light and views aslant."""
    paths = 64 * 600
    plain = light(medium, paths, view=view, entering=entering)
    monkeypatch.setattr(stretching, "_SEEN", 0.0)
    drawn = light(medium, paths, seed=4, view=view, entering=entering)
    assert_mean(drawn - plain, 0.0)
    assert relative(drawn, paths) < 2 * relative(plain, paths)


def test_events_are_foretold():
    """A weight of a^B makes -a dnu/da of the scatterings a depth; the first few are others."""
    for medium in (slab(0.9, 100.0), slab(0.5, 100.0), slab(0.9, 60.0, 0.9)):
        tracer = plane_tracer(medium, 1.0, AXIS[None], AXIS[None], False)
        bank = tracer.trace(1, 2000)
        # Some leave by the near face, early.
        assert 0.7 < bank.events / bank.count / tracer.events_per_path < 1.1
        assert tracer.events_per_path == events_across(medium)


# ---- Who is drawn --------------------------------------------------------------------------------------
def test_only_what_needs_it_is_drawn():
    """Not where paths cross by themselves; not for light that comes back; not where paths serve both ways."""
    back = unit(0.3, 0, -1)

    def drawn(medium, views=AXIS[None], reverse=False):
        return plane_tracer(medium, 1.0, AXIS[None], views, reverse).across

    assert drawn(slab(0.9, 30.0))
    assert drawn(slab(0.9, 10.0))
    assert not drawn(slab(0.9, 4.0))
    assert not drawn(slab(1.0, 300.0))
    assert not drawn(slab(0.9, 30.0), back[None])
    assert not drawn(slab(0.9, 30.0), reverse=True)
    proposal = plane_tracer(slab(0.9, 30.0), 1.0, AXIS[None], AXIS[None], False).proposal
    assert not stretches(slab(0.9, 30.0), replace(proposal, probes=np.stack([AXIS, back])))
