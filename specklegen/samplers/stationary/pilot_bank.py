"""Pilot paths of a scene as the test of stationarity reads them: exact correlations and intensities over 64 batches.

All pairs of lights and views are evaluated together, one block of connections after the other: the entrances of paths
once, their exits once for each view, and no phase of either end, since only phases between the two of a pair matter.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from specklegen.core.parallel import slices
from specklegen.core.random_streams import Stream
from specklegen.core.statistics import BATCHES, batch_sums
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions, contributions_of_pairs
from specklegen.paths.far_field import lobe_loss
from specklegen.paths.kept_angles import advance, depth_between
from specklegen.paths.layout import Layout
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.scene import Scene

_AT_ONCE = 2**17
"""Values of a block: connections times views or pairs, which then stay in the cache of a core."""


class Pair(NamedTuple):
    """Two waves whose correlation is asked for: (light, view) and (light - tilt, other), in direction sines float64[2].

    ``kept`` says whether light keeps its angle to phase functions under the tilt (:mod:`specklegen.paths.kept_angles`).
    """

    view: np.ndarray
    other: np.ndarray
    tilt: np.ndarray
    kept: bool


class PilotBank:
    """Pilot paths about one direction of light, with their weights at views and their sums over batches."""

    def __init__(self, scene: Scene, tracer: SlabTracer, seed: int, paths: int, sample: int = 0) -> None:
        self.scene, self.light, self._layout = scene, tracer.proposal.reference, tracer.layout
        self.bank = tracer.trace(seed, paths, sample=sample, stream=Stream.PILOT)
        self._paths, self._batches = paths, min(BATCHES, paths)

    def weight(self, sines: np.ndarray) -> np.ndarray:
        """Contribution float64[M] of every connection at one view."""
        return contributions(self._layout.at(self.light, self._view(sines)), self.bank)

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums over 64 batches of paths, complex128[64]."""
        return batch_sums(values, self.bank.paths, self._paths)

    def correlations(self, pairs: Sequence[Pair]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sums over 64 batches of the paths of each pair, [64, P] each.

        Returns
        -------
        of sqrt(w_1 w_2) e^(i phase) less that of the window (complex128), of w_1 and of w_2 (float64). Where light
        keeps its angle w_2 is w_1.
        """
        numbers: dict[bytes, int] = {}
        sines = [each for pair in pairs for each in (pair.view, pair.view if pair.kept else pair.other)]
        which = np.array([numbers.setdefault(each.tobytes(), len(numbers)) for each in sines]).reshape(-1, 2)
        seen = self._seen(self.light, np.array([np.frombuffer(key) for key in numbers]))
        turns = self._turns(pairs)

        def block(bank: PathBank) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            weights = contributions_of_pairs(seen, bank)[0]
            root = np.sqrt(weights)
            product, phase = root[which[:, 0]] * root[which[:, 1]], turns @ self._ways(bank)
            return product * np.cos(phase), product * np.sin(phase), weights

        real, imaginary, powers = self._summed(len(pairs), block)
        return real + 1j * imaginary, powers[:, which[:, 0]], powers[:, which[:, 1]]

    def intensities(self, lights: np.ndarray, views: np.ndarray) -> np.ndarray:
        """Sums over 64 batches of the contributions of each light at its view, direction sines [n, 2]: float64[64, n].

        A light that moves all light along has the paths of the bank's own, seen from as far aside.
        """
        out, lights, views = np.empty((self._batches, len(lights))), np.array(lights), np.array(views)
        for n, light in enumerate(lights):
            moved = views[n] - (light - self.light[:2])
            if not np.array_equal(light, self.light[:2]) and self.is_rigid_shift(light) and np.hypot(*moved) < 1:
                lights[n], views[n] = self.light[:2], moved
        for light in np.unique(lights, axis=0):
            like = np.flatnonzero((lights == light).all(axis=1))
            own = np.array_equal(light, self.light[:2])
            seen = self._seen(self.light if own else directions_of_sines("light", light), views[like])
            out[:, like] = self._summed(len(like), lambda bank, seen=seen: (contributions_of_pairs(seen, bank)[0],))[0]
        return out

    def is_rigid_shift(self, light: np.ndarray) -> bool:
        """Return whether a tilt to these sines moves all light equally, phase functions included (physics.md 10)."""
        return keeps_angle(self.scene, np.hypot(*(light - self.light[:2])))

    def _seen(self, light: np.ndarray, sines: np.ndarray) -> Layout:
        return self._layout.at(light, self._view(sines))

    def _view(self, sines: np.ndarray) -> np.ndarray:
        return directions_of_sines("view", sines, self.scene.side)

    def _turns(self, pairs: Sequence[Pair]) -> np.ndarray:
        """float64[P, 5], what each length of :meth:`_ways` adds to the phase of the exact correlation of a pair."""
        views, others, tilts = (np.array([getattr(pair, name) for pair in pairs]) for name in Pair._fields[:3])
        along = self._view(others)[:, 2] - self._view(views)[:, 2]
        lights = directions_of_sines("tilt", self.light[:2] - tilts)
        between = [-advance(self.light, light) if pair.kept else 0.0 for light, pair in zip(lights, pairs, strict=True)]
        turns = self.light[2] - lights[:, 2], along, np.array(between), *(others - views).T
        return self.scene.wavenumber * np.stack(turns, axis=1)

    def _ways(self, bank: PathBank) -> np.ndarray:
        """float64[5, M]: depths of entrance, of exit from its face, between the two, and the way sideways."""
        depth = bank.exit[:, 2] - (self.scene.slab.thickness if self.scene.side > 0 else 0.0)
        lateral = bank.exit[:, :2] - bank.entry[:, :2]
        return np.stack([bank.entry[:, 2], depth, depth_between(self._layout, bank), *lateral.T])

    def _summed(self, width: int, block: Callable[[PathBank], tuple[np.ndarray, ...]]) -> list[np.ndarray]:
        """Sums over batches, float64[64, n], of what ``block`` finds for some connections, float64[n, m]."""
        totals: list[np.ndarray] = []
        for bank, batches, starts in self._blocks(width):
            terms = block(bank)
            totals = totals or [np.zeros((self._batches, len(each))) for each in terms]
            for total, each in zip(totals, terms, strict=True):
                np.add.at(total, batches, np.add.reduceat(each, starts, axis=1).T)
        return totals or [np.zeros((self._batches, len(each))) for each in block(self.bank)]

    def _blocks(self, width: int) -> Iterator[tuple[PathBank, np.ndarray, np.ndarray]]:
        """Connections in blocks, and the runs of one batch in them: whose, and where they start."""
        batch = self.bank.paths * self._batches // self._paths
        for part in slices(len(self.bank), max(_AT_ONCE // max(width, 1), 256)):
            own = batch[part]
            starts = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
            yield self.bank.select(part), own[starts], starts


def keeps_angle(scene: Scene, tilt: float) -> bool:
    """Return whether light keeps its angle to phase functions under a tilt, in sines."""
    return lobe_loss(scene.slab, scene.wavelength, float(tilt)).spurious
