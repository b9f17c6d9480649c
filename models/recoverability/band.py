"""Estimates from the frequencies of a camera frame: grain along both axes, shape of the aperture, camera noise.

Speckle through an aperture has no frequency above one cycle a grain; noise is white (:mod:`camera_noise`). The power of
a camera frame of some object is

    S(f) = A(f) T(f; grain) + n^2

T the transform of the grain's shape, which falls to 0 at the edge of the band, and A what object and pixels make of it:
smooth, and nowhere 0. Its logarithm is taken for a polynomial. The greatest likelihood of the periodogram, exponential
numbers of mean S, gives all of them (Whittle, *Ark. Mat.* 2, 423 (1953)). An object's own spectrum is rougher than any
polynomial, which widens errors: they are those of the scatter that is left in blocks of frequencies.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from specklegen.scene.window import Profile, Window

SHAPES: tuple[Profile, ...] = ("square", "disc")
_SIDE = 72  # blocks of frequencies along each axis, at most
_FIRST = 1.5  # frequencies about zero that are left out, in peaks of Hann's window
_LEAST = 1e-3
"""Of the mean power: noise that is added, below which Hann's window leaks, and nothing is told apart."""
_ALIKE = 0.02  # standard deviation of ln(grain down / grain across) / 2, before anything was seen
_LOW, _HIGH = -30.0, 12.0  # of the logarithms of powers
_FINEST = 1.9  # pixels in a grain below which its edge lies too near the camera's last frequency


class Band(NamedTuple):
    """Result of the search.

    Attributes
    ----------
    grain : (float, float)
        Camera pixels in a grain, down and across.
    error : float
        Standard error of their logarithm.
    profile : str
        Shape of the aperture, "square" or "disc".
    noise : float
        Variance that the camera adds to a pixel, over the squared mean.
    power : float64[h, w // 2 + 1]
        Periodogram; its mean is the variance of the image.
    frequencies : (float64[h], float64[w // 2 + 1])
        Cycles a pixel.
    light, passed : float64[h, w // 2 + 1]
        Fitted A(f) T(f), and T(f), 1 at frequency 0.
    edge : float
        How much likelier an edge of the band is than none, 2 ln ratio, over the scatter.
    """

    grain: tuple[float, float]
    error: float
    profile: Profile
    noise: float
    power: np.ndarray
    frequencies: tuple[np.ndarray, np.ndarray]
    light: np.ndarray
    passed: np.ndarray
    edge: float


