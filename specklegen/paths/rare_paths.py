"""Rare paths of great weight: errors that rest on few of them are too low more often than not, and say so.

Where a narrow phase function has turned by far more than its width, a path comes out of the scatterers' phase function
about the view once in thousands, and then counts for thousands. What k such paths show of their variance is off by
1/sqrt(k) of it.

The phase function implies the variance, whatever the sample shows. A connection weighs w = rho(cos) towards the view,
and light arrives evenly from all directions that a narrow phase function tells apart. So for any f of its place

    E[w^n f] = M_n E[w f],    M_n = integral of rho^n over all directions

and ``sum(w^2 f^2)`` is ``M_2 sum(w f^2)``, a sum to which many paths contribute. The attenuation on the way out would
make this less, further connections of the same path make it more; both are left out. Standard deviations of many runs
are within a fifth of it for forward Henyey-Greenstein particles (``5 <= OD <= 50``, ``0.9 <= g <= 0.99``), along the
axis; at OD 2 it is up to 1.6 times too large.

Light sent back does not arrive evenly from slabs thinner than half a transport length: few paths turn so far that they
come out about the view. The error would be up to five times too large; it is made smaller as the slab is thinner.
Reversed paths leave it as it is (docs/notes/trust.md has coverages).
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import warn_user
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.statistics import BATCHES, doubt_factor, rarity
from specklegen.core.values import remembered
from specklegen.paths.steps import refracting_layers
from specklegen.paths.stretching import draws_across
from specklegen.scene.media import PlaneMedium
from specklegen.scene.scatterers import Scatterer

ENOUGH = 25.0
"""Paths that have to carry a variance for an error known to a tenth."""
FEW = 4.0
"""Fewer than these, and an error is known to a factor of two at best."""
_UNKNOWABLE = 0.5
"""Fewer that are expected to carry a variance, and not even what the phase function implies is known from a sample."""


class Implied(NamedTuple):
    """Consequences of a phase function for estimates K = E[w p]/E[w].

    Attributes
    ----------
    error : float64[T]
        Standard error of K.
    paths : float64[T]
        How many paths are expected to carry its variance; infinite where nothing is implied, or nothing varies.
    """

    error: np.ndarray
    paths: np.ndarray

    def seen(self, medium: PlaneMedium, side: float) -> "Implied":
        """Return it for light let through (``side`` > 0) or sent back."""
        turns = (layer.thickness / layer.mean_free_path * (1 - layer.scatterer.mean_cosine())
                 for layer in medium.layers)  # fmt: skip
        return self if side > 0 else self._replace(error=self.error * min(1.0, 2 * sum(turns)))

    def at_least(self, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Errors float64[T] of a function of K of this slope, raised to what is implied where few paths carry them.

        A sample may have missed the widest of the k paths that carry a variance: a k-th of it is added.
        """
        missed = np.sqrt(1 + 1 / np.maximum(self.paths, _UNKNOWABLE))
        return np.where(self.paths < FEW, np.maximum(error, slope * self.error * missed), error)


def implied_error(medium: PlaneMedium, light: float, squares: np.ndarray, fourths: np.ndarray) -> Implied:
    """Error of K that the phase function of a medium implies, and how many paths carry it.

    Parameters
    ----------
    medium
        Layers of several phase functions imply what the widest does; nothing is implied where paths are drawn across
        absorbing slabs, and where layers refract: weights are others there.
    light
        Sum of the weights w of all connections.
    squares, fourths
        float64[batches, T] and float64[T], sums of w f^2 of each batch, and of w f^4, f the deviation from K.
    """
    carried = np.full(len(fourths), np.inf)
    if draws_across(medium) or refracting_layers(medium) or not light > 0:
        return Implied(np.zeros(len(fourths)), carried)
    squares, fourths = squares / light, fourths / light  # faint light underflows
    square, fourth = min(map(lobe_moments, medium.scatterers))
    weight, total = light / medium.albedo, squares.sum(axis=0)  # every path has been scattered once
    np.divide((square * total) ** 2 * weight, fourth * fourths, out=carried, where=fourths > 0)
    spread = np.square(squares - total / len(squares)).sum(axis=0)
    doubt = np.divide(spread, np.square(total), out=np.zeros(len(fourths)), where=np.square(total) > 0)
    return Implied(np.sqrt(square * total / weight) * doubt_factor(doubt, doubt), carried)


def implied_by_each(
    medium: PlaneMedium, weights: np.ndarray, batch: np.ndarray, batches: int, deviations: Iterable[np.ndarray]
) -> Implied:
    """Errors by connections: weights float64[M], batches int64[M], T times their deviations from K float64[M].

    Where polarised light passes an analyser, weights are what passes: at most what the phase function implies.
    """
    off = [np.square(each) for each in deviations]
    squares = np.array([np.bincount(batch, weights * each, batches) for each in off]).reshape(len(off), batches)
    fourths = np.array([weights @ np.square(each) for each in off])
    return implied_error(medium, float(weights.sum()), squares.T, fourths)


