"""Epochs of batches: what the stream and the shuffled cache share with a DataLoader.

Batches are made in the data set, so that their order is the same for any number of workers. Worker w makes
every n-th batch of its rank, and the DataLoader takes from the workers in turn. Nothing here holds random
state: batch b of epoch e is a pure function.
"""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NoReturn

import torch
from torch.utils.data import IterableDataset, get_worker_info
from torch.utils.data._utils.collate import default_collate_fn_map

from specklegen.core.arguments import flag, whole_number
from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread
from specklegen.datasets.loading.partition import batch_count, batch_range
from specklegen.datasets.workers import prepare_worker

if TYPE_CHECKING:
    from specklegen.datasets.loading.loader import EpochLoader


def distributed_place() -> tuple[int, int]:
    """Return (rank, world) of torch.distributed, or (0, 1) where it is not in use."""
    distributed = torch.distributed
    if distributed.is_available() and distributed.is_initialized():
        return distributed.get_rank(), distributed.get_world_size()
    return 0, 1


class Batch(dict):
    """A batch: a dict that a DataLoader does not batch again."""


def _refuse_to_batch_again(batches: list, **_: Any) -> NoReturn:
    reject("DataLoader.batch_size", "None: the batches are made in the data set",
           f"{len(batches)} batches to be joined",
           "Use stream.loader(num_workers=...), or DataLoader(stream, batch_size=None).")  # fmt: skip


default_collate_fn_map[Batch] = _refuse_to_batch_again


class EpochBatches(IterableDataset):
    """Batches of one rank, epoch after epoch; subclasses say how they are made.

    One iteration is one epoch, always the same one until :meth:`set_epoch` chooses another; what :meth:`loader`
    returns goes on to the next by itself. The epoch lies in shared memory, where :meth:`set_epoch` reaches workers
    that are already running. Set it between iterations.
    """

    repeats = False
    """Whether a loader goes through the same epoch again and again unless told otherwise."""

    def __init__(
        self, length: int, batch_size: int, rank: int | None = None, world: int | None = None, drop_last: bool = False,
    ) -> None:  # fmt: skip
        here_rank, here_world = distributed_place()
        owner = type(self).__name__
        self.length, self.drop_last = length, flag(f"{owner}.drop_last", drop_last)
        self.batch_size = whole_number(f"{owner}.batch_size", batch_size, 1)
        self.world = whole_number(f"{owner}.world", here_world if world is None else world, 1)
        self.rank = whole_number(f"{owner}.rank", here_rank if rank is None else rank)
        if self.rank >= self.world:
            reject(f"{owner}.rank", f"from 0 to world - 1 = {self.world - 1}", self.rank)
        self._count = batch_count(length, self.batch_size, self.world, self.drop_last)
        self._epoch = torch.zeros((), dtype=torch.int64, device="cpu").share_memory_()
        self.choices = 0

    def __len__(self) -> int:
        """Return the number of batches in an epoch, the same for every rank."""
        return self._count

    @property
    def epoch(self) -> int:
        """The epoch that the next iteration goes through."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch of the next iteration, here and in workers that are already running.

        Raise a `RuleError` if it is not a whole number of at least 0, or an index of its samples would not fit into 64
        bits.
        """
        self._epoch.fill_(self.checked_epoch(epoch))
        self.choices += 1

    def checked_epoch(self, epoch: Any) -> int:
        """Return the number of an epoch, or refuse it."""
        last = (2**63 - 1) // max(1, self.length) - 1
        return whole_number(f"{type(self).__name__}.epoch", epoch, 0, last)

    def places(self, number: int) -> range:
        """Return the places in the epoch that make up batch ``number`` of this rank."""
        return batch_range(self.length, self.batch_size, self.world, self.rank, number)

    def identity(self) -> dict[str, Any]:
        """Say what the order of the samples depends on, apart from the batches: for ``state_dict``."""
        raise NotImplementedError

    def make(self, epoch: int, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
        """Make the batches with these numbers, one after the other."""
        raise NotImplementedError

    def warm(self) -> None:
        """Do, in the process that starts workers, what each of them would otherwise do anew."""

    def starting_at(self, first: int, epoch: int | None = None) -> Iterator[Batch]:
        """Iterate over the rest of an epoch from batch ``first`` on; in a worker, over its share of it."""
        worker, epoch = get_worker_info(), self.epoch if epoch is None else epoch
        if worker is None:
            batches = self.make(epoch, range(first, self._count))
            for _ in range(first, self._count):
                with one_torch_thread():
                    batch = next(batches)
                yield Batch(batch)
            return
        prepare_worker()
        yield from map(Batch, self.make(epoch, range(first + worker.id, self._count, worker.num_workers)))

    def __iter__(self) -> Iterator[Batch]:
        return self.starting_at(0)

    def loader(self, num_workers: int = 0, **options: Any) -> "EpochLoader":
        """Return an iterable over epochs with exact resume: specklegen.datasets.loading.loader.EpochLoader.

        Parameters
        ----------
        num_workers
            Processes that make batches; 0 makes them in this one. The batches are the same.
        options
            Further arguments of ``torch.utils.data.DataLoader``, such as ``pin_memory``.
        """
        from specklegen.datasets.loading.loader import EpochLoader

        return EpochLoader(self, num_workers, **options)
