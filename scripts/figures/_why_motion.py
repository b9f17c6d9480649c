"""Exposures of a medium in motion, as figures/why.py trains networks on them and judges them.

From this package's stream, from patterns whose field correlation falls as one exponential, as the textbook of speckle
contrast has it, or, to judge by, from waves that go through screens which move (:mod:`specklegen.oracles.multi_slice`).
One bin, 1 / 384 in direction sine, is a pixel of the camera and half a grain: it sees the middle of the light.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.memory_effects.moving import estimate_moving_correlation
from specklegen.oracles.multi_slice import slice_film
from specklegen.theory.speckle_contrast import sub_frames

CAMERA, SIDE = 64, 384
THICKNESS, FREE_PATHS, LOBE = 40.0, (5.0, 10.0), 520.0  # drawn slabs: within the waves' domain
EXPOSURES = np.array([0.25, 1.0, 4.0, 16.0])
TAU0 = 0.01, 0.16  # of particles; light behind them forgets twenty to some hundred times later
LAW_TIMES = 0.25, 16.0  # to 1/e, of the law by hand
_PITCH, _SIZE, _WINDOW = 1.0, 384, slice(96, 288)
_MODES, _ENOUGH = 64, 0.995  # instants of an exposure by hand, and the share of its light in the modes that are drawn
_TOLERANCE = 0.02  # of K^2, by the instants of waves
_VIEWS = np.arange(-CAMERA // 2, CAMERA // 2)


def contrasts(stack: np.ndarray) -> np.ndarray:
    """log10 of K^2 of every exposure over its smooth brightness; float32[T]."""
    seen = stack / gaussian_filter(stack, (0, 12.0, 12.0), mode="nearest")
    return np.log10(seen.var((1, 2)) / np.square(seen.mean((1, 2)))).astype(np.float32)


def exposures_of_the_stream(seed: int, count: int) -> Iterator[tuple[np.ndarray, tuple[float, float]]]:
    """Exposures of drawn slabs, with log10 of the time to 1/e and of the particles' tau0."""
    layer = {"thickness": THICKNESS, "mean_free_path": {"log_uniform": list(FREE_PATHS)},
             "scatterer": {"type": "VonMisesFisher", "concentration": LOBE}}  # fmt: skip
    recipe = load_recipe("lsci-slab", {
        "sampler": "stationary", "material": {"wavelength": 1.0, "kernel_paths": 4000, "layers": [layer]},
        "window": {"width": SIDE / 2.0}, "camera": {"shape": [CAMERA, CAMERA], "pixels_per_grain": 2.0},
        "exposures": {"durations": EXPOSURES.tolist(), "tau0": {"log_uniform": list(TAU0)}},
    })  # fmt: skip
    for start in range(0, count, 50):
        batch = recipe.batch(seed, "train", range(start, min(start + 50, count)))
        told = batch["parameters"]
        yield from zip(batch["stack"], np.log10([told["correlation_time"], told["tau0"]]).T, strict=True)


def exposures_by_a_law(seed: int) -> Iterator[tuple[np.ndarray, tuple[float, float]]]:
    """Exposures without end of light whose g1 is e^-(t / time), as one would write by hand; no slab is behind them."""
    rng = np.random.default_rng([seed, 6])
    apart = np.abs(np.subtract.outer(np.arange(_MODES), np.arange(_MODES))) / _MODES
    while True:
        time, images = float(np.exp(rng.uniform(*np.log(LAW_TIMES)))), []
        for exposure in EXPOSURES:
            values = np.linalg.eigvalsh(np.exp(-apart * exposure / time))[::-1] / _MODES
            needed = int(np.searchsorted(np.cumsum(values), _ENOUGH)) + 1
            field = np.zeros((needed, CAMERA, CAMERA), np.complex64)
            real, imaginary = rng.standard_normal((2, needed, CAMERA // 2, CAMERA // 2), dtype=np.float32)
            field[:, : CAMERA // 2, : CAMERA // 2] = real + 1j * imaginary
            powers = np.square(np.abs(np.fft.ifft2(field))) * CAMERA**4
            images.append(np.tensordot(values[:needed].astype(np.float32), powers, 1))
        yield np.array(images), (np.log10(time), np.nan)


def exposures_by_waves(seed: int) -> tuple[np.ndarray, tuple[float, float]]:
    """One stack of exposures of a drawn slab, each of a medium of its own; the time to 1/e is that of this package."""
    rng = np.random.default_rng([seed, 7])
    free, tau0 = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (FREE_PATHS, TAU0))
    medium = sg.Slab(thickness=THICKNESS, mean_free_path=free, scatterer=sg.media.VonMisesFisher(LOBE))
    known = estimate_moving_correlation(medium.replace(motion=sg.media.Brownian(diffusion=1.0)), 20_000, seed)
    images = []
    for n, exposure in enumerate(EXPOSURES / tau0):
        instants = max(sub_frames(known.field, float(exposure), tolerance=_TOLERANCE), 2)
        motions = (np.arange(instants) + 0.5) / instants * exposure
        film = slice_film(medium, wavelength=1.0, pitch=_PITCH, size=_SIZE, motions=motions, seed=10 * seed + n)
        images.append(np.mean([_seen(each) for each in film], 0))
    return np.array(images), (float(np.log10(known.decay() * tau0)), float(np.log10(tau0)))


def _seen(field: np.ndarray) -> np.ndarray:
    """What a camera sees of a transform, behind a window and without the light that was not scattered."""
    field[0, 0] = 0
    inside = np.zeros_like(field)
    inside[_WINDOW, _WINDOW] = np.fft.ifft2(field)[_WINDOW, _WINDOW]
    return np.square(np.abs(np.fft.fft2(inside)[np.ix_(_VIEWS, _VIEWS)]))
