"""The stream: samples rendered while a network trains on them, never stored."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils.data import get_worker_info

from specklegen.core.arguments import whole_number
from specklegen.core.devices import checked_device
from specklegen.core.errors import reject
from specklegen.datasets.loading.epochs import EpochBatches
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store.identity import device_kind

if TYPE_CHECKING:
    from specklegen.datasets.loading.loader import EpochLoader


class SpeckleStream(EpochBatches):
    """Batches of fresh samples, as a torch ``IterableDataset``.

    Epoch e holds the samples from e · length on, so that every epoch is new. Use it with
    ``stream.loader(num_workers=4)``, or with ``DataLoader(stream, batch_size=None, num_workers=4)``: the
    batches are made here, and are the same to the bit for any number of workers.

    Parameters
    ----------
    recipe : Renderable
        What renders the samples.
    seed : int
        Seed of the data set.
    split : str
        "train", "validation" or "test": disjoint by construction.
    batch_size : int
        Samples in a batch; those of the last round may be smaller.
    rank, world : int, optional
        By default those of torch.distributed where it is initialised, else 0 and 1. Rank r takes global
        batch b · world + r; every rank gets the same number of batches.
    drop_last : bool
        Leave out the last, smaller batches.
    device : str or torch.device
        Where to render, and where the batches lie: "cpu", or "cuda" in the training process itself, without
        workers. The random numbers are the same; the last bits are not.

    Raises
    ------
    RuleError
        If the batches cannot be shared out, a rank is not in the world, or there is no such device.

    Examples
    --------
    A training loop that can be stopped and resumed::

        loader = SpeckleStream(recipe, batch_size=32).loader(num_workers=4)
        loader.load_state_dict(checkpoint)                      # when resuming
        for epoch in range(loader.state_dict()["epoch"], 100):
            loader.set_epoch(epoch)
            for batch in loader:
                ...
    """

    def __init__(
        self,
        recipe: Renderable,
        seed: int = 0,
        split: str = "train",
        batch_size: int = 32,
        *,
        rank: int | None = None,
        world: int | None = None,
        drop_last: bool = False,
        device: str | torch.device = "cpu",
    ) -> None:
        if not isinstance(recipe, Renderable):
            reject("SpeckleStream.recipe", "a recipe", recipe, "Read one with load_recipe.")
        super().__init__(recipe.length(split), batch_size, rank, world, drop_last)
        self.recipe, self.split = _on(recipe, device), split
        self.seed = whole_number("SpeckleStream.seed", seed)
        self.device = torch.device(device)

    def indices(self, epoch: int, number: int) -> range:
        """Return the indices of the samples in batch ``number`` of this rank."""
        places = self.places(number)
        return range(epoch * self.length + places.start, epoch * self.length + places.stop)

    def make(self, epoch: int, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
        """Render batches."""
        if get_worker_info() is not None:
            self._require_no_workers(get_worker_info().num_workers)  # type: ignore[union-attr]
        for number in numbers:
            yield tensors(self.recipe.batch(self.seed, self.split, self.indices(epoch, number)), self.device)

    def loader(self, num_workers: int = 0, **options: Any) -> "EpochLoader":
        """Return an iterable over epochs with exact resume: specklegen.datasets.loading.loader.EpochLoader.

        Raises
        ------
        RuleError
            If there are workers, and another device than the CPU.
        """
        self._require_no_workers(num_workers)
        if self.device.type != "cpu":
            options = {"pin_memory": False} | options  # the batches are where they are used
        return super().loader(num_workers, **options)

    def _require_no_workers(self, num_workers: int) -> None:
        if num_workers and self.device.type != "cpu":
            reject(
                "loader.num_workers",
                f'0 for a stream with device="{self.device}"',
                num_workers,
                'The device renders in the training process; workers are for device="cpu".',
            )

    def identity(self) -> dict[str, Any]:
        """Return seed, split, length of an epoch, fingerprint, data version and kind of device."""
        return {
            "seed": self.seed,
            "split": self.split,
            "length": self.length,
            "fingerprint": self.recipe.fingerprint(),
            "data_version": self.recipe.data_version,
            "device": device_kind(self.recipe),
        }

    def warm(self) -> None:
        """Render one sample, so that kernels are compiled and cached before workers start."""
        self.recipe.sample(self.seed, self.split, 0)


def _on(recipe: Renderable, device: str | torch.device) -> Renderable:
    if str(device) != "cpu" and not hasattr(recipe, "on"):
        reject("SpeckleStream.device", f'"cpu" for {type(recipe).__name__}, which has no method `on`', str(device))
    if checked_device("SpeckleStream.device", device).type == "cpu":
        return recipe
    return recipe.on(str(device))  # type: ignore[attr-defined]


def tensors(batch: Any, device: torch.device | str = "cpu") -> Any:
    """Turn the arrays of a (nested) dict into tensors that own their memory; other things stay."""
    if isinstance(batch, dict):
        return {key: tensors(value, device) for key, value in batch.items()}
    if isinstance(batch, np.ndarray):
        return torch.from_numpy(np.require(batch, requirements=["C", "W"])).to(device)
    return batch
