"""Straight segments in flatland: nodes and spectral quadratures for wave kernels that are singular on them.

A segment is x = c + h cos(t) along its direction, 0 < t < pi. In t the edge singularities of the unknowns of a thin
screen are gone: a density of 1/sqrt type times dx is an even (cosine) series, a field that vanishes like a square
root is a sine series. What stays singular is removed exactly, with

    ln|cos t - cos t'| = -ln 2 - sum_m (2/m) cos(mt) cos(mt')
    f.p. int_0^pi sin(mt') sin(t') / (cos t - cos t')^2 dt' = -pi m sin(mt) / sin(t)

so that the error falls faster than any power of the number of nodes. Source: Kress, *Linear Integral Equations* (2014),
section 13.5 (logarithm); Martin, Rizzo, *On boundary integral equations for crack problems*, Proc. R. Soc. A
421, 341 (1989) (finite part).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import factorial, hankel1, j0, j1, psi

SMALL = 1.5
"""Below this argument the regular part of a Hankel function is summed as a power series: there it would cancel."""


@dataclass(frozen=True)
class Segment:
    """A segment from ``start`` to ``end``, float64[2] each, with ``count`` nodes.

    Attributes
    ----------
    start, end : float64[2]
    ends : bool
        Nodes t = j pi / (count + 1) of a sine series if true, else t = (j + 1/2) pi / count of a cosine series.
    """

    start: np.ndarray
    end: np.ndarray
    count: int
    ends: bool = False

    @property
    def half(self) -> float:
        """Half of the length, h."""
        return float(np.hypot(*(self.end - self.start))) / 2

    @cached_property
    def nodes(self) -> np.ndarray:
        """Parameters t, float64[count], rising: the first node lies next to ``end``."""
        j = np.arange(self.count)
        return (j + 1) * np.pi / (self.count + 1) if self.ends else (j + 0.5) * np.pi / self.count

    @property
    def step(self) -> float:
        """Weight of every node in an integral over t of a smooth even function (that vanishes at the ends)."""
        return np.pi / (self.count + 1 if self.ends else self.count)

    @cached_property
    def points(self) -> np.ndarray:
        """Positions of the nodes, float64[count, 2]."""
        middle, along = (self.start + self.end) / 2, (self.end - self.start) / 2
        return middle + np.cos(self.nodes)[:, None] * along

    @cached_property
    def gaps(self) -> np.ndarray:
        """|cos t_i - cos t_j|, float64[count, count], as a product of sines: nodes near an end keep their digits."""
        t = self.nodes
        return np.abs(2 * np.sin((t[:, None] + t) / 2) * np.sin((t[:, None] - t) / 2))

    @cached_property
    def log_weights(self) -> np.ndarray:
        """Weights float64[count, count] of int ln|cos t_i - cos t'| f(t') dt' for a cosine series f."""
        modes = np.arange(1, self.count + 1 if self.ends else self.count)
        cosines = np.cos(self.nodes[:, None] * modes)
        series = -np.log(2) - (cosines * (2 / modes)) @ cosines.T
        if self.ends:  # the last mode that the nodes carry counts half, as in a trapezoidal sum
            last = np.cos((self.count + 1) * self.nodes)
            series -= np.outer(last, last) / (self.count + 1)
        return series * self.step


def segment(
    start: tuple[float, float], end: tuple[float, float], wavelength: float, nodes: float, ends: bool = False
) -> Segment:
    """Return a `Segment` with ``nodes`` nodes a wavelength, and 24 at least."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.hypot(*(b - a)))
    return Segment(a, b, max(24, int(np.ceil(nodes * length / wavelength))), ends)


def single_layer(own: Segment, k: float) -> np.ndarray:
    """Matrix complex128[n, n] of int H_0^(1)(k|x_i - x'|) f(t') dt' on one segment, f a cosine series."""
    z = k * own.half * own.gaps
    log = (2j / np.pi) * j0(z)
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = np.where(z < SMALL, _regular_0(z, k * own.half), hankel1(0, z) - log * np.log(own.gaps))
    return log * own.log_weights + smooth * own.step


def hypersingular(own: Segment, k: float) -> np.ndarray:
    """Matrix complex128[n, n] of sin(t_i) f.p. int (ik/2) H_1^(1)(kR)/R f(t') dx' on one segment, f a sine series."""
    h, t = own.half, own.nodes
    z = k * h * own.gaps
    bessel = np.where(z > 0, j1(z) / np.where(z > 0, z, 1), 0.5)
    log = -(k**2 / np.pi) * bessel
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = h * own.gaps
        direct = 0.5j * k * hankel1(1, z) / distance - 1 / (np.pi * distance**2) - log * np.log(own.gaps)
        smooth = np.where(z < SMALL, _regular_1(z, k, h), direct)
    weights = h * np.sin(t)  # dx' = h sin(t') dt'
    regular = np.sin(t)[:, None] * (log * own.log_weights + smooth * own.step) * weights
    modes = np.arange(1, own.count + 1)
    sines = np.sin(t[:, None] * modes)
    return regular - (sines * modes) @ sines.T * (2 / (own.count + 1)) / h


def _regular_0(z: np.ndarray, scale: float) -> np.ndarray:
    """H_0^(1)(z) - (2i/pi) J_0(z) ln(gap), z = scale * gap: a power series in z^2 [DLMF 10.8.2]."""
    order = np.arange(24)
    terms = (-np.square(np.minimum(z, SMALL))[..., None] / 4) ** order / factorial(order) ** 2
    y = (2 / np.pi) * (np.log(scale / 2) * j0(z) - terms @ psi(order + 1))
    return j0(z) + 1j * y


def _regular_1(z: np.ndarray, k: float, h: float) -> np.ndarray:
    """Return ``(ik/2) H_1^(1)(z)/R`` less its ``1/R^2`` and ``ln(gap)`` terms, ``z = kR = k h gap`` [DLMF 10.8.1]."""
    order = np.arange(24)
    terms = (-np.square(np.minimum(z, SMALL))[..., None] / 4) ** order / (factorial(order) * factorial(order + 1))
    bessel = 0.5 * terms.sum(-1)  # J_1(z) / z
    y = (2 / np.pi) * np.log(k * h / 2) * bessel - terms @ (psi(order + 1) + psi(order + 2)) / (2 * np.pi)
    return 0.5j * k**2 * (bessel + 1j * y)

