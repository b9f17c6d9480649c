"""Memory that a block of the general engine reserves: enough for thick media near a sensor, whatever it holds."""

from dataclasses import replace

import numpy as np
import pytest

import specklegen as sg
from specklegen.kernels import volume_walk
from specklegen.paths.tracer import volume_tracer

THICK = sg.Scene(wavelength=1.0,
                 medium=sg.Slab(thickness=300.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g=0.5)),
                 illumination=sg.PlaneWaves.tilts([0.0, 0.1], dimensions=3),
                 sensor=sg.NearField(points=np.array([[0.0, 0.0, 310.0], [5.0, 0.0, 310.0]])))  # fmt: skip


def test_a_thick_medium_is_traced_once(monkeypatch):
    """Blocks of the render: one call each; with the eight connections a path of old, two."""
    tracer = volume_tracer(THICK, False)
    calls = []
    walk = volume_walk.trace_volume
    monkeypatch.setattr(volume_walk, "trace_volume", lambda *a: calls.append(a) or walk(*a))
    bank = tracer.trace(1, 2000, threads=1)
    assert len(bank) > 8 * 2000
    assert len(calls) == 1
    replace(tracer, capacity=8.0).trace(1, 2000, threads=1)
    assert len(calls) == 3


@pytest.mark.parametrize("capacity", [0.0, 1.0, 500.0])
def test_the_bank_does_not_depend_on_the_capacity(capacity):
    tracer = volume_tracer(THICK, False)
    bank, other = tracer.trace(1, 300, threads=1), replace(tracer, capacity=capacity).trace(1, 300, threads=1)
    assert bank.records.tobytes() == other.records.tobytes()
    assert bank.types.tobytes() == other.types.tobytes()
