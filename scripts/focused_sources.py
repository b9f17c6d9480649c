"""What focused sources are worth to Monte Carlo: their closed form, and paths that start where the light is.

Bar, Alterman, Gkioulekas, Levin, *Rendering Near-Field Speckle Statistics in Scattering Media*, ACM Trans. Graph.
39(6), 187 (2020): with Gaussian beams and lobes of von Mises and Fisher focusing has a closed form, which makes
rendering a few orders of magnitude faster at negligible bias. Here the mean intensity of multiply scattered light
straight ahead is estimated from the same walks in two ways:

* points: starts evenly wherever light of the window comes, the focus a sum of plane waves (what ``sg.render`` does of
  FocusedBeams);
* focused: starts as the Gaussian beam is bright at their depth, nine in ten of them, and the closed form at the first
  particle.

    python scripts/focused_sources.py [--paths 100000] [--quick]
"""

import argparse
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import specklegen as sg
from specklegen.kernels import walk
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import endpoint_factors
from specklegen.paths.focused_light import entrance_factors
from specklegen.paths.tracer import slab_tracer
from specklegen.theory.focused_light import gaussian_focus

CONCENTRATION = 60.0  # g = .983
BATCHES = 20
SHARE = 0.9  # of the starts that follow the light; the others keep weights below ten
CASES = {
    "OD 2, focused 1 mean free path deep": (40.0, 20.0, 20.0, 3.0),
    "OD 5, focused 1 mean free path deep": (100.0, 20.0, 20.0, 3.0),
    "OD 5, focused 2.5 mean free paths deep": (100.0, 20.0, 50.0, 3.0),
}
"""Thickness, mean free path, depth of the focus and waist, in wavelengths."""


class Found(NamedTuple):
    """Estimates of one way: means and sums of squares of a path's contributions, batch by batch."""

    means: np.ndarray
    squares: np.ndarray
    seconds: float  # CPU, of all paths, tracing included

    @property
    def relative_variance(self) -> float:
        """Of what one path contributes, over its mean squared."""
        return float(self.squares.mean() / self.means.mean() ** 2 - 1)

    @property
    def relative_error(self) -> float:
        """Of the mean of all paths."""
        return float(self.means.std(ddof=1) / np.sqrt(len(self.means)) / self.means.mean())


def scene_of(thickness: float, mean_free_path: float, depth: float, waist: float) -> sg.Scene:
    """One focus on the axis of a slab, seen straight ahead."""
    lobe = sg.media.VonMisesFisher(CONCENTRATION)
    return sg.Scene(
        wavelength=1.0, medium=sg.Slab(thickness=thickness, mean_free_path=mean_free_path, scatterer=lobe),
        illumination=sg.light.FocusedBeams([[0.0, 0.0, depth]], waist=waist),
        sensor=sg.sensors.FarField([[0.0, 0.0, 1.0]]),
    )  # fmt: skip


def moved_to_focus(bank: PathBank, depth: float, waist: float, side: float, rng: np.random.Generator) -> PathBank:
    """The same walks, moved sideways to start where a Gaussian beam is bright at the depth of their first particle.

    A slab is alike everywhere, so that a walk may start anywhere; weights are times the density of even starts
    over that of these.
    """
    z = bank.entry[:, 2]
    radius = waist * np.sqrt(1 + np.square((z - depth) / (np.pi * waist**2)))  # 1/e^2 of the intensity
    places = rng.normal(size=(len(bank), 2)) * (radius / 2)[:, None]
    anywhere = rng.random(len(bank)) > SHARE
    places[anywhere] = (rng.random((int(anywhere.sum()), 2)) - 0.5) * side
    bright = 2 / (np.pi * radius**2) * np.exp(-2 * np.square(places).sum(1) / radius**2)
    even = (np.abs(places) < side / 2).all(axis=1) / side**2
    records = bank.records.copy()
    shift = places - bank.entry[:, :2]
    records[:, walk.ENTRY : walk.ENTRY + 2] += shift
    records[:, walk.EXIT : walk.EXIT + 2] += shift
    records[:, walk.WEIGHT] *= even / (SHARE * bright + (1 - SHARE) * even)
    return replace(bank, records=records)


