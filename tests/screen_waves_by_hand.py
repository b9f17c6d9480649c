"""Moments of fields behind screens, by waves and by the sampler, at the same views and with the same phases."""

import numpy as np

import specklegen as sg
from specklegen.oracles.screen_waves import ScreenWaves


def scene_of(waves, half, steps, width, profile="square", times=None):
    """The scene of a periodic square: views and tilts on the steps of its spectrum."""
    sines = np.asarray(steps) * waves.step
    return sg.Scene(wavelength=waves.wavelength, medium=waves.stack,
                    illumination=sg.CollimatedBeams.tilts(np.arcsin(sines), width, profile, times=times),
                    sensor=sg.FarField.grid((2 * half + 1, 2 * half + 1), waves.step))  # fmt: skip


def wave_fields(waves: ScreenWaves, scene, draws, seed):
    """Scattered fields complex128[R, T, H, W] by waves, with the sampler's origin: window's centre, first screen."""
    rng = np.random.default_rng(seed)
    middle = waves.side / 2
    along = waves.positions - middle
    window = scene.beams.window.amplitude(along, along[:, None])
    beams, (x, y) = scene.beams.directions, scene.sensor.sines
    steps = np.rint(beams[:, :2] / waves.step).astype(int)
    k, views = scene.wavenumber, scene.sensor.directions
    columns, rows = (np.rint(axis / waves.step).astype(int) for axis in (x, y))
    turned = (views[None, ..., :2] - beams[:, None, None, :2]).sum(-1) * middle
    turned = turned - (views[..., 2] - 1) * waves.stack.thickness
    gain = views[None, ..., 2] / np.sqrt(beams[:, 2])[:, None, None] * np.exp(1j * k * turned)
    unscattered = np.exp(-0.5 * waves.stack.optical_depth(waves.wavelength))
    free = waves.fields(np.zeros((len(waves.stack.screens), 1, 1)), steps, window) * unscattered
    found = []
    for _ in range(draws):
        phases = waves.phases(rng)
        if scene.beams.times is None:
            fields = waves.fields(phases, steps, window)
        else:
            both = zip(scene.beams.times, steps, strict=True)
            fields = np.concatenate([waves.fields(at(phases, waves, t), s[None], window) for t, s in both])
        found.append(waves.spectra(fields - free)[:, rows][:, :, columns] * gain)
    return np.array(found)


def at(phases, waves, time):
    """Phases float64[M, n, n] of moving screens at a time, by whole points of the grid."""
    steps = waves.stack.moved([time])[0] / waves.spacing
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    whole = np.rint(steps).astype(int)
    return np.stack([np.roll(each, (y, x), (0, 1)) for each, (x, y) in zip(phases, whole, strict=True)])


def moved(fields, t, step):
    """u_0(v) and u_t(v + i_t) at the views that both see, [R, H, W - step], tilt t by ``step`` views along x."""
    return fields[:, 0, :, : fields.shape[-1] - step], fields[:, t, :, step:]