def periodogram(images: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Mean power float64[h, w // 2 + 1] of images float64[n, h, w] of mean 1, under a Hann window, and frequencies."""
    rows, columns = images.shape[1:]
    weights = np.hanning(rows + 2)[1:-1, None] * np.hanning(columns + 2)[1:-1]
    light = images - (images * weights).sum((1, 2), keepdims=True) / weights.sum()
    power = np.square(np.abs(np.fft.rfft2(light * weights))).mean(0) / np.square(weights).sum()
    return power, (np.fft.fftfreq(rows), np.fft.rfftfreq(columns))


def transfer(profile: Profile, down: np.ndarray, across: np.ndarray) -> np.ndarray:
    """T at frequencies in cycles a grain, 1 at 0."""
    return Window(profile, 1.0).overlap(across, down)


def fit_band(images: np.ndarray, looks: float = 1.0) -> Band:
    """Fit grain, aperture and noise to images float64[n, h, w] of mean 1, each a realization of its own."""
    power, (fy, fx) = periodogram(images)
    added = _LEAST * float(power.mean())
    blocks = _blocks(power + added, fy, fx)
    noise = _floor(blocks)
    guess = _edges(blocks, noise)
    fits = [_fitted(blocks, shape, guess, noise) for shape in SHAPES]
    best = min(fits, key=lambda each: each[1])
    free = _fitted(blocks, None, guess, noise)
    shape, cost, at = best
    gy, gx = np.exp(at[:2])
    v, u = np.meshgrid(fy, fx, indexing="ij")
    passed = transfer(shape, v * gy, u * gx)
    light = np.exp(np.clip(_surface(v * gy, u * gx) @ at[3:], _LOW, _HIGH)) * passed
    spread, error = _scatter(blocks, best)
    level = max(float(np.exp(at[2])) - added, 0.0)
    return Band((float(gy), float(gx)), error / np.sqrt(looks), shape, level, power, (fy, fx), light,
                passed, float(2 * (free[1] - cost) / spread))  # fmt: skip


class _Blocks(NamedTuple):
    """Mean power of blocks of frequencies, how many each has, and where they are."""

    power: np.ndarray
    number: np.ndarray
    down: np.ndarray
    across: np.ndarray


def _blocks(power: np.ndarray, fy: np.ndarray, fx: np.ndarray) -> _Blocks:
    """Blocks of frequencies, those about zero left out; all frequencies where they are few."""
    rows = np.minimum(((fy + 0.5) * _SIDE).astype(int), _SIDE - 1) if len(fy) > _SIDE else np.arange(len(fy))
    half = _SIDE // 2
    columns = np.minimum((fx / 0.5 * half).astype(int), half) if len(fx) > half else np.arange(len(fx))
    place = rows[:, None] * (columns.max() + 1) + columns
    near = np.hypot(fy[:, None] * len(fy), fx * (2 * (len(fx) - 1))) <= 2 * _FIRST
    used = np.where(near, 0.0, np.where((fx == 0) | (fx == 0.5), 0.5, 1.0))  # rows that are their own mirror images
    total = np.bincount(place.ravel(), used.ravel())
    wanted = power, np.broadcast_to(fy[:, None], power.shape), np.broadcast_to(fx, power.shape)
    means = [np.bincount(place.ravel(), (used * each).ravel()) / np.maximum(total, 1e-9) for each in wanted]
    kept = total > 0.4
    return _Blocks(np.maximum(means[0][kept], 1e-13), total[kept] / 2.25, means[1][kept], means[2][kept])


def _floor(blocks: _Blocks) -> float:
    """Noise, roughly: the middle of the lowest tenth of the power."""
    low = np.sort(blocks.power)
    return float(np.mean(low[: max(4, len(low) // 10)]))


def _edges(blocks: _Blocks, noise: float) -> tuple[float, float]:
    """Grain down and across, roughly: by where the power along each axis falls to the noise."""
    grains = []
    for along, beside in ((blocks.down, blocks.across), (blocks.across, blocks.down)):
        middle = np.abs(beside) < 0.12
        edges = np.linspace(0, 0.5, 26)
        place = np.digitize(np.abs(along), edges) - 1
        number = np.bincount(place[middle], blocks.number[middle], 26)[:25]
        line = np.bincount(place[middle], (blocks.number * blocks.power)[middle], 26)[:25] / np.maximum(number, 1e-9)
        above = np.flatnonzero(line > 1.5 * noise)
        last = edges[above[-1] + 1] if len(above) else 0.25
        grains.append(float(np.clip(1 / last, _FINEST, 40.0)))
    return grains[0], grains[1]


def _surface(down: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Terms float64[..., 7] of ln A, of frequencies in cycles a grain."""
    square = np.square(down) + np.square(across)
    rho = np.sqrt(square + 0.01)
    turned = np.square(down) - np.square(across)
    return np.stack([np.ones_like(rho), rho, square, rho * square, square * square, turned, down * across], -1)


def _fitted(
    blocks: _Blocks, shape: Profile | None, guess: tuple[float, float], noise: float
) -> tuple[Profile, float, np.ndarray]:  # fmt: skip
    """Shape, -ln likelihood and numbers: ln grain down, across, ln noise, the surface's; without an edge if None."""
    scale = np.maximum(blocks.number, 0.1)
    lit = np.log(np.maximum(np.quantile(blocks.power, 0.9), 2 * noise))

    def cost(at: np.ndarray) -> tuple[float, np.ndarray]:
        gy, gx = np.exp(at[:2])
        v, u = blocks.down * gy, blocks.across * gx
        terms = _surface(v, u)
        smooth = np.exp(np.clip(terms @ at[3:], _LOW, _HIGH))
        passed = np.ones_like(smooth) if shape is None else transfer(shape, v, u)
        level = np.exp(np.clip(at[2], _LOW, _HIGH))
        seen = smooth * passed + level
        ratio = blocks.power / seen
        pull = scale * (1 - ratio) / seen
        slope = np.empty_like(at)
        slope[2] = (pull * level).sum()
        slope[3:] = (pull * smooth * passed) @ terms
        step = 1e-5
        for n, axis in enumerate(((1 + step, 1), (1, 1 + step))):
            there = _surface(v * axis[0], u * axis[1])
            other = np.exp(np.clip(there @ at[3:], _LOW, _HIGH))
            other = other * (1.0 if shape is None else transfer(shape, v * axis[0], u * axis[1]))
            slope[n] = (pull * (other - smooth * passed)).sum() / step
        apart = (at[0] - at[1]) / 2 / _ALIKE
        prior = 1e-3 * np.square(at[3:]).sum() + 0.5 * apart**2
        slope[3:] += 2e-3 * at[3:]
        slope[:2] += np.array([0.5, -0.5]) * apart / _ALIKE
        return float((scale * (np.log(seen) + ratio)).sum() + prior), slope

    best: tuple[float, np.ndarray] | None = None
    bounds = [(np.log(_FINEST * 0.8), np.log(80.0))] * 2 + [(_LOW, _HIGH)] + [(-60.0, 60.0)] * 7
    for factor in (1.0, 0.85, 1.2):
        start = np.zeros(10)
        start[:3] = np.log(np.array(guess) * factor).tolist() + [np.log(noise)]
        start[3] = lit
        optimum = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 200})
        if best is None or optimum.fun < best[0]:
            best = float(optimum.fun), optimum.x
    assert best is not None
    return shape or "square", best[0], best[1]


def _scatter(blocks: _Blocks, fit: tuple[Profile, float, np.ndarray]) -> tuple[float, float]:
    """Variance of the power over the fitted one, over that of exponential numbers; and the error of ln grain."""
    shape, _, at = fit

    def seen(shift: float) -> np.ndarray:
        v, u = blocks.down * np.exp(at[0] + shift), blocks.across * np.exp(at[1] + shift)
        terms = _surface(blocks.down * np.exp(at[0]), blocks.across * np.exp(at[1]))
        smooth = np.exp(np.clip(terms @ at[3:], _LOW, _HIGH))
        return smooth * transfer(shape, v, u) + np.exp(at[2])

    here = seen(0.0)
    number = np.maximum(blocks.number, 0.1)
    spread = max(1.0, float((number * np.square(blocks.power / here - 1)).mean()))
    bend = (seen(0.01) - seen(-0.01)) / 0.02 / here
    return spread, float(np.sqrt(spread / max((number * np.square(bend)).sum(), 1e-12)))
