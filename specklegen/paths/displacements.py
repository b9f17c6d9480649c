"""Phases that the motion of scatterers adds to connections, for each frame of a film.

    k (i - w_1) . Dr_1 + k (w_(B-1) - v) . Dr_B + G,    B = 1: k (i - v) . Dr_1

A flow carries particles by V(x) t more, so that all between add k t D_interior to G.

A component of k Dr at either end has the variance 2 x m, G of all particles between 4 x Y_interior: both ends are right
at every light and view, and so is the mean of a connection's phase, e^(-2 x Y) (:mod:`specklegen.paths.momentum`). x is
the time of :mod:`specklegen.scene.motion`, whose steps may depend on each other.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.core.values import remembered
from specklegen.kernels import displacements as kernels
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import turned_over
from specklegen.paths.layout import Layout
from specklegen.paths.momentum import interior_doppler
from specklegen.paths.volumes import mobility_at, velocity_at
from specklegen.scene.motion import law_of, step_roots
from specklegen.scene.scene import Scene

_BLOCK = 16384
_NONE = 1e-9  # of the largest step: what rounding leaves of steps that a law does not mix


class Moved(NamedTuple):
    """Displacements of M connections in one frame, times k.

    Attributes
    ----------
    first, last : float64[M, 3]
        Of the first and of the last particle; of single scattering the same.
    between : float64[M]
        Phase that all others add.
    """

    first: np.ndarray
    last: np.ndarray
    between: np.ndarray

    def backwards(self) -> "Moved":
        """Return the displacements of the reversed paths."""
        return Moved(self.last, self.first, self.between)

    def select(self, chosen: np.ndarray) -> "Moved":
        """Return the rows of the connections bool[M]."""
        return Moved(*(each[chosen] for each in self))

    def turns(self, bank: PathBank, light: np.ndarray) -> np.ndarray:
        """Phasors complex128[M] of a light float64[3]: of all but what -v . last adds at a view."""
        phase = ((light - bank.entry_direction) * self.first + bank.exit_direction * self.last).sum(axis=1)
        return np.exp(1j * (phase + self.between))


@remembered(16)
def film_roots(scene: Scene) -> np.ndarray:
    """Roots float64[T, T - 1] of a film's steps (:func:`specklegen.scene.motion.step_roots`)."""
    law = law_of(scene.volume.motions)
    assert law is not None, "a film is of a medium that moves"
    return step_roots("CollimatedBeams.times", law, scene.wavelength, np.asarray(scene.beams.times))


def frames(
    layout: Layout, bank: PathBank, roots: np.ndarray, times: np.ndarray, seed: Seed, sample: int, threads: Threads = 1
) -> Iterator[Moved]:
    """Displacements of a bank's connections in every frame, one after the other, at times float64[T]."""
    key0, key1 = stream_key(seed, Stream.MOTION)
    walked = np.zeros((len(bank), kernels.COLUMNS))
    once, least = bank.orders == 1, _NONE * np.abs(roots).max(initial=0.0)
    scale = np.empty_like(walked)
    scale[:, :3] = np.sqrt(2 * mobility_at(layout.volume, bank.entry))[:, None]
    scale[:, 3:6] = np.sqrt(2 * mobility_at(layout.volume, bank.exit))[:, None]
    scale[:, 6] = 2 * np.sqrt(bank.transfer)
    carried = _carried(layout, bank)
    mirror = np.where(turned_over(bank)[:, None], [1.0, 1.0, -1.0], 1.0)
    for t in range(len(roots)):
        for step in np.flatnonzero(np.abs(roots[t] - roots[t - 1]) > least) if t else ():
            amount = float(roots[t, step] - roots[t - 1, step])

            def add(part: slice, step: int = int(step), amount: float = amount) -> None:
                kernels.add_step(
                    key0, key1 + step, sample, bank.orders[part], bank.paths[part], amount, walked[part]
                )  # fmt: skip

            map_blocks(add, slices(len(bank), _BLOCK), threads)
        moved = walked * scale
        first, last = moved[:, :3], moved[:, 3:6]
        last[once] = (first * mirror)[once]
        since = float(times[t] - times[0])
        if carried is None or not since:
            yield Moved(first, last, moved[:, 6])
        else:
            ends = first + since * carried.first, last + since * carried.last
            yield Moved(*ends, moved[:, 6] + since * carried.between)


def _carried(layout: Layout, bank: PathBank) -> Moved | None:
    """Displacements by a flow in a unit of time, times k; None where nothing flows."""
    if not len(layout.volume.flow):
        return None
    k = 2 * np.pi / layout.wavelength
    first, last = (k * velocity_at(layout.volume, points) for points in (bank.entry, bank.exit))
    return Moved(first, last, k * interior_doppler(layout, bank))
