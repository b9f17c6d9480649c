"""Distribution of path sums: chunks of paths that threads trace and sum in parallel.

Chunks are fixed by the plan, and what they add is joined in their order, so that a sum does not depend on threads.
A chunk stays on one thread: steps that threads do together wait for the slowest. A thread without a chunk helps others.
"""

import math
from dataclasses import dataclass

from specklegen.core.parallel import even_slices

CONNECTIONS = 2**16
"""Connections of a chunk at most, unless its transforms are so large that more are better summed at a time."""

_PATHS = 2**20  # of a chunk at most, however few connections they have
_ROOM = 2**17  # connections that a thread may hold ...
_FIELDS = 8  # ... of which one takes the memory of so many values of a field


@dataclass(frozen=True)
class Chunks:
    """The paths of one realization, cut into even chunks of at most about ``at_once`` connections.

    Attributes
    ----------
    connections_per_path : float
        As a pilot found.
    """

    paths: int
    connections_per_path: float
    at_once: int = CONNECTIONS

    @property
    def count(self) -> int:
        """Number of chunks."""
        wanted = max(self.paths * self.connections_per_path / self.at_once, self.paths / _PATHS)
        return max(1, min(self.paths, math.ceil(wanted)))

    @property
    def connections(self) -> float:
        """Connections of a chunk."""
        return self.paths * self.connections_per_path / self.count

    @property
    def slices(self) -> list[slice]:
        """Paths of every chunk."""
        return even_slices(self.paths, self.count)

    def side_by_side(self, threads: int, fields: float, realizations: int = 1) -> int:
        """Chunks in work at a time.

        Parameters
        ----------
        threads
            Threads there are.
        fields
            Values of the field that a chunk adds to. Of large chunks fewer are in work, so that they take no more
            memory than small ones.
        realizations
            Whose chunks may be in work together.
        """
        fit = int(threads * _ROOM / (self.connections + fields / _FIELDS + 1))
        return max(1, min(threads, self.count * realizations, fit))
