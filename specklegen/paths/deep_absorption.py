"""How many paths reach the far face of an absorbing slab: what no pilot can tell that has seen none of them.

Paths absorb by a coin and start exponentially deep, so that those at the optical depth t are as many as the light
there, e^(-nu t), nu the slowest decay of radiative transfer. A connection from there is worth e^(-(OD - t)). The
contribution w of a path to a view behind the slab then has

    Var w / (E w)^2 ~ e^(nu OD) max(1 - nu, 1/OD)^2 / (2 - nu)

1/nu is the largest eigenvalue of the spherical harmonics' recurrence (Case and Zweifel, Linear Transport Theory, 1967,
ch. 8): symmetric, tridiagonal, beside the diagonal (l + 1) / sqrt((2l + 1)(2l + 3)(1 - a g_l)(1 - a g_(l+1))), a the
albedo and g_l the Legendre moments of the phase function. Isotropic, a = 0.9: nu = 0.5254; a = 0.5: 0.9575.
"""

import math

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.values import remembered
from specklegen.scene.media import Medium, Slab
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import NearField

LEAST = 10
"""Least ratio of a run's paths to this variance: an error of 30 % is the most that is handed out."""
MOST_PATHS = 10**12
"""Paths of one run: days on a thousand cores."""
_SEEN = 120.0  # relative variance up to which a pilot of 6000 paths sees what matters, 50 times
_MOMENTS = 400
_NODES = 4000


@remembered(64)
def decay(medium: Slab) -> float:
    """Return nu: the transmitted light falls as e^(-nu OD); 0 without absorption, at most 1."""
    albedo = medium.albedo
    if albedo == 1:
        return 0.0
    loss = 1 - albedo * _moments(medium)
    order = np.arange(len(loss) - 1)
    beside = (order + 1) / np.sqrt((2 * order + 1.0) * (2 * order + 3) * loss[:-1] * loss[1:])
    return min(1.0, 1 / float(np.linalg.eigvalsh(np.diag(beside, 1) + np.diag(beside, -1))[-1]))


def relative_variance(medium: Medium) -> float:
    """Var w / (E w)^2 of a path behind a slab, where pilots cannot know it; 0 where they can."""
    if not isinstance(medium, Slab) or medium.optical_depth <= 4 or medium.albedo == 0:
        return 0.0
    nu, depth = decay(medium), medium.optical_depth
    logarithm = nu * depth + 2 * math.log(max(1 - nu, 1 / depth)) - math.log(2 - nu)
    found = math.exp(min(logarithm, 700.0))
    return found if found > _SEEN else 0.0


def scene_relative_variance(scene: Scene) -> float:
    """The same of a scene; 0 where no light has to cross a slab."""
    if not isinstance(scene.medium, Slab) or scene.dimension == 2 or isinstance(scene.sensor, NearField):
        return 0.0
    through = scene.side > 0 and len(scene.lights) > 0
    return relative_variance(scene.medium) if through else 0.0


def require_reach(owner: str, variance: float, paths: int) -> None:
    """Refuse a run whose paths are too few to have seen the light that crosses a slab.

    Parameters
    ----------
    owner
        Function that is asked, for the message.
    variance
        Of :func:`relative_variance`.
    paths
        Paths of the run.

    Raises
    ------
    RuleError
        With the paths that it takes, where there can be so many.
    """
    if paths >= LEAST * variance and paths <= MOST_PATHS:
        return
    needed = LEAST * variance
    remedy = (
        f"Trace {needed:.1e} paths or more." if needed <= MOST_PATHS / 10
        else "Use a thinner slab or less absorption, or look at the light that comes back."
    )  # fmt: skip
    if variance > 0:
        reject(
            f"{owner} paths", "enough that light crosses the absorbing slab in some of them", paths,
            f"Of {variance:.1e} paths about one carries what is seen behind it. {remedy}",
        )  # fmt: skip
    reject(f"{owner} paths", f"at most {MOST_PATHS:.0e}", paths, "Ask for a larger rel_error.")


def _moments(medium: Slab) -> np.ndarray:
    """Legendre moments g_l float64[n] of the phase function, g_0 = 1."""
    t = (np.arange(_NODES) + 0.5) / _NODES
    theta, weights = np.pi * t**2, t  # nodes are dense towards the forward lobe
    cos = np.cos(theta)
    shares = medium.scatterer.components
    density = sum(share * np.square(np.abs(each.amplitude(cos, 3))) for each, share in shares)
    weights = weights * np.sin(theta) * density
    weights /= weights.sum()
    out, before, now = np.empty(_MOMENTS), np.ones(_NODES), cos
    for order in range(_MOMENTS):
        out[order] = weights @ before
        before, now = now, ((2 * order + 3) * cos * now - (order + 1) * before) / (order + 2)
    return np.minimum(out, 1.0)
