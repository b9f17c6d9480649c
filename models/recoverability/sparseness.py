"""Sparseness of the frequency bands of a camera frame, which separates pictures from speckle without a setup.

A band of frequencies of speckle, whatever the object, is ``y = sum_i a_i |z_i|^2`` of Gaussian z_i with weights of sum
0. Its excess kurtosis ``6 sum a^4 / (sum a^2)^2`` is at most 6, and falls as points or grains are added that take part
in it: of Gaussian noise it is 0. Of the speckle of one point, simulated, it is 8 times centre times grain, and 3.4 from
about half a cycle a grain on; of several alike points a share of that, a quarter of the squared skewness.

Pictures are edges between even places: their bands are dark nearly everywhere and bright along a few lines, with an
excess of 5 to 100 (Field, *J. Opt. Soc. Am. A* 4, 2379 (1987); Mallat, *IEEE Trans. Pattern Anal. Mach. Intell.*
11, 674 (1989)). No object has to be found, and light that only adds, or lowers contrast, changes no excess. Noise that
was blurred is as Gaussian as speckle of many points: this does not decide it.

Bands are octaves of log-Gaussian profile (Field), of pixels, since the grain that is read off a picture means nothing.
Those that hold few independent numbers, or hardly any power of their own octave, are left out. Camera noise stays in:
what is noise is unknown in a picture, and that of photons, whose variance follows the light, has an excess of
3 contrast^2.
"""

import numpy as np

CENTRES = (0.36, 0.18, 0.09, 0.045, 0.0225)
"""Of the bands, cycles a pixel."""
_WIDTH = 0.4  # standard deviation of ln frequency
_OCTAVE, _INSIDE = float(np.log(2)), 0.5  # share of a band's power within its octave, below which it is left out
_SIDE, _FRAMES = 512, 8  # pixels along a side, from the middle, and frames that are looked at, at most
_PADDED = 24  # pixels of mirror image on each side
_BORDER = 2.0  # periods along each side that are left out: a mirror has a kink
_FEWEST = 60.0  # independent numbers in a band
_DARK = 1e-24  # mean square of a band that is rounding
_RISE, _MOST = 8.0, 3.4  # of one point's excess: over centre times grain; at most
_FEW = 1 / 3  # of a point's excess, what any object is granted
_OWN, _SHARE = 0.25, 0.25  # spread of an object's excess: of its own, and over that of a point
_BLOCKS = 4  # along each side, for contrast that changes over the frame


def sparseness(frames: np.ndarray, grain: float, noise: float) -> float:
    """Return how many spreads the sparsest band lies above speckle of a few points; 0 without bands.

    Parameters
    ----------
    frames
        float64[n, h, w] of mean 1.
    grain
        Pixels in a grain.
    noise
        Variance that the camera adds to a pixel.
    """
    first = [max(0, (side - _SIDE) // 2) for side in frames.shape[1:]]
    frames = frames[:_FRAMES, first[0] : first[0] + _SIDE, first[1] : first[1] + _SIDE]
    light = frames - frames.mean((1, 2), keepdims=True)
    variance = max(float(np.square(light).mean()) - noise, 1e-12)
    share = float(np.clip((float((light**3).mean()) / variance**1.5 / 2) ** 2, _FEW, 1.0))
    return max((
        (excess - share * point) / float(np.hypot(_OWN + _SHARE * point, np.sqrt(24 / number)))
        for centre, excess, number in band_excesses(frames)
        for point in [min(_RISE * centre * grain, _MOST)]
    ), default=0.0)  # fmt: skip


def band_excesses(frames: np.ndarray) -> list[tuple[float, float, float]]:
    """Centre in cycles a pixel, excess kurtosis and independent numbers of each band of frames float64[n, h, w]."""
    pads = [min(_PADDED, side - 1) for side in frames.shape[1:]]
    light = np.pad(_levelled(frames), ((0, 0), *((pad, pad) for pad in pads)), mode="reflect")
    sides = light.shape[1:]
    spectrum = np.fft.rfft2(light)
    frequency = np.hypot(np.fft.fftfreq(sides[0])[:, None], np.fft.rfftfreq(sides[1]))
    frequency[0, 0] = 1e-9
    found = []
    for centre in CENTRES:
        passed = np.exp(-np.square(np.log(frequency / centre) / _WIDTH) / 2)
        square, fourth = (2 * float((passed**power).sum()) / (sides[0] * sides[1]) for power in (2, 4))
        number = frames.size * square**2 / fourth
        band = np.fft.irfft2(spectrum * passed, s=sides)
        cuts = [pad + int(min(_BORDER / centre, side / 8)) for pad, side in zip(pads, frames.shape[1:], strict=True)]
        band = band[:, cuts[0] : -cuts[0], cuts[1] : -cuts[1]]
        power = float(np.square(band).mean())
        here = np.square(np.abs(spectrum)).sum(0) * np.square(passed)
        own = here[np.abs(np.log(frequency / centre)) < _OCTAVE / 2].sum() > _INSIDE * here.sum()
        if own and number >= _FEWEST and power > _DARK:
            found.append((centre, float((band**4).mean()) / power**2 - 3, number))
    return found


def _levelled(frames: np.ndarray) -> np.ndarray:
    """Frames less their mean, over a contrast that changes smoothly across: stray light lowers it to one side."""
    rows, columns = (side // _BLOCKS for side in frames.shape[1:])
    light = frames - frames.mean((1, 2), keepdims=True)
    cut = light[:, : rows * _BLOCKS, : columns * _BLOCKS]
    parts = np.square(cut.reshape(len(frames), _BLOCKS, rows, _BLOCKS, columns)).mean((0, 2, 4)).ravel()
    y, x = np.indices((_BLOCKS, _BLOCKS)).reshape(2, -1) - (_BLOCKS - 1) / 2
    terms = np.stack([np.ones_like(x), y, x], 1)
    _, down, across = np.linalg.lstsq(terms, np.log(parts + 1e-3 * parts.mean() + 1e-30), rcond=None)[0]
    at_y, at_x = (
        (np.arange(side) + 0.5) / part - _BLOCKS / 2
        for side, part in zip(frames.shape[1:], (rows, columns), strict=True)
    )
    return light * np.exp(-(down * at_y[:, None] + across * at_x) / 2)
