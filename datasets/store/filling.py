"""One shard of a store: rendered in batches, checked against its layout, written, and what became of it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from specklegen.core.errors import ToldError, reject
from specklegen.core.parallel import one_torch_thread
from specklegen.datasets.sample_schema import Renderable, require_finite
from specklegen.datasets.store.files import no_room
from specklegen.datasets.store.store import Store

BATCH = 32
"""Samples rendered at once: enough to share work, few enough that memory stays flat."""


class GenerationError(ToldError, RuntimeError):
    """Samples that could not be rendered; all others are in the store."""


@dataclass(frozen=True)
class Outcome:
    """What became of one shard; small enough to send between machines.

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
    with store.claimed(shard, wait) as claimed:
        if claimed == "busy":
            return Outcome(shard, "busy")
        if store.is_complete(shard):
            return Outcome(shard, "present", checksum=store.recorded_digest(shard).hex())
        try:
            checksum = store.write_shard(shard, _render(store, recipe, store.span(shard)))
        except Exception as error:  # a bad sample must not stop the others; it is reported with its address
            message = f"shard {shard}: {type(error).__name__}: {error}"
            transient = (isinstance(error, OSError) or isinstance(error.__cause__, OSError)) and not no_room(error)
            return Outcome(shard, "failed", message=message, transient=transient, final=no_room(error))
    return Outcome(shard, "written", time.perf_counter() - start, checksum.hex())


def _render(store: Store, recipe: Renderable, span: range) -> dict[str, np.ndarray]:
    seed, split = store.attributes["identity"]["seed"], store.attributes["identity"]["split"]
    types, kinds, names = store.stored_types(), store.sample_types(), store.parameter_names
    columns = {key: np.empty((len(span), *shape), types[key]) for key, shape in store.sample_shapes().items()}
    columns["parameters"] = np.empty((len(span), len(names)))
    columns["index"] = np.empty(len(span), np.int64)
    columns["seed"] = np.full(len(span), seed, np.int64)
    for first in range(0, len(span), BATCH):
        indices = span[first : first + BATCH]
        place = slice(first, first + len(indices))
        batch = _batch(recipe, seed, split, indices)
        require_finite(batch, recipe, seed, split)
        for key in store.keys:
            columns[key][place] = _as_stored(key, np.asarray(batch[key]), kinds[key], types[key])
        if list(batch["parameters"]) != names:
            reject(f"{recipe.name}.parameters", f"{names} in every sample", list(batch["parameters"]))
        for place_of_name, name in enumerate(names):
            columns["parameters"][place, place_of_name] = batch["parameters"][name]
        columns["index"][place] = batch["index"]
    if not np.array_equal(columns["index"], np.arange(span.start, span.stop)):
        reject(f"{recipe.name}.batch", "samples in the order of their indices", columns["index"])
    return columns


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
        reject(f"sample[{key!r}]", f"{promised}, as its layout says", array.dtype)
    if stored == promised:
        return array
    cast = array.astype(stored)
    if not np.array_equal(cast.astype(promised), array) or (array < 0).any() or (array > 65535).any():
        reject(f"sample[{key!r}]", "whole counts from 0 to 65535, as its layout says", array.ravel()[:6])
    return cast
