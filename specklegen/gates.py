"""Verdicts: what a scene needs, and why. The planner folds them; pipelines obey them."""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from specklegen.values import reject

Reverse = bool | Literal["auto"]
Sampler = Literal["auto", "paths", "covariance", "stationary"]
BACKSCATTER_WING = {3: 0.65, 2: 0.56}  # isotropic scatterers: the slow wing of the cone (physics.md 2)


@dataclass(frozen=True)
class Verdict:
    """Whether one part of the physics takes part, with the reason in words.

    Attributes
    ----------
    part : str
        The part judged.
    needed : bool
        Whether it takes part.
    reason : str
        Why, for a reader of ``plan(...).explain()``.
    """

    part: str
    needed: bool
    reason: str


class DoubtWarning(UserWarning):
    """The model is applied where what it assumes is doubtful; results are finite, but may not be physical."""


def independence_doubt(mean_free_path: float, wavelength: float) -> str | None:
    """Why the particles' independence, which every estimate assumes, is doubtful; None where it is not."""
    if mean_free_path >= wavelength:
        return None
    return f"the mean free path {mean_free_path:g} is below the wavelength {wavelength:g}"


def warn_of_dependence(mean_free_path: float, wavelength: float) -> None:
    """Issue a :class:`DoubtWarning` where independent scattering is doubtful, for results that have no verdicts."""
    doubt = independence_doubt(mean_free_path, wavelength)
    if doubt:
        warnings.warn(f"independent scattering is assumed, but doubtful: {doubt}", DoubtWarning, stacklevel=3)


def reversal_verdict(
    mean_free_path: float, wavelength: float, light: np.ndarray, views: np.ndarray, reverse: Reverse, tolerance: float
) -> Verdict:
    """Reversed paths (coherent backscattering): needed near v = -i.

    Away from -i they add about 0.65 / (k l |i + v|) of the intensity, 0.56 in flatland (physics.md 2), with the
    mean free path l and not the transport length, which is the safe side for forward scattering.

    Parameters
    ----------
    light, views
        float64[..., d], all tilts and all views; every pair counts.
    reverse
        True or False decide, "auto" judges.
    tolerance
        Relative intensity below which they are left out.
    """
    part = "reversed paths"
    if isinstance(reverse, bool):
        return Verdict(part, reverse, "asked for" if reverse else "as asked")
    if reverse != "auto":
        reject("reverse", 'True, False or "auto"', reverse)
    dimension = views.shape[-1]
    nearest = _nearest_sum(light.reshape(-1, dimension), views.reshape(-1, dimension))
    wing = BACKSCATTER_WING[dimension] * wavelength / (2 * np.pi * mean_free_path * max(nearest, 1e-300))
    if wing > tolerance:
        return Verdict(part, True, f"add up to {min(wing, 1):.2g} of the intensity near exact backscattering")
    return Verdict(
        part, False,
        f"add at most {wing:.2g} of the intensity this far from backscattering, allowed {tolerance:g}",
    )  # fmt: skip


def _nearest_sum(light: np.ndarray, views: np.ndarray) -> float:
    """Smallest |i + v| over all pairs, from a tree (grids have a million views)."""
    if len(light) == 0 or len(views) == 0:
        return 2.0
    if views[:, -1].min() > 0 and light[:, -1].min() > 0:
        # Transmission: |i + v| >= i_z + v_z, tight enough and free.
        return float(light[:, -1].min() + views[:, -1].min())
    from scipy.spatial import KDTree

    distance, _ = KDTree(-light).query(views)
    return float(distance.min())
