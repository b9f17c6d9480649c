"""Lengths in absurd units: the same physics, or a refusal; never 0, infinite or NaN without a word."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.samplers.sampler import require_finite


def scene(unit: float, *, incoherent=False) -> sg.Scene:
    width = 500 * unit
    beams = sg.CollimatedBeams.tilts([0.0, 1e-4], width=width)
    pixels = sg.IncoherentObject(brightness=np.ones((2, 2)), pitch=1e-4, width=width)
    return sg.Scene(
        wavelength=0.5 * unit,
        medium=sg.Slab(thickness=20 * unit, mean_free_path=10 * unit, scatterer=sg.Isotropic()),
        illumination=pixels if incoherent else beams,
        sensor=sg.FarField.grid(shape=(6, 6), pitch=4e-4),
    )


@pytest.mark.parametrize("unit", [1e-25, 1e20, 1e40])
@pytest.mark.parametrize("sampler", ["paths", "stationary", "covariance"])
@pytest.mark.parametrize("incoherent", [False, True])
def test_intensities_that_float32_does_not_hold_are_refused(unit, sampler, incoherent):
    with pytest.raises(RuleError, match="Scene intensity must be between .* since images are float32.*unit near"):
        sg.render(scene(unit, incoherent=incoherent), paths=200, sampler=sampler)


def test_streamed_stacks_are_refused_too():
    with pytest.raises(RuleError, match="since images are float32"):
        sg.render_tiles(scene(1e25), paths=200)
    with pytest.raises(RuleError, match="since images are float32"):
        require_finite(np.array([1e25 + 0j], np.complex64))
    with pytest.raises(RuleError, match="since images are float32"):
        require_finite(np.array([np.nan], np.float32))


@pytest.mark.parametrize("unit", [1e-15, 1e14])
@pytest.mark.parametrize("incoherent", [False, True])
def test_large_units_are_the_same_physics(unit, incoherent):
    one, other = (
        sg.render(scene(u, incoherent=incoherent), paths=200, sampler="paths", seed=3).intensity for u in (1.0, unit)
    )
    assert other.mean() / unit**2 == pytest.approx(one.mean(), rel=1e-2)


@pytest.mark.parametrize("unit", [1e-140, 1e140])
def test_lengths_beyond_floats_are_refused(unit):
    """They gave NaN or 0, and standard errors of exactly 0."""
    with pytest.raises(RuleError, match=r"Scene.wavelength must be between 1e-60 and 1e\+60"):
        scene(unit)
    beams = scene(1.0).beams.replace(width=unit)
    with pytest.raises(RuleError, match="CollimatedBeams.width must be between"):
        scene(1.0).replace(illumination=beams)


@pytest.mark.parametrize("unit", [1e-50, 1e50])
def test_covariance_has_an_error_at_the_largest_units(unit):
    found, plain = (sg.covariance(scene(u), paths=200, pairs=[[0, 0, 0, 0]]) for u in (unit, 1.0))
    assert found.standard_error[0] > 0
    assert found.rel_error == pytest.approx(plain.rel_error, rel=1e-6)
