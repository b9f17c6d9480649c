"""Amplitudes of a sphere against the output that Bohren and Huffman print for their program (Appendix A, BHMIE).

A sphere of radius .525 micrometres and index 1.55 in vacuum, light of .6328 micrometres: size parameter 5.213. By angle
S11 over its forward value, the polarisation -S12/S11, S33/S11 and S34/S11; printed to six digits.
"""

import numpy as np
import pytest

import specklegen as sg

pytest.importorskip("miepython", reason="needs the extra mie")

PRINTED = np.array([
    [0, 1.00000, 0.0, 1.00000, 0.0], [9, 0.785390, -0.00459811, 0.999400, 0.0343261],
    [18, 0.356897, -0.0458541, 0.986022, 0.160184], [27, 0.0766119, -0.364744, 0.843603, 0.394076],
    [36, 0.0355355, -0.534997, 0.686967, -0.491787], [45, 0.0701845, 0.00959953, 0.959825, -0.280434],
    [54, 0.0574313, 0.0477927, 0.985371, 0.163584], [63, 0.0219660, -0.440604, 0.648043, 0.621216],
    [72, 0.0125959, -0.831996, 0.203255, -0.516208], [81, 0.0173750, 0.0341670, 0.795354, -0.605182],
    [90, 0.0124601, 0.230462, 0.937497, 0.260742], [99, 0.00679093, -0.713472, -0.00717397, 0.700647],
    [108, 0.00954239, -0.756255, -0.0394748, -0.653085], [117, 0.00863419, -0.281215, 0.536251, -0.795835],
    [126, 0.00227421, -0.239612, 0.967602, 0.0795798], [135, 0.00543998, -0.850804, 0.187531, -0.490882],
    [144, 0.0160243, -0.706334, 0.495254, -0.505781], [153, 0.0188852, -0.891081, 0.453277, -0.0226817],
    [162, 0.0195254, -0.783319, -0.391613, 0.482752], [171, 0.0301676, -0.196194, -0.962069, 0.189556],
    [180, 0.0383189, 0.0, -1.00000, 0.0],
])  # fmt: skip


def matrices(index: complex, size: float) -> np.ndarray:
    """S11, -S12/S11, S33/S11 and S34/S11, float64[21, 4], at the printed angles."""
    wavelength = 0.6328
    sphere = sg.Mie(radius=size * wavelength / (2 * np.pi), wavelength=wavelength, refractive_index=index)
    one, two = sphere.amplitude_matrix(np.cos(np.radians(PRINTED[:, 0])))
    s11, both = (abs(one) ** 2 + abs(two) ** 2) / 2, two * one.conj()
    return np.stack([s11 / s11[0], (abs(one) ** 2 - abs(two) ** 2) / 2 / s11, both.real / s11, both.imag / s11], axis=1)


def test_amplitudes_are_those_that_bohren_and_huffman_print():
    found = matrices(1.55, 2 * np.pi * 0.525 / 0.6328)
    np.testing.assert_allclose(found, PRINTED[:, 1:], rtol=2e-5, atol=2e-6)


def test_another_index_is_told():
    far = abs(matrices(1.551, 2 * np.pi * 0.525 / 0.6328) - PRINTED[:, 1:])
    assert (far > 1e-3).any()
