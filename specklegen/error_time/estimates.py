"""The covariance that a run implies, with the random phases of its fields averaged out.

    C_pq = E[ a_p a_q* ]    over the paths of a render               ("paths")
    C_pq = I K(i_p - i_q) W^(kappa)    of the correlation that its paths estimate    ("stationary", objects)

One render is one draw of a Gaussian field: its |u|^2 scatters by 100 % whatever the paths. What a number of paths
decides is the covariance of that Gaussian, found here from the same paths, which are a function of the seed.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.special import j0

from specklegen.core.budgets import Reverse
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import batch_sums
from specklegen.error_time.probes import Probes, only
from specklegen.memory_effects.cached import estimated_anew
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.memory_effects.oblique import ObliqueCorrelation
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.tracer import Tracer
from specklegen.planning.planning import plan
from specklegen.samplers.covariance.covariance import covariance
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.screens.correlation import envelope, screen_correlation
from specklegen.samplers.screens.rule import errors
from specklegen.samplers.stationary.renderer import StationaryRenderer
from specklegen.scene.scene import Scene, require_no_film, require_no_focus, require_unpolarised
from specklegen.synthesis.objects import object_imaging
from specklegen.synthesis.stacks import mean_intensity, stack_sampler


@dataclass(frozen=True)
class Estimate:
    """Entries of a covariance and how well they are known.

    Attributes
    ----------
    value : complex128[P]
        In the units of |u|^2, in the order of :attr:`Probes.quadruples`.
    standard_error : float64[P]
        sqrt(E|error|^2), as the run itself finds it.
    """

    value: np.ndarray
    standard_error: np.ndarray

    @classmethod
    def of_batches(cls, sums: np.ndarray, count: float) -> "Estimate":
        """Estimate from the share of n independent batches in the total, complex128[n, P]; NaN errors where n < 2."""
        n = len(sums)
        mean = sums.sum(axis=0) / count
        if n < 2:
            return cls(mean, np.full(mean.shape, np.nan))
        scatter = np.square(np.abs(sums - sums.mean(axis=0))).sum(axis=0)
        return cls(mean, np.sqrt(scatter * n / (n - 1)) / count)


def paths_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed) -> Estimate:
    """Return what ``render(scene, sampler="paths", paths=paths, seed=seed)`` implies, from the paths of that render.

    The NUFFT's error is not in it: it is below the render's ``field_tolerance`` and has nothing to do with paths.
    """
    sampler = plan(scene, paths=paths, sampler="paths", threads=1).chosen
    assert isinstance(sampler, PathSums)
    p, q = probes.ends.T
    sums = np.zeros((), np.complex128)
    for chunk in sampler.work.chunks.slices:
        bank = sampler.tracer.trace(seed, chunk.stop - chunk.start, first=chunk.start, threads=1)
        for part in (bank.single, bank.multiple):
            amplitudes = connection_amplitudes(sampler.tracer, part, probes.points, reverse=sampler.reverse)
            owners = np.tile(part.paths, amplitudes.shape[1] // max(len(part), 1))
            sums = sums + batch_sums(amplitudes[p] * amplitudes[q].conj(), owners, paths)
    return Estimate.of_batches(sums, paths)


def connection_amplitudes(tracer: Tracer, bank: PathBank, points: np.ndarray, *, reverse: bool) -> np.ndarray:
    """Amplitude sqrt(W) a of every connection at points (light, view): complex128[n, M], or [n, 2 M].

    Parameters
    ----------
    tracer
        Of the paths.
    bank
        Connections of single scattering, or of more.
    points
        int[n, 2].
    reverse
        Whether both ways of a path interfere; where they are incoherent, each has columns of its own.
    """
    rows = []
    for light, view in points:
        seen = tracer.layout.of_ends(slice(light, light + 1), slice(view, view + 1))
        if len(bank) and bank.orders[0] == 1:
            rows.append(single_amplitudes(seen, bank))
        else:
            rows.append(multiple_amplitudes(seen, bank, bidirectional=tracer.bidirectional, reverse=reverse))
    return np.concatenate(rows)


def covariance_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed) -> Estimate:
    """Estimate the covariance of the points alone: other lights and views would cost time."""
    return eigen_estimate(*only(scene, probes), paths, seed)


def eigen_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed, *, reverse: Reverse = "auto") -> Estimate:
    """The entries that ``render(scene, sampler="covariance", paths=paths, seed=seed)`` draws its fields from."""
    estimate = covariance(
        scene, paths=paths, seed=seed, pairs=probes.quadruples, orders="all", reverse=reverse, threads=1
    )
    return Estimate(estimate.value, estimate.standard_error)


def single_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed) -> Estimate:
    """Single scattering alone, in closed form; its error is the light that it leaves out, by the largest share."""
    estimate = covariance(scene, pairs=probes.quadruples, orders="single", threads=1)
    share = min(estimate.rel_error, 1 - 1e-9)  # of all light, three standard errors included: may exceed 1
    return Estimate(estimate.value, share / (1 - share) * probes.scale(estimate.value))


def stationary_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed) -> Estimate:
    """Return what the model of ``render(scene, sampler="stationary", paths=paths)`` implies, estimated under a seed.

    Of an incoherent object: between the beams of its lit pixels at views that have moved with them, as its modes
    have it.
    """
    require_no_film("compare", scene)
    require_unpolarised("compare", scene)
    require_no_focus("compare", scene)
    with estimated_anew(seed):
        renderer = plan(scene, paths=paths, sampler="stationary", threads=1).chosen.prepare(seed, 1)
        assert isinstance(renderer, StationaryRenderer)
        correlation = renderer.shared.correlation
    assert isinstance(correlation, MemoryEffectCorrelation | ObliqueCorrelation)
    lights = scene.lights[probes.points[:, 0]]
    q = -scene.wavenumber * np.diff(lights[probes.ends, :2], axis=1)[:, 0]
    area = scene.beams.window.area
    estimate = Estimate.of_batches(area * _batch_sums(correlation, q), correlation.paths)
    carried = 1.0
    if renderer.shared.envelope is not None:
        views = scene.sensor.directions.reshape(-1, 3)[probes.points[:, 1], :2]  # type: ignore[union-attr]
        gains = np.sqrt(renderer.shared.envelope.intensity(lights[:, :2], views))
        carried = gains[probes.ends].prod(axis=1)
    if not scene.illumination.coherent:
        assert isinstance(correlation, MemoryEffectCorrelation)
        value = mean_intensity(correlation, area) * _mode_products(scene, probes, correlation) * carried
        return Estimate(value, estimate.standard_error * carried)
    pattern = _window_products(scene, probes, correlation) / mean_intensity(correlation, area) * carried
    return Estimate(pattern * estimate.value, np.abs(pattern) * estimate.standard_error)


def screens_estimate(scene: Scene, probes: Probes, paths: int, seed: Seed) -> Estimate:
    """Return the closed form behind ``render(scene, sampler="screens")``; its error is the planner's."""
    plan(scene, sampler="screens", threads=1)
    stack = scene.thin
    assert stack is not None
    correlation, (lights, views) = screen_correlation(stack, scene.wavelength), probes.points.T
    carried = envelope(stack, scene.wavelength, scene.beams.directions, scene.grid.directions)
    if carried.mirrored is not None:
        reject("sampler", "another one for a single weak screen", stack, "Its field is not circular.")
    gains = carried.direct.reshape(len(scene.lights), -1)[lights, views].astype(np.complex128)
    p, q = probes.ends.T
    between = correlation.matrix(scene.beams.directions[:, :2], scene.wavenumber)[lights[p], lights[q]]
    value = _window_products(scene, probes, correlation) * between * gains[p] * gains[q].conj()
    return Estimate(value, max(errors(scene).values()) * probes.scale(value))


