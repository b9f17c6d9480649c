"""Reflectance and transmittance: the light of a medium that leaves by each face, and in which directions.

    R + T + (sides) + A = 1,     R = R_specular + R_scattered,     T = T_ballistic + T_scattered

Radiative transfer without interference, by paths that go as light goes (:mod:`specklegen.kernels.analog_walk`). Of a
slab the unscattered parts are closed forms, and paths that scatter stand for the rest: with r the reflectance of a face
and b = e^(-OD / mu) inside,

    T_ballistic = (1 - r)^2 b / (1 - r^2 b^2),     R_specular = r + (1 - r)^2 r b^2 / (1 - r^2 b^2),

means over both polarisations, which keep to themselves.

Of layers whose indices differ they are the sums of :mod:`specklegen.paths.steps`. What is left is absorbed,
A = 1 - R - T, exactly. Definitions and figures: van de Hulst, *Multiple Light Scattering*
(1980); Wang, Jacques and Zheng, Computer Methods and Programs in Biomedicine 47, 131 (1995).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import real_array, real_number
from specklegen.core.budgets import DEFAULT_PATHS, Budget, BudgetFields, budget_of
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, Stream, pilot_seed
from specklegen.core.statistics import tail_factor
from specklegen.core.units import RADIAN
from specklegen.kernels.analog_walk import ENTRANCE, FAR, SIDE
from specklegen.paths.analog_walk import Exits, require_walkable, walk
from specklegen.paths.faces import both_reflectances
from specklegen.paths.steps import end_indices, optics, unscattered
from specklegen.scene.media import Medium, PlaneMedium, require_medium
from specklegen.scene.polarisation import require_scalar

_STEPS = 30  # of angle, three degrees each
_UNSEEN = 3 / 1.96  # paths in a standard error: where none of n has shown it, a share is below 3/n in 95 % of cases


class Share(NamedTuple):
    """A share of the incident light, or such shares per steradian, with standard error."""

    value: Any
    standard_error: Any


@dataclass(frozen=True, repr=False)
class ReflectanceTransmittance(Pictured):
    """Shares of incident light that a medium reflects, transmits and absorbs.

    Attributes
    ----------
    reflectance, transmittance, absorptance : float
        Shares of the incident light: thrown back by the entrance face, let through by the far one, absorbed.
    sides : float
        Share that leaves a box by its sides; of a slab 0. The four add up to 1.
    specular, ballistic : float
        The parts of ``reflectance`` and ``transmittance`` that were never scattered.
    reflectance_error, transmittance_error, absorptance_error, sides_error : float
        Standard errors: 1.96 of them hold the truth in 95 % of cases, wider than the scatter where few paths carry it
        (:func:`specklegen.core.statistics.tail_factor`); of what no path has shown, as much as three paths would.
    angles : float64[n + 1]
        Bounds of the steps of angle from the normal, radians, outside the medium.
    reflected, transmitted : float64[n]
        Share per steradian of scattered light that leaves within each step of angle, over all azimuths.
    reflected_error, transmitted_error : float64[n]
        Standard errors.
    paths : int
        Paths walked.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=2.0, mean_free_path=1.0, albedo=0.9, scatterer=sg.media.HenyeyGreenstein(0.75))
    >>> light = sg.statistics.reflectance_transmittance(slab, paths=10_000)
    >>> round(light.reflectance, 2), round(light.transmittance, 2), round(light.ballistic, 4)
    (0.1, 0.66, 0.1353)
    """

    reflectance: float
    transmittance: float
    absorptance: float
    sides: float
    specular: float
    ballistic: float
    reflectance_error: float
    transmittance_error: float
    absorptance_error: float
    sides_error: float
    angles: np.ndarray
    reflected: np.ndarray
    transmitted: np.ndarray
    reflected_error: np.ndarray
    transmitted_error: np.ndarray
    paths: int

    _named = {"reflectance": "reflectance", "transmittance": "transmittance", "absorptance": "absorptance",
              "share out of the sides": "sides", "specular": "specular", "ballistic": "ballistic",
              "paths": "paths"}  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Both densities over the angle, bars of two standard errors."""
        middles = np.rad2deg((self.angles[1:] + self.angles[:-1]) / 2)
        lead = f"{label}: " if label else ""
        for name in ("reflected", "transmitted"):
            draw_curve(axes, middles, getattr(self, name), getattr(self, f"{name}_error"), lead + name)
        axes.set(xlabel="angle from the normal (degrees)", ylabel="share of the light per steradian")
        axes.set_ylim(bottom=0)


