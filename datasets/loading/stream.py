"""The stream: samples rendered while a network trains on them, and stored where a cache is named."""

import os
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import accumulate, chain, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils.data import get_worker_info

from specklegen.core.arguments import whole_number
from specklegen.core.devices import checked_device
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject
from specklegen.core.parallel import slices
from specklegen.core.registered import require_importable
from specklegen.datasets.loading.epochs import EpochBatches
from specklegen.datasets.loading.prefetch import ahead
from specklegen.datasets.loading.sample_cache import SampleCache
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.recipe import Recipe, arrays
from specklegen.datasets.sample_schema import Renderable, require_finite
from specklegen.datasets.store.identity import device_kind

if TYPE_CHECKING:
    from specklegen.datasets.loading.loader import EpochLoader


class SpeckleStream(EpochBatches):
    """Batches of fresh samples, as a torch ``IterableDataset``.

    Epoch e holds the samples from e · length on, so that every epoch is new. Use it with
    ``stream.loader(num_workers=4)``, which goes from epoch to epoch by itself, or with
    ``DataLoader(stream, batch_size=None, num_workers=4)``, where ``stream.set_epoch`` has to be called: the
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
        workers. The random numbers are the same; the last bits are not. :meth:`report` says what the host makes there
        all the same. Small batches are made several at once, and on "cuda" the next ones while the program uses these.
    graphs : bool
        Whether CUDA graphs may be used, on "cuda"; the samples are the same.

    cache : path, optional
        A folder, by custom ending in ``.zarr``, or an address that fsspec knows: a sample that was rendered once is
        written to this store, and read from it in later epochs and runs, with the same bits. Workers, ranks, several
        trainings and ``generate`` may share it. If it cannot be written, a warning says so and training goes on.
    cache_limit : int, optional
        Bytes of the cache, about, from which on nothing more is written.

    Raises
    ------
    RuleError
        If the batches cannot be shared out, a rank is not in the world, there is no such device, or the cache holds
        another data set: the fields that differ are named.

    Examples
    --------
    >>> from specklegen.datasets import SpeckleStream, load_recipe
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> batch = next(iter(SpeckleStream(recipe, batch_size=4).loader()))
    >>> batch["image"].shape, batch["object"].shape
    (torch.Size([4, 128, 128]), torch.Size([4, 28, 28]))

    A training loop that can be stopped and resumed::

        loader = SpeckleStream(recipe, batch_size=32).loader(num_workers=4)
        loader.load_state_dict(checkpoint)                      # when resuming
        for epoch in range(loader.state_dict()["epoch"], 100):
            for batch in loader:                                # epoch after epoch, each with new samples
                ...
    """

    def __init__(
        self, recipe: Renderable, seed: int = 0, split: str = "train", batch_size: int = 32, *, rank: int | None = None,
        world: int | None = None, drop_last: bool = False, device: str | torch.device = "cpu", graphs: bool = True,
        cache: str | os.PathLike | None = None, cache_limit: int | None = None,
    ) -> None:  # fmt: skip
        if not isinstance(recipe, Renderable):
            reject("SpeckleStream.recipe", "a recipe", recipe, "Read one with load_recipe.")
        super().__init__(recipe.length(split), batch_size, rank, world, drop_last)
        getattr(recipe, "rendering", None)  # planned here once, and carried to the workers
        self.recipe, self.split = _on(recipe, device), split
        self.seed = whole_number("SpeckleStream.seed", seed)
        self.device, self.graphs = torch.device(device), graphs
        self.repeats = split != "train"
        if cache is None and cache_limit is not None:
            reject("SpeckleStream.cache_limit", "left out without a cache", cache_limit)
        self._cache = None
        if cache is not None:
            self._cache = SampleCache(self.recipe, self.seed, split, cache, cache_limit, self.length, self.batch_size)

    def __repr__(self) -> str:
        name = getattr(self.recipe, "name", type(self.recipe).__name__)
        return summary(self, recipe=name, seed=self.seed, split=self.split, batches=len(self),
                       batch_size=self.batch_size, epoch=self.epoch, device=str(self.device))  # fmt: skip

    def indices(self, epoch: int, number: int) -> range:
        """Return the indices of the samples in batch ``number`` of this rank."""
        places = self.places(number)
        return range(epoch * self.length + places.start, epoch * self.length + places.stop)

    def make(self, epoch: int, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
        """Render batches."""
        if get_worker_info() is not None:
            self._require_no_workers(get_worker_info().num_workers)  # type: ignore[union-attr]
        if self._cache is not None:
            for number in numbers:
                yield tensors(self._cache.batch(self.indices(epoch, number), self._rendered), self.device)
            return
        if self._generator is not None:
            for rendered, parts in ahead(self._at_once(self._generator, epoch, [*numbers]), self.device):
                for part in parts:
                    batch = _own(rendered, part)
                    require_finite(batch, self.recipe, self.seed, self.split)
                    yield batch
            return
        for number in numbers:
            yield tensors(self._rendered(self.indices(epoch, number)), self.device)

    def _rendered(self, indices: Sequence[int]) -> dict[str, Any]:
        """Render samples as arrays of this machine."""
        if self._generator is not None:
            batch = arrays(self._generator([*indices]))
        else:
            batch = self.recipe.batch(self.seed, self.split, indices)
        require_finite(batch, self.recipe, self.seed, self.split)
        return batch

    def _at_once(
        self, generator: SpeckleGenerator, epoch: int, numbers: list[int]
    ) -> Iterator[tuple[dict[str, Any], list[slice]]]:
        """Several batches made together, and which samples are whose."""
        for part in slices(len(numbers), self._batches_at_once(generator)):
            batches = [self.indices(epoch, number) for number in numbers[part]]
            edges = [0, *accumulate(map(len, batches))]
            yield generator([*chain(*batches)]), [slice(*ends) for ends in pairwise(edges)]

    def _batches_at_once(self, generator: SpeckleGenerator) -> int:
        return max(1, generator.at_once // self.batch_size)

    @cached_property
    def _generator(self) -> SpeckleGenerator | None:
        """Maker of batches on another device than the CPU; None if the recipe makes them."""
        if self.device.type == "cpu" or not isinstance(self.recipe, Recipe):
            return None
        return SpeckleGenerator(self.recipe, self.seed, self.split, self.device, graphs=self.graphs)

    def report(self) -> dict[str, Any]:
        """Say how batches are made; see :meth:`SpeckleGenerator.report`."""
        if self._generator is not None:
            return self._generator.report() | {"batches_at_once": self._batches_at_once(self._generator)}
        host = "everything but sums of fields" if not isinstance(self.recipe, Recipe) else "everything"
        return {"device": str(self.device), "host": [host]}

    def loader(self, num_workers: int = 0, **options: Any) -> "EpochLoader":
        """Return an iterable over epochs with exact resume: specklegen.datasets.loading.loader.EpochLoader.

        Parameters
        ----------
        num_workers
            Processes that make batches; 0 makes them in this one. The batches are the same.
        options
            Further arguments of ``torch.utils.data.DataLoader``, such as ``pin_memory``.

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
            reject("loader.num_workers", f'0 for a stream with device="{self.device}"', num_workers,
                   'The device renders in the training process; workers are for device="cpu".')  # fmt: skip

    def identity(self) -> dict[str, Any]:
        """Return seed, split, length of an epoch, fingerprint, data version and kind of device."""
        return {
            "seed": self.seed, "split": self.split, "length": self.length, "fingerprint": self.recipe.fingerprint(),
            "data_version": self.recipe.data_version, "device": device_kind(self.recipe),
        }  # fmt: skip

    def warm(self) -> None:
        """Render one sample, so that kernels are compiled and cached before workers start."""
        require_importable(getattr(self.recipe, "own_classes", tuple)())
        self.recipe.sample(self.seed, self.split, 0)


def _on(recipe: Renderable, device: str | torch.device) -> Renderable:
    if str(device) != "cpu" and not hasattr(recipe, "on"):
        reject("SpeckleStream.device", f'"cpu" for {type(recipe).__name__}, which has no method `on`', str(device))
    if checked_device("SpeckleStream.device", device).type == "cpu":
        return recipe
    return recipe.on(str(device))  # type: ignore[attr-defined]


def _own(made: Any, part: slice) -> Any:
    """Some samples of a (nested) dict of tensors, in memory of the stream that reads them."""
    return {key: _own(value, part) for key, value in made.items()} if isinstance(made, dict) else made[part].clone()


def tensors(batch: Any, device: torch.device | str = "cpu") -> Any:
    """Turn the arrays of a (nested) dict into tensors that own their memory; other things stay."""
    if isinstance(batch, dict):
        return {key: tensors(value, device) for key, value in batch.items()}
    if isinstance(batch, np.ndarray):
        return torch.from_numpy(np.require(batch, requirements=["C", "W"])).to(device)
    return batch
