"""The memory effect of a medium is estimated once, for all seeds, processes and units, and cached as it is."""

import numpy as np
import pytest
from cached import link_kernels

import specklegen as sg
from specklegen.core.most_recent import MostRecent
from specklegen.memory_effects import cached
from specklegen.memory_effects.atlas import atlas_correlation, atlas_errors
from specklegen.memory_effects.cached import (
    axial_correlation,
    estimated_anew,
    medium_seed,
    oblique_correlation,
    polarised_correlation,
    polarised_fields,
)
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.samplers.stationary.renderer import PREPARED

PATHS = 3000


def forget_all():
    cached._CACHE.forget()
    PREPARED.forget()


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(link_kernels(tmp_path)))
    forget_all()
    yield tmp_path / "correlations"
    forget_all()


@pytest.fixture
def traced(monkeypatch):
    """Seeds under which paths are traced that are no pilot's."""
    seeds, plain = [], SlabTracer.trace

    def noted(self, seed, paths, **how):
        if "stream" not in how:
            seeds.append((seed, paths))
        return plain(self, seed, paths, **how)

    monkeypatch.setattr(SlabTracer, "trace", noted)
    return seeds


def slab(unit=1.0, **fields):
    fields = {"scatterer": sg.HenyeyGreenstein(0.8)} | fields
    return sg.Slab(thickness=100.0 * unit, mean_free_path=25.0 * unit, **fields)


def scene(aside=0.0, **fields):
    tilts = np.stack([aside + np.array([0.0, 1e-4, 3e-4]), np.zeros(3)], axis=-1)
    return sg.Scene(wavelength=0.5, medium=slab(**fields), illumination=sg.CollimatedBeams.tilts(tilts, width=5000.0),
                    sensor=sg.FarField.grid((8, 8), 2e-5, center=(aside, 0.0)))  # fmt: skip


@pytest.mark.parametrize("aside", [0.0, 0.3])
def test_seeds_share_one_estimate_and_differ_in_their_noise(empty_cache, traced, aside):
    one, two = (sg.render(scene(aside), paths=PATHS, seed=seed, sampler="stationary") for seed in (1, 2))
    assert traced == [(medium_seed(slab()), PATHS)]
    assert one.report.paths == PATHS
    assert not np.allclose(one.field, two.field)
    again = sg.render(scene(aside), paths=PATHS, seed=2, sampler="stationary", realizations=2)
    np.testing.assert_array_equal(again.field[0], two.field)


@pytest.mark.parametrize("aside", [0.0, 0.3])
def test_the_disk_gives_the_same_bits(empty_cache, traced, aside):
    """Of another process, too, which finds the file alone."""
    first = sg.render(scene(aside), paths=PATHS, sampler="stationary").field
    forget_all()
    np.testing.assert_array_equal(sg.render(scene(aside), paths=PATHS, sampler="stationary").field, first)
    assert len(traced) == 1


def test_what_decides_it_has_a_file_of_its_own(empty_cache):
    axis, aside = np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])
    axial_correlation(slab(), PATHS)
    axial_correlation(slab(), 2 * PATHS)
    axial_correlation(slab(albedo=0.9), PATHS)
    for light, view in ((axis, axis), (aside, axis), (axis, aside)):
        for transfer in (False, True):
            found = oblique_correlation(slab(), light, view, PATHS, transfer=transfer)
            assert (found.transfer is not None) == transfer
    assert len(list(empty_cache.glob("*"))) == 3 + 6


def test_it_is_a_property_of_the_medium_in_any_unit(empty_cache):
    one, two = axial_correlation(slab(), PATHS), axial_correlation(slab(1000.0), PATHS)
    np.testing.assert_allclose(two.radius, 1000 * one.radius, rtol=1e-9)
    np.testing.assert_allclose(two.weights, one.weights, rtol=1e-9)


def test_it_is_that_of_its_paths(empty_cache):
    """And nobody can write into what all share."""
    found, literal = axial_correlation(slab(), PATHS), estimate_correlation(slab(), PATHS, medium_seed(slab()))
    np.testing.assert_array_equal(found.weights, literal.weights)
    with pytest.raises(ValueError, match="read-only"):
        found.weights[0, 0] = 1.0


def test_the_atlas_serves_unless_paths_are_asked_for(empty_cache, traced):
    stated = atlas_errors(slab())
    made = sg.plan(scene())
    assert (made.sampler, made.paths) == ("stationary", 0)
    assert made.expected_error == max(stated.intensity, stated.correlation)
    assert f"{stated.correlation:.2g}" in next(d.reason for d in made.decisions if "memory-effect" in d.part)
    sg.render(scene())
    assert not traced
    assert sg.plan(scene(), paths=PATHS).paths == PATHS
    assert sg.plan(scene(), rel_error=0.9 * stated.intensity).paths > 0  # more than it states is asked
    assert sg.plan(scene(faces=sg.Faces(inside=1.4))).paths > 0


def test_the_atlas_and_paths_agree(empty_cache):
    """Of intensities, and of |K|^2 at every lag of a scene, within what both state."""
    traced, table = estimate_correlation(slab(), 100_000, 5), atlas_correlation(slab())
    errors, q = atlas_errors(slab()), np.linspace(0, 0.2, 30)
    value, _, error = traced.intensity(q)
    assert (np.abs(table(q) ** 2 - value) < errors.correlation + 5.5 * error).all()
    light, batches = traced.weights.sum() / traced.paths, traced.weights.sum(axis=1)
    spread = batches.std() * np.sqrt(len(batches)) / traced.paths
    assert abs(np.log(table.weights.sum() / light)) < errors.intensity + 5.5 * spread / light


def test_anew_is_under_the_seed_that_is_asked_for(empty_cache, traced):
    with estimated_anew(7):
        sg.render(scene(), paths=PATHS, sampler="stationary", seed=3)
        sg.render(scene(), paths=PATHS, sampler="stationary", seed=3)
    assert traced == [(7, PATHS)] * 2
    assert not list(empty_cache.glob("*"))


def test_polarised_light_is_cached_by_light_and_analyser(empty_cache, traced):
    medium = slab(scatterer=sg.Rayleigh(), polarisation="vector")
    for of in (polarised_fields, polarised_correlation):
        ends = [np.array([0.0, 0.0, 1.0])] * 2 if of is polarised_fields else []
        for polarisers in (sg.Polarisers.parallel(), sg.Polarisers.crossed()):
            first = of(medium, polarisers, *ends, PATHS)
            forget_all()
            again = of(medium, polarisers, *ends, PATHS)
            np.testing.assert_array_equal(again.weights, first.weights)
    assert len(traced) == len(list(empty_cache.glob("*"))) == 4


def test_results_are_cached_by_their_bytes():
    store, made = MostRecent(2000), []

    def make(n):
        made.append(n)
        return np.zeros(100)

    for n in (0, 1, 0, 2, 0, 1):
        store.get(n, lambda n=n: make(n))
    assert made == [0, 1, 2, 1]  # 0 was asked for last when 2 came
    store.get(9, lambda: np.zeros(10_000))
    assert len(store) == 1
    store.trim()
    assert len(store) == 0


def test_scenes_too_large_to_cache_are_let_go(empty_cache, monkeypatch):
    monkeypatch.setattr(PREPARED, "_most_bytes", 1000)
    sg.render(scene())
    assert len(PREPARED) == 0
    assert cached.estimated_under() is None
