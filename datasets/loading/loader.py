"""The loader: a DataLoader with the safe start method, and a position that can be saved and restored."""

from collections.abc import Iterator
from typing import Any

import torch
from torch.utils.data import DataLoader, IterableDataset

from specklegen.core.arguments import whole_number
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject, warn_user
from specklegen.core.shielded import shielded
from specklegen.datasets.loading.epochs import EpochBatches
from specklegen.datasets.store.identity import differences
from specklegen.datasets.workers import worker_context

_TAKEN_ALWAYS = ("generator", "pin_memory_device")
_TAKEN_BY_WORKERS = ("persistent_workers", "multiprocessing_context", "worker_init_fn")
_REFUSED = {
    "batch_size": "The stream, or cache.shuffled, makes the batches: pass it there.",
    "drop_last": "The stream, or cache.shuffled, makes the batches: pass it there.",
    "shuffle": "Samples of a stream are independent, in any order; a store is shuffled by cache.shuffled(seed=...).",
    "sampler": "The order is that of the stream, or of cache.shuffled, so that a position can be resumed.",
    "batch_sampler": "The order is that of the stream, or of cache.shuffled, so that a position can be resumed.",
    "collate_fn": "Batches are made in the stream; change them in the training loop.",
    "in_order": "Batches out of their order could not be resumed.",
    "dataset": "The loader already belongs to a stream or a shuffled cache.",
}
"""Arguments of DataLoader that would change the order or the batches, and why they are refused."""


def _require_harmless(batches: EpochBatches, options: dict[str, Any]) -> None:
    """Refuse arguments of a DataLoader that would change the batches; those that say what is so anyway are taken."""
    so_anyway = {"batch_size": (None, batches.batch_size), "drop_last": (batches.drop_last,), "in_order": (True,)}
    so_anyway |= {"shuffle": (False, None), "sampler": (None,), "batch_sampler": (None,), "collate_fn": (None,)}
    for name, value in options.items():
        if name in _REFUSED and not any(value is same or value == same for same in so_anyway.get(name, ())):
            reject(f"loader.{name}", "left out", value, _REFUSED[name])
        if name not in (*_REFUSED, *_TAKEN_ALWAYS, *_TAKEN_BY_WORKERS):
            names = ["repeat", "pin_memory", "timeout", "prefetch_factor", *_TAKEN_ALWAYS, *_TAKEN_BY_WORKERS]
            reject(f"loader.{name}", f"one of {', '.join(names)}", value)
    if options.get("multiprocessing_context") is not None:
        context = options["multiprocessing_context"]
        if (context if isinstance(context, str) else context.get_start_method()) == "fork":
            reject("loader.multiprocessing_context", '"forkserver" or "spawn"', "fork",
                   "A forked process may deadlock, since threads compute in its parent.")  # fmt: skip


class _FromBatch(IterableDataset):
    """The batches of an epoch from a first one on; both numbers lie in shared memory."""

    def __init__(self, batches: EpochBatches) -> None:
        self.batches = batches
        self.start = torch.zeros(2, dtype=torch.int64, device="cpu").share_memory_()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        epoch, first = self.start.tolist()
        return self.batches.starting_at(first, epoch)