def closed_form(scene: sg.Scene, bank: PathBank) -> np.ndarray:
    """What the first particles send on of the focus, complex128[M], attenuated along the axis."""
    light, kappa = scene.illumination, CONCENTRATION
    assert light.waist is not None
    lobe = np.sqrt(kappa / (2 * np.pi * -np.expm1(-2 * kappa)))
    field = gaussian_focus(bank.entry, light.points[0], light.waist, scene.wavelength,
                           direction=bank.entry_direction, sharpness=kappa / 2)  # fmt: skip
    return lobe * field * np.exp(-bank.entry[:, 2] / (2 * scene.medium.mean_free_path))


def measured(scene: sg.Scene, paths: int, seed: int = 1) -> dict[str, Found]:
    """Both ways, and a third: moved walks with sums of plane waves, whose mean tells the closed form's bias."""
    lit = scene.replace(illumination=scene.beams)
    tracer, light = slab_tracer(lit, False), scene.illumination
    assert light.waist is not None
    amplitudes, side = light.amplitudes(1.0), 2 * tracer.proposal.extent  # the window, and as far as tilted beams drift
    tracer.trace(seed + 1, 64, threads=1)  # compiled
    closed_form(scene, tracer.trace(seed + 1, 64, threads=1).multiple)
    ways = {"points": (False, False), "focused": (True, True), "moved": (True, False)}
    sums = {name: [] for name in ways}
    seconds = dict.fromkeys(ways, 0.0)
    some, rng = paths // BATCHES, np.random.default_rng(seed)
    for n in range(BATCHES):
        begun = time.process_time()
        bank = tracer.trace(seed, some, first=n * some, threads=1).multiple
        out = np.square(np.abs(endpoint_factors(tracer.layout, bank, tracer.layout.views, "exit")[0]))
        shared = time.process_time() - begun
        for name, (moves, closed) in ways.items():
            begun = time.process_time()
            own = moved_to_focus(bank, light.points[0, 2], light.waist, side, rng) if moves else bank
            entrance = closed_form(scene, own) if closed else entrance_factors(tracer.layout, own, amplitudes)[0]
            power = own.weight * out * np.square(np.abs(entrance))
            seconds[name] += time.process_time() - begun + shared
            sums[name].append([power.sum() / some, np.square(power).sum() / some])
    both = {name: np.array(each).T for name, each in sums.items()}
    return {name: Found(means, squares, seconds[name]) for name, (means, squares) in both.items()}


def main() -> None:
    """Print a line a case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--paths", type=int, default=100_000)
    parser.add_argument("--quick", action="store_true", help="the first case, a tenth of the paths")
    chosen = parser.parse_args()
    for name, case in list(CASES.items())[: 1 if chosen.quick else None]:
        scene = scene_of(*case)
        found = measured(scene, chosen.paths // (10 if chosen.quick else 1))
        points, focused, moved = found["points"], found["focused"], found["moved"]
        beams, variance = len(scene.beams.directions), points.relative_variance / focused.relative_variance
        error = np.hypot(focused.relative_error, moved.relative_error)
        bias = focused.means.mean() / moved.means.mean() - 1
        gap = points.means.mean() / moved.means.mean() - 1
        print(
            f"{name}, {beams} plane waves: relative variance of a path {points.relative_variance:.3g} by points, "
            f"{focused.relative_variance:.3g} focused, ratio {variance:.2g}; CPU time ratio "
            f"{points.seconds / focused.seconds:.2g}; together {variance * points.seconds / focused.seconds:.2g}; "
            f"mean of the closed form off by {bias:+.2%} +- {error:.2%}, "
            f"of even starts by {gap:+.1%} +- {np.hypot(points.relative_error, moved.relative_error):.1%}"
        )


if __name__ == "__main__":
    main()
