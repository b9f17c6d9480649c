"""Camera frames of one point's speckle, drawn from what :func:`fit_setup` found: aperture, grain, contrast, noise.

The field on the camera is the transform of the aperture, filled with circular Gaussian numbers (Goodman, *Speckle
Phenomena in Optics* (2007), chapter 4). Contrast below 1 is a sum of independent patterns whose shares have that
contrast. Pixels with area average the light over it: a product with their transform, exact, since the light is sampled
finely enough to be interpolated. The noise has a variance in proportion to the light, as photons have.
"""

from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len

from specklegen.scene.window import Profile

_APART = 8  # grains between what is seen and its repetition
_FINE = 8  # along a cell of the spectrum, by which the part of it inside the iris is counted
MOST_PATTERNS = 100
"""Independent patterns added up at most: contrast of .1."""


class PointSpeckle(NamedTuple):
    """A setup whose camera frames are drawn.

    Attributes
    ----------
    profile, grain
        As of :class:`specklegen.fit.SetupFit`.
    lit, noise
        Squares of contrast and of the noise over the mean light.
    pixel_integration
        Whether pixels collect light over their area.
    """

    profile: Profile
    grain: float
    lit: float
    noise: float
    pixel_integration: bool

    def draw(self, shape: tuple[int, int], count: int, seed: int) -> np.ndarray:
        """Camera frames float64[count, h, w] of mean 1; those of one seed move smoothly with every number."""
        finer = int(np.ceil((4.0 if self.profile == "gaussian" else 2.0) / self.grain * (1.0 + 1e-3))) + 1
        apart = int(np.ceil(_APART * self.grain))  # a spectrum in cells repeats the light: beyond what the grains reach
        grid = tuple(finer * (next_fast_len(side + apart) or 0) for side in shape)
        pupil = _pupil(self.profile, self.grain * finer, grid)
        shares = _shares(min(self.lit, 1.0))
        mean = np.square(pupil).sum() / np.prod(grid) ** 2
        lit = pupil > 0
        passed = None
        if self.pixel_integration:
            down, across = np.fft.fftfreq(grid[0]) * finer, np.fft.rfftfreq(grid[1]) * finer
            passed = np.sinc(down)[:, None] * np.sinc(across)
        photographs = np.empty((count, *shape))
        for n in range(count):
            rng = np.random.default_rng([seed, n])
            rough = rng.normal(size=shape)
            light = np.zeros(grid)
            for share in shares:
                waves = np.zeros(grid, np.complex128)
                waves[lit] = _numbers(rng, lit) * pupil[lit]
                field = np.fft.ifft2(waves)
                power = np.square(field.real) + np.square(field.imag)
                light += share * power / mean
            if passed is not None:
                light = np.fft.irfft2(np.fft.rfft2(light) * passed, grid)
            seen = light[: finer * shape[0] : finer, : finer * shape[1] : finer]
            photographs[n] = seen + np.sqrt(self.noise * np.maximum(seen, 0.0)) * rough
        return photographs


def _numbers(rng: np.random.Generator, lit: np.ndarray) -> np.ndarray:
    """Circular Gaussian numbers of mean square 1 at the cells that are lit, by their distance from the middle."""
    rows, columns = (np.rint(np.fft.fftfreq(side) * side).astype(int) for side in lit.shape)
    reach = int(max(np.abs(rows[lit.any(axis=1)]).max(), np.abs(columns[lit.any(axis=0)]).max())) + 1
    # squares about the middle, one ring after the other: a wider pupil draws the same and goes on
    drawn = np.empty((2 * reach + 1, 2 * reach + 1), np.complex128)
    for ring in range(reach + 1):
        number = max(8 * ring, 1)
        line = rng.normal(size=(number, 2)) @ np.array([1.0, 1.0j]) / np.sqrt(2)
        if ring == 0:
            drawn[reach, reach] = line[0]
            continue
        side = 2 * ring
        low, high = reach - ring, reach + ring
        drawn[low, low:high] = line[:side]
        drawn[low:high, high] = line[side : 2 * side]
        drawn[high, low + 1 : high + 1] = line[2 * side : 3 * side]
        drawn[low + 1 : high + 1, low] = line[3 * side :]
    at = np.nonzero(lit)
    return drawn[rows[at[0]] + reach, columns[at[1]] + reach]


def _pupil(profile: Profile, samples: float, grid: tuple[int, int]) -> np.ndarray:
    """Amplitudes over a grid of frequencies of light with so many samples a grain."""
    axes = [np.fft.fftfreq(side) * side for side in grid]
    radii = [side / samples / 2 for side in grid]  # in cells
    if profile == "gaussian":
        r2 = np.add.outer(np.square(axes[0] / radii[0]), np.square(axes[1] / radii[1]))
        return np.where(r2 < 9.0, np.exp(-r2), 0.0)
    inside = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    y, x = ((axis[:, None] + inside).reshape(-1) / radius for axis, radius in zip(axes, radii, strict=True))
    if profile == "square":
        parts = [(np.abs(each) < 1).reshape(-1, _FINE).mean(axis=1) for each in (y, x)]
        return np.sqrt(np.outer(*parts))
    share = np.zeros(grid)
    near = [np.abs(axis) <= radius + 1 for axis, radius in zip(axes, radii, strict=True)]
    rows, columns = (np.repeat(each, _FINE) for each in near)
    part = (np.add.outer(np.square(y[rows]), np.square(x[columns])) < 1).astype(np.float64)
    part = part.reshape(near[0].sum(), _FINE, near[1].sum(), _FINE).mean(axis=(1, 3))
    share[np.ix_(near[0], near[1])] = part
    return np.sqrt(share)


def _shares(lit: float) -> np.ndarray:
    """Shares of the fewest independent patterns whose sum has this contrast^2."""
    count = int(np.ceil(1 / lit - 1e-9))
    if count <= 1:
        return np.ones(1)
    moved = np.sqrt(max(lit - 1 / count, 0.0) / (count * (count - 1)))
    return np.array([1 / count + moved] * (count - 1) + [1 / count - (count - 1) * moved])
