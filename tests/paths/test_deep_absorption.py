"""Light that crosses an absorbing slab: how fast it falls, and no figure from paths that have not seen it."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.paths.deep_absorption import LEAST, decay, relative_variance, scene_relative_variance
from specklegen.paths.pilot import scene_pilot


def slab(albedo: float, optical_depth: float, g: float = 0.0) -> sg.Slab:
    scatterer = sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    return sg.Slab(thickness=25.0 * optical_depth, mean_free_path=25.0, albedo=albedo, scatterer=scatterer)


def scene(medium: sg.Slab, side="transmission") -> sg.Scene:
    return sg.Scene(
        wavelength=0.5,
        medium=medium,
        illumination=sg.CollimatedBeams.tilts([0.0, 1e-5], width=5000.0),
        sensor=sg.FarField.grid(shape=(6, 6), pitch=4e-5, side=side),
    )


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


DEEP = [(0.5, 40.0, 0.0), (0.9, 30.0, 0.0), (0.9, 100.0, 0.0), (0.99, 100.0, 0.0), (0.9, 100.0, 0.9)]


@pytest.mark.parametrize(("albedo", "optical_depth", "g"), DEEP)
def test_paths_that_do_not_cross_are_refused(albedo, optical_depth, g):
    """They gave 1e-16 to 0.3 of the intensity, a single share of 0.226 for 0.103, and errors of 5 to 24 %."""
    medium = slab(albedo, optical_depth, g)
    with pytest.raises(RuleError, match="memory_effect paths must be enough that light crosses"):
        sg.memory_effect(medium, wavelength=0.5, tilts=[0.0], reverse=False)
    with pytest.raises(RuleError, match="plan paths must be enough"):
        sg.plan(scene(medium), paths=100_000)
    with pytest.raises(RuleError, match="covariance paths must be enough"):
        sg.covariance(scene(medium), paths=1000, pairs=[[0, 0, 0, 0]])


def test_an_error_that_is_asked_for_counts_the_paths_that_cross():
    this = scene(slab(0.9, 20.0))
    variance = scene_relative_variance(this)
    assert 1000 < variance < 1e5
    made = sg.plan(this, rel_error=0.3)
    assert made.paths >= variance / 0.3**2 > 10_000
    assert made.expected_error >= np.sqrt(variance / made.paths) * (1 - 1e-9)


def test_the_variance_is_that_of_paths_where_they_can_tell():
    """Within a factor 4 of a pilot at a depth that it still sees, a little below where it is believed no more."""
    for albedo, optical_depth in ((0.9, 11.0), (0.5, 8.0)):
        found = scene_pilot(scene(slab(albedo, optical_depth)), False).moments.relative_variance
        nu = decay(slab(albedo, 1.0))
        said = np.exp(nu * optical_depth) * max(1 - nu, 1 / optical_depth) ** 2 / (2 - nu)
        assert said / 4 < found < said * 4, (albedo, found, said)


def test_what_paths_see_is_answered():
    assert [relative_variance(slab(*of)) for of in ((1.0, 300.0), (0.9, 3.0), (0.0, 99.0))] == [0, 0, 0]
    assert np.isfinite(sg.memory_effect(slab(0.9, 10.0), wavelength=0.5, tilts=[0.0], paths=2000).single_share)
    assert sg.plan(scene(slab(0.5, 40.0), "reflection"), paths=1000).paths == 1000
    assert sg.plan(scene(slab(0.9, 14.0)), paths=int(LEAST * relative_variance(slab(0.9, 14.0))) + 1)


def test_memory_effect_names_what_serves_a_box():
    box = sg.Box(
        lower=np.zeros(3), upper=np.array([10.0, 10.0, 1000.0]), mean_free_path=100.0, scatterer=sg.Isotropic()
    )
    grid = sg.VoxelGrid(lower=box.lower, upper=box.upper, extinction=np.ones((2, 2, 2)), scatterers=(sg.Isotropic(),))
    for medium in (box, grid, scene(slab(1.0, 1.0))):
        with pytest.raises(RuleError, match="must be a Slab, which is infinite sideways.*covariance.*render"):
            sg.memory_effect(medium, wavelength=0.5, tilts=[0.0])  # type: ignore[arg-type]
