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
from specklegen.scene.screens import PhaseScreen, ScreenStack
from specklegen.scene.sensors import FarField
from specklegen.synthesis.coherent import wave_grid
from specklegen.synthesis.drawn_screens import drawn_scene, drawn_screens
from specklegen.synthesis.gaussian_noise import complex_normals
from tests.refusals import assert_refused
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


def judged(stack, light, sensor, points=150, **changes):
    """A drawer of a scene and one medium of it; its phases, and the fields of the wave program behind all screens.

    On the grid of the first, which begins at the first point of the window: float64[n] positions.
    """
    drawn, amplitudes = drawn_scene(sg.Scene(wavelength=1.0, medium=stack, illumination=light, sensor=sensor))
    drawn = replace(drawn, ballistic=True, **({"points": points} if points else {}), **changes)
    medium = drawn.medium(complex_normals(3, 0, drawn.normals, torch.complex64))
    place = drawn.first + np.arange(drawn.points) * drawn.spacing
    wave = np.where(np.arange(drawn.points)[:, None] < drawn.lit, np.exp(1j * K * place[:, None] * drawn.sines), 0)
    waves = ScreenWaves(stack.replace(behind=0.0), 1.0, drawn.points, drawn.spacing)
    still = drawn._turns(medium) if drawn.moved is not None else medium
    lit = wave @ amplitudes @ wave.T

    def behind(phases, light):
        return waves.fields(phases, [(0, 0)], light)[0]

    place = np.where(place >= drawn.period / 2, place - drawn.period, place)
    return drawn, drawn.speckle(medium, drawn.light(amplitudes)).numpy(), np.angle(still.numpy()), lit, behind, place


def spectrum_of(field, place, sines):
    """(1 / lambda) sum E e^(-ik s . x) dA complex128[n, n] at sines float64[n]."""
    wave = np.exp(-1j * K * sines[:, None] * place)
    return wave @ field @ wave.T * (place[1] - place[0]) ** 2


@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("focus", [0.0, 700.0, -200.0])
def test_a_lens_images_the_field_of_the_wave_program(stack, focus):
    """An integral over the disc of the pupil, 12 times as fine: within 0.02 of the brightest pixel; signs are told."""
    light = CoherentObject(OBJECTS, 30.0, distance=400.0)
    camera = sg.sensors.Imaging(shape=(9, 11), pitch=12.0, aperture=0.012, focus=focus,
                                pupil=sg.sensors.Pupil(stop=0.3, zernike=(0.0, 0.0, 0.0, 0.1, 0.0, 0.2)))  # fmt: skip
    drawn, found, phases, lit, behind, place = judged(stack, light, camera, 300)
    fine = drawn.wavelength / drawn.period / 12
    sines = np.arange(-int(camera.aperture / fine) - 1, int(camera.aperture / fine) + 2) * fine
    pupil = camera.pupil.transmission(*np.meshgrid(sines / camera.aperture, sines / camera.aperture))
    square = np.square(sines) + np.square(sines)[:, None]
    x, y = camera.positions
    for way, told in ((stack.behind + focus, True), (stack.behind + focus + 250.0, False)):
        carried = pupil * np.exp(-1j * K * way * square / (1 + np.sqrt(1 - square))) * fine**2
        rows, columns = (np.exp(1j * K * np.outer(at, sines)) for at in (y, x))
        off = []
        for n in range(2):
            expected = rows @ (spectrum_of(behind(phases, lit[n]), place, sines) * carried) @ columns.T
            off.append(np.abs(found[n] - expected).max() / np.abs(expected).max())
            assert np.abs(found[n] - expected.conj()).max() > 0.1 * np.abs(expected).max()
        assert (max(off) < 0.02) if told else (max(off) > 0.03), off


@pytest.mark.parametrize("stack", STACKS)
def test_points_see_the_field_of_the_wave_program(stack):
    """On the exit plane and beyond, at points of its grid and between rows: within 1e-4 of the brightest."""
    light = CoherentObject(OBJECTS, 30.0, distance=400.0)
    last = sum(stack.gaps)
    drawn = judged(stack, light, sg.sensors.NearField(np.array([[0.0, 0.0, last + 500.0]])), 300)[0]
    rng = np.random.default_rng(1)
    which, deep = rng.integers(0, drawn.lit, (12, 2)), np.repeat([last, last + 300.0, last + 500.0], 4)
    at = drawn.first + which * drawn.spacing
    points = np.column_stack([at, deep]).reshape(3, 4, 3)
    drawn, found, phases, lit, behind, _ = judged(stack, light, sg.sensors.NearField(points), 300)
    waves = ScreenWaves(stack.replace(behind=0.0), 1.0, drawn.points, drawn.spacing)
    for n in range(2):
        field = behind(phases, lit[n])
        expected = [
            waves._carried(field, float(z) - last)[row, column] * np.exp(1j * K * z)
            for z, (column, row) in zip(deep, which, strict=True)
        ]
        expected = np.reshape(expected, (3, 4))
        assert np.abs(found[n] - expected).max() < 1e-4 * np.abs(expected).max()
        assert np.abs(found[n] - expected.conj()).max() > 0.1 * np.abs(expected).max()


