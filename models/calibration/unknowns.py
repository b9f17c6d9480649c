"""The unknowns u of a fit: the numbers of a slab that are to be found, and the combinations of them with names.

A slab is x = x0 + A u (columns of :mod:`prediction`): logarithms, so that products are sums, and -ln albedo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from specklegen.core.arguments import positive_number, real_number
from specklegen.core.errors import reject
from specklegen.memory_effects.atlas import load, loss_at
from specklegen.models.calibration.prediction import DEPTH, DIFFUSION, DROP, LOSS, THICKNESS

NAMES = ("thickness", "mean_free_path", "g", "albedo", "diffusion")
_LONGEST = 60.0  # of the logarithm of a length or a diffusion, in the user's units
WIDEST = 4.0
"""Absorption coordinate up to which there are tables."""

COMBINATIONS: dict[str, np.ndarray] = {
    "thickness": np.array([1.0, 0, 0, 0, 0]),
    "mean_free_path": np.array([1.0, -1, 0, 0, 0]),
    "optical_depth": np.array([0.0, 1, 0, 0, 0]),
    "g": np.array([0.0, 0, 1, 0, 0]),
    "transport_mean_free_path": np.array([1.0, -1, -1, 0, 0]),
    "transport_depth": np.array([0.0, 1, 1, 0, 0]),
    "albedo": np.array([0.0, 0, 0, 1, 0]),
    "diffusion": np.array([0.0, 0, 0, 0, 1]),
}
"""Logarithms of what may be asked for, as sums of the columns: of g that of 1 - g, of the albedo -ln."""


def value_of(name: str, logarithm: float) -> float:
    """Return the number that a logarithm of :data:`COMBINATIONS` stands for."""
    if name == "g":
        return -math.expm1(logarithm)
    return math.exp(-logarithm if name == "albedo" else logarithm)


def logarithm_of(name: str, value: float) -> float:
    """Return the logarithm of :data:`COMBINATIONS` that stands for a number."""
    if name == "g":
        return math.log1p(-value)
    return max(-math.log(value), 0.0) if name == "albedo" else math.log(value)


@dataclass(frozen=True)
class Unknowns:
    """The free numbers of a slab.

    Attributes
    ----------
    free : tuple of str
        Their names.
    base : float64[5]
        x0.
    matrix : float64[5, n]
        A.
    low, high : float64[n]
        Ends of the tables.
    """

    free: tuple[str, ...]
    base: np.ndarray
    matrix: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def slabs(self, at: np.ndarray) -> np.ndarray:
        """X float64[..., 5] at unknowns float64[..., n]."""
        return self.base + at @ self.matrix.T

    @property
    def moved(self) -> tuple[int, ...]:
        """Columns of x that are not known."""
        return tuple(np.flatnonzero(self.matrix.any(axis=1)).tolist())

    def weights(self, name: str) -> np.ndarray:
        """Return the weights float64[n] of a combination of :data:`COMBINATIONS`; 0 where it is known."""
        return COMBINATIONS[name] @ self.matrix

    def value(self, name: str, held: float) -> float:
        """Return the number of a combination whose free part, ``weights(name) @ u``, is given."""
        return value_of(name, float(COMBINATIONS[name] @ self.base) + held)

    def held(self, name: str, value: float) -> float:
        """Return the free part of a combination that has a given value."""
        return logarithm_of(name, value) - float(COMBINATIONS[name] @ self.base)

    def limits(self, name: str) -> tuple[float, float]:
        """Ends between which a number has to lie."""
        return (-1.0, 1.0) if name == "g" else (0.0, 1 + 1e-12) if name == "albedo" else (0.0, math.inf)

    def names(self) -> list[str]:
        """Combinations that are not known: the free numbers first, what follows from them behind."""
        others = [name for name in COMBINATIONS if name not in self.free and self.weights(name).any()]
        return [*self.free, *others]


def unknowns_of(owner: str, known: Mapping[str, Any], free: Sequence[str], moving: bool) -> Unknowns:
    """Return the unknowns of a fit; of what is not named, the albedo is 1 and no diffusion is looked for."""
    if not isinstance(known, Mapping):
        reject(f"{owner} known", 'a table of names and numbers, such as {"thickness": 1.0}', known)
    if isinstance(free, str) or not isinstance(free, Sequence) or not all(isinstance(each, str) for each in free):
        reject(f"{owner} free", 'a sequence of names, such as ("mean_free_path", "g")', free)
    for name in (*known, *free):
        if name not in NAMES:
            reject(f"{owner} {'known' if name in known else 'free'}", f"made of {', '.join(NAMES)}", name,
                   "The optical depth is thickness over mean_free_path.")  # fmt: skip
    twice = [name for name in free if name in known or list(free).count(name) > 1]
    if twice or not free:
        reject(f"{owner} free", "at least one name, each once and none of them known", tuple(free))
    given = {"albedo": 1.0} | {name: _known(owner, name, value) for name, value in known.items()}
    missing = [name for name in NAMES[:3] if name not in given and name not in free]
    if missing or (moving and "diffusion" not in (*given, *free)):
        missing = missing or ["diffusion"]
        reject(f"{owner} known and free", "names of all numbers of the slab, each in one of the two",
               tuple(known) + tuple(free), f"Add {' and '.join(missing)} to known or to free.")  # fmt: skip
    if "diffusion" in free and not moving:
        reject(f"{owner} free", "without diffusion, since no observation is a TemporalCurve", tuple(free),
               "Add a TemporalCurve.")  # fmt: skip
    return _assembled(owner, given, tuple(free))


def _known(owner: str, name: str, value: object) -> float:
    number = real_number(f"{owner} known[{name!r}]", value)
    if name == "g":
        if not -1 < number < 1:
            reject(f"{owner} known['g']", "between -1 and 1, both excluded", value)
    elif name == "albedo":
        if not 0 < number <= 1:
            reject(f"{owner} known['albedo']", "above 0 and at most 1", value)
    else:
        positive_number(f"{owner} known[{name!r}]", value)
    return number


def _assembled(owner: str, given: Mapping[str, float], free: tuple[str, ...]) -> Unknowns:
    base, columns = np.zeros(5), []
    atlas = load()
    (low_depth, high_depth), (low_drop, high_drop) = ((np.log(nodes[0]), np.log(nodes[-1]))
                                                      for nodes in (atlas.depths, atlas.drops))  # fmt: skip
    if "thickness" in given:
        base[THICKNESS] = np.log(given["thickness"])
    if "mean_free_path" in given:
        base[DEPTH] = base[THICKNESS] - np.log(given["mean_free_path"])
    if "g" in given:
        base[DROP] = np.log1p(-given["g"])
    base[LOSS] = -np.log(given.get("albedo", 1.0))
    if "diffusion" in given:
        base[DIFFUSION] = np.log(given["diffusion"])
    low, high = [], []
    for name in free:
        column, ends = np.zeros(5), (-_LONGEST, _LONGEST)
        if name == "thickness":
            column[THICKNESS] = 1.0
            if "mean_free_path" in given:
                column[DEPTH] = 1.0  # optical depth at a known mean free path
                ends = tuple(np.array([low_depth, high_depth]) - base[DEPTH])
        elif name == "mean_free_path":
            column[DEPTH], ends = 1.0, (low_depth, high_depth)  # as the optical depth
        elif name == "g":
            column[DROP], ends = 1.0, (low_drop, high_drop)
        elif name == "albedo":
            column[LOSS], ends = 1.0, (0.0, float(loss_at(WIDEST, np.exp(low_depth), np.exp(low_drop))))
        else:
            column[DIFFUSION] = 1.0
        columns.append(column)
        low.append(ends[0])
        high.append(ends[1])
    matrix = np.array(columns).T
    for column, (name, first, last) in {
        DEPTH: ("optical depth, thickness over mean_free_path,", low_depth, high_depth),
        DROP: ("1 - g", low_drop, high_drop),
    }.items():
        if not matrix[column].any() and not first - 1e-9 <= base[column] <= last + 1e-9:
            reject(f"{owner} known {name}", f"within the lookup table, {np.exp(first):.3g} to {np.exp(last):.4g}",
                   float(np.exp(base[column])), "The range of the table is on the page docs/atlas.md.")  # fmt: skip
    return Unknowns(free, base, matrix, np.array(low, np.float64), np.array(high, np.float64))
