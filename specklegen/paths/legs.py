"""Legs of connections through layers that refract: the ways of straight light between the outside and each layer.

Between two planes light of one direction keeps k_xy everywhere. In a layer of index n_k its sines are n / n_k times
those in the index n in which directions are measured, its cosine is mu_k. A leg is the row of faces that light has
crossed or been turned back by; at its end it is in layer k with what the faces leave and the layers before let through,

    |A|^2 = prod_j (1 - R_j or R_j) e^(-sum OD / mu),     over (n_k / n)^2 mu_k for irradiance per area of the face,

or for a view, seen per steradian in the index n, ``mu_n / ((n_k / n)^2 mu_k)`` times that product. Its phase grows by
``k (sqrt(n_k^2 - n^2 s^2) - n_k) / n`` per depth, beside light along the axis. Light keeps its polarisation along a
leg; the mean over both is taken at its end. Phases of reflections go into the random phase of the connection, which
every leg has for itself.

Legs are found from the brightest on, down to :data:`_LEFT_OUT` of what comes to their layer straight.
"""

import heapq
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.values import remembered
from specklegen.kernels.fresnel import reflectances
from specklegen.kernels.legs import ALONG, AMOUNT, ASIDE, COLUMNS, DECAY, PHASE, SLOPE, TOWARDS, Legs
from specklegen.paths.steps import Optics, optics
from specklegen.scene.media import PlaneMedium

_LEFT_OUT = 2e-5  # of what comes to a layer straight, in one of the legs that are not followed
_MOST = 1024  # legs
_MOST_LIGHTS = 64  # that stand for all where footprints are compared: the farthest from the reference
_STEEPNESSES = 5  # sines by which legs are judged, from the axis to the steepest


class _Leg(NamedTuple):
    parent: int  # number of the leg before it; -1 of the first
    layer: int
    down: bool
    face: int  # that it has met last
    turned: bool  # back by this face


