"""Statistics that compare two sets of speckle images: a few numbers of each image, in groups of one cause each.

Every number is a function of one image (or of one stack of frames of one medium) alone, its brightness taken off, so
that images of one law are exchangeable whatever the numbers are.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.fft import next_fast_len

_EDGES = (0.15, 0.35, 0.6, 0.85, 1.15)  # of rings of frequency, in cycles a grain
_LEAST = 4  # frequencies in a part of a ring
_SHARES = (2.0, 10.0, 25.0, 50.0, 75.0, 90.0, 98.0, 99.5)
_DEGREES = 2  # of the envelope, above those that were fitted
_TINY = 1e-12
_LEAST_SHORT = 1e-9  # of 1, by which a correlation falls short

Groups = Mapping[str, np.ndarray]


def statistics(
    samples: np.ndarray, grain: float, fitted: int = 0, moves: Mapping[int, tuple[int, int]] | None = None
) -> dict[str, np.ndarray]:
    """Numbers of every sample, float64[n, d] by group.

    Parameters
    ----------
    samples
        Images float64[n, T, h, w]; T frames of one medium.
    grain
        Camera pixels in a grain, which says at what distances and frequencies to look.
    fitted
        Degree of an envelope that was fitted and taken off: what it took is no statistic any more.
    moves
        How far patterns move from frame to frame, as of :func:`movements`; left out, not at all.
    """
    level = samples.mean(axis=(2, 3), keepdims=True)
    light = samples / level
    spread = np.sqrt(np.maximum(light.var(axis=(2, 3), keepdims=True), _TINY))
    standard = (light - 1) / spread
    groups = {
        "contrast": np.log(spread[..., 0, 0]).mean(axis=1, keepdims=True),
        "grain": _grain(standard, grain),
        "spectrum": _spectrum(standard, grain),
        "histogram": np.moveaxis(np.percentile(standard, _SHARES, axis=(1, 2, 3)), 0, 1),
        "third order": _third(standard, grain),
        "envelope": _envelope(light.mean(axis=1), fitted),
    }
    if samples.shape[1] > 1:
        groups |= _between(standard, grain, moves or dict.fromkeys(_steps(samples.shape[1]), (0, 0)))
    return groups


def _lags(grain: float, shares: Sequence[float], most: int) -> list[int]:
    return sorted({int(np.clip(round(grain * share), 1, most)) for share in shares})


def _grain(standard: np.ndarray, grain: float) -> np.ndarray:
    """Autocorrelation along both axes up to a grain."""
    lags = _lags(grain, (0.3, 0.5, 0.75, 1.0), min(standard.shape[2:]) // 2)
    across = [(standard[..., lag:] * standard[..., :-lag]).mean(axis=(1, 2, 3)) for lag in lags]
    down = [(standard[..., lag:, :] * standard[..., :-lag, :]).mean(axis=(1, 2, 3)) for lag in lags]
    return np.stack(across + down, axis=1)


def _spectrum(standard: np.ndarray, grain: float) -> np.ndarray:
    """Logarithm of the power in rings of frequency, in three directions each, and the scatter inside the parts."""
    height, width = standard.shape[2:]
    power = np.square(np.abs(np.fft.rfft2(standard))).mean(axis=1)
    v, u = np.meshgrid(np.fft.fftfreq(height), np.fft.rfftfreq(width), indexing="ij")
    place = np.digitize(np.hypot(v, u) * grain, _EDGES)
    steep = np.abs(np.arctan2(v, u))
    turned = np.where(steep > 3 * np.pi / 8, 0, np.where(steep < np.pi / 8, 1, 2))
    means, scatter = [], []
    usable = np.ones_like(place, bool)
    usable[0, 0] = False
    for ring in range(len(_EDGES) + 1):
        for direction in range(3):
            part = power[:, usable & (place == ring) & (turned == direction)]
            if part.shape[1] >= _LEAST:
                part = np.maximum(part, _TINY)
                means.append(np.log(part.mean(axis=1)))
                scatter.append(means[-1] - np.log(part).mean(axis=1))
    return np.stack([*means, np.mean(scatter, axis=0)], axis=1)


def _third(standard: np.ndarray, grain: float) -> np.ndarray:
    """Third-order correlations: x^2(r) x(r + d), and of three points at right angles."""
    most = min(standard.shape[2:]) // 2
    square = np.square(standard)
    moments = []
    for lag in _lags(grain, (0.5, 1.0), most):
        moments.append((square[..., lag:] * standard[..., :-lag]).mean(axis=(1, 2, 3)))
        moments.append((square[..., lag:, :] * standard[..., :-lag, :]).mean(axis=(1, 2, 3)))
        corner = standard[..., lag:, lag:] * standard[..., :-lag, lag:] * standard[..., lag:, :-lag]
        moments.append(corner.mean(axis=(1, 2, 3)))
    return np.stack(moments, axis=1)


def _envelope(light: np.ndarray, fitted: int) -> np.ndarray:
    """Components of the light along Legendre polynomials, and the logarithm of the sum of their squares."""
    rows, columns = (
        np.polynomial.legendre.legvander((2 * np.arange(side) + 1) / side - 1, fitted + _DEGREES) for side in
        light.shape[1:]
    )  # fmt: skip
    parts = np.einsum("yi,nyx,xj->nij", rows, light, columns) / light[0].size
    degree = np.add.outer(np.arange(parts.shape[1]), np.arange(parts.shape[2]))
    kept = parts[:, (degree > fitted) & (degree <= fitted + _DEGREES)]
    return np.concatenate([kept, np.log(np.square(kept).sum(axis=1, keepdims=True) + _TINY)], axis=1)


def movements(samples: np.ndarray) -> dict[int, tuple[int, int]]:
    """Pixels, down and across, by which patterns move between frames so many apart: the peaks of all together.

    Of frames float64[n, T, h, w]. Tilts move the pattern across the camera, and C_I is what is left beside that. The
    frames overlap by a quarter at least.
    """
    frames, height, width = samples.shape[1:]
    light = samples / samples.mean(axis=(2, 3), keepdims=True) - 1
    grid = [next_fast_len(2 * side) or 0 for side in (height, width)]
    waves = np.fft.rfft2(light, grid)
    seen = np.fft.rfft2(np.ones((height, width)), grid)
    overlap = np.rint(np.fft.irfft2(np.square(np.abs(seen)), grid))
    shifts = {}
    for step in _steps(frames):
        power = (np.conj(waves[:, :-step]) * waves[:, step:]).mean(axis=(0, 1))
        alike = np.where(overlap >= height * width / 4, np.fft.irfft2(power, grid) / np.maximum(overlap, 1), -np.inf)
        down, across = np.unravel_index(int(np.argmax(alike)), alike.shape)
        shifts[step] = (int((down + grid[0] // 2) % grid[0]) - grid[0] // 2,
                        int((across + grid[1] // 2) % grid[1]) - grid[1] // 2)  # fmt: skip
    return shifts


def _steps(frames: int) -> list[int]:
    return sorted({int(step) for step in np.rint(np.geomspace(1, frames - 1, 6))})


def _between(standard: np.ndarray, grain: float, moves: Mapping[int, tuple[int, int]]) -> dict[str, np.ndarray]:
    """Correlation of frames against how many lie between, the movement taken off, and by how much more they move.

    Of the correlation the logarithm of what it falls short of 1: where that is little, it differs from range to range
    by as large a factor as elsewhere, and scatters no more.
    """
    correlations = [_short_of_one(standard, step, *moves[step]) for step in _steps(standard.shape[1])]
    lag = max(1, round(grain / 2))
    down, across = moves[1]
    beside = [
        _alike(standard, 1, down, across + lag) - _alike(standard, 1, down, across - lag),
        _alike(standard, 1, down + lag, across) - _alike(standard, 1, down - lag, across),
    ]
    return {"C_I": np.stack(correlations, axis=1), "displacement": np.stack(beside, axis=1)}


def _short_of_one(standard: np.ndarray, step: int, down: int, across: int) -> np.ndarray:
    """ln(1 - C), C the correlation at its peak between pixels: of a parabola through a pixel and those beside it."""
    peak = middle = _alike(standard, step, down, across)
    for sides in (((-1, 0), (1, 0)), ((0, -1), (0, 1))):
        before, after = (_alike(standard, step, down + dy, across + dx) for dy, dx in sides)
        bend = np.maximum(2 * middle - before - after, np.abs(after - before) + _TINY)  # within half a pixel
        peak = peak + np.square(after - before) / (8 * bend)
    return np.log(np.maximum(1 - peak, _LEAST_SHORT))


def _alike(standard: np.ndarray, step: int, down: int, across: int) -> np.ndarray:
    """Correlation of a frame with a later one that has moved so far, where both see the pattern; the mean of all pairs.

    Of what is seen by both, since the contrast of a part differs from that of the whole by more than C_I from 1.
    """
    height, width = standard.shape[2:]
    one = standard[:, :-step, max(0, -down) : height - max(0, down), max(0, -across) : width - max(0, across)]
    other = standard[:, step:, max(0, down) : height - max(0, -down), max(0, across) : width - max(0, -across)]
    one, other = (each - each.mean(axis=(2, 3), keepdims=True) for each in (one, other))
    norm = np.sqrt(np.square(one).sum(axis=(2, 3)) * np.square(other).sum(axis=(2, 3)))
    return ((one * other).sum(axis=(2, 3)) / np.maximum(norm, _TINY)).mean(axis=1)
