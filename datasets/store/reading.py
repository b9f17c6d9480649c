"""Reading samples of a store, each checked to be there, undamaged, and the one that was asked for."""

from collections import OrderedDict
from typing import NamedTuple

import numpy as np

from specklegen.datasets.store.metadata import COLUMNS
from specklegen.datasets.store.shards import REMEDY, ForeignShard, MissingSample, UnlistedSample
from specklegen.datasets.store.store import Store

_TABLES = 4096
"""Shards whose lines of the ledger and rows of parameters are kept in memory."""


class Stored(NamedTuple):
    """A sample as it lies in the store: its arrays in their stored types, and float64[p] parameters."""

    arrays: dict[str, np.ndarray]
    parameters: np.ndarray


class SampleReader:
    """Reads samples one at a time; keeps what it knows of the ledger and the tables.

    Parameters
    ----------
    store : Store
        The store; it may still be being filled.
    patient : bool
        Whether a ledger that is not there is waited for, shortly, at the first look.
    """

    def __init__(self, store: Store, patient: bool = True) -> None:
        self.store, self._patient = store, patient
        self._valid: OrderedDict[int, np.ndarray] = OrderedDict()  # by shard
        self._looked: set[int] = set()
        self._tables: OrderedDict[int, dict[str, np.ndarray]] = OrderedDict()

    def read(self, index: int) -> Stored:
        """Read a sample.

        Raises
        ------
        MissingSample
            If it was not generated yet (as UnlistedSample), or a file of it is gone.
        DamagedShard
            If bytes are not those that were written; as ForeignShard, if they were written for another data set or
            another sample.
        """
        shard, row = divmod(index, self.store.shard_samples)
        self._require_valid(index, shard)
        try:
            table = self._table(shard)
            arrays = {key: files.read(index) for key, files in self.store.shard_files.items()}
        except MissingSample as error:
            raise MissingSample(f"{error}, but the ledger lists it. {REMEDY}") from None
        place, seed = f"shard {shard} of {self.store.folder}", self.store.seed
        there, of = int(table["index"][row]), int(table["seed"][row])
        if (there, of) != (index, seed):
            raise ForeignShard(
                f"{place} holds sample {there} of seed {of} where sample {index} of seed {seed} should be. {REMEDY}"
            )
        if self.store.seal(index, seed, table["parameters"][row], arrays) != table["seal"][row]:
            raise ForeignShard(
                f"{place} holds files of another data set or shard: the seal of sample {index} differs. {REMEDY}"
            )
        return Stored(arrays, table["parameters"][row])

    def _require_valid(self, index: int, shard: int) -> None:
        row, known = index - shard * self.store.shard_samples, self._valid.get(shard)
        if known is not None and known[row]:
            return
        self._forget(shard)
        # The first time only: who goes through a store that is not full would wait for every sample.
        self._valid[shard] = valid = self.store.valid_in(shard, expected=self._patient and shard not in self._looked)
        self._looked.add(shard)
        if len(self._valid) > _TABLES:
            self._valid.popitem(last=False)
        if not valid[row]:
            raise UnlistedSample(
                f"sample {index} of {self.store.folder} has not been generated yet. Run generate again: it resumes"
            )

    def _forget(self, shard: int) -> None:
        self._tables.pop(shard, None)
        for files in self.store.shard_files.values():
            files.close()

    def _table(self, shard: int) -> dict[str, np.ndarray]:
        table = self._tables.get(shard)
        if table is None:
            table = {name: self.store.table(name, shard) for name in COLUMNS}
            self._tables[shard] = table
            if len(self._tables) > _TABLES:
                self._tables.popitem(last=False)
        return table
