"""A wavefront shaped by the transmission matrix focuses behind a slab, as bright and as far as theory says.

Of N beams of one amplitude and the phases that meet in a view, Vellekoop and Mosk, Opt. Lett. 32, 2309 (2007):
(N - 1) pi / 4 + 1 times the mean intensity; with both tilted by delta, 1 + (N - 1) pi / 4 C_I(delta).
"""

import numpy as np
import pytest

import specklegen as sg
from specklegen.coherence import transmission_matrix
from tests.zscore import assert_mean, refute_mean

WIDTH, SIDE, STEPS, PATHS = 2000.0, 6, (0, 2, 4, 8), 2000
SLAB = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.Isotropic())
PITCH = 1 / WIDTH  # between beams, and between views that see independent speckle


def _beams():
    """SIDE^2 beams, and all of them tilted by the steps along x: [steps, SIDE^2] of a wider grid."""
    across = SIDE + max(STEPS)
    y, x = np.meshgrid(np.arange(SIDE) - SIDE // 2, np.arange(across) - SIDE // 2, indexing="ij")
    sines = np.stack([x, y], axis=-1).reshape(-1, 2) * PITCH
    directions = np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(-1))])
    number = np.arange(SIDE * across).reshape(SIDE, across)
    return directions, np.stack([number[:, s : s + SIDE].ravel() for s in STEPS])


def _matrices(count):
    """[targets, steps, SIDE^2] of media, targets and beams moved by each step; targets far apart on the y axis."""
    directions, chosen = _beams()
    targets = np.arange(-4, 4) * 12 * PITCH
    sines = np.array([[s * PITCH, y] for s in STEPS for y in targets])
    views = np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(-1))])
    light = sg.CollimatedBeams(directions=directions, width=WIDTH)
    scene = sg.Scene(wavelength=1.0, medium=SLAB, illumination=light, sensor=sg.FarField(views))
    for seed in range(count):
        found = transmission_matrix(scene, paths=PATHS, seed=seed, reverse=False, threads=1).value
        found = found.reshape(len(STEPS), len(targets), -1)
        yield np.stack([found[n][:, own] for n, own in enumerate(chosen)], axis=1)


@pytest.fixture(scope="module")
def matrices():
    return list(_matrices(16))


def focused(phases, matrix):
    """Intensity at targets float64[targets, steps] of beams of phases [targets, N], over what random phases make."""
    n = matrix.shape[-1]
    shaped = np.einsum("tn,tsn->ts", phases, matrix) / np.sqrt(n)
    return np.square(np.abs(shaped))


def test_the_enhancement_is_that_of_circular_gaussian_matrices(matrices):
    n = SIDE**2
    mean = np.mean([np.square(np.abs(each)).mean() for each in matrices])
    found = [focused(np.exp(-1j * np.angle(each[:, 0])), each)[:, 0].mean() / mean for each in matrices]
    expected = 1 + (n - 1) * np.pi / 4
    assert_mean(np.array(found), expected, slack=0.005 * expected)  # what is left of Gaussian statistics: kurtosis / 16
    without = [focused(np.exp(-1j * np.angle(each[::-1, 0])), each)[:, 0].mean() / mean for each in matrices]
    assert_mean(np.array(without), 1.0, slack=0.05)  # phases of other targets make nothing
    refute_mean(np.array(found), 0.8 * expected)


def test_the_focus_is_scanned_as_far_as_the_memory_effect_reaches(matrices):
    """Wavefront and target tilted together, the focus keeps 1 + (N - 1) pi / 4 C_I."""
    n = SIDE**2
    mean = np.mean([np.square(np.abs(each)).mean() for each in matrices])
    scanned = np.array([focused(np.exp(-1j * np.angle(each[:, 0])), each).mean(axis=0) / mean for each in matrices])
    curve = sg.memory_effect(SLAB, wavelength=1.0, tilts=np.array(STEPS) * PITCH, paths=50_000, seed=0)
    expected = 1 + (n - 1) * np.pi / 4 * curve.intensity
    assert curve.intensity[-1] < 0.5 < curve.intensity[1]  # the steps reach beyond the half range
    assert_mean(scanned, expected, slack=0.01 * expected + (n - 1) * np.pi / 4 * 3 * curve.standard_error.max())
