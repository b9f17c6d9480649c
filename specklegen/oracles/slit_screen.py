"""Slits in an infinite thin perfect screen, lit by a plane wave at any angle: the exact field in flatland.

The screen lies on y = 0, the light e^{ik(x sin a + y cos a)} comes from y < 0, time e^{-i omega t}; g = e^{ikx sin a}.
By the symmetry of the screen, in a slit of a *hard* screen (du/dy = 0 on metal) u = g and v = du/dy is unknown; in that
of a *soft* screen (u = 0) du/dy = ik cos(a) g and w = u is unknown:

    hard:  (i/2) int H_0(k|x - x'|) v(x') dx' = -g,              u(x, y) = -(i/2) int H_0(kR) v dx'
    soft:  f.p. int (ik/2) (H_1(k|x - x'|) / |x - x'|) w dx' = ik cos(a) g,   u(x, y) = int (ik/2) H_1(kR) (y/R) w dx'

The transmitted power for unit irradiance is Im(int v g*) / k (hard) and cos(a) Re(int w g*) (soft), a length.
Source: Born and Wolf, *Principles of Optics*, section 11.3 (Babinet's principle, dual integral equations).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import hankel1

from specklegen.oracles.straight_segments import Segment, hypersingular, segment, single_layer

Boundary = Literal["soft", "hard"]


@dataclass(frozen=True)
class SlitScreen:
    """The solved problem; ``unknowns`` complex128[n] stand at the nodes of all slits.

    Attributes
    ----------
    unknowns : complex128[n]
        v h sin(t) (hard) or w (soft).
    angle : float
        Of the light, from the y axis towards +x.
    """

    wavelength: float
    boundary: Boundary
    slits: tuple[Segment, ...]
    unknowns: np.ndarray
    angle: float = 0.0

    @property
    def _weighted(self) -> np.ndarray:
        """V dx' or w dx' at the nodes."""
        soft = self.boundary == "soft"
        lengths = [s.step * (s.half * np.sin(s.nodes) if soft else np.ones(s.count)) for s in self.slits]
        return self.unknowns * np.concatenate(lengths)

    @property
    def transmitted(self) -> float:
        """Power behind the screen for unit irradiance, divided by that of ray optics (the width of all slits seen)."""
        k, x = 2 * np.pi / self.wavelength, np.concatenate([s.points[:, 0] for s in self.slits])
        total = self._weighted @ np.exp(-1j * k * np.sin(self.angle) * x)
        power = total.imag / (k * np.cos(self.angle)) if self.boundary == "hard" else total.real
        return float(power / sum(2 * s.half for s in self.slits))

    def field(self, points: np.ndarray) -> np.ndarray:
        """Field complex128[P] at float64[P, 2] behind the screen, y > 0.

        The sum over the nodes is exact a few node distances away from the slits.
        """
        k, x = 2 * np.pi / self.wavelength, np.concatenate([s.points[:, 0] for s in self.slits])
        distance = np.hypot(points[:, :1] - x, points[:, 1:])
        if self.boundary == "hard":
            return -0.5j * hankel1(0, k * distance) @ self._weighted
        return 0.5j * k * (hankel1(1, k * distance) * points[:, 1:] / distance) @ self._weighted

    def far_field(self, angles: np.ndarray) -> np.ndarray:
        """Amplitude f(theta) complex128[A] of u -> f e^{ikr} / sqrt(r), theta from the y axis towards +x."""
        k, x = 2 * np.pi / self.wavelength, np.concatenate([s.points[:, 0] for s in self.slits])
        angles = np.asarray(angles, dtype=np.float64)
        total = np.exp(-1j * k * np.sin(angles)[:, None] * x) @ self._weighted
        wave = np.sqrt(2 / (np.pi * k)) * np.exp(-0.25j * np.pi)  # H_0(z) -> wave e^{iz}/sqrt(r); H_1 has one -i more
        return -0.5j * wave * total if self.boundary == "hard" else 0.5 * k * wave * np.cos(angles) * total


def slit_screen(
    slits: Sequence[tuple[float, float]], wavelength: float = 1.0, boundary: Boundary = "hard", nodes: float = 16,
    angle: float = 0.0,
) -> SlitScreen:  # fmt: skip
    """Solve slits [x0, x1] that do not touch, with ``nodes`` nodes a wavelength, lit at ``angle`` radians.

    16 nodes a wavelength give 1e-13; each slit has at least 24; slits nearer to each other than a node distance need
    more.
    """
    soft = boundary == "soft"
    parts = tuple(segment((a, 0.0), (b, 0.0), wavelength, nodes, soft) for a, b in slits)
    k = 2 * np.pi / wavelength
    rows = [np.hstack([_block(a, b, k, soft) for b in parts]) for a in parts]
    light = [np.exp(1j * k * np.sin(angle) * a.points[:, 0]) for a in parts]
    light = [1j * k * np.cos(angle) * np.sin(a.nodes) * g if soft else -g for a, g in zip(parts, light, strict=True)]
    return SlitScreen(wavelength, boundary, parts, np.linalg.solve(np.vstack(rows), np.concatenate(light)), angle)


def _block(at: Segment, of: Segment, k: float, soft: bool) -> np.ndarray:
    if at is of:
        return hypersingular(at, k) if soft else 0.5j * single_layer(at, k)
    distance = np.abs(at.points[:, :1] - of.points[:, 0])
    if not soft:
        return 0.5j * hankel1(0, k * distance) * of.step
    weights = of.step * of.half * np.sin(of.nodes)
    return np.sin(at.nodes)[:, None] * (0.5j * k * hankel1(1, k * distance) / distance) * weights
