"""Estimated cost of generating a data set, from a few samples rendered and stored now."""

import math
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.core.budgets import MOST_SECONDS, TOLD_SECONDS, require_time
from specklegen.core.errors import counted, reject
from specklegen.core.parallel import thread_count
from specklegen.datasets.sample_schema import Renderable, stored_arrays
from specklegen.datasets.store.creation import open_for
from specklegen.datasets.store.filling import GenerationError, fill_shard
from specklegen.datasets.store.layout import default_shard_samples, stored_type
from specklegen.datasets.store.places import is_remote, place_of
from specklegen.datasets.store.timing import sample_seconds

_PROBE = 32
_SECONDS = 3.0  # for the samples of one of the two shards that are tried
_LITTLE = 2**30  # bytes on a disk that nobody need be told of
_UNITS = ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0), ("s", 1.0)
_COPIES = 2
"""Of the largest array, beside a shard's columns: its encoded chunks, and the file made of them."""


def estimate(
    recipe: Renderable, samples: int, seed: int = 0, split: str = "train", *, dtype: str = "uint16",
    shard_samples: int | None = None, processes: int | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Predict the cost of :func:`specklegen.datasets.store.generate.generate` with the same arguments.

    Up to 64 samples are rendered and stored in a temporary folder, as many as a few seconds allow. A medium that many
    samples share is counted once. Raise a `GenerationError` if the samples cannot be rendered.

    Returns
    -------
    dict
        bytes : length of the shard files; seconds : to render and write, the start of workers left out;
        memory : bytes that a worker holds for a shard, beside what rendering itself takes; shards,
        shard_samples, processes.
    """
    types = {key: (spec, stored_type(spec, dtype)) for key, spec in stored_arrays(recipe).items()}
    raw = [int(np.prod(spec.shape)) * stored.itemsize for spec, stored in types.values()]
    rows = min(shard_samples or default_shard_samples(samples, max(raw, default=1)), samples)
    media, fresh, again = sample_seconds(recipe, seed, split, samples)
    probe = max(1, min(_PROBE, samples, int(_SECONDS / max(fresh, 1e-6))))
    with tempfile.TemporaryDirectory() as folder:
        store = open_for(recipe, seed, split, dtype, Path(folder) / "probe.zarr", 2 * probe, probe).store
        for shard in (0, 1):  # the first pays for imports and compilation
            outcome = fill_shard(store, recipe, shard)
            if outcome.state == "failed":
                raise GenerationError(outcome.message)
        written = max(outcome.seconds / probe - fresh, 0.0)
        stored = sum(file.stat().st_size for file in store.files(1))
        row = 8 * len(store.parameter_names) + 16
    shards = -(-samples // rows)
    workers = min(thread_count(processes), shards)
    return {
        "bytes": round(stored / probe * samples),
        "seconds": (samples * (written + again) + media * (fresh - again)) / workers,
        "memory": rows * (sum(raw) + _COPIES * max(raw, default=0) + row), "shards": shards, "shard_samples": rows,
        "processes": workers,
    }  # fmt: skip


def foreseen(
    recipe: Renderable, samples: int, folder: str | os.PathLike, seed: int = 0, split: str = "train", *,
    processes: int | None = None, anyway: bool = False,
) -> str:  # fmt: skip
    """Say what storing so many more samples in a folder will cost; nothing where that is seconds and little room.

    Raise a `RuleError` if the disk has less room than that, or if it would take more than thirty days, unless
    ``anyway``.
    """
    specs = stored_arrays(recipe).values()
    raw = samples * sum(int(np.prod(spec.shape)) * stored_type(spec, "uint16").itemsize for spec in specs)
    free = _free(place_of(folder))
    media, fresh, again = sample_seconds(recipe, seed, split, samples)
    least = ((samples - media) * again + media * fresh) / thread_count(processes)
    if raw < min(_LITTLE, free) and least < TOLD_SECONDS:
        return ""
    cost = estimate(recipe, samples, seed, split, processes=processes)
    if not anyway:
        remedy = "Ask for fewer samples, or start nevertheless with --anyway."
        if cost["bytes"] > free:
            have, need = (f"{count / 2**30:.2g} GiB" for count in (free, cost["bytes"]))
            reject("generate.samples", f"small enough for the {have} free in {folder}", f"{need} for {samples}",
                   f"Make room. {remedy}")  # fmt: skip
        if cost["seconds"] > MOST_SECONDS:
            require_time("generate.samples", cost["seconds"], counted(samples, "sample"), remedy)
    return (
        f"{counted(samples, 'sample')} to render: about {_in_words(cost['seconds'])} on "
        f"{counted(cost['processes'], 'core')}, {cost['bytes'] / 2**30:.2g} GiB"
    )


def _free(folder: Path) -> float:
    """Bytes that the disk of a folder has left; of an address nobody knows."""
    if is_remote(folder):
        return math.inf
    return shutil.disk_usage(next(place for place in (folder, *folder.parents) if place.is_dir())).free


def _in_words(seconds: float) -> str:
    unit, length = next((unit, length) for unit, length in _UNITS if seconds >= 2 * length or unit == "s")
    return f"{seconds / length:.2g} {unit}" if seconds < 10 * length else f"{seconds / length:.0f} {unit}"
