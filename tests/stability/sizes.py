"""Wide media, and any unit of length."""

from dataclasses import replace

import numpy as np

import specklegen as sg
from specklegen.paths.endpoint_factors import endpoint_factors
from specklegen.paths.tracer import volume_tracer

from .row import Row, measured, within
from .scenes import REQUIRED, beams, scene, slab


def scaled() -> Row:
    """C / length² of one scene with all lengths scaled over 16 decades: the same paths, so equal to rounding."""

    def value(s: float) -> np.ndarray:
        made = scene(slab(1.0, 0.5, thickness=100 * s), beams([0.0, 0.01], width=30 * s), wavelength=s)
        return sg.covariance(made, paths=640, seed=1, reverse=False).value / s**2

    # Phases of 100 wavelengths carry 1e-13.
    right = value(1.0)
    return within("lengths scaled by 1e-8 and 1e8", "scale invariance", [right, right], [value(1e-8), value(1e8)],
                  1e-11)  # fmt: skip


def _leaving(made: sg.Scene, paths: int, seed: int) -> np.ndarray:
    """Light through a box's sides over what meets the box, 64 batches: float64[64]."""
    tracer = replace(volume_tracer(made, False), threshold=0.0)
    generator, sums = np.random.default_rng(seed), np.zeros(64)
    bounds = np.stack([made.medium.lower, made.medium.upper])
    size = paths // 64
    area = float(np.prod((bounds[1] - bounds[0])[:2]))
    for n in range(64):
        bank = tracer.trace(seed, size, first=n * size)
        power = bank.weight * np.square(np.abs(endpoint_factors(tracer.layout, bank, tracer.layout.lights, "entry")[0]))
        # One direction a connection, isotropic: what leaves there unscattered, and through which face.
        out = generator.normal(size=(len(bank), 3))
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        ways = (np.where(out > 0, bounds[1], bounds[0]) - bank.exit) / out
        leaving = power * np.exp(-made.medium.extinction * ways.min(axis=1))
        sums[n] = (leaving * (ways.argmin(axis=1) < 2)).sum() / (size * area)
    return sums


def sideways(optical_depth: float, right: float, paths: int) -> Row:
    """Share of the light that leaves a wide box through its sides, times W/ℓ*, the beam as wide as the box. 5 % are
    allowed, as the table says, and three standard errors of ours: 2e-3 is the chance that a right one fails."""
    width = 200.0  # mean free paths
    box = sg.Box(lower=[-width / 2, -width / 2, 0], upper=[width / 2, width / 2, optical_depth], mean_free_path=1.0,
                 scatterer=sg.Isotropic())  # fmt: skip
    shares = width * _leaving(scene(box, beams([0.0], width)), paths, 1)
    ours, se = float(shares.mean()), float(shares.std(ddof=1) / 8)
    allowed = 0.05 + 3 * se / right
    row = within(f"wide box, OD {optical_depth:g}: sideways share × W/ℓ*", REQUIRED, right, ours, allowed)
    return replace(row, ours=f"{ours:.3g} ± {se:.1g}")


def sideways_thin() -> Row:
    """At optical depth 1."""
    return sideways(1.0, 0.9, 64 * 20_000)


def sideways_medium() -> Row:
    """At optical depth 5."""
    return sideways(5.0, 4.9, 64 * 4000)


def wide_box() -> Row:
    """A box 1e6 times wider than deep is a slab to a beam in its middle."""
    depth, half = 10.0, 5e6
    box = sg.Box(lower=[-half, -half, 0], upper=[half, half, depth], mean_free_path=10.0, scatterer=sg.Isotropic())
    one, two = (
        sg.covariance(scene(medium, beams([0.0, 0.05])), paths=64 * 400, seed=seed, reverse=False)
        for medium, seed in ((box, 1), (slab(1.0, thickness=depth), 2))
    )
    return measured("aspect ratio 1e6: covariance inside", "infinite slab", two.value, one.value,
                    np.hypot(one.standard_error, two.standard_error))  # fmt: skip


ROWS = (scaled, sideways_thin, sideways_medium, wide_box)
