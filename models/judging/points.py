"""Localisation: which of an object's points a reconstruction shows where they are."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from specklegen.models.judging.evaluation import Case, Evaluation
from specklegen.models.metrics import bootstrap

RADIUS = 1.5
"""Pixels within which a point counts as found."""


def brightest(image: np.ndarray, count: int) -> np.ndarray:
    """Places int64[m, 2] (row, column) of the ``count`` brightest maxima among their eight neighbours; m <= count."""
    peaks = np.argwhere((image == maximum_filter(image, 3, mode="constant", cval=-np.inf)) & (image > image.min()))
    order = np.argsort(-image[tuple(peaks.T)], kind="stable")
    return peaks[order[:count]]


def share_found(image: np.ndarray, points: np.ndarray) -> float:
    """Share of the points of an object real[h, w] that have a maximum of the image within :data:`RADIUS` of their own.

    As many maxima as points are looked at, and paired so that most are found: what is missed is also what is invented.
    """
    places = np.argwhere(points > 0)
    near = cdist(places, brightest(image, len(places))) <= RADIUS
    return float(near[linear_sum_assignment(near, maximize=True)].sum() / len(places))


def localisation(found: Evaluation, cases: Sequence[Case]) -> str:
    """Markdown: share of points found by each method, in all and by extent."""
    shares = {
        name: np.array([share_found(case.reconstructions[name], case.object) for case in cases])
        for name in cases[0].reconstructions
    }
    parts = {"all": found} | found.parts()
    masks = {name: np.isin(found.media, part.media) for name, part in parts.items()}
    lines = [f"Share of points within {RADIUS:g} pixels of their own place [95 % interval over media]:", ""]
    lines += ["| method | " + " | ".join(f"{name} ({mask.sum()})" for name, mask in masks.items()) + " |"]
    lines += ["|---" * (1 + len(parts)) + "|"]
    for name, share in shares.items():
        each = [bootstrap(share[mask], found.media[mask]) for mask in masks.values()]
        lines.append(f"| {name} | " + " | ".join("{:.2f} [{:.2f}, {:.2f}]".format(*one) for one in each) + " |")
    return "\n".join(lines) + "\n"
