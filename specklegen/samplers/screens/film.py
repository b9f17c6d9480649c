"""Films through screens that move: what motion does to K between the frames of an object's images.

A move of the screens by s_m is to K, at a fixed view, what a tilt by delta_s is, and a rest: a_m = D_m delta + s_m,

    K(delta, s) = K(delta + delta_s) K(0, s - D delta_s),
    delta_s = sum_m e_m (D_m - <D>) s_m / sum_m e_m (D_m - <D>)^2

with e_m and Eq. 2 of :mod:`specklegen.theory.phase_screens`. Of two screens that is exact and nothing rests: one that
moves by s before another, d further on, is a tilt by s / d. Of more it holds where their phase functions are strong,
and :func:`film_error` says how far. The window lets in new parts of a pattern that moves: its overlap is what is kept.
"""

from typing import NamedTuple

import numpy as np

from specklegen.samplers.screens.correlation import drifts, screen_correlation
from specklegen.scene.screens import ScreenStack
from specklegen.scene.window import Window
from specklegen.theory.phase_screens import lobes, tilt_ways


class Film(NamedTuple):
    """Properties of K between frames.

    Attributes
    ----------
    tilts : float64[F, 2]
        delta_s of every frame, direction sines that are added to those of its beams.
    kept : float64[F, F]
        What is left of K besides.
    """

    tilts: np.ndarray
    kept: np.ndarray


def film_of(stack: ScreenStack, wavelength: float, moved: np.ndarray, window: Window) -> Film:
    """Frames of screens that have moved by float64[F, M, 2], behind a window."""
    terms = lobes(stack, wavelength)
    events = terms.densities(0.0) @ terms.events
    apart = stack.distances - events @ stack.distances / events.sum()
    walk = events @ np.square(apart)
    tilts = np.einsum("m,fmc->fc", events * apart / walk if walk else 0 * apart, moved)
    rest, drift = moved - tilt_ways(stack, tilts), drifts(stack, wavelength, moved)
    gone = drift[:, None] - drift
    kept = terms.decorrelation(rest[:, None] - rest) * window.overlap(gone[..., 0], gone[..., 1])
    return Film(tilts, kept)


def frame_correlation(stack: ScreenStack, wavelength: float, moved: np.ndarray, window: Window) -> np.ndarray:
    """Correlation float64[F] of one beam's field with that of screens that have not moved; float64[F, M, 2]."""
    drift = drifts(stack, wavelength, moved)
    return lobes(stack, wavelength).decorrelation(moved) * window.overlap(drift[:, 0], drift[:, 1])


def film_error(
    film: Film, stack: ScreenStack, wavelength: float, moved: np.ndarray, window: Window, reach: float
) -> float:
    """Largest error of C_I between a film's first frame and any other, of beams up to ``reach`` (sine) apart."""
    correlation = screen_correlation(stack, wavelength)
    terms, drift = lobes(stack, wavelength), drifts(stack, wavelength, moved)
    inside = window.overlap(*(drift - drift[0]).T)
    tilt = reach * np.array([[0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5], [1, 0], [-1, 0], [0, 1], [0, -1]])
    exact = terms.decorrelation(tilt_ways(stack, tilt)[:, None] + moved - moved[0]) * inside
    apart = tilt[:, None] + film.tilts - film.tilts[0]
    like = terms.wavenumber * np.hypot(apart[..., 0], apart[..., 1])
    model = (correlation(like) if correlation.weights.any() else 1.0) * film.kept[:, 0]
    return float(np.abs(np.square(exact) - np.square(model)).max(initial=0.0))
