"""The direct sum by torch: that of the kernels within rounding, on any device."""

import numpy as np
import pytest
import torch

import specklegen as sg
from specklegen.paths.slab_optics import Optics, random_phases
from specklegen.paths.slab_tracer import beam_proposal, trace
from specklegen.samplers.path_sums import device
from specklegen.samplers.path_sums.device import device_field
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.scene.illumination import directions_of_sines

DEVICES = [
    "cpu",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")),
]


def case(g: float, reverse: bool):
    medium = sg.Slab(
        thickness=100.0, mean_free_path=30.0, albedo=0.9, scatterer=sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    )
    beams = sg.CollimatedBeams.tilts([[0.0, 0.0], [0.3, -0.2], [0.01, 0.4]], width=2e4)
    optics = Optics.of(0.5, medium, beams, -1.0)
    bank = trace(medium, beam_proposal(medium, beams, optics.view_reference, reverse=reverse), 1, 400)
    sines = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 2))
    views = np.concatenate([directions_of_sines("view", sines, side) for side in (1.0, -1.0)] + [[[1.0, 0.0, 0.0]]])
    return bank, optics, random_phases(bank, 2), views


@pytest.mark.parametrize("where", DEVICES)
@pytest.mark.parametrize(("dtype", "rounding"), [(torch.complex128, 2e-11), (torch.complex64, 2e-6)])
@pytest.mark.parametrize(("g", "reverse"), [(0.0, False), (0.9, True), (-0.4, True)])
def test_the_sum_by_torch_is_the_kernels_sum(where, dtype, rounding, g, reverse, monkeypatch):
    """Turns of 3e4 leave 2e-11 radians in double precision; single precision, after the reduction, 2e-7 a term."""
    monkeypatch.setattr(device, "_CONNECTIONS", 100)
    monkeypatch.setattr(device, "_PAIRS", 700)
    bank, optics, phases, views = case(g, reverse)
    expected = direct_field(bank, optics, phases, views, reverse=reverse)
    found = device_field(bank, optics, phases, views, device=where, dtype=dtype, reverse=reverse).cpu().numpy()
    assert found.shape == expected.shape
    assert np.linalg.norm(found - expected) < rounding * np.linalg.norm(expected)
    # Power: vertices off by 1e-9 turn phases by 1e-8 radians, far more than rounding does.
    if dtype == torch.complex128:
        off = device_field(
            bank.translated(np.array([1e-9, 0.0, 0.0])), optics, phases, views, device=where, reverse=reverse
        )
        assert np.linalg.norm(off.cpu().numpy() - expected) > 10 * rounding * np.linalg.norm(expected)


def test_nothing_is_zero():
    bank, optics, phases, views = case(0.5, False)
    none = slice(0, 0)
    field = device_field(bank.select(none), optics, phases[none], views, device="cpu")
    assert field.shape == (3, 101)
    assert not field.any()
