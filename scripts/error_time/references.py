"""Right values, frozen: each from something other than the samplers that it judges.

transfer    the correlation transfer equation of a slab of isotropic scatterers, without Monte Carlo. With reversed
            paths: C = S + M(i1, i2; v1, v2) + M(i1, -v2; v1, -i2), for a beam far wider than a mean free path.
naive       Algorithm 1 as a plain Numba program (no thinning, its own generator).
literal     Algorithm 3 as a NumPy program, uniform starts.
coherence   the sheared coherences of thin screens, Eq. 1 of :mod:`specklegen.theory.phase_screens`, transformed by
            quadrature over the exit plane: no mixture of lobes, and no random number.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from references.correlation_transfer import quadruple
from references.naive_covariance import naive_covariance

import specklegen as sg
from specklegen.core.statistics import BATCHES
from specklegen.error_time import Estimate, Probes
from specklegen.error_time.probes import only
from specklegen.oracles import box_algorithms
from specklegen.theory.phase_screens import coherence, tilt_ways

from . import machine
from .literal import literal_setup
from .scenes import SCENES, Case

FOLDER = Path(__file__).with_name("references")
SEED = 20_260_000
SECONDS = 40.0
"""Processor time of a reference that is estimated."""
LONGER = {"transmission-g09-od50": 180.0, "voxels": 210.0}
"""Where that is not enough."""
_PATHS = 8192  # at a time
_QUADRATURE = 800  # intervals of the exit plane along an axis


@dataclass(frozen=True)
class Reference:
    """Frozen right values: value complex128[P], standard_error float64[P], and where they come from."""

    value: np.ndarray
    standard_error: np.ndarray
    source: str


def load(name: str) -> Reference:
    """Read the frozen reference of a scene."""
    with np.load(FOLDER / f"{name}.npz") as stored:
        return Reference(stored["value"], stored["standard_error"], str(stored["source"]))


def freeze(name: str, command: str) -> Reference:
    """Make a scene's reference and store it."""
    case = SCENES[name]()
    exact = {"transfer": transfer, "coherence": coherences}
    if case.reference in exact:
        value = exact[case.reference](case)
        found, count = Estimate(value, np.zeros(len(value))), 0
    else:
        found, count = estimated(case, LONGER.get(name, SECONDS))
    source = {
        "transfer": "correlation transfer equation, no Monte Carlo",
        "naive": f"naive Numba Algorithm 1, {count} paths, seed {SEED}",
        "literal": f"literal NumPy Algorithm 3, {count} paths, seed {SEED}",
        "coherence": "transform of the screens' sheared coherences by quadrature",
    }[case.reference]
    FOLDER.mkdir(exist_ok=True)
    np.savez(
        FOLDER / f"{name}.npz", value=found.value, standard_error=found.standard_error,
        source=f"{source}; `{command}` at {machine.commit()}",
    )  # fmt: skip
    return load(name)


def transfer(case: Case) -> np.ndarray:
    """Entries of the covariance in closed form, complex128[P]."""
    scene, backscatter = case.scene, case.scene.views[0, -1] < 0

    def exchange(i1, i2, v1, v2):
        return quadruple(
            scene.slab.optical_depth, mean_free_path=scene.slab.mean_free_path, wavelength=scene.wavelength,
            lights=(i1, i2), views=(v1, v2), albedo=scene.slab.albedo,
        )  # fmt: skip

    entries = []
    for t1, n1, t2, n2 in case.probes.quadruples:
        i1, i2, v1, v2 = scene.lights[t1], scene.lights[t2], scene.views[n1], scene.views[n2]
        found = exchange(i1, i2, v1, v2).total + (exchange(i1, -v2, v1, -i2).multiple if backscatter else 0)
        entries.append(found / np.sqrt(i1[2] * i2[2]))
    return np.array(entries) * scene.slab.albedo / (4 * np.pi) * scene.beams.width**2


def coherences(case: Case) -> np.ndarray:
    """Entries of the covariance behind thin screens at views that have moved with the lights, complex128[P]."""
    scene, found = case.scene, []
    stack, k = scene.thin, scene.wavenumber
    assert stack is not None
    axis = np.linspace(-1.0, 1.0, _QUADRATURE + 1) * 4 * stack.correlation_lengths.max()
    points = np.stack(np.meshgrid(axis, axis), axis=-1)
    rest = np.exp(-stack.optical_depth(scene.wavelength))
    for t1, n1, t2, n2 in case.probes.quadruples:
        i1, i2, v1, v2 = scene.lights[t1], scene.lights[t2], scene.views[n1], scene.views[n2]
        ways, seen = tilt_ways(stack, (i1 - i2)[:2]), (v1 - i1)[:2]
        held = coherence(stack, scene.wavelength, points + ways.mean(axis=0), ways) - rest
        waves = np.exp(-1j * k * (points + ways.mean(axis=0)) @ seen)
        turned = stack.distances[0] * (i1[2] - i2[2]) - stack.thickness * (v1[2] - v2[2])  # phases from z = 0
        gain = v1[2] * v2[2] / np.sqrt(i1[2] * i2[2]) * np.exp(1j * k * turned)
        found.append(gain * (held * waves).sum() * (axis[1] - axis[0]) ** 2 / scene.wavelength**2)
    return np.array(found) * scene.beams.window.area


def estimated(case: Case, seconds: float) -> tuple[Estimate, int]:
    """Entries by the oracle that is none of the samplers, for a processor time: the estimate and the paths."""
    batch = _naive_batch if case.reference == "naive" else _literal_batch
    scene, probes = only(case.scene, case.probes)
    started, parts = time.process_time(), []
    while len(parts) < BATCHES or time.process_time() - started < seconds:
        parts.append(batch(scene, probes, _PATHS, SEED + len(parts)))
    used = len(parts) // BATCHES * BATCHES
    batches = np.array(parts[:used]).reshape(BATCHES, -1, len(parts[0])).sum(axis=1)
    return Estimate.of_batches(batches, used), used * _PATHS


def _naive_batch(scene: sg.Scene, probes: Probes, paths: int, seed: int) -> np.ndarray:
    lights, views = scene.lights[probes.points[:, 0]], scene.views[probes.points[:, 1]]
    found = naive_covariance(
        scene.slab, wavelength=scene.wavelength, width=scene.beams.width, lights=lights, views=views, paths=paths,
        seed=seed,
    )  # fmt: skip
    return found[tuple(probes.ends.T)]


def _literal_batch(scene: sg.Scene, probes: Probes, paths: int, seed: int) -> np.ndarray:
    setup = literal_setup(scene, probes)
    found = box_algorithms.covariance(setup, paths, np.random.default_rng([seed]), reverse=True)
    return found[tuple(probes.ends.T)]
