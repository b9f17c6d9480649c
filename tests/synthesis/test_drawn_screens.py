"""Coherent objects behind screens of few correlation lengths: fields of one medium, and moments, by an independent way.

The judge is :mod:`specklegen.oracles.screen_waves`: NumPy, double precision, a grid and phases of its own.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

import specklegen as sg
from specklegen.light import CoherentObject
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.samplers.screens.drawn import drawn_screens
from specklegen.scene.screens import PhaseScreen, ScreenStack
from specklegen.scene.sensors import FarField
from specklegen.synthesis.coherent import wave_grid
from specklegen.synthesis.gaussian_noise import complex_normals
from tests.zscore import assert_z, refute_z

K = 2 * np.pi  # of the wavelength 1
ONE = np.zeros((6, 6), complex)
ONE[1:5, 1] = ONE[4, 1:5] = 1.0
OBJECTS = np.stack([ONE, np.roll(ONE, 1, 1) * np.exp(0.5j * np.arange(6))])
STACKS = [
    ScreenStack(screens=[PhaseScreen(rms_phase=3.0, correlation_length=120.0)]),
    ScreenStack(screens=[PhaseScreen(rms_phase=0.6, correlation_length=60.0)]),
    ScreenStack(screens=[PhaseScreen(rms_phase=2.0, correlation_length=100.0)] * 2, gaps=(1500.0,), behind=300.0),
]  # fmt: skip


def scene(stack, light, views=17, off=0.0):
    step = 0.5 / light.side(1.0)
    return sg.Scene(wavelength=1.0, medium=stack, illumination=light,
                    sensor=FarField.grid((views, views), step, center=(off * step, 0.0)))  # fmt: skip


@pytest.mark.parametrize("stack", STACKS)
def test_fields_of_drawn_phases_are_those_of_the_wave_program(stack):
    """The same phases: every view within 1e-4 of the brightest, at a camera beside the axis; a conjugate is told."""
    light = CoherentObject(OBJECTS, 30.0, distance=400.0)
    camera = scene(stack, light, off=2.0).grid
    grid, amplitudes = wave_grid(light, 1.0, camera)
    # of the judge's period, which is 8 correlation lengths at least
    drawn = replace(drawn_screens(stack, 1.0, grid, ballistic=True), points=150)
    medium = drawn.medium(complex_normals(3, 0, drawn.normals, torch.complex64))
    found = drawn.speckle(medium, drawn.light(amplitudes)).numpy()
    # the wave program's grid begins at the first point of the window
    waves = ScreenWaves(stack.replace(behind=0.0), 1.0, drawn.points, drawn.spacing)  # a far field does not feel it
    lit = np.zeros((2, drawn.points, drawn.points), complex)
    x = (np.arange(drawn.lit) - (drawn.lit - 1) / 2) * drawn.spacing
    wave = np.exp(1j * K * x[:, None] * grid.sines)
    lit[:, : drawn.lit, : drawn.lit] = wave @ amplitudes @ wave.T
    phases = np.angle(medium.numpy())
    fields = np.concatenate([waves.fields(phases, [(0, 0)], each) for each in lit])
    x, y = camera.sines
    place = (np.arange(drawn.points) - (drawn.lit - 1) / 2) * drawn.spacing
    place = np.where(place >= drawn.points * drawn.spacing / 2, place - drawn.points * drawn.spacing, place)
    rows, columns = (np.exp(-1j * K * views[:, None] * place) for views in (y, x))
    expected = rows @ fields @ columns.T * drawn.spacing**2
    cosines = np.sqrt(1 - np.square(x) - np.square(y)[:, None])
    expected = expected * np.exp(-1j * K * sum(stack.gaps) * (cosines - 1))
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(found - expected.conj()).max() > 0.1 * np.abs(expected).max()
    scattered = replace(drawn, ballistic=False).speckle(medium, drawn.light(amplitudes)).numpy()
    mean = sg.statistics.mean_field(scene(stack, light, off=2.0))
    # points are summed here
    assert np.abs(found - scattered - mean).max() < 0.01 * np.abs(mean).max()


@pytest.mark.parametrize("stack", STACKS)
def test_moments_are_those_of_phases_drawn_elsewhere(stack):
    """Mean and mean square of intensities, and products of two objects' fields; Gaussian speckle is told by them."""
    light, draws = CoherentObject(OBJECTS, 30.0), 400
    seen = scene(stack, light)
    plan = sg.plan(seen)
    assert "phases drawn on" in plan.explain()
    assert not plan.doubts
    assert plan.gaussianity.contributions == 0

    def measured(fields):
        power = np.square(np.abs(fields[:, 0]))
        blocks = [power[:, 7:10, 7:10], power[:, :4, :4], power[:, 13:, 8:12]]
        shared = [fields[:, 0, :, s:] * fields[:, 1, :, : 17 - s].conj() for s in (0, 1, 2)]
        moments = [each.mean(axis=(1, 2)) for each in (*blocks, *(np.square(block) for block in blocks))]
        values = np.stack([*moments, *(f(each.mean(axis=(1, 2))) for each in shared for f in (np.real, np.imag))], -1)
        return values.mean(axis=0), values.std(axis=0, ddof=1) / len(values) ** 0.5

    found = measured(sg.render(seen, realizations=10 * draws, seed=1, mean=True).field)
    side = light.side(1.0)
    count, lit = 128, 16
    waves = ScreenWaves(stack.replace(behind=0.0), 1.0, count, side / lit)
    sines, amplitudes = light.spectrum(1.0)
    place = (np.arange(count) - (lit - 1) / 2) * waves.spacing
    place = np.where(place > count * waves.spacing / 2, place - count * waves.spacing, place)
    wave = np.where(np.arange(count)[:, None] < lit, np.exp(1j * K * place[:, None] * sines), 0)
    shown, view = wave @ amplitudes @ wave.T, np.arange(-8, 9) / side / 2
    cosines, ramp = np.sqrt(1 - np.square(view) - np.square(view)[:, None]), np.exp(-1j * K * view[:, None] * place)
    turned = np.exp(-1j * K * sum(stack.gaps) * (cosines - 1)) * waves.spacing**2
    rng, fields = np.random.default_rng(8), []
    for _ in range(draws):
        phases = waves.phases(rng)
        exits = np.concatenate([waves.fields(phases, [(0, 0)], each) for each in shown])
        fields.append(ramp @ exits @ ramp.T * turned)
    expected = measured(np.array(fields))
    error = np.hypot(found[1], expected[1])
    # 0.02 of the brightest: the light of five rms angles and more
    slack = 0.02 * np.repeat([expected[0][0], expected[0][3], expected[0][0]], [3, 3, 6])
    assert_z(found[0], expected[0], error, degrees=draws - 1, slack=slack)
    refute_z(found[0][3:6], 2 * np.square(found[0][:3]), found[1][3:6])  # of Gaussian speckle
    refute_z(found[0] * np.repeat([1.0, -1.0, 1.0], [7, 1, 4]), expected[0], error, degrees=draws - 1, slack=slack)