class EpochSampler:
    """Object by which training frameworks set the next epoch: they call ``loader.sampler.set_epoch``."""

    def __init__(self, loader: "EpochLoader") -> None:
        self._loader = loader

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch of the next iteration, unless the loader repeats its epoch, as in validation."""
        if not self._loader.repeat:
            self._loader.set_epoch(epoch)


class EpochLoader:
    """An iterable over batches: each iteration is one epoch, and the next iteration the next epoch.

    Who calls :meth:`set_epoch` chooses the epochs from then on: an iteration goes through the one chosen last.
    Frameworks that call ``loader.sampler.set_epoch`` do so too.

    The position is counted here, in the training process, by the batches handed out: what workers had made in
    advance is not in it. After :meth:`load_state_dict` the next iteration is the rest of that epoch (nothing,
    if it was over), with any number of workers. There is one position, and so one iteration at a time: where a
    second one has begun, the first one refuses to go on.

    Parameters
    ----------
    batches : EpochBatches
        The stream, or a shuffled cache.
    num_workers : int
        Worker processes, started by a fork server (spawned where there is none) and kept between epochs: a
        script needs ``if __name__ == "__main__":``. 0 makes batches in this process.
    repeat : bool, optional
        Go through the same epoch each time. By default for streams of the splits validation and test, so that
        every validation is on the same samples.
    pin_memory : bool, optional
        By default, whether there is a CUDA device.
    timeout : float
        Seconds to wait for a batch before giving up; 0 waits for ever.
    prefetch_factor : int
        Batches that each worker makes in advance.
    options
        Other arguments of ``DataLoader``: ``persistent_workers`` (by default True), ``multiprocessing_context``,
        ``worker_init_fn``, ``generator``, ``pin_memory_device``. Those that would change the order or the batches are
        refused, with the reason.

    Raises
    ------
    RuleError
        If an option is refused, or there is none of its name.
    """

    def __init__(
        self, batches: EpochBatches, num_workers: int = 0, *, repeat: bool | None = None,
        pin_memory: bool | None = None, timeout: float = 0, prefetch_factor: int = 2, **options: Any,
    ) -> None:  # fmt: skip
        _require_harmless(batches, options)
        self.batches, self.num_workers = batches, whole_number("loader.num_workers", num_workers)
        self._source = _FromBatch(batches)
        self.repeat = batches.repeats if repeat is None else repeat
        self._upcoming = batches.epoch, 0
        self._position: tuple[int, int] | None = None
        self._choices = batches.choices
        self._turn = 0
        settings = {name: value for name, value in options.items() if name in _TAKEN_ALWAYS}
        if num_workers:
            batches.warm()
            settings |= {
                "num_workers": num_workers, "multiprocessing_context": worker_context(), "persistent_workers": True,
                "prefetch_factor": prefetch_factor, "timeout": timeout,
            }  # fmt: skip
            settings |= {name: options[name] for name in _TAKEN_BY_WORKERS if options.get(name) is not None}
        pinned = torch.cuda.is_available() if pin_memory is None else pin_memory
        self._loader = DataLoader(self._source, batch_size=None, pin_memory=pinned, **settings)

    def __repr__(self) -> str:
        return summary(self, batches=self.batches, num_workers=self.num_workers)

    @property
    def sampler(self) -> EpochSampler:
        """Object that receives the epoch from frameworks."""
        return EpochSampler(self)  # not kept: in a circle the workers would outlive the loader

    @property
    def dataset(self) -> EpochBatches:
        """Source of the batches, by the name that training frameworks use."""
        return self.batches

    def __len__(self) -> int:
        """Return the number of batches in a whole epoch."""
        return len(self.batches)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch of the next iteration; a resumed position holds if it is in that epoch."""
        self.batches.set_epoch(epoch)

    def _hear(self) -> None:
        """Take notice of a call of ``set_epoch``, here or on the batches themselves."""
        if self.batches.choices != self._choices:
            self._choices = self.batches.choices
            if self.batches.epoch != self._upcoming[0]:
                self._upcoming, self._position = (self.batches.epoch, 0), None

    def __iter__(self) -> Iterator[dict[str, Any]]:
        self._hear()
        self._turn += 1
        turn = self._turn
        epoch, number = self._position = self._upcoming
        stays = self.repeat or self.batches.choices > 0
        self._upcoming = (epoch if stays else epoch + 1), 0
        self._source.start.copy_(torch.tensor([epoch, number], device="cpu"))
        with shielded():  # torch draws a seed for its workers on the default device
            batches = iter(self._loader)
        while True:
            if turn != self._turn:
                reject("loader", "iterated over once at a time", "a second iteration, begun before this one had ended",
                       "Make one loader for each iteration.")  # fmt: skip
            try:
                batch = next(batches)
            except StopIteration:
                return
            number += 1
            self._position = epoch, number
            yield batch

    def state_dict(self) -> dict[str, Any]:
        """Return the position after the last batch that was handed out; plain values, for any checkpoint."""
        self._hear()
        epoch, number = self._position or self._upcoming
        return self._settings() | {"epoch": epoch, "next_batch": number}

    def load_state_dict(self, state: dict[str, Any], *, strict_device: bool = False) -> None:
        """Go to a saved position.

        Another number of workers, and another rank, is exact. So is another world or batch size where the position
        falls on one of its rounds. On another kind of device samples have the same random words and other roundings
        (docs/devices.md). Raise a `RuleError` if the state is of other data, its numbers are not those of a position,
        or its position is inside a round of this world and batch size.

        Parameters
        ----------
        state
            From :meth:`state_dict`.
        strict_device
            Refuse the position of another kind of device, instead of warning of it.

        Warns
        -----
        DoubtWarning
            If the position was saved on another kind of device.
        """
        here = self._settings()
        self._check(state)
        there, kind = state.get("device"), here.get("device")
        moved = isinstance(there, str) and there != kind and not strict_device
        free = ("world", "batch_size", "device") if moved else ("world", "batch_size")
        fields = differences(
            {key: value for key, value in state.items() if key not in ("epoch", "next_batch", *free)},
            {key: value for key, value in here.items() if key not in free},
        )
        if fields:
            reject("loader.state", "the state of a loader of the same samples in the same order", "; ".join(fields))
        if state["next_batch"] > _rounds(self.batches, state):
            reject("loader.state['next_batch']", f"at most {_rounds(self.batches, state)}", state["next_batch"])
        sample = min(state["next_batch"] * state["world"] * state["batch_size"], self.batches.length)
        number, inside = divmod(sample, here["world"] * here["batch_size"])
        if sample == self.batches.length or state["next_batch"] == _rounds(self.batches, state):
            number, inside = len(self.batches), 0
        if inside:
            reject("loader.state", f"at the end of a round of {here['world']} ranks × {here['batch_size']} samples",
                   f"sample {sample}",
                   f"Resume with {state['world']} ranks and batches of {state['batch_size']}.")  # fmt: skip
        if moved:
            warn_user(
                f"the position was saved on {there!r} and is resumed on {kind!r}: samples are the same, but rounded "
                "differently",
            )
        self._choices = self.batches.choices
        self._upcoming, self._position = (state["epoch"], number), None
        self._turn += 1  # an iteration that was going on does not

    def _check(self, state: Any) -> None:
        """Refuse what cannot be a position."""
        if not isinstance(state, dict):
            reject("loader.state", "a dict that state_dict() returned", state)
        least = {"epoch": 0, "next_batch": 0, "world": 1, "batch_size": 1}
        for name, low in least.items():
            value = state.get(name)
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                reject(f"loader.state[{name!r}]", f"a whole number of at least {low}", state.get(name, "none"))
        if not isinstance(state.get("drop_last"), bool):
            reject("loader.state['drop_last']", "True or False", state.get("drop_last", "none"))
        self.batches.checked_epoch(state["epoch"])

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
