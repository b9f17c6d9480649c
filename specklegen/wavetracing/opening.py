"""Openings in a plane screen: loops of straight edges, outer ones counter-clockwise, holes clockwise.

An opening is given as one loop float64[n, 2], or as a sequence of loops; the last corner joins the first. Coordinates
are (x, y) in the plane of the screen, seen against the light, which travels to +z.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.errors import reject, warn_user

Opening = ArrayLike | Sequence[ArrayLike]
"""One loop float64[n, 2], or several."""


@dataclass(frozen=True)
class Rim:
    """The checked edges of an opening.

    Attributes
    ----------
    loops : tuple of float64[n, 2]
    """

    loops: tuple[np.ndarray, ...]

    @cached_property
    def starts(self) -> np.ndarray:
        """Start points of the edges, float64[N, 2]; the opening lies on their left."""
        return np.concatenate(self.loops)

    @cached_property
    def ends(self) -> np.ndarray:
        """End points of the edges, float64[N, 2]."""
        return np.concatenate([np.roll(loop, -1, axis=0) for loop in self.loops])

    @cached_property
    def centre(self) -> np.ndarray:
        """Middle of the bounding box, float64[2]."""
        return (self.starts.min(axis=0) + self.starts.max(axis=0)) / 2

    @cached_property
    def about_centre(self) -> np.ndarray:
        """Midpoints about the centre and vectors of the edges, float64[N, 4], as the kernels take them."""
        middle = (self.starts - self.centre + (self.ends - self.centre)) / 2
        return np.ascontiguousarray(np.hstack([middle, self.ends - self.starts]))

    @cached_property
    def area(self) -> float:
        """Area of the opening, holes taken off."""
        a, b = self.starts - self.centre, self.ends - self.centre
        return float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2)

    @cached_property
    def breadth(self) -> float:
        """Mean width, twice the area over the rim's length: that of a long slit, half of a square's or a disc's."""
        length = float(np.linalg.norm(self.ends - self.starts, axis=1).sum())
        return 2 * self.area / length if length > 0 else 0.0

    @cached_property
    def triangles(self) -> np.ndarray:
        """Triangles that cover the opening once, float64[T, 3, 2], by ear clipping (needs the extra ``mesh``)."""
        if len(self.loops) == 1 and len(self.loops[0]) == 3:
            return self.loops[0][None]
        try:
            from mapbox_earcut import triangulate_float64
        except ImportError:
            raise ModuleNotFoundError(
                "An opening that is not a triangle is triangulated by mapbox-earcut: install specklegen-torch[mesh]."
            ) from None
        found = []
        for outer, holes in self._nested():
            corners = np.concatenate([outer, *holes])
            rings = np.cumsum([len(outer), *(len(hole) for hole in holes)]).astype(np.uint32)
            found.append(corners[triangulate_float64(corners, rings).reshape(-1, 3).astype(np.intp)])
        return np.concatenate(found) if found else np.empty((0, 3, 2))

    def _nested(self) -> list[tuple[np.ndarray, list[np.ndarray]]]:
        """Every outer loop with its holes: those whose first corner lies in it and in no smaller outer loop."""
        areas = [_signed_area(loop) for loop in self.loops]
        outer = sorted((n for n, a in enumerate(areas) if a > 0), key=lambda n: areas[n])
        groups: dict[int, list[np.ndarray]] = {n: [] for n in outer}
        for n, area in enumerate(areas):
            if area < 0:
                larger = [m for m in outer if areas[m] > -area]
                owner = next((m for m in larger if winding(self.loops[n][:1], [self.loops[m]])[0]), None)
                if owner is None:
                    reject("opening", "holes (clockwise loops) inside outer loops", self.loops[n], _ORDER)
                groups[owner].append(self.loops[n])
        return [(self.loops[n], groups[n]) for n in outer]


_PAIRS = 2**20  # of edges looked at together
_BESIDE = 1024  # edges beside which the winding number is found
_TOUCH = 1e-12  # of an area: corners that close to an edge touch it
_ORDER = "List outer loops counter-clockwise and holes clockwise."


