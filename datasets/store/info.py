"""What a store says about itself, without its recipe."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.datasets.store.store import Store


def info(folder: str | os.PathLike) -> dict[str, Any]:
    """Describe a store from the store alone.

    Returns
    -------
    dict
        title, split, seed, data_version, device, fingerprint, done and total (samples), shards_done, shards,
        shard_samples, bytes (on the disk, as file lengths), parameters (names), arrays (key: shape, dtype as
        stored, dims, units, description), recipe.
    """
    store = Store(folder)
    valid = store.valid()
    identity = store.attributes["identity"]
    return {
        "title": store.attributes["title"],
        **{key: identity[key] for key in ("split", "seed", "data_version", "device")},
        "fingerprint": store.attributes["fingerprint"],
        "done": int(np.count_nonzero(valid)),
        "total": store.samples,
        "shards_done": sum(
            bool(valid[s.start : s.stop].all()) for s in map(store.span, range(store.shard_count))
        ),
        "shards": store.shard_count,
        "shard_samples": store.shard_samples,
        "epoch_samples": store.attributes["epoch_samples"],
        "bytes": stored_bytes(store.folder),
        "parameters": store.parameter_names,
        "arrays": store.describe(),
        "libraries": store.attributes.get("libraries", {}),
        "recipe": store.attributes["recipe"],
    }


def stored_bytes(folder: Path) -> int:
    """Sum the lengths of the files of a store; files that vanish meanwhile count nothing."""
    total = 0
    for file in folder.rglob("*"):
        try:
            total += file.stat().st_size if file.is_file() else 0
        except FileNotFoundError:
            continue
    return total
