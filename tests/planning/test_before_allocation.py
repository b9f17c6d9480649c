"""What does not fit is refused before it is allocated, and deep slabs are planned within bounds."""

import tracemalloc

import numpy as np
import pytest

import specklegen as sg
from specklegen import memory_curve
from specklegen.core.errors import RuleError
from specklegen.paths import roulette


def slab(optical_depth: float, albedo: float = 1.0) -> sg.Slab:
    return sg.Slab(thickness=10.0 * optical_depth, mean_free_path=10.0, albedo=albedo, scatterer=sg.Isotropic())


def scene(medium: sg.Slab) -> sg.Scene:
    return sg.Scene(
        wavelength=0.5,
        medium=medium,
        illumination=sg.CollimatedBeams.tilts([0.0], width=5000.0),
        sensor=sg.FarField.grid(shape=(4, 4), pitch=4e-5),
    )


def test_a_grid_beyond_memory_is_refused():
    with pytest.raises(RuleError, match="FarFieldGrid.shape must be at most"):
        sg.FarField.grid(shape=(10**12, 1), pitch=1e-13)


@pytest.mark.parametrize("tilts", [np.linspace(0, 0.5, 2000), np.linspace(0, 1e-3, 2000)])
def test_tilts_beyond_memory_are_refused(monkeypatch, tilts):
    """A small machine stands for many tilts: 0.2 GiB, where 1e5 tilts asked for 75."""
    monkeypatch.setattr(memory_curve, "available_memory", lambda: 2**21)
    with pytest.raises(RuleError, match="memory_effect tilts must be so few that"):
        sg.memory_effect(slab(2.0), wavelength=0.5, tilts=tilts, paths=6400, reverse=True)


def test_slabs_too_deep_to_trace_are_refused():
    for ask in (
        lambda: sg.plan(scene(slab(3e4)), paths=10),
        lambda: sg.memory_effect(slab(3e4), wavelength=0.5, tilts=[0.0], paths=10),
        lambda: sg.covariance(scene(slab(3e4)), paths=10, pairs=[[0, 0, 0, 0]]),
    ):
        with pytest.raises(RuleError, match="Slab.optical_depth must be at most 4e"):
            ask()


def test_the_pilot_of_a_deep_slab_is_bounded(monkeypatch):
    """In memory, which all its connections share; a hundredth of the bound stands for a slab a hundred times deeper."""
    monkeypatch.setattr(roulette, "_SLAB_CONNECTIONS", 2**23 // 100)
    medium = slab(60.0)
    sg.memory_effect(slab(1.0), wavelength=0.5, tilts=[0.0], paths=10, reverse=False)  # compiles
    tracemalloc.start()
    sg.memory_effect(medium, wavelength=0.5, tilts=[0.0], paths=10, reverse=False)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6