def _batch_sums(correlation: MemoryEffectCorrelation | ObliqueCorrelation, q: np.ndarray) -> np.ndarray:
    """Sums of contribution times phasor over up to 64 batches of paths at q float64[P, 2], complex128[n, P]."""
    if isinstance(correlation, ObliqueCorrelation):
        phasors = np.exp(-1j * (q @ correlation.displacement.T))
        return batch_sums(correlation.weights * phasors, correlation.owners, correlation.paths)
    return correlation.weights @ j0(np.hypot(*q.T)[:, None] * correlation.radius).T


def _window_products(
    scene: Scene, probes: Probes, correlation: MemoryEffectCorrelation | ObliqueCorrelation
) -> np.ndarray:
    """I W^(kappa) complex128[P] as the cells of the stack sampler have it."""
    stacks = stack_sampler(scene, correlation, dtype=torch.complex128)
    columns = stacks.shape[1]
    rows, across, ramps = (each.numpy() for each in (stacks.rows, stacks.columns, stacks.ramps))
    turned = np.ones(stacks.shape) if stacks.face is None else stacks.face.numpy()
    fields = [turned.flat[v] * np.outer(rows[v // columns], across[v % columns]) * ramps[t] for t, v in probes.points]
    return np.array([np.vdot(fields[q], fields[p]) for p, q in probes.ends])


def _mode_products(scene: Scene, probes: Probes, correlation: MemoryEffectCorrelation) -> np.ndarray:
    """K float64[P] between an object's lit pixels, by the modes that its sampler keeps."""
    beams = scene.illumination
    window = beams.window
    imaging = object_imaging(
        correlation, wavelength=scene.wavelength, object_shape=beams.brightness.shape, object_pitch=beams.pitch,
        width=window.width, profile=window.profile, grid=scene.grid, dtype=torch.complex128,
    )  # fmt: skip
    modes = imaging.modes[0, 0].numpy()[:, np.flatnonzero(beams.brightness)[probes.points[:, 0]]]
    return np.array([modes[:, p] @ modes[:, q] for p, q in probes.ends])