def test_single_views_are_those_of_a_grid_of_them():
    """Of 625, more than are summed at once."""
    light, stack = CoherentObject(OBJECTS, 30.0), STACKS[2]
    camera = scene(stack, light, views=25, off=2.0).grid
    drawn = judged(stack, light, sg.sensors.FarField(camera.directions), 200)[1]
    np.testing.assert_allclose(drawn, judged(stack, light, camera, 200)[1], atol=1e-4 * np.abs(drawn).max())


@pytest.mark.parametrize("stack", STACKS)
def test_frames_are_fields_behind_screens_that_have_moved(stack):
    """Each screen by whole points of its own along x and y: fields of the wave program; backwards is told."""
    light = CoherentObject(ONE, 30.0, distance=400.0, times=[0.0, 1.0, 3.0])
    still, steps = light.replace(times=None), np.array([[2.0, -1.0], [-1.0, 3.0]])[: len(stack.screens)]
    for sensor in (scene(stack, still).grid, sg.sensors.Imaging(shape=(5, 5), pitch=12.0, aperture=0.012)):
        plain = judged(stack, still, sensor, 300)[0]
        moving = stack.replace(velocities=tuple(map(tuple, steps * plain.spacing)))
        drawn, found, phases, lit, behind, _ = judged(moving, light, sensor, 300)
        assert drawn.spacing == pytest.approx(plain.spacing)
        for sign in (1, -1):
            expected = []
            for time, shown in zip(light.times, lit, strict=True):
                moved = [np.roll(phase, (sign * step * time)[::-1].astype(int), (0, 1))
                         for phase, step in zip(phases, steps, strict=True)]  # fmt: skip
                field = torch.from_numpy(behind(np.stack(moved), shown)[None].astype(np.complex64))
                expected.append(drawn.views.seen(drawn, field, sum(stack.gaps)).numpy()[0])
            off = np.abs(found - np.stack(expected)).max(axis=(1, 2)) / np.abs(expected).max()
            assert (off < 2e-3).all() if sign > 0 else off[1:].min() > 0.1


@pytest.mark.parametrize("stack", STACKS)
def test_what_screens_do_not_scatter_is_the_light_without_them(stack):
    """Through a lens and at points: e^(-OD / 2) times the field behind screens of no phase."""
    light, last = CoherentObject(OBJECTS, 30.0, distance=400.0), sum(stack.gaps)
    clear = stack.replace(screens=[each.replace(rms_phase=0.0) for each in stack.screens])
    share = np.exp(-0.5 * stack.optical_depth(1.0))
    for sensor in (sg.sensors.Imaging(shape=(5, 5), pitch=12.0, aperture=0.012, focus=50.0),
                   sg.sensors.NearField(np.array([[3.0, 4.0, last + 90.0], [-30.0, 9.0, last + 90.0]]))):  # fmt: skip
        seen = sg.Scene(wavelength=1.0, medium=stack, illumination=light, sensor=sensor)
        mean = sg.statistics.mean_field(seen)
        both = [sg.render(seen, seed=1, mean=added).field for added in (True, False)]
        np.testing.assert_allclose(both[0] - both[1], mean, atol=1e-5 * np.abs(both[0]).max())
        without = sg.render(seen.replace(medium=clear), seed=1, mean=True).field  # on another grid
        np.testing.assert_allclose(mean, share * without, atol=0.02 * np.abs(mean).max())


def test_grids_that_are_too_large_are_refused():
    stack = ScreenStack(screens=[PhaseScreen(rms_phase=30.0, correlation_length=60.0)])
    seen = sg.Scene(wavelength=1.0, medium=stack, illumination=CoherentObject(ONE, 3000.0),
                    sensor=sg.sensors.Imaging(shape=(5, 5), pitch=12.0, aperture=0.012))  # fmt: skip
    assert_refused(lambda: sg.plan(seen), r"so small that 4096 points a side.*Use a smaller object")


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
