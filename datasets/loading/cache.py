"""The cache: a generated store as a torch data set that never hands out a sample that is not there."""

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from torch.utils.data import Dataset

from specklegen.core.arguments import choice, instance, whole_number, whole_numbers
from specklegen.core.display.plot import SHOWN, Pictured, draw_stack
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread
from specklegen.datasets.loading.epochs import EpochBatches
from specklegen.datasets.loading.shard_order import ORDER, ShardOrder
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.sample_schema import Renderable, named_file, require_finite
from specklegen.datasets.store.creation import require_same
from specklegen.datasets.store.files import reaching
from specklegen.datasets.store.identity import identity
from specklegen.datasets.store.places import place_of
from specklegen.datasets.store.reading import SampleReader
from specklegen.datasets.store.shards import MissingSample
from specklegen.datasets.store.store import Store


class SpeckleCache(Dataset, Pictured):
    """A store as a map-style data set: ``cache[n]`` equals ``recipe.sample(seed, split, n)`` to the bit.

    A sample is a dict of tensors, with "index" (int) and "parameters" (a dict of floats); and "file", a name, where
    objects are pictures of a folder. Files are opened
    when first read, in whichever process reads them; a process that finds another data set at the path than the one
    that was opened there refuses it.

    Parameters
    ----------
    folder : path
        The folder of the store, which may still be being filled; or an address that fsspec knows, such as
        ``s3://bucket/a.zarr`` (extra ``remote``), a ``UPath`` where it needs options.
    missing : {"raise", "render"}
        What to do with a sample that is not there: raise MissingSample, or render it from ``recipe``.
    recipe : Renderable, optional
        The recipe that the store was made from; needed to render.

    Raises
    ------
    RuleError
        If the folder is not a store, or the recipe is not that of the store.
    MissingSample
        On reading a sample that is not there.
    DamagedShard
        On reading bytes that are not those that were written; as ForeignShard, if they were written for another
        data set or another sample.

    Examples
    --------
    >>> import tempfile
    >>> from specklegen.datasets import SpeckleCache, generate, load_recipe
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     said = generate(recipe, samples=4, folder=f"{folder}/a.zarr", processes=1)
    ...     cache = SpeckleCache(f"{folder}/a.zarr")
    ...     len(cache), cache[3]["image"].shape
    (4, torch.Size([128, 128]))
    """

    def __init__(
        self, folder: str | os.PathLike, missing: Literal["raise", "render"] = "raise",
        recipe: Renderable | None = None,
    ) -> None:  # fmt: skip
        choice("SpeckleCache.missing", missing, ("raise", "render"))
        if missing == "render" and recipe is None:
            reject("SpeckleCache.recipe", "given where missing samples are to be rendered", recipe)
        if recipe is not None and not isinstance(recipe, Renderable):
            reject("SpeckleCache.recipe", "a recipe", recipe, "Read one with load_recipe.")
        self.folder, self.missing, self.recipe = place_of(folder), missing, recipe
        self._open()
        stated = self.identity
        if recipe is not None:
            require_same(self._store, identity(recipe, stated["seed"], stated["split"], stated["dtype"]))

    def _open(self) -> None:
        self._store = Store(self.folder)
        self._types = self._store.sample_types()
        self._reader = SampleReader(self._store)

    @property
    def store(self) -> Store:
        """The open store."""
        return self._store

    @property
    def identity(self) -> dict[str, Any]:
        """Origin of the store: recipe, seed, split, dtype, data version."""
        return self._store.attributes["identity"]

    @property
    def keys(self) -> list[str]:
        """Names of the arrays of a sample."""
        return self._store.keys

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files that objects are from, by the number "file" among a sample's parameters; () without.

        As they were when the store was begun.
        """
        return self._store.file_names

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the identity."""
        return self._store.attributes["fingerprint"]

    @property
    def shard_samples(self) -> int:
        """Samples in a shard."""
        return self._store.shard_samples

    def __repr__(self) -> str:
        split = self.identity["split"]
        return summary(self, folder=str(self.folder), samples=len(self), split=split, keys=self.keys)

    def _facts(self) -> Mapping[str, object]:
        return {
            "folder": self.folder, "samples": len(self), "split": self.identity["split"], "seed": self.identity["seed"],
            "arrays": ", ".join(self.keys), "parameters": ", ".join(self._store.parameter_names),
        }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Images of those of its first samples that are there."""
        key = "image" if "image" in self.keys else self.keys[0]
        images = []
        for n in range(min(len(self), SHOWN)):
            with contextlib.suppress(MissingSample):
                images.append(np.abs(self.numpy(n)[key]))
        if images:
            draw_stack(axes, np.stack(images))

    def __len__(self) -> int:
        return self._store.samples

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("folder", "missing", "recipe", "fingerprint")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update({name: each for name, each in state.items() if name != "fingerprint"})
        self._open()
        self._store.require(state["fingerprint"])

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Return a sample as tensors."""
        return tensors(self.numpy(index))

    def numpy(self, index: int) -> dict[str, Any]:
        """Return a sample as arrays; -1 is the last one.

        Parameters
        ----------
        index
            Which sample.

        Raises
        ------
        RuleError, IndexError
            If the index is no whole number, or there is no such sample.
        """
        if not -len(self) <= whole_number("SpeckleCache index", index, -(2**63)) < len(self):
            raise IndexError(f"index {index} is out of range: the store has {len(self)} samples")
        index = int(index) % len(self)
        try:
            return self._read(index)
        except MissingSample:
            if self.missing == "raise" or self.recipe is None:
                raise
        seed, split = self.identity["seed"], self.identity["split"]
        with one_torch_thread():
            sample = self.recipe.sample(seed, split, index)
        require_finite(sample, self.recipe, seed, split)
        rendered = {key: value for key, value in sample.items() if key != "file"}
        return rendered | named_file(self.file_names, sample["parameters"])  # the names of those that were stored

    def _read(self, index: int) -> dict[str, Any]:
        with reaching(self.folder):
            stored = self._reader.read(index)
        sample: dict[str, Any] = {key: np.array(array, self._types[key]) for key, array in stored.arrays.items()}
        sample["index"] = index
        sample["parameters"] = dict(zip(self._store.parameter_names, stored.parameters.tolist(), strict=True))
        return sample | named_file(self.file_names, sample["parameters"])

    def batch(self, indices: Sequence[int]) -> dict[str, Any]:
        """Return samples stacked along a new first axis, as tensors; read in the order of the shards.

        Parameters
        ----------
        indices
            Which samples, in the order wanted; -1 is the last one.
        """
        indices = whole_numbers("SpeckleCache.batch indices", indices, -(2**63))
        order = np.argsort(indices, kind="stable")
        samples: list[dict[str, Any]] = [{}] * len(order)
        for place in order.tolist():
            samples[place] = self.numpy(indices[place])
        stacked = {key: np.stack([sample[key] for sample in samples]) for key in self.keys}
        stacked["index"] = np.array([sample["index"] for sample in samples], np.int64)
        names = self._store.parameter_names
        drawn = {name: np.array([sample["parameters"][name] for sample in samples]) for name in names}
        return tensors(stacked | {"parameters": drawn})

    def shuffled(
        self, batch_size: int = 32, seed: int = 0, buffer_shards: int = 4, **options: Any
    ) -> "ShuffledCache":
        """Return epochs of shuffled batches that read few shards at a time.

        Parameters
        ----------
        batch_size
            Samples in a batch.
        seed
            Of the order; every epoch has another.
        buffer_shards
            Shards whose samples are shuffled among themselves: more are better mixed, and hold more files open.
        options
            ``rank``, ``world`` and ``drop_last``, as those of a :class:`~specklegen.datasets.SpeckleStream`.
        """
        return ShuffledCache(self, batch_size, seed, buffer_shards, **options)