@with_units
def reflectance_transmittance(
    medium: Medium, *, budget: Budget | None = None, angle: Annotated[float, RADIAN] = 0.0,
    angles: Annotated[ArrayLike, RADIAN] | None = None, **fields: Unpack[BudgetFields],
) -> ReflectanceTransmittance:  # fmt: skip
    """Walk light through a medium: how much of it is reflected, transmitted and absorbed, and in which directions.

    Intensities alone: interference adds the narrow cone of coherent backscattering, and nothing to the totals behind.

    Parameters
    ----------
    medium
        A slab or layers, with all steps of their refractive index, under light of any width. Or a box or voxels in
        space, lit evenly over the whole face at the lower end of z; what enters at no other face.
    angle
        Of the light from the normal, radians, *outside* the medium; towards +x.
    angles
        float64[n + 1], rising from 0 to pi/2: bounds of the steps over which densities are taken. By default 30
        steps of three degrees; narrower ones show a forward phase function.
    budget
        Paths, an error or a time, seed and threads (:class:`specklegen.results.Budget`). ``rel_error`` is the largest
        standard error of the totals, as a share of the incident light. By default 100 000 paths.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        For arguments out of range, thin screens and flatland, and media that take more than a month.

    Examples
    --------
    >>> import specklegen as sg
    >>> skin = sg.Slab(thickness=1.0, mean_free_path=0.05, albedo=0.99, scatterer=sg.media.HenyeyGreenstein(0.9),
    ...                faces=sg.media.Faces(inside=1.4, outside=1.0))
    >>> light = sg.statistics.reflectance_transmittance(skin, angle=0.5, paths=10_000, seed=1)
    >>> round(light.reflectance + light.transmittance + light.absorptance, 12), round(light.specular, 3)
    (1.0, 0.029)
    >>> light.transmitted.shape  # steps of three degrees
    (30,)
    """
    owner = "reflectance_transmittance"
    budget = budget_of(owner, budget, fields, unused=("reverse", "tolerance"))
    require_medium(f"{owner} medium", medium, "Thin screens transmit all light; for a Scene give its medium.")
    require_scalar(f"{owner} medium", medium)
    if medium.dimension == 2:
        reject(f"{owner} medium", "of three dimensions", medium, "In flatland there are no solid angles.")
    angle = real_number(f"{owner} angle", angle)
    if not 0 <= angle < np.pi / 2:
        reject(f"{owner} angle", "radians from 0 to below pi/2", angle, "Use np.deg2rad.")
    edges = _edges(owner, angles)
    require_walkable(owner, medium, budget.paths or DEFAULT_PATHS)

    def run(count: int, seed: Seed, stream: Stream = Stream.PATHS) -> ReflectanceTransmittance:
        return _balance(medium, angle, edges, count, seed, stream, budget.threads)

    def pilot(count: int) -> float:
        balance = run(count, pilot_seed(medium.fingerprint()), Stream.PILOT)
        return max(
            balance.reflectance_error, balance.transmittance_error, balance.absorptance_error, balance.sides_error
        )

    count = budget.count(pilot)
    require_walkable(owner, medium, count)
    return run(count, budget.seed)


