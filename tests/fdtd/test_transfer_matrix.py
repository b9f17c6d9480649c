"""The exact frequency-domain solution of the Yee grid."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.fdtd import RandomLayer, transfer_matrix

ROUNDING = 1500 * np.finfo(float).eps / 0.01  # N steps, each divided by sin(theta): 3e-11


def dense_solution(kappa, theta):
    """Solve the grid's wave equation for the scattered field as one linear system with outgoing ends."""
    n = kappa.size
    s = 4 * np.sin(theta / 2) ** 2
    out = np.exp(-1j * theta)
    matrix = np.diag(s * (1 + kappa) - 2 + 0j) + np.eye(n, k=1) + np.eye(n, k=-1)
    matrix[0, 0] += out
    matrix[-1, -1] += out
    incident = np.exp(-1j * theta * np.arange(n))
    scattered = np.linalg.solve(matrix, -s * kappa * incident)
    return scattered[0], 1 + scattered[-1] / incident[-1]


@pytest.mark.parametrize("courant", [1.0, 0.7])
def test_against_one_dense_linear_system(courant):
    kappa = RandomLayer(correlation_length=0.02, n_points=60, rms_index=0.3).sample(3, 0)
    omega = np.array([0.01, 0.1, 0.5])
    theta = 2 * np.arcsin(np.sin(omega / 2) / courant)
    r, t = transfer_matrix(kappa, omega, courant)
    for m in range(3):
        for f in range(3):
            assert (r[m, f], t[m, f]) == pytest.approx(dense_solution(kappa[m], theta[f]), abs=1e-12)


def test_energy_and_reciprocity():
    """|r|^2 + |t|^2 = 1, and a layer transmits the same both ways, to ROUNDING."""
    kappa = RandomLayer(correlation_length=0.1, rms_index=0.2).sample(5, 1)
    omega = np.linspace(0.01, 0.03, 7)
    r, t = transfer_matrix(kappa, omega)
    assert np.abs(np.abs(r) ** 2 + np.abs(t) ** 2 - 1).max() < ROUNDING
    assert np.abs(transfer_matrix(kappa[:, ::-1], omega)[1] - t).max() < ROUNDING


def test_zero_frequency_and_zero_fluctuation():
    r, t = transfer_matrix(np.full(10, 0.3), np.array([0.0, 0.1]))
    assert (r[0], t[0]) == (0, 1)
    assert abs(r[1]) > 0.01
    r, t = transfer_matrix(np.zeros(1500), np.array([0.02]))
    assert abs(r[0]) < ROUNDING
    assert abs(t[0] - 1) < ROUNDING


def test_frequencies_off_the_grid_are_refused():
    assert_refused(lambda: transfer_matrix(np.zeros(5), np.array([1.5]), 0.5), r"omega must be in \[0, 2 asin\(S\)\]")
    assert_refused(lambda: transfer_matrix(np.zeros(5), np.array([0.1]), 1.2), "courant must be")
