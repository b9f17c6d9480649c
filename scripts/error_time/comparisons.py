"""Methods to compare with, from ``specklegen.oracles``: they give fields, whose covariance is then measured.

A field of few paths is a draw of what the paths imply, with the phases still in it; four paths a field spend little
on that scatter and are what a field of Algorithm 2 is least. The programs in NumPy are literal, not fast: compare
their errors, not their times.
"""

from collections.abc import Callable

import numpy as np
from references.electric_field import electric_field
from references.naive_numba import naive_field
from scipy.fft import next_fast_len

import specklegen as sg
from specklegen.core.statistics import BATCHES
from specklegen.error_time import Estimate, Probes, Sampler
from specklegen.oracles import box_algorithms
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.oracles.wave_ensemble import CylinderGas, ensemble
from specklegen.oracles.wave_solver import PlaneLights

from .literal import literal_setup
from .scenes import CYLINDER, PERIOD

PATHS_A_FIELD = 4
_AT_ONCE = 4096  # fields
_STACKS = 256  # of the screens sampler, rendered at once


def of_fields(probes: Probes, fields: np.ndarray) -> Estimate:
    """Covariance of independent zero-mean fields complex128[R, n] at the points, with errors from batches of them."""
    batches = min(BATCHES, len(fields))
    p, q = probes.ends.T
    sums = np.array([(part[:, p] * part[:, q].conj()).sum(axis=0) for part in np.array_split(fields, batches)])
    return Estimate.of_batches(sums, len(fields))


def naive(scene: sg.Scene, probes: Probes, count: int, seed: int) -> np.ndarray:
    """Fields of Algorithm 2: of a slab by the Numba program at every light and view, else by the literal one."""
    if not isinstance(scene.medium, sg.Slab):
        return _in_parts(
            lambda rng, fields: box_algorithms.fields(
                literal_setup(scene, probes), PATHS_A_FIELD, fields, rng, reverse=True
            ),
            count, seed,
        )  # fmt: skip
    fields = np.empty((max(2, count // PATHS_A_FIELD), len(probes.points)), np.complex128)
    lights, views = probes.points.T
    for n in range(len(fields)):
        fields[n] = naive_field(
            scene.slab, wavelength=scene.wavelength, width=scene.beams.width, tilts=scene.lights, views=scene.views,
            paths=PATHS_A_FIELD, seed=(seed * 10_000_019 + n) % 2**32,
        )[lights, views]  # fmt: skip
    return fields


def electric(scene: sg.Scene, probes: Probes, count: int, seed: int) -> np.ndarray:
    """Fields of electric-field Monte Carlo: a phase of its own for every photon at every point, forward paths."""
    setup = literal_setup(scene, probes)
    return _in_parts(lambda rng, fields: electric_field(setup, PATHS_A_FIELD, fields, rng), count, seed)


def _in_parts(fields: Callable[[np.random.Generator, int], np.ndarray], count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    left = max(2, count // PATHS_A_FIELD)
    return np.concatenate([fields(rng, min(_AT_ONCE, left - n)) for n in range(0, left, _AT_ONCE)])


def waves(scene: sg.Scene, probes: Probes, count: int, seed: int) -> Estimate:
    """The wave equation for so many placements of cylinders; correlations with light 0."""
    medium = scene.medium
    assert isinstance(medium, sg.media.Box)
    gas = CylinderGas.with_mean_free_path(
        CYLINDER, tuple(medium.lower), tuple(medium.upper), medium.mean_free_path
    )
    views, place = np.unique(probes.points[:, 1], return_inverse=True)
    found = ensemble(
        gas, PlaneLights(scene.lights), {"": lambda solved: solved.far_field(scene.views[views])},
        placements=count, seed=seed, batches=min(BATCHES, count // 2), workers=1,
    )[""]  # fmt: skip
    light = probes.points[:, 0]
    p, q = probes.crossings.T
    assert not light[p].any(), "the ensemble keeps correlations with light 0"
    error = found.covariance_error[place[p], place[q], light[q]]
    return Estimate(
        np.concatenate([found.intensity[place, light], found.covariance[place[p], place[q], light[q]]]),
        np.concatenate([found.intensity_error[place, light], np.hypot(error.real, error.imag)]),
    )


def screen_waves(scene: sg.Scene, probes: Probes, count: int, seed: int) -> np.ndarray:
    """Scattered fields complex128[R, n] of so many drawn pairs of screens, with the sampler's origin and phases."""
    stack, step = scene.thin, scene.sensor.pitch
    assert stack is not None
    points = next_fast_len(int(np.ceil(PERIOD * 8 * stack.rms_angle(scene.wavelength) / scene.wavelength)))
    program = ScreenWaves(stack, scene.wavelength, points, PERIOD / points)
    along = program.positions - PERIOD / 2
    window = scene.beams.window.amplitude(along, along[:, None])
    lights, views = (each[place] for each, place in zip((scene.lights, scene.views), probes.points.T, strict=True))
    columns, rows = np.rint(views[:, :2].T / step).astype(int)
    apart = (views - lights)[:, :2].sum(axis=1) * PERIOD / 2 - (views[:, 2] - 1) * stack.thickness
    gain = views[:, 2] / np.sqrt(lights[:, 2]) * np.exp(1j * scene.wavenumber * apart)
    tilts, rng = np.rint(scene.lights[:, :2] / step).astype(int), np.random.default_rng(seed)
    free = program.fields(np.zeros((len(stack.screens), 1, 1)), tilts, window)
    free = free * np.exp(-0.5 * stack.optical_depth(scene.wavelength))
    found = np.empty((count, len(views)), complex)
    for n in range(count):
        spectra = program.spectra(program.fields(program.phases(rng), tilts, window) - free)
        found[n] = spectra[probes.points[:, 0], rows, columns] * gain
    return found


def drawn_screens(scene: sg.Scene, probes: Probes, count: int, seed: int) -> np.ndarray:
    """Fields complex64[R, n] of as many realizations of the screens sampler."""
    lights, views = probes.points.T
    parts = []
    for n in range(0, count, _STACKS):
        field = sg.render(scene, seed=(seed, n), realizations=min(_STACKS, count - n), threads=1).field
        parts.append(field.reshape(*field.shape[:2], -1)[:, lights, views])
    return np.concatenate(parts)


def _measured(scene: sg.Scene, probes: Probes, count: int, seed: int, fields: np.ndarray) -> Estimate:
    return of_fields(probes, fields)


COMPARISONS = {
    "naive Algorithm 2": Sampler("naive Algorithm 2", naive, _measured, first=16),
    "electric-field Monte Carlo": Sampler("electric-field Monte Carlo", electric, _measured, first=256),
    "wave solver": Sampler("wave solver", waves, lambda *arguments: arguments[-1], first=16),
    "waves through screens": Sampler("waves through screens", screen_waves, _measured, first=4),
    "screens, drawn fields": Sampler("screens, drawn fields", drawn_screens, _measured, first=64),
}
"""Name to method; a scene names those that apply to it."""