def _balance(
    medium: Medium, angle: float, edges: np.ndarray, paths: int, seed: Seed, stream: Stream, threads: int | None
) -> ReflectanceTransmittance:
    (first, last), outside = end_indices(medium), medium.faces.outside
    sine = np.sin(angle) * outside / first
    if sine >= 1:  # the light is reflected as a whole, and none is walked
        none = np.zeros(len(edges) - 1)
        return ReflectanceTransmittance(
            reflectance=1.0, transmittance=0.0, absorptance=0.0, sides=0.0, specular=1.0, ballistic=0.0,
            reflectance_error=0.0, transmittance_error=0.0, absorptance_error=0.0, sides_error=0.0, angles=edges,
            reflected=none, transmitted=none, reflected_error=none, transmitted_error=none, paths=0,
        )  # fmt: skip
    light = np.array([sine, 0.0, np.sqrt(1 - sine**2)])
    exits = walk(medium, light, paths, seed, stream=stream, threads=threads)
    share = 1.0
    straight: tuple[Any, ...] = 0.0, *(np.where(exits.straight(face), 1.0, 0.0) for face in (FAR, SIDE))
    if not medium.has_sides:
        straight = *_unscattered(medium, angle, float(light[2])), 0.0  # type: ignore[arg-type]
        share, exits = 1 - sum(straight), exits.select(exits.collisions > 0)
    scattered = [share * exits.scattered(face) for face in (ENTRANCE, FAR, SIDE)]
    least = share / max(len(exits.face), 1) if np.any(medium.albedo) else 0.0
    reflected, transmitted = (
        _density(some, exits, edges, index / outside, least)
        for some, index in zip(scattered[:2], (first, last), strict=True)
    )
    back, through, beside = (_total(some, part, least) for some, part in zip(scattered, straight, strict=True))
    left = _total(sum(scattered), sum(straight), least)
    return ReflectanceTransmittance(
        reflectance=back.value,
        transmittance=through.value,
        absorptance=1 - (back.value + through.value + beside.value),
        sides=beside.value,
        specular=float(np.mean(straight[0])),
        ballistic=float(np.mean(straight[1])),
        reflectance_error=back.standard_error,
        transmittance_error=through.standard_error,
        absorptance_error=left.standard_error,
        sides_error=beside.standard_error if medium.has_sides else 0.0,
        angles=edges,
        reflected=reflected.value,
        transmitted=transmitted.value,
        reflected_error=reflected.standard_error,
        transmitted_error=transmitted.standard_error,
        paths=paths,
    )


def _unscattered(medium: PlaneMedium, angle: float, cosine: float) -> tuple[float, float]:
    """Shares of the incident light that a slab throws back and lets through unscattered, echoes included.

    The angle is that outside, the cosine that in the first layer.
    """
    if medium.indices:
        return unscattered(optics(medium), float(np.sin(angle)))
    r, b = both_reflectances(medium.faces, np.array(cosine)), float(np.exp(-medium.optical_depth / cosine))
    echoes = (1 - r) ** 2 * b / (1 - (r * b) ** 2)
    return float((r + r * b * echoes).mean()), float(echoes.mean())


def _total(weights: Any, straight: Any, least: float) -> Share:
    """Mean of what each path adds to the unscattered light, and its standard error, of a path's ``least`` light."""
    samples = weights + straight if len(weights) else np.array([straight])
    error = samples.std() / np.sqrt(len(samples)) * tail_factor(samples - samples.mean())
    return Share(float(samples.mean()), max(float(error), _UNSEEN * least if not np.any(weights) else least))


def _density(weights: np.ndarray, exits: Exits, edges: np.ndarray, ratio: float, least: float) -> Share:
    """Shares per steradian float64[n] within the steps of the angle outside, ``ratio`` times the sine inside."""
    lit, paths = weights > 0, max(len(weights), 1)
    sines = np.hypot(exits.direction[lit, 0], exits.direction[lit, 1]) * ratio
    step = np.clip(np.searchsorted(edges, np.arcsin(np.minimum(sines, 1.0)), side="right") - 1, 0, len(edges) - 2)
    sums, squares = (np.bincount(step, weights[lit] ** n, len(edges) - 1) / paths for n in (1, 2))
    angle = -2 * np.pi * np.diff(np.cos(edges))
    error = np.sqrt(np.maximum(squares - sums**2, 0) / paths)
    return Share(sums / angle, np.maximum(error, least) / angle)


def _edges(owner: str, angles: ArrayLike | None) -> np.ndarray:
    if angles is None:
        return np.linspace(0, np.pi / 2, _STEPS + 1)
    edges = real_array(f"{owner} angles", angles)
    ends = edges.ndim == 1 and len(edges) > 1 and edges[0] == 0 and abs(edges[-1] - np.pi / 2) < 1e-9
    if not ends or not (np.diff(edges) > 0).all():
        reject(f"{owner} angles", "radians that rise from 0 to pi/2, of shape (n + 1,)", angles, "Use np.linspace.")
    return edges
