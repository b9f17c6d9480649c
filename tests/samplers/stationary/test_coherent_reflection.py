"""Coherent objects in reflection: the stationary sampler beside sums over paths, averaged over their phases."""

from functools import cache

import numpy as np
import pytest

import specklegen as sg
from specklegen.paths.endpoint_factors import endpoint_factors, single_factors
from specklegen.paths.phases import reversal_phases
from specklegen.paths.tracer import slab_tracer
from specklegen.scene.illumination import directions_of_sines
from tests.refusals import assert_refused
from tests.zscore import assert_z, refute_z

LETTER = np.zeros((6, 6), complex)
LETTER[1:5, 1] = LETTER[4, 1:5] = 1.0
LETTER[2, 4] = 1j
SHOWN = np.stack([LETTER, np.roll(LETTER, 1, 1) * np.exp(0.3j * np.arange(6))])
SLAB = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.media.Isotropic())
WIDE = SLAB.replace(thickness=200.0, mean_free_path=100.0)  # whose cone of backscattering is narrower
STEP, SIDE = 6e-4, 24


def scene(aside=0.3, medium=SLAB):
    camera = sg.sensors.FarField.grid((SIDE, SIDE), STEP, center=(aside, 0.0), side="reflection")
    return sg.Scene(wavelength=1.0, medium=medium, illumination=sg.light.CoherentObject(SHOWN, 40.0), sensor=camera)


def values(products):
    """Mean intensities of both objects, and their products at lags of 0 to 2 pixels, of a function of (t, t', s)."""
    shared = [products(0, 1, lag) for lag in range(3)]
    return np.array([products(0, 0, 0).real, products(1, 1, 0).real,
                     *(each.real for each in shared), *(each.imag for each in shared)])  # fmt: skip


@cache
def summed(aside, reverse, medium=SLAB, paths=200_000):
    """Those of path sums at 18 views, averaged over the phases of connections: of 40 batches float64[40, 8]."""
    seen = scene(aside, medium)
    columns, rows = np.add.outer([0, 11, 21], range(3)).ravel() - 11.5, np.array([-11.5, 0.5])
    sines = np.stack(np.meshgrid(aside + columns * STEP, rows * STEP), axis=-1).reshape(-1, 2)
    beams = seen.replace(illumination=seen.beams, sensor=sg.sensors.FarField(directions_of_sines("view", sines, -1.0)))
    amplitudes, tracer = seen.illumination.amplitudes(1.0), slab_tracer(beams, reverse)
    layout, batches = tracer.layout, []

    def ends(bank, lit, seen_from, phases=1.0):
        factors = amplitudes @ endpoint_factors(layout, bank, layout.lights, lit) * (np.sqrt(bank.weight) * phases)
        return factors[:, None] * endpoint_factors(layout, bank, layout.views, seen_from)

    for n in range(40):
        bank, count = tracer.trace(7, paths // 40, first=n * (paths // 40), threads=1), paths // 40
        once, often = bank.single, bank.multiple
        lights = endpoint_factors(layout, once, layout.lights, "entry") * np.sqrt(once.weight)
        views = endpoint_factors(layout, once, layout.views, "exit")
        factors = np.broadcast_to(single_factors(layout, once), (len(lights), len(views), len(once)))
        fields = [np.einsum("tn,nm,vm,nvm->tvm", amplitudes, lights, views, factors, optimize=True)]
        fields.append(ends(often, "entry", "exit"))
        if reverse:
            fields[1] = fields[1] + ends(often, "exit", "entry", reversal_phases(layout, often))
        power = sum(np.einsum("tvm,swm->tvsw", each, each.conj(), optimize=True) for each in fields) / count
        number = np.arange(18).reshape(6, 3)
        batches.append(values(lambda t, s, lag, p=power, number=number: np.mean(
            p[t, number[:, lag:].ravel(), s, number[:, : 3 - lag].ravel()])))  # fmt: skip
    return np.array(batches)


@cache
def drawn(aside, medium=SLAB):
    """Those of 600 fields of the stationary sampler: means and standard errors float64[8]."""
    seen = scene(aside, medium)
    fields = sg.render(seen, sampler="stationary", realizations=600, seed=1, reverse=False, threads=1).field
    each = np.array([
        values(lambda t, s, lag, u=u: (u[t, :, lag:] * u[s, :, : SIDE - lag].conj()).mean()) for u in fields
    ])  # fmt: skip
    return each.mean(axis=0), each.std(axis=0, ddof=1) / 600**0.5


@pytest.mark.parametrize(
    "medium", [WIDE, pytest.param(WIDE.replace(faces=sg.media.Faces(inside=1.4)), marks=pytest.mark.slow)]
)
def test_fields_aside_of_backscattering_have_the_moments_of_path_sums(medium):
    """Mean within 2 %, products of two objects within 0.01; a conjugate and 1.15 times the brightness are told."""
    fast, spread = drawn(0.3, medium)
    batches = summed(0.3, False, medium)
    slow, scale = batches.mean(axis=0), fast[0]
    error = np.hypot(spread, batches.std(axis=0, ddof=1) / 40**0.5) / scale
    limit = 0.02 * np.repeat([1.0, 0.5], [2, 6])
    assert sg.plan(scene(0.3, medium)).sampler == "stationary"
    assert_z(slow / scale, fast / scale, error, degrees=39, slack=limit)
    refute_z(slow / scale, fast * np.repeat([1.0, -1.0], [5, 3]) / scale, error, degrees=39, slack=limit)
    refute_z(slow / scale, fast * np.repeat([1.15, 1.0], [2, 6]) / scale, error, degrees=39, slack=limit)


def test_about_backscattering_both_ways_of_a_path_interfere_and_are_summed():
    """There the mean is not that of the sampler, which then refuses and is not chosen."""
    fast, spread = drawn(0.0)
    batches = summed(0.0, True)
    error = np.hypot(spread, batches.std(axis=0, ddof=1) / 40**0.5)
    refute_z(batches.mean(axis=0)[:2], fast[:2], error[:2], degrees=39, slack=0.1 * fast[:2])
    assert_refused(lambda: sg.plan(scene(0.0), sampler="stationary"), r"has no reversed paths.*look aside of the axis")
    assert_refused(lambda: sg.plan(scene(0.3), sampler="stationary", reverse=True), "which reverse=True asks for")
    made = sg.plan(scene(0.0), paths=100)
    assert made.sampler == "paths"
    assert any("has no reversed paths" in each.reason for each in made.decisions)


@pytest.mark.parametrize("parts", [
    {"sensor": sg.sensors.Imaging(shape=(4, 4), pitch=4.0, aperture=0.05, side="reflection")},
    {"medium": WIDE.replace(polarisation="projector"), "polarisers": sg.light.Polarisers.parallel()},
])  # fmt: skip
def test_lenses_and_polarised_light_are_left_to_path_sums(parts):
    seen = scene(0.3, WIDE).replace(**parts)
    assert_refused(lambda: sg.plan(seen, sampler="stationary"), "draws far fields of scalar light only, where it comes")
