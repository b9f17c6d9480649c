"""The cache behind a stream: a sample that was rendered once is written to a store, and read from it from then on.

What a batch lacks is rendered, and written beside what its shards hold, under the claim of each shard: workers, ranks,
other trainings and calls of generate lose nothing of one another's. A failure here ends the writing, not the training.
"""

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.errors import RuleError, warn_user
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store import metadata
from specklegen.datasets.store.creation import grown, opened, tell_of_other_libraries
from specklegen.datasets.store.files import reaching
from specklegen.datasets.store.filling import add_samples, stored_columns
from specklegen.datasets.store.identity import identity
from specklegen.datasets.store.places import is_remote, place_of, stored_bytes
from specklegen.datasets.store.reading import SampleReader, Stored
from specklegen.datasets.store.shards import DamagedShard, UnlistedSample
from specklegen.datasets.store.store import Store

LEAST_SHARD = 16
"""Samples in a shard of a new store, at least: otherwise those of a batch."""


class SampleCache:
    """Samples of one data set, read from a store where they are there, else rendered and written to it.

    Parameters
    ----------
    recipe, seed, split
        The data set.
    folder
        Of the store, or its address; made where it is missing.
    limit : int, optional
        Bytes of the store from which on nothing more is written.
    length : int
        Samples in an epoch: the store grows by whole epochs.
    batch_size : int
        Samples in a batch.

    Raises
    ------
    RuleError
        If there is something else, or a store of another data set: the fields that differ are named.
    """

    def __init__(
        self, recipe: Renderable, seed: int, split: str, folder: str | os.PathLike, limit: int | None, length: int,
        batch_size: int,
    ) -> None:  # fmt: skip
        if limit is not None:
            limit = whole_number("SpeckleStream.cache_limit", limit)
        place = place_of(folder)
        self.folder = place if is_remote(place) else place.resolve()  # links are followed once
        there = metadata.recorded(self.folder) if metadata.is_store(self.folder) else None  # not waited for
        dtype = "uint16" if there is None else there.attributes["identity"]["dtype"]  # either is without loss
        wanted = identity(recipe, seed, split, dtype)
        shard_samples = batch_size * -(-LEAST_SHARD // batch_size)
        store = opened(recipe, wanted, self.folder, length, shard_samples)
        tell_of_other_libraries(store, recipe)
        self.recipe, self.limit, self.length = recipe, limit, length
        self.fingerprint = store.fingerprint
        self._free, self._ended = 0, False
        self._use(store)

    def _use(self, store: Store) -> None:
        store.require(self.fingerprint)
        self._store, self._reader = store, SampleReader(store, patient=False)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_store", "_reader")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._use(Store(self.folder))

    def batch(self, indices: Sequence[int], render: Callable[[Sequence[int]], dict[str, Any]]) -> dict[str, Any]:
        """Return samples stacked along a new first axis: arrays, as ``render`` makes those that are missing."""
        there = self._read(indices)
        missing = [index for index in indices if index not in there]
        if not missing:
            return self._joined(indices, there, {})
        rendered = render(missing)
        if not self._ended:
            self._write(rendered)
        return rendered if not there else self._joined(indices, there, rendered)

    def _read(self, indices: Sequence[int]) -> dict[int, Stored]:
        """Read those that are there and sound; damaged ones are rendered, and written, anew.

        Where an address gives no answer, the others are rendered.
        """
        there: dict[int, Stored] = {}
        listed: dict[int, np.ndarray] = {}
        try:
            with reaching(self.folder):
                if max(indices) >= self._store.samples:
                    self._use(Store(self.folder))  # another process may have made room
                for index in indices:
                    shard, row = divmod(index, self._store.shard_samples)
                    if index >= self._store.samples or not listed.get(shard, {row: True})[row]:
                        continue
                    try:
                        there[index] = self._reader.read(index)
                    except UnlistedSample:
                        listed[shard] = self._store.valid_in(shard)
                    except (DamagedShard, LookupError, FileNotFoundError):
                        continue
        except (RuleError, DamagedShard) as error:
            self._end(str(error))
        return there

    def _joined(self, indices: Sequence[int], there: dict[int, Stored], rendered: dict[str, Any]) -> dict[str, Any]:
        """Stack samples that were read and samples that were rendered, in the order of their indices."""
        rows = {int(index): row for row, index in enumerate(rendered.get("index", ()))}
        types, names = self._store.sample_types(), self._store.parameter_names
        batch: dict[str, Any] = {
            key: np.stack([
                there[n].arrays[key].astype(types[key]) if n in there else rendered[key][rows[n]] for n in indices
            ])
            for key in self._store.keys
        }  # fmt: skip
        batch["index"] = np.array(indices, np.int64)
        batch["parameters"] = {
            name: np.array([
                there[n].parameters[place] if n in there else rendered["parameters"][name][rows[n]] for n in indices
            ])
            for place, name in enumerate(names)
        }  # fmt: skip
        return batch

    def _write(self, rendered: dict[str, Any]) -> None:
        """Write what was rendered; whatever goes wrong is reported once, and nothing more is written."""
        try:
            last = int(max(rendered["index"]))
            if last >= self._store.samples:
                room = (last // self.length + 1) * self.length
                metadata.require_bounded("SpeckleStream.cache", room, self._store.shard_samples)
                self._use(grown(self._store, room))
            columns = stored_columns(self._store, self.recipe, rendered)
            shards = columns["index"] // self._store.shard_samples
            for shard in np.unique(shards).tolist():
                part = {name: column[shards == shard] for name, column in columns.items()}
                if not self._fits(sum(column.nbytes for column in part.values())):
                    return self._end(f"it has reached cache_limit = {self.limit} bytes")
                add_samples(self._store, shard, part)
        except Exception as error:  # of a disk, a server or its library: none of them is worth a training
            self._end(f"{type(error).__name__}: {error}")

    def _end(self, reason: str) -> None:
        if self._ended:
            return
        self._ended = True
        warn_user(f"No further samples are cached in {self.folder}: {reason}. Missing samples are rendered. Raise "
                  "cache_limit or make room, if they should be cached.")

    def _fits(self, size: int) -> bool:
        """Compare with the limit; the store is measured anew from time to time, since others write to it too."""
        if self.limit is None:
            return True
        if size > self._free:
            # At most a sixteenth of what is left is given out before the next look.
            left = self.limit - stored_bytes(self.folder)
            self._free = max(left // 16, size) if left >= size else 0
        self._free -= size
        return self._free >= 0
