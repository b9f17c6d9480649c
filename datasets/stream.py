"""The stream: samples rendered while a network trains on them, never stored."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import torch

from specklegen.datasets.epochs import EpochBatches
from specklegen.datasets.protocol import Renderable


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

    Raises
    ------
    RuleError
        If the batches cannot be shared out, or a rank is not in the world.

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
    ) -> None:
        super().__init__(recipe.length(split), batch_size, rank, world, drop_last)
        self.recipe, self.seed, self.split = recipe, seed, split

    def indices(self, epoch: int, number: int) -> range:
        """Return the indices of the samples in batch ``number`` of this rank."""
        places = self.places(number)
        return range(epoch * self.length + places.start, epoch * self.length + places.stop)

    def make(self, epoch: int, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
        """Render batches."""
        for number in numbers:
            yield tensors(self.recipe.batch(self.seed, self.split, self.indices(epoch, number)))

    def identity(self) -> dict[str, Any]:
        """Return seed, split, length of an epoch, fingerprint and data version."""
        return {
            "seed": self.seed,
            "split": self.split,
            "length": self.length,
            "fingerprint": self.recipe.fingerprint(),
            "data_version": self.recipe.data_version,
        }

    def warm(self) -> None:
        """Render one sample, so that kernels are compiled and cached before workers start."""
        self.recipe.sample(self.seed, self.split, 0)


def tensors(batch: Any) -> Any:
    """Turn the arrays of a (nested) dict into tensors that own their memory; other things stay."""
    if isinstance(batch, dict):
        return {key: tensors(value) for key, value in batch.items()}
    if isinstance(batch, np.ndarray):
        return torch.from_numpy(np.require(batch, requirements=["C", "W"]))
    return batch
