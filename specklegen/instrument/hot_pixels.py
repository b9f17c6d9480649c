"""Hot pixels, by dark frames or by their neighbours.

In speckle a bright pixel is nothing strange. But fields are Gaussian, and so given its neighbours a pixel's intensity
is that of a Gaussian field about some mean: whatever the size of the grains, what it is above the best linear
prediction from its neighbours has an exponential tail at most (Goodman, *Speckle Phenomena in Optics*, 2007, section
3.2): it is wider where the light is brighter. That tail, read off between two quantiles among pixels of equally
bright neighbours, says which step hardly any pixel of an image would take. Camera noise has shorter tails.
"""

import numpy as np
from scipy.ndimage import convolve, correlate, maximum_filter

FALSE_ALARMS = 0.1
"""Pixels an image that may be called hot and are not, at most, where the tail is exponential."""
_FAR = 8.0  # spreads of a dark frame from which on a pixel is hot
_WIDE = 5  # pixels, of the square that predicts its middle
_FITTED = 20_000  # squares that the prediction is fitted to
_BINS = 16  # of the neighbours' brightness, at most
_IN_A_BIN = 500  # pixels, at least
_ENDS = 0.9, 0.98  # quantiles between which the tail is read off
_PASSES = 8


def hot_in_dark(dark: np.ndarray) -> np.ndarray:
    """Return which pixels are far off in dark frames[n, h, w]: bool[h, w]."""
    own = dark.mean(axis=0)
    middle = np.median(own)
    spread = max(1.4826 * float(np.median(np.abs(own - middle))), 0.5 / np.sqrt(len(dark)))
    return np.abs(own - middle) > _FAR * spread


def hot_among_neighbours(light: np.ndarray) -> np.ndarray:
    """Return which pixels of a mean image[h, w] are too bright for their neighbours: bool[h, w]."""
    hot = np.zeros(light.shape, bool)
    light = light.astype(np.float64)
    for _ in range(_PASSES):
        step, predicted = _step(light)
        peaks = (step > 1) & (step == maximum_filter(step, _WIDE, mode="reflect")) & ~hot
        if not peaks.any():
            break
        hot |= peaks  # what it did to its neighbours' predictions is gone in the next pass
        light = np.where(peaks, predicted, light)
    return hot


def _step(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Excess of each pixel over its neighbours, divided by the largest such step of an image without hot pixels."""
    around = np.lib.stride_tricks.sliding_window_view(light, (_WIDE, _WIDE)).reshape(-1, _WIDE**2)
    some = around[:: max(1, len(around) // _FITTED)]
    ring = np.arange(_WIDE**2) != _WIDE**2 // 2
    known, centre = some[:, ring], some[:, ~ring][:, 0]
    weights = np.zeros(_WIDE**2)
    mean = light.mean()
    weights[ring] = np.linalg.lstsq(known - mean, centre - mean, rcond=1e-6)[0]
    near = convolve(light, np.ones((3, 3)) / 8, mode="reflect") - light / 8
    predicted = mean + correlate(light - mean, weights.reshape(_WIDE, _WIDE), mode="reflect")
    above = light - predicted
    bins = int(np.clip(light.size // _IN_A_BIN, 1, _BINS))
    edges = np.quantile(near, np.linspace(0, 1, bins + 1))
    places = np.clip(np.searchsorted(edges, near.ravel()) - 1, 0, bins - 1)
    numbers = np.bincount(places, minlength=bins)
    parts = np.split(above.ravel()[np.argsort(places, kind="stable")], np.cumsum(numbers)[:-1])
    ends = np.array([np.quantile(part, _ENDS) if len(part) else (0.0, 0.0) for part in parts])
    beyond = np.log((1 - _ENDS[0]) * light.size / FALSE_ALARMS) / np.log((1 - _ENDS[0]) / (1 - _ENDS[1]))
    largest = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * beyond
    floor = 1e-9 * max(1e-300, abs(mean))
    return above / np.interp(near, (edges[1:] + edges[:-1]) / 2, np.maximum(largest, floor)), predicted


def filled(frames: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return frames[n, h, w] with the mean of good neighbours in the place of pixels that are not good."""
    if good.all():
        return frames
    frames = np.where(good, frames, 0.0)
    known = good.copy()
    ring = np.ones((3, 3))
    while not known.all():
        weight = convolve(known.astype(float), ring, mode="constant")
        new = ~known & (weight > 0)
        for frame in frames:
            frame[new] = convolve(np.where(known, frame, 0.0), ring, mode="constant")[new] / weight[new]
        known |= new
    return frames