def changes_of(weight: np.ndarray, product: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
    """Sums complex128[CHANGES] over connections that :func:`implied_by_changes` takes.

    Of weights w float64[M] through an analyser, of complex128[M], w (1 + d), and of all ``light`` l float64[M], w by
    default, which the phase function weighs: the sum of w d, and moments of the change along the mean, of w, and of the
    change across the mean, all over l.
    """
    light = weight if light is None else light
    turn = np.exp(-1j * np.angle(product.sum()))
    turned = product * turn - weight
    lit = light > 0
    whole = turned.real, weight, turned.imag
    parts = [np.divide(each, light, out=np.zeros_like(weight), where=lit) for each in whole]
    pairs = np.array([parts[m] * parts[n] for m, n in _PAIRS])
    return np.concatenate([[(product - weight).sum(), turn], pairs @ light, ((pairs * light) @ pairs.T).ravel()])


_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
CHANGES = 2 + len(_PAIRS) + len(_PAIRS) ** 2


def implied_by_changes(medium: PlaneMedium, lit: np.ndarray, changes: np.ndarray) -> Implied:
    """Errors by light float64[batches] and sums complex128[batches, T, CHANGES] of :func:`changes_of`."""
    light, n = lit.sum(), len(_PAIRS)
    first, turn, moments = changes[..., 0].sum(axis=0) / light, changes[..., 1], changes[..., 2:].real
    size = np.abs(1 + first)
    # From the mean phase of each batch to that of all, which few connections of a batch would take with them.
    off = np.angle((1 + first) * turn)
    less = -2 * np.square(np.sin(off / 2))  # cos - 1
    # The deviation along K: (Re(e turn) - |K|) w / l, by its three parts.
    lost = -(2 * first.real + np.square(np.abs(first))) / (1 + size)  # 1 - |K|
    part = 1 + less, less + lost, np.sin(off)
    pair = np.array([part[j] * part[k] * (1 if j == k else 2) for j, k in _PAIRS])
    squares = np.einsum("pbt,btp->bt", pair, moments[..., :n])
    fourths = np.einsum("pbt,btpq,qbt->t", pair, moments[..., n:].reshape(*off.shape, n, n), pair)
    return implied_error(medium, float(light), np.maximum(squares, 0.0), np.maximum(fourths, 0.0))


@remembered(64)
def lobe_moments(scatterer: Scatterer) -> tuple[float, float]:
    """Integrals of ``rho^2`` and ``rho^4`` over all directions, rho the density of a phase function per steradian.

    Isotropic: ``1 / (4 pi)``, and that to the third power. Henyey-Greenstein: ``(1 + g^2) / (1 - g^2)^2 / (4 pi)``, and
    so on.
    """
    t, weights = gauss_legendre(_NODES)
    half = np.exp((t + 1) / 2 * _DECADES - _DECADES)  # (1 - cos) / 2, by its logarithm
    weights = 2 * np.pi * weights * _DECADES * half
    densities = [(share, np.square(np.abs(each.amplitude(1 - 2 * half, 3)))) for each, share in scatterer.components]
    square, fourth = (sum(share * float(weights @ rho**n) for share, rho in densities) for n in (2, 4))
    return square, fourth


_NODES, _DECADES = 1024, 12 * np.log(10)  # from 2e-6 radians on


def rare_paths_decision(effective_paths: float) -> Decision | None:
    """A doubt where next to none of a pilot's paths carry the variance that it states."""
    if effective_paths >= FEW:
        return None
    return Decision("rare paths", True, f"the expected error rests on {_counted(effective_paths)}", doubt=True)


def warn_of_rare_paths(owner: str, powers: np.ndarray, expected: float = np.inf) -> None:
    """Issue a DoubtWarning where standard errors rest on next to no path.

    Parameters
    ----------
    owner
        Function that is asked, for the message.
    powers
        float64[batches, ...], intensities that batches of paths find.
    expected
        Number of paths that the phase function lets expect (:func:`implied_error`).
    """
    if len(powers) < BATCHES or not np.any(powers):
        return
    rare = float(rarity(powers - powers.mean(axis=0)).max(initial=0.0))
    if rare * FEW > 1 or expected < _UNKNOWABLE:
        warn_user(f"{owner}: standard errors rest on {_counted(min(expected, 1 / max(rare, 1e-300)))}.")


def _counted(count: float) -> str:
    return (
        f"about {max(1, round(count))} of the paths, rare ones of large weight: the stated error may be several "
        "times too low. Trace at least ten times as many paths"
    )
