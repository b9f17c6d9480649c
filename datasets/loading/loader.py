"""The loader: a DataLoader with the safe start method, and a position that can be saved and restored."""

from collections.abc import Iterator
from typing import Any

import torch
from torch.utils.data import DataLoader, IterableDataset

from specklegen.core.errors import reject
from specklegen.datasets.loading.epochs import EpochBatches
from specklegen.datasets.store.identity import differences
from specklegen.datasets.workers import worker_context


class _FromBatch(IterableDataset):
    """The batches of an epoch from a first one on, which lies in shared memory."""

    def __init__(self, batches: EpochBatches) -> None:
        self.batches = batches
        self.first = torch.zeros((), dtype=torch.int64).share_memory_()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return self.batches.starting_at(int(self.first))


class EpochLoader:
    """An iterable over batches: each iteration is one epoch, the one that ``set_epoch`` chose.

    The position is counted here, in the training process, by the batches handed out: what workers had made in
    advance is not in it. After :meth:`load_state_dict` the next iteration is the rest of that epoch (nothing,
    if it was over), with any number of workers.

    Parameters
    ----------
    batches : EpochBatches
        The stream, or a shuffled cache.
    num_workers : int
        Worker processes, started by a fork server (spawned where there is none) and kept between epochs: a
        script needs ``if __name__ == "__main__":``. 0 makes batches in this process.
    pin_memory : bool, optional
        By default, whether there is a CUDA device.
    timeout : float
        Seconds to wait for a batch before giving up; 0 waits for ever.
    prefetch_factor : int
        Batches that each worker makes in advance.
    """

    def __init__(
        self,
        batches: EpochBatches,
        num_workers: int = 0,
        *,
        pin_memory: bool | None = None,
        timeout: float = 0,
        prefetch_factor: int = 2,
    ) -> None:
        if num_workers < 0:
            reject("loader.num_workers", "at least 0", num_workers)
        self.batches = batches
        self._source = _FromBatch(batches)
        self._position = batches.epoch, 0
        self._resume: int | None = None
        workers: dict[str, Any] = {}
        if num_workers:
            batches.warm()
            workers = {
                "num_workers": num_workers,
                "multiprocessing_context": worker_context(),
                "persistent_workers": True,
                "prefetch_factor": prefetch_factor,
                "timeout": timeout,
            }
        pinned = torch.cuda.is_available() if pin_memory is None else pin_memory
        self._loader = DataLoader(self._source, batch_size=None, pin_memory=pinned, **workers)

    def __len__(self) -> int:
        """Return the number of batches in a whole epoch."""
        return len(self.batches)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch of the next iteration; a resumed position holds if it is in that epoch."""
        if epoch != self.batches.epoch:
            self._resume = None
        self.batches.set_epoch(epoch)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        first, self._resume = self._resume or 0, None
        epoch = self.batches.epoch
        self._source.first.fill_(first)
        self._position = epoch, first
        for number, batch in enumerate(self._loader, first + 1):
            self._position = epoch, number
            yield batch

    def state_dict(self) -> dict[str, Any]:
        """Return the position after the last batch that was handed out; plain values, for any checkpoint."""
        epoch, number = self._position
        if self._resume is None and epoch != self.batches.epoch:
            epoch, number = self.batches.epoch, 0
        return self._settings() | {"epoch": epoch, "next_batch": number}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go to a saved position.

        Another number of workers, and another rank, is exact. So is another world or batch size where the
        position falls on one of its rounds.

        Raises
        ------
        RuleError
            If the state is of other data, or its position is inside a round of this world and batch size.
        """
        here = self._settings()
        free = ("world", "batch_size")
        fields = differences(
            {key: value for key, value in state.items() if key not in ("epoch", "next_batch", *free)},
            {key: value for key, value in here.items() if key not in free},
        )
        if fields:
            reject("loader.state", "that of the same samples in the same order", "; ".join(fields))
        sample = min(state["next_batch"] * state["world"] * state["batch_size"], self.batches.length)
        number, inside = divmod(sample, here["world"] * here["batch_size"])
        if sample == self.batches.length or state["next_batch"] == _rounds(self.batches, state):
            number, inside = len(self.batches), 0
        if inside:
            reject(
                "loader.state",
                f"at the end of a round of {here['world']} ranks × {here['batch_size']} samples",
                f"sample {sample}",
                f"Resume with {state['world']} ranks and batches of {state['batch_size']}.",
            )
        self.batches.set_epoch(state["epoch"])
        self._position = state["epoch"], number
        self._resume = number

    def _settings(self) -> dict[str, Any]:
        batches = self.batches
        return batches.identity() | {
            "world": batches.world,
            "batch_size": batches.batch_size,
            "drop_last": batches.drop_last,
        }


def _rounds(batches: EpochBatches, state: dict[str, Any]) -> int:
    full, rest = divmod(batches.length, state["world"] * state["batch_size"])
    return full + bool(rest and not state["drop_last"])