@dataclass(frozen=True)
class LegsOf:
    """The legs from one side of a medium.

    Attributes
    ----------
    far : bool
        Whether they begin behind the far face, z = thickness.
    steepest : float
        Largest sine by which they were judged, in the index ``faces.inside``.
    """

    medium: PlaneMedium
    far: bool
    steepest: float

    @cached_property
    def _known(self) -> Optics:
        return optics(self.medium)

    @cached_property
    def _found(self) -> tuple[list[_Leg], np.ndarray]:
        """All legs, parents first, and their numbers in the order of their layers, int64[L]."""
        known, n = self._known, len(self._known.indices)
        sines = np.linspace(0.0, self.steepest, _STEEPNESSES)
        optic = _Optic(known, self.medium.faces.inside, sines)
        straight = np.zeros((n, len(sines)))
        direct = _Leg(-1, n - 1 if self.far else 0, not self.far, n if self.far else 0, False)
        share = optic.through(direct.face)
        for k in range(n):
            layer = n - 1 - k if self.far else k
            straight[layer] = share.mean(axis=0)
            face = layer if self.far else layer + 1
            share = share * optic.passed(layer) * optic.through(face)
        out: list[_Leg] = []
        heap, count = [(-1.0, 0, direct, optic.through(direct.face))], 1
        while heap:
            _, _, leg, share = heapq.heappop(heap)
            number = len(out)
            out.append(leg)
            if number >= _MOST:
                reject(f"{self.medium.type}.layers", f"of index steps that reflect light along at most {_MOST} ways", n,
                       "Use fewer layers, or smaller steps of the index.")  # fmt: skip
            share = share * optic.passed(leg.layer)
            face = leg.layer + 1 if leg.down else leg.layer
            onward = leg.layer + 1 if leg.down else leg.layer - 1
            ways = [(_Leg(number, leg.layer, not leg.down, face, True), share * optic.back(face))]
            if 0 <= onward < n:
                ways.append((_Leg(number, onward, leg.down, face, False), share * optic.through(face)))
            for way, left in ways:
                reference = straight[way.layer]
                ratio = float((left.mean(axis=0) / np.where(reference > 0, reference, np.inf)).max())
                always = not way.turned and _is_direct(out, number)
                if ratio >= _LEFT_OUT or always:
                    heapq.heappush(heap, (-ratio, count, way, left))
                    count += 1
        return out, np.argsort([leg.layer for leg in out], kind="stable")

    def __len__(self) -> int:
        return len(self._found[0])

    @cached_property
    def layers(self) -> np.ndarray:
        """Layer that each leg leads to, int64[L]."""
        legs, order = self._found
        return np.array([legs[n].layer for n in order])

    def towards(
        self, vectors: np.ndarray, wavelength: float = 1.0, turns: np.ndarray | None = None, *, lights: bool
    ) -> Legs:
        """Return what the kernels know of directions float64[D, 3] away from the medium: views, or lights reversed.

        ``turns`` float64[D, 2] are their lateral phases per unit length, where these are not theirs.
        """
        legs, order = self._found
        known, inside = self._known, self.medium.faces.inside
        flat = np.hypot(*vectors[:, :2].T)
        optic = _Optic(known, inside, flat)
        turning = optic if turns is None else _Optic(known, inside, wavelength * np.hypot(*turns.T))
        along, thick = turning.along / wavelength, np.diff(known.edges)
        amount, phase = np.zeros((len(legs), 2, len(vectors))), np.zeros((len(legs), len(vectors)))
        aside = self._asides(optic)
        for number, leg in enumerate(legs):
            step = optic.back(leg.face) if leg.turned else optic.through(leg.face)
            if leg.parent < 0:
                amount[number] = step
                continue
            layer = legs[leg.parent].layer
            amount[number] = amount[leg.parent] * step * optic.passed(layer)
            phase[number] = phase[leg.parent] + thick[layer] * along[layer]
        if self.far:  # beside light that has crossed the medium straight, as of views of a medium without steps
            phase -= (thick[:, None] * along).sum(axis=0)
        rows = np.zeros((len(vectors), len(legs), COLUMNS))
        for place, number in enumerate(order):
            leg, row = legs[number], rows[:, place]
            k = leg.layer
            ratio = inside / known.indices[k]
            slant = optic.cosines[k]
            row[:, TOWARDS : TOWARDS + 2] = vectors[:, :2] * ratio
            row[:, TOWARDS + 2] = -slant if leg.down else slant
            role = 1.0 if lights else np.abs(vectors[:, 2])
            row[:, AMOUNT] = optic.there[k] * ratio * np.sqrt(amount[number].mean(axis=0) * role / slant)
            row[:, DECAY] = known.depths[k] / (2 * thick[k] * slant)
            row[:, PHASE], row[:, ALONG] = phase[number], along[k]
            row[:, ASIDE : ASIDE + 2] = vectors[:, :2] * aside[number][:, None]
            row[:, SLOPE : SLOPE + 2] = vectors[:, :2] * optic.slope[k][:, None]
        layers = self.layers
        faces = np.array([known.edges[legs[n].layer + (0 if legs[n].down else 1)] for n in order])
        return Legs(faces, np.searchsorted(layers, np.arange(len(known.indices) + 1)), rows)

    def _asides(self, optic: "_Optic") -> np.ndarray:
        """Lateral ways, over the sine, to where legs enter their layers, float64[L, D], parents first."""
        legs, thick = self._found[0], np.diff(self._known.edges)
        out = np.zeros((len(legs), optic.slope.shape[1]))
        for number, leg in enumerate(legs[1:], 1):
            layer = legs[leg.parent].layer
            out[number] = out[leg.parent] + thick[layer] * optic.slope[layer]
        return out

    def lateral_ways(self, direction: np.ndarray, numbers: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """Sideways distance of a direction float64[3] along legs int[M] from depths float64[M], over its sine."""
        legs, order = self._found
        optic = _Optic(self._known, self.medium.faces.inside, np.hypot(*direction[:2])[None])
        faces = np.array([self._known.edges[legs[n].layer + (0 if legs[n].down else 1)] for n in order])
        aside, slope = self._asides(optic)[order, 0], optic.slope[self.layers, 0]
        return aside[numbers] + slope[numbers] * np.abs(depths - faces[numbers])

    def farthest_apart(self, directions: np.ndarray, reference: np.ndarray) -> float:
        """Largest drift of lights float64[T, 3] from a reference float64[3] along any leg, along x or y."""
        thick = np.diff(self._known.edges)[self.layers]
        far = np.argsort(np.square(directions[:, :2] - reference[:2]).sum(axis=1))[-_MOST_LIGHTS:]
        rows = self.towards(-np.concatenate([reference[None], directions[far]]), lights=True).rows
        begin = rows[..., ASIDE : ASIDE + 2]
        end = begin + thick[:, None] * rows[..., SLOPE : SLOPE + 2]
        return float(max(np.abs(at[1:] - at[:1]).max(initial=0.0) for at in (begin, end)))


def _is_direct(legs: list[_Leg], number: int) -> bool:
    while number >= 0:
        if legs[number].turned:
            return False
        number = legs[number].parent
    return True


class _Optic:
    """Layers as light of some sines float64[D], in the index of directions, meets them.

    Attributes
    ----------
    there : bool[n, D]
        Whether it can be in a layer.
    cosines : float64[n, D]
        In each layer; 1 of light that cannot be there, which its faces hold back.
    along : float64[n, D]
        sqrt(n_k^2 / n^2 - s^2) - n_k / n: phase per depth beside the axis, over k.
    slope : float64[n, D]
        Lateral way per depth, over the sine.
    """

    def __init__(self, known: Optics, inside: float, sines: np.ndarray) -> None:
        ratios = known.indices[:, None] / inside
        own = sines / ratios
        self._known, self.there = known, own < 1
        self.cosines = np.where(self.there, np.sqrt(np.maximum(1 - own**2, 1e-300)), 1.0)
        self.along = -np.square(sines) / (ratios * (1 + self.cosines))
        self.slope = 1 / (ratios * self.cosines)

    def passed(self, layer: int) -> np.ndarray:
        """e^(-OD / mu) float64[D] of a layer."""
        return np.where(self.there[layer], np.exp(-self._known.depths[layer] / self.cosines[layer]), 0.0)

    def back(self, face: int) -> np.ndarray:
        """R_s and R_p float64[2, D] of the face j, between layers j - 1 and j; from either side the same."""
        known, last = self._known, len(self._known.indices)
        k = max(face - 1, 0)
        wall = known.walls[0] if face == 0 else known.walls[1] if face == last else known.indices[k]
        beyond = known.outside if face in (0, last) else known.indices[face]
        out = np.empty((2, self.there.shape[1]))
        reflectances(np.where(self.there[k], self.cosines[k], 0.0), known.indices[k], wall, beyond, out)
        return out

    def through(self, face: int) -> np.ndarray:
        """1 - R float64[2, D] of a face."""
        return 1 - self.back(face)


@dataclass(frozen=True)
class Ways:
    """Legs of lights and of views.

    Attributes
    ----------
    lights, views : LegsOf
        The same where views are on the side of the lights.
    """

    lights: LegsOf
    views: LegsOf

    @classmethod
    def of(cls, medium: PlaneMedium, lights: np.ndarray, views: np.ndarray) -> Self:
        """Ways of lights and views float64[..., 3], unit vectors of travel, the views of one side."""
        both = np.concatenate([each.reshape(-1, 3)[:, :2] for each in (lights, views)])
        steepest = float(np.hypot(*both.T).max(initial=0.0))
        far = bool((views[..., 2] > 0).any())
        return cls(_legs_of(medium, False, steepest), _legs_of(medium, far, steepest))


@remembered(32)
def _legs_of(medium: PlaneMedium, far: bool, steepest: float) -> LegsOf:
    return LegsOf(medium, far, steepest)