def rim_of(field: str, opening: Opening | Rim) -> Rim:
    """Check an opening and return its rim.

    Raise a `RuleError` if a loop is not float64[n, 2] with n >= 3 and finite, loops cross, or wind about a place twice
    or the wrong way round.
    """
    if isinstance(opening, Rim):
        return opening
    try:
        first = np.asarray(opening[0], dtype=np.float64)  # type: ignore[index]
        loops = [opening] if first.ndim == 1 else list(opening)  # type: ignore[arg-type]
        loops = [np.array(loop, dtype=np.float64) for loop in loops]
    except (TypeError, ValueError, IndexError, KeyError, RuntimeError):  # the last of torch, of what has gradients
        reject(field, "loops of shape (n, 2)", opening)
    for loop in loops:
        if loop.ndim != 2 or loop.shape[1] != 2 or len(loop) < 3:
            reject(field, "loops of shape (n, 2), n at least 3", loop.shape)
        if not np.isfinite(loop).all():
            reject(field, "finite everywhere", loop)
        loop.flags.writeable = False
    rim = Rim(tuple(loops))
    if rim.area < -1e-12 * float(np.square(np.ptp(rim.starts, axis=0)).sum()):
        reject(field, "of positive area", rim.area, _ORDER)
    crossed = crossing(rim.starts, rim.ends)
    if crossed is not None:
        reject(field, "of loops that cross neither themselves nor each other", rim.starts[list(crossed)],
               "Edges that begin at these corners cross: list corners in their order around the opening.")  # fmt: skip
    wrong = _wound(rim)
    if wrong is not None:
        reject(field, "inside outer loops and outside holes, each listed once",
               f"a winding number of {wrong[0]} at {wrong[1]}", _ORDER)  # fmt: skip
    return rim


def crossing(starts: np.ndarray, ends: np.ndarray) -> tuple[int, int] | None:
    """Two edges that cross within both, if there are any; those that touch do not."""
    left, right = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    order = np.argsort(left, kind="stable")
    # Of edges in the order of their left ends, those up to the last that begins before this one ends.
    last = np.searchsorted(left[order], right[order], side="right")
    count = np.maximum(last - np.arange(len(order)) - 1, 0)
    total, done = np.cumsum(count), 0
    while done < len(order):
        until = max(done + 1, int(np.searchsorted(total, total[done] + _PAIRS)))
        rows = np.arange(done, min(until, len(order)))
        first = np.repeat(rows, count[rows])
        second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(count[rows]) - count[rows], count[rows])
        i, j = order[first], order[second]
        over = _sides(starts[i], ends[i], starts[j], ends[j]) & _sides(starts[j], ends[j], starts[i], ends[i])
        if over.any():
            return int(i[over.argmax()]), int(j[over.argmax()])
        done = until
    return None


def _sides(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return whether c and d lie on either side of the line through a and b, beyond rounding."""
    along = b - a
    sides = [along[:, 0] * (p - a)[:, 1] - along[:, 1] * (p - a)[:, 0] for p in (c, d)]
    scale = np.square(np.abs(np.stack([along, c - a, d - a])).max(axis=(0, 2)))
    return (np.minimum(*sides) < -_TOUCH * scale) & (np.maximum(*sides) > _TOUCH * scale)


def _wound(rim: Rim) -> tuple[int, np.ndarray] | None:
    """A winding number that is neither 0 nor 1, and the point float64[2] beside an edge where it is so."""
    about = [loop - rim.centre for loop in rim.loops]  # near the origin, so that rounding stays small
    edges = rim.about_centre[:: -(-len(rim.starts) // _BESIDE)]
    across = 1e-9 * np.stack([-edges[:, 3], edges[:, 2]], axis=1)
    points = np.concatenate([edges[:, :2] + across, edges[:, :2] - across])
    around = winding(points, about)
    wrong = np.flatnonzero((around != 0) & (around != 1))
    return (int(around[wrong[0]]), points[wrong[0]] + rim.centre) if len(wrong) else None


def doubt_narrow(field: str, breadth: float, wavelength: float) -> None:
    """Warn of openings narrower than a wavelength, whose rims are no longer apart for the light."""
    if 0 < breadth < wavelength:
        warn_user(
            f"{field} is {breadth / wavelength:.2g} wavelengths wide in the mean: light in a real opening below one is "
            "not that without a screen (a slit of .2 passes .11 of it, soft, to 1.06, hard); take wider openings, or "
            "an exact solution for slits, specklegen.oracles.slit_screen",
        )


def winding(points: np.ndarray, loops: Sequence[np.ndarray]) -> np.ndarray:
    """Winding number int64[P] of the loops about ``points`` float64[P, 2]; edges belong to their upper, left side."""
    total = np.zeros(len(points), np.int64)
    x, y = points[:, :1], points[:, 1:]
    for loop in loops:
        a, b = loop, np.roll(loop, -1, axis=0)
        left = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (x - a[:, 0]) * (b[:, 1] - a[:, 1])
        up, down = (a[:, 1] <= y) & (b[:, 1] > y), (a[:, 1] > y) & (b[:, 1] <= y)
        total += (up & (left > 0)).sum(axis=1) - (down & (left < 0)).sum(axis=1)
    return total


def _signed_area(loop: np.ndarray) -> float:
    a = loop - loop[0]
    b = np.roll(a, -1, axis=0)
    return float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2)
