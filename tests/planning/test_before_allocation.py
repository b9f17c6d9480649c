"""What does not fit is refused before it is allocated, and deep slabs are planned within bounds."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.paths import roulette
from specklegen.paths.endpoints import AXIS
from specklegen.paths.tracer import slab_tracer, volume_tracer
from specklegen.paths.volume_tracer import VolumeTracer


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


def test_a_tilt_is_the_same_among_many_and_alone():
    """Tilts are taken one after the other: amplitudes of all at once took 75 GiB for 1e5 of them."""
    many, one = (
        sg.memory_effect(slab(5.0), wavelength=0.5, tilts=tilts, paths=640, reverse=False)
        for tilts in (np.linspace(0, 1, 9), [0.5])
    )
    assert many.intensity[4] == pytest.approx(one.intensity[0], rel=1e-9)  # sums over batches are rounded otherwise
    assert many.standard_error[4] == pytest.approx(one.standard_error[0], rel=1e-9)


def test_more_tilts_than_anybody_waits_for_are_refused_before_a_path_is_traced():
    with pytest.raises(RuleError, match="memory_effect tilts must be done within 30 days.*fewer paths"):
        sg.memory_effect(slab(5.0), wavelength=0.5, tilts=np.linspace(0, 1, 10**5), paths=10**10)


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


def test_the_pilot_of_any_geometry_is_bounded(monkeypatch):
    """At optical depth 1000 it walked ten million scatterings: 35 s and 1.8 GB."""
    held, trace = [], VolumeTracer.trace

    def counted(self, *arguments, **options):
        bank = trace(self, *arguments, **options)
        held.append(len(bank))
        return bank

    monkeypatch.setattr(VolumeTracer, "trace", counted)
    volume_tracer(scene(slab(700.0)), False)
    # 2^20 are asked for; lengths of paths are so uneven that twice as many may come.
    assert max(held) < 2**21


def test_the_pilot_of_a_slab_is_weighed_in_parts(monkeypatch):
    """The threshold has the bits of all paths at once, and the memory is that of a part: an eighth, and the weights."""
    tracer = slab_tracer(scene(slab(20.0)), False)
    whole = replace(tracer, proposal=replace(tracer.proposal, threshold=0.0))

    def found():
        tracemalloc.start()
        threshold = roulette.slab_roulette(whole, AXIS, 3).proposal.threshold
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return threshold, most

    found()  # compiles
    in_parts, little = found()
    monkeypatch.setattr(roulette, "_AT_ONCE", roulette.SLAB_PATHS)
    at_once, much = found()
    assert in_parts == at_once
    assert little < much / 4
