"""Do reported standard errors cover the true error? The variance of 200 z-scores against frozen truth.

z = (value - truth) / (reported standard error), for intensities, whose errors are real; of complex entries the mean
of |error|^2 over the reported square. Right errors give 1; chi-square limits at a false-alarm rate of 1e-6 are
0.58 and 1.57 for 200 runs.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from references.correlation_transfer import field_correlation

import specklegen as sg
from specklegen.error_time import SAMPLERS, Sampler

from .references import load
from .scenes import SCENES, Case, slab

RUNS = 200
LIMITS = 0.58, 1.57
_SAMPLERS: dict[str, Sampler] = {sampler.name: sampler for sampler in SAMPLERS}
CASES = (
    ("paths", "transmission-g0-od10", 8192),
    ("paths", "transmission-g0-od1", 8192),
    ("paths", "backscatter", 8192),
    ("stationary", "transmission-g0-od10", 8192),
    ("stationary", "hidden-object-within", 8192),
    ("covariance, few points", "transmission-g0-od10", 4096),
    ("covariance, few points", "backscatter", 4096),
    ("covariance, few points", "wide-field", 4096),
    ("paths", "transmission-g09-od10", 8192),
    ("stationary", "transmission-g09-od10", 8192),
    ("covariance, few points", "flatland-box", 4096),
    ("covariance, few points", "near-field", 4096),
    ("covariance, few points", "voxels", 4096),
)
"""Sampler, scene, paths; where the truth has an error of its own, it is below a tenth of that of these runs."""


class Calibrated(NamedTuple):
    """Spread of z-scores: ``variance`` is about their mean for real values, and the mean square for complex ones."""

    sampler: str
    scene: str
    quantity: str
    paths: int
    runs: int
    mean: float
    variance: float

    @property
    def passed(self) -> bool:
        """Within the limits of a chi-square variable of 199 degrees of freedom, and a mean within 4.9 / sqrt(runs)."""
        return LIMITS[0] < self.variance < LIMITS[1] and (
            np.isnan(self.mean) or abs(self.mean) < 4.9 * np.sqrt(LIMITS[1] / self.runs)
        )


def calibrate(runs: int = RUNS, progress: Callable[[str], None] = lambda what: None) -> Iterator[Calibrated]:
    """Every sampler, and what ``render`` and ``memory_effect`` report."""
    for name, scene, paths in CASES:
        progress(f"{name}: {scene}")
        yield from sampler_scores(_SAMPLERS[name], scene, paths, runs)
    progress("render")
    yield render_scores("transmission-g0-od10", 8192, runs)
    progress("memory_effect")
    yield memory_effect_scores(8192, runs)


def sampler_scores(sampler: Sampler, scene: str, paths: int, runs: int, *, factor: float = 1.0) -> list[Calibrated]:
    """Scores of one sampler: its first intensity and its first correlation; ``factor`` falsifies what it reports."""
    case, truth = SCENES[scene](), load(scene)
    n = len(case.probes.points)
    found = [
        sampler.estimate(case.scene, case.probes, paths, seed, _needed(sampler, case, paths, seed))
        for seed in range(runs)
    ]
    error = np.array([each.value - truth.value for each in found])
    reported = factor * np.array([each.standard_error for each in found])
    z, square = error[:, 0].real / reported[:, 0], np.square(np.abs(error[:, n]) / reported[:, n])
    return [
        Calibrated(sampler.name, scene, "intensity", paths, runs, float(z.mean()), float(z.var(ddof=1))),
        Calibrated(sampler.name, scene, "tilt covariance", paths, runs, float("nan"), float(square.mean())),
    ]


def _needed(sampler: Sampler, case: Case, paths: int, seed: int) -> object:
    """What the work returns, where the estimate is the work itself; renders are not needed."""
    return sampler.work(case.scene, case.probes, paths, seed) if sampler.name == "covariance, few points" else None


def render_scores(scene: str, paths: int, runs: int) -> Calibrated:
    """The ``expected_error`` of a render's report: relative standard error of the intensity that its paths imply."""
    case, truth = SCENES[scene](), load(scene)
    made = sg.plan(case.scene, paths=paths, sampler="paths", threads=1)
    estimate = partial(_SAMPLERS["paths"].estimate, case.scene, case.probes, paths)
    values = np.array([estimate(seed, None).value[0].real for seed in range(runs)])
    z = (values / truth.value[0].real - 1) / made.expected_error
    return Calibrated(
        "render's expected_error", scene, "intensity", paths, runs, float(z.mean()), float(z.var(ddof=1))
    )


def memory_effect_scores(paths: int, runs: int) -> Calibrated:
    """The standard error of |K|^2 from ``memory_effect``, at q = 1.5, isotropic scatterers, OD 10."""
    medium = slab(0.0, 10.0, 2000.0)
    tilt = 1.5 / (2 * np.pi * medium.thickness)
    truth = float(field_correlation(1.5, medium.optical_depth)) ** 2
    curves = [
        sg.memory_effect(medium, wavelength=1.0, tilts=[np.arcsin(tilt)], paths=paths, seed=seed, threads=1)
        for seed in range(runs)
    ]
    z = np.array([(curve.intensity[0] - truth) / curve.standard_error[0] for curve in curves])
    return Calibrated(
        "memory_effect", "slab, g = 0, OD 10, q = 1.5", "|K|²", paths, runs, float(z.mean()), float(z.var(ddof=1))
    )