class ShuffledCache(EpochBatches):
    """Shuffled batches of a cache in shard order, as a torch ``IterableDataset``.

    The shards are shuffled; then the samples of every ``buffer_shards`` shards among themselves. So reading
    stays within a few files at a time, and each epoch has another order: a pure function of (seed, epoch).
    ``rank``, ``world``, ``drop_last`` and ``loader()`` are as in :class:`~specklegen.datasets.SpeckleStream`.
    """

    def __init__(
        self, cache: SpeckleCache, batch_size: int = 32, seed: int = 0, buffer_shards: int = 4, *,
        rank: int | None = None, world: int | None = None, drop_last: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(len(instance("ShuffledCache.cache", cache, SpeckleCache)), batch_size, rank, world, drop_last)
        self.cache, self.seed = cache, whole_number("ShuffledCache.seed", seed)
        self.buffer_shards = whole_number("ShuffledCache.buffer_shards", buffer_shards, 1)

    def __repr__(self) -> str:
        return summary(self, cache=self.cache, batches=len(self), batch_size=self.batch_size, epoch=self.epoch)

    def order(self, epoch: int) -> np.ndarray:
        """Return the samples of an epoch in their order: int64[length]."""
        return ShardOrder(self.length, self.cache.shard_samples, self.buffer_shards, self.seed, epoch)[0 : self.length]

    def make(self, epoch: int, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
        """Read batches."""
        order = ShardOrder(self.length, self.cache.shard_samples, self.buffer_shards, self.seed, epoch)
        for number in numbers:
            places = self.places(number)
            yield self.cache.batch(order[places.start : places.stop].tolist())

    def identity(self) -> dict[str, Any]:
        """Return what the order depends on."""
        return {
            "seed": self.seed, "split": self.cache.identity["split"], "length": self.length,
            "fingerprint": self.cache.fingerprint, "buffer_shards": self.buffer_shards,
            "shard_samples": self.cache.shard_samples, "order": ORDER,
        }  # fmt: skip
