"""One shard of a store: rendered in batches, checked against its layout, written, and what became of it."""

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from specklegen.core.errors import ToldError, reject
from specklegen.core.parallel import one_torch_thread
from specklegen.datasets.sample_schema import Renderable, require_finite
from specklegen.datasets.store.files import no_room, passing
from specklegen.datasets.store.places import is_remote
from specklegen.datasets.store.reading import SampleReader
from specklegen.datasets.store.shards import DamagedShard
from specklegen.datasets.store.store import Store

BATCH = 32
"""Samples rendered at once: enough to share work, few enough that memory stays flat."""

PATIENCE = 1.0
"""Seconds that :func:`add_samples` waits for a shard that another process claims."""


class GenerationError(ToldError, RuntimeError):
    """Samples that could not be rendered; all others are in the store."""


RENEWALS = 3
"""Times that a shard is written again where locks exclude nobody and calls of other lengths write to it."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one shard; small enough to send between machines.

    ``transient`` failures were the system's (an OSError) and may not come back; all others would. After a
    ``final`` one nothing more can be written, by any shard: the disk is full.
    """

    shard: int
    state: Literal["written", "present", "busy", "failed"]
    seconds: float = 0.0
    checksum: str = ""
    message: str = ""
    transient: bool = False
    final: bool = False


def fill_shard(store: Store, recipe: Renderable, shard: int, wait: bool = False) -> Outcome:
    """Render and write one shard, unless it is there or another process is at it (``wait``: wait for it)."""
    start = time.perf_counter()
    try:
        with store.claimed(shard, wait) as claimed:
            if claimed == "busy":
                return Outcome(shard, "busy")
            if store.is_complete(shard):
                return Outcome(shard, "present", checksum=store.recorded_digest(shard).hex())
            try:
                checksum = store.write_shard(shard, _render(store, recipe, store.span(shard)))
                for _ in range(RENEWALS if claimed == "unlockable" else 0):
                    there = Store(store.folder)
                    if len(there.span(shard)) == len(store.span(shard)) and _is_whole(there, shard):
                        break
                    store = there
                    checksum = store.write_shard(shard, _render(store, recipe, store.span(shard)))
            except Exception as error:  # a bad sample must not stop the others; it is reported with its address
                return _failed(shard, error)
    except ToldError:
        raise
    except Exception as error:  # an address that gives no answer to a claim
        if not is_remote(store.folder):
            raise
        return _failed(shard, error)
    return Outcome(shard, "written", time.perf_counter() - start, checksum.hex())


def _is_whole(store: Store, shard: int) -> bool:
    """Return whether a shard has its checksum: another call, of fewer samples, may have written to it meanwhile."""
    try:
        return store.digest(shard) == store.recorded_digest(shard)
    except (OSError, LookupError):
        return False


def _failed(shard: int, error: Exception) -> Outcome:
    message = f"shard {shard}: {type(error).__name__}: {error}"
    passes = (passing(error) or isinstance(error.__cause__, OSError)) and not no_room(error)
    return Outcome(shard, "failed", message=message, transient=passes, final=no_room(error))


def _render(store: Store, recipe: Renderable, span: range) -> dict[str, np.ndarray]:
    seed, split = store.attributes["identity"]["seed"], store.attributes["identity"]["split"]
    columns: dict[str, np.ndarray] = {}
    for first in range(0, len(span), BATCH):
        batch = _batch(recipe, seed, split, span[first : first + BATCH])
        require_finite(batch, recipe, seed, split)
        for name, rows in stored_columns(store, recipe, batch).items():
            columns.setdefault(name, np.empty((len(span), *rows.shape[1:]), rows.dtype))[first : first + BATCH] = rows
    if not np.array_equal(columns["index"], np.arange(span.start, span.stop)):
        reject(f"{recipe.name}.batch", "samples in the order of their indices", columns["index"])
    return columns


def stored_columns(store: Store, recipe: Renderable, batch: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Turn a batch into the columns of a store."""
    types, kinds, names = store.stored_types(), store.sample_types(), store.parameter_names
    if list(batch["parameters"]) != names:
        reject(f"{recipe.name}.parameters", f"{names} in every sample", list(batch["parameters"]))
    index = np.asarray(batch["index"], np.int64)
    columns = {key: _as_stored(key, np.asarray(batch[key]), kinds[key], types[key]) for key in store.keys}
    columns["parameters"] = np.empty((len(index), len(names)))
    for place, name in enumerate(names):
        columns["parameters"][:, place] = batch["parameters"][name]
    return columns | {"index": index, "seed": np.full(len(index), store.seed, np.int64)}


def add_samples(store: Store, shard: int, columns: Mapping[str, np.ndarray]) -> None:
    """Write samples of a shard beside those that it holds, unless another process is at it for long.

    Every file holds a sample before the ledger lists it, and goes on to hold it. Where claims exclude nobody, whole
    shards alone are written, which are the same for every writer.
    """
    end = time.monotonic() + PATIENCE
    while True:
        with store.claimed(shard) as state:
            if state != "busy":
                store = Store(store.folder)  # others may have made room, and written to it
                merged = _merged(store, shard, columns)
                if merged and (len(merged["index"]) == len(store.span(shard)) or state == "held"):
                    store.write_shard(shard, merged)
                return
        if time.monotonic() > end:
            return
        time.sleep(0.01)


def _merged(store: Store, shard: int, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Join new samples of a shard with those that it holds; {} if it holds them. Damaged ones go off the ledger."""
    reader, there = SampleReader(store, patient=False), {}
    try:
        listed = store.valid_in(shard)
    except DamagedShard:
        listed = np.zeros(len(store.span(shard)), bool)
    for row in np.flatnonzero(listed).tolist():
        with contextlib.suppress(OSError, LookupError):
            there[store.span(shard)[row]] = reader.read(store.span(shard)[row])
    if len(there) < listed.sum():
        store.forget_shard(shard)
    new = ~np.isin(columns["index"], [*there])
    if not new.any():
        return {}
    old = {key: [stored.arrays[key] for stored in there.values()] for key in store.keys}
    old |= {"parameters": [stored.parameters for stored in there.values()], "index": [*there]}
    old["seed"] = [store.seed] * len(there)
    return {
        name: np.concatenate([np.array(old[name], column.dtype).reshape(-1, *column.shape[1:]), column[new]])
        for name, column in columns.items()
    }


def _batch(recipe: Renderable, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
    """Render a batch; if that fails, find the sample that does, for the message."""
    try:
        with one_torch_thread():
            return recipe.batch(seed, split, indices)
    except Exception as error:
        for index in indices:
            try:
                recipe.sample(seed, split, index)
            except Exception as cause:
                address = f"sample (seed={seed}, split={split!r}, index={index})"
                raise GenerationError(f"{address} failed: {type(cause).__name__}: {cause}") from error
        raise


def _as_stored(key: str, array: np.ndarray, promised: np.dtype, stored: np.dtype) -> np.ndarray:
    if array.dtype != promised:
        reject(f"sample[{key!r}]", f"{promised}, as in its layout", array.dtype)
    if stored == promised:
        return array
    cast = array.astype(stored)
    if not np.array_equal(cast.astype(promised), array) or (array < 0).any() or (array > 65535).any():
        reject(f"sample[{key!r}]", "whole counts from 0 to 65535, as in its layout", array.ravel()[:6])
    return cast
