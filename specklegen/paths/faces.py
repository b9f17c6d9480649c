"""Factors of a connection whose legs cross or meet the faces of a slab.

    |A_i|^2 -> |A_i|^2 <(1 - R(i)) R(i)^m>,     |B_v|^2 -> |B_v|^2 <(1 - R(v)) R(v)^m'>

m, m' are the reflections of the first and the last leg; the mean is over both polarisations, which light keeps along a
leg (:mod:`specklegen.kernels.fresnel`). The factors are symmetric, so reciprocity holds, and with them |u|^2 stays per
steradian *inside*; outside it is cos(theta_out) / (n^2 cos(theta_in)) times that. Phases of reflections go into the
random phase of the connection, which each (m, m') has for itself. Polarised light has roots of 1 - R and of R for
its field along the plane of incidence, and others for that across it (:func:`crossing_matrices`). Legs that were
reflected are unfolded in the bank: their images stand where the leg is straight, so that all else at the ends is as
without faces.
"""

import math

import numpy as np

from specklegen.core.errors import reject
from specklegen.kernels.fresnel import amplitudes, reflectances
from specklegen.scene.faces import Faces
from specklegen.scene.media import PlaneMedium

MOST_IMAGES = 15
_LEFT_OUT = 1e-4  # of the light of an end, in reflections that are not followed


def both_reflectances(faces: Faces, cosines: np.ndarray) -> np.ndarray:
    """R_s and R_p float64[2, ...] at cosines inside, float64[...] of either sign."""
    flat = np.abs(np.asarray(cosines, np.float64)).ravel()
    out = np.empty((2, flat.size))
    reflectances(flat, *faces.indices, out)
    return out.reshape(2, *np.shape(cosines))


def reflectance(faces: Faces, cosines: np.ndarray) -> np.ndarray:
    """R of unpolarised light float64[...] at cosines inside, float64[...] of either sign."""
    return both_reflectances(faces, cosines).mean(axis=0)


def images(medium: PlaneMedium, directions: np.ndarray) -> int:
    """Reflections of a leg that are followed for lights and views float64[n, 3]: all but 1e-4 of the light."""
    if medium.faces.matched or not len(directions):
        return 0
    cosines = np.abs(directions[:, 2])
    back = both_reflectances(medium.faces, cosines).max(axis=0)
    share = float((back * np.exp(-medium.optical_depth / cosines)).max())
    if not share > 0:
        return 0
    return min(MOST_IMAGES, max(0, math.ceil(math.log(_LEFT_OUT * (1 - share)) / math.log(share)) - 1))


def seen_through(medium: PlaneMedium, views: np.ndarray, most: int) -> np.ndarray:
    """Views float64[n, 3] as roulette judges by them: float64[(most + 1) n, 5].

    One block for every number of reflections of the last leg. A row holds the direction in which the leg leaves its
    vertex, and the optical depth from there to the outside as (at z = 0, per length of z); to it -ln of what the
    faces leave is added.
    """
    rows = [_reached(medium, views, m) for m in range(most + 1)]
    return np.ascontiguousarray(np.concatenate(rows))


def _reached(medium: PlaneMedium, views: np.ndarray, m: int) -> np.ndarray:
    up, slant = views[:, 2] > 0, np.abs(views[:, 2])
    from_below = up == (m % 2 == 0)  # whether the leg leaves its vertex upwards
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slope = np.where(slant == 0, 0.0, np.where(from_below, -1.0, 1.0) * medium.extinction / slant)
        far = np.where(from_below, m + 1.0, m) * medium.optical_depth / slant
    slope = np.nan_to_num(slope)  # grazing, to the last bit: the largest number, which times no depth is 0
    far = np.where(slant == 0, np.inf, far)
    if not medium.faces.matched:
        r = both_reflectances(medium.faces, slant)
        with np.errstate(divide="ignore"):
            far -= np.log(((1 - r) * r**m).mean(axis=0))
    turned = views * np.array([1.0, 1.0, -1.0 if m % 2 else 1.0])
    return np.column_stack([turned, far, slope])


def crossing_factors(faces: Faces, vectors: np.ndarray, bounces: np.ndarray) -> np.ndarray:
    """Return ``<(1 - R) R^m>^(1/2)`` float64[n, M] of lights or views [n, 3] after m = bounces int8[M] reflections."""
    r = both_reflectances(faces, vectors[:, 2])[..., None]
    return np.sqrt(((1 - r) * r ** np.arange(MOST_IMAGES + 1)).mean(axis=0))[:, bounces]


def crossing_matrices(faces: Faces, direction: np.ndarray) -> np.ndarray:
    """Shares of either polarisation, beside :func:`crossing_factors`: float64[m, 2, 2] by reflections.

    Of a light or view float64[3], between fields along x and y on both sides: turned the shortest way from the axis,
    they have the same parts in the plane with the axis, whatever the angle to it.
    """
    inside, _, outside = faces.indices
    flat = float(np.hypot(*direction[:2]))
    across, across_im, along, _ = amplitudes(abs(float(direction[2])), inside, outside)
    out = np.zeros((MOST_IMAGES + 1, 2, 2))
    if across_im or abs(across) >= 1:  # nothing crosses
        return out
    radial = direction[:2] / flat if flat else np.array([1.0, 0.0])
    axes = np.stack([radial, [-radial[1], radial[0]]])
    for m in range(MOST_IMAGES + 1):
        if scalar := float(crossing_factors(faces, direction[None], np.array([m])).item()):
            kept = [math.sqrt(1 - r * r) * r**m / scalar for r in (along, across)]
            out[m] = axes.T @ np.diag(kept) @ axes
    return out


def require_reflection(medium: PlaneMedium, views: np.ndarray) -> None:
    """Refuse reversed paths through a slab with faces: both ways then end behind different ones."""
    if medium.refracts and len(views) and (views[:, 2] > 0).any():
        reject("reverse", 'False or "auto" in transmission through faces that reflect', True,
               "There is no backscattering direction behind the slab, so reversed paths add nothing.")  # fmt: skip
