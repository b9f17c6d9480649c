"""The Yee march: exact propagation, slab, both forms, against the frequency domain, against literal NumPy."""

import math

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.fdtd import Pulse, RandomLayer, illuminate, slab_fresnel, transfer_matrix, yee
from specklegen.fdtd.marching import march
from specklegen.kernels.fdtd import march_total


def rel(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


def literal_yee(kappa, courant, margin, source, source_cell, mur):
    """Transcribe the scheme plainly: the oracle of the kernels."""
    size = kappa.size + 2 * margin
    permittivity = np.ones(size)
    permittivity[margin : margin + kappa.size] += kappa
    e, h = np.zeros(size), np.zeros(size - 1)
    records = []
    for value in source:
        h = h - courant * np.diff(e)
        new = e.copy()
        new[1:-1] = e[1:-1] - courant / permittivity[1:-1] * np.diff(h)
        new[source_cell] += 2 * courant * value
        new[0] = e[1] + mur * (new[1] - e[0])
        new[-1] = e[-2] + mur * (new[-2] - e[-1])
        e = new
        records.append((e[margin], e[margin + kappa.size - 1]))
    return np.array(records).T


def test_kernel_is_the_literal_scheme():
    layer = RandomLayer(correlation_length=0.05, n_points=80, rms_index=0.2)
    incidence = illuminate(layer, Pulse(duration=0.1))
    kappa = layer.sample(2, 0)
    first, last = np.empty((2, 2, incidence.steps))
    march_total(kappa, incidence.courant, incidence.mur, 20, incidence.source, 10, first, last)
    for r in range(2):
        expected = literal_yee(kappa[r], incidence.courant, 20, incidence.source, 10, incidence.mur)
        # same operations in the same order, but for contraction of products and sums
        assert rel(np.stack([first[r], last[r]]), expected) < 1e-13


@pytest.mark.parametrize("courant", [1.0, 0.99, 0.9, 1 / 1.45, 0.5])
def test_pulse_crosses_300_cells_with_its_exact_delay(courant):
    """Exact at S = 1; below it the grid is late by (1 - S^2) (k dx)^3/24 a cell, at k = 1.03 k_carrier."""
    layer = RandomLayer(correlation_length=1, n_points=301, rms_index=0)
    incidence = illuminate(layer, Pulse(duration=1.0), courant, margin=4000)
    first, last = np.empty((2, 1, incidence.steps))
    march_total(np.zeros((1, 301)), courant, incidence.mur, 4000, incidence.source, 3990, first, last)
    if courant == 1.0:  # a whole cell a step: compare the records themselves
        assert np.abs(last[0, 300:] - first[0, :-300]).max() < 1e-14 * np.abs(first).max()
        return
    dispersion = (1 - courant**2) * (2 * np.pi * 1.45 / 0.6 * 0.002) ** 3 / 24 * 300
    delayed = incidence.series(np.exp(-1j * incidence.omega / courant * 300))
    assert rel(last[0], delayed) == pytest.approx(dispersion, rel=0.1)  # the band spreads k^3 by 7 %
    assert rel(last[0], incidence.series(np.exp(-1j * incidence.theta * 300))) < 1e-6


def test_mur_ends_are_exact_at_courant_one():
    layer = RandomLayer(correlation_length=1, n_points=50, rms_index=0)
    near, far = (illuminate(layer, Pulse(duration=0.3), 1.0, margin) for margin in (20, 5000))
    records = []
    for incidence in (near, far):
        first, last = np.empty((2, 1, incidence.steps))
        march_total(np.zeros((1, 50)), 1.0, incidence.mur, incidence.margin, incidence.source, incidence.source_cell,
                    first, last)  # fmt: skip
        records.append(np.concatenate([first, last]))
    assert near.mur == pytest.approx(0, abs=1e-15)
    assert np.abs(records[0] - records[1]).max() < 1e-14


@pytest.mark.parametrize("courant", [1 / 1.45, 0.9])
def test_time_domain_is_the_frequency_domain_solution(courant):
    """To 1e-6 where nothing returns from the ends; to 1e-3 with Mur ends 20 cells away (measured 6e-5)."""
    layer = RandomLayer(correlation_length=0.5)
    kappa = layer.sample(1, 0)
    for margin, bound in ((6000, 1e-6), (20, 1e-3)):
        incidence = illuminate(layer, courant=courant, margin=margin)
        back, forward = march(kappa, incidence)
        r, t = transfer_matrix(kappa[0], incidence.omega, courant)
        to_last = np.exp(-1j * incidence.theta * 1499)
        assert rel(back[0], incidence.series(r)) < bound
        assert rel(forward[0], incidence.series((t - 1) * to_last)) < bound


def test_scattered_form_is_total_minus_incident():
    layer = RandomLayer(correlation_length=0.1)
    total, scattered = (yee(layer, seed=4, form=form) for form in ("total", "scattered"))
    assert rel(scattered.back, total.back) < 1e-12
    assert rel(scattered.forward, total.forward) < 1e-12
    assert np.array_equal(scattered.incident, total.incident)


def slab_errors(dx):
    """Relative errors of r and t of a 3 um slab of 1.60 in 1.45 over 450-850 nm, and of |r|^2."""
    cells = round(3 / dx)
    k0 = 2 * np.pi / np.linspace(0.45, 0.85, 200)
    r, t = transfer_matrix(np.full(cells, (1.6 / 1.45) ** 2 - 1), k0 * dx, 1 / 1.45)
    exact_r, exact_t = slab_fresnel(1.6, 1.45, 3.0, k0)
    at_first_node = np.exp(1j * k0 * 1.45 * dx)  # the face is half a cell before the first node
    return (rel(r, exact_r * at_first_node), rel(t, exact_t), np.abs(np.abs(r) ** 2 - np.abs(exact_r) ** 2).max())


def test_slab_converges_to_fresnel_at_second_order():
    expected = {0.008: (3.58e-2, 9.1e-3, 5.9e-4), 0.004: (8.92e-3, 2.28e-3, 1.46e-4), 0.002: (2.23e-3, 5.70e-4, 3.6e-5),
                0.001: (5.57e-4, 1.42e-4, 9.1e-6)}  # fmt: skip
    errors = {dx: slab_errors(dx) for dx in expected}
    for dx, row in expected.items():
        assert errors[dx] == pytest.approx(row, rel=0.03)  # the sampling of the band is ours
    for coarse, fine in ((0.008, 0.004), (0.004, 0.002), (0.002, 0.001)):
        ratios = np.divide(errors[coarse], errors[fine])
        assert ratios == pytest.approx([4, 4, 4], rel=0.03)


@pytest.mark.parametrize(("change", "rule"), [
    ({"n_slab": math.nan}, "n_slab must be finite and above 0; got nan"),
    ({"n_background": 0.0}, "n_background must be finite and above 0; got 0.0"),
    ({"thickness": "x"}, "thickness must be a number; got 'x'"), ({"thickness": -1.0}, "thickness must be finite"),
    ({"wavenumber": [1.0, math.inf]}, "wavenumber must be finite everywhere"),
])  # fmt: skip
def test_slabs_that_are_none_are_refused(change, rule):
    fields = {"n_slab": 1.5, "n_background": 1.0, "thickness": 1.0, "wavenumber": [1.0]} | change
    assert_refused(lambda: slab_fresnel(**fields), f"slab_fresnel {rule}")


def test_bad_input_is_refused():
    layer = RandomLayer(correlation_length=0.5, n_points=100)
    assert_refused(lambda: yee(layer, kappa=np.zeros(99)), r"yee.kappa must be of shape \[100\]")
    with pytest.raises(ValueError, match="yee.form must be one of"):
        yee(layer, form="half")  # type: ignore[arg-type]
    assert_refused(lambda: yee(layer, margin=3), "margin must be at least 12")
    with pytest.raises(ValueError, match="RandomLayer.dx must be an eighth or less"):
        yee(RandomLayer(correlation_length=0.5, n_points=100, dx=0.05))
    assert_refused(lambda: Pulse(duration=0), "Pulse.duration must be greater than 0")
    with pytest.raises(ValueError, match="courant must be greater than 0 and at most 1"):
        yee(RandomLayer(n_background=0.9, correlation_length=0.5, n_points=100))
