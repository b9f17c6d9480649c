"""Description of a store by itself, without its recipe."""

import os
from typing import Any

import numpy as np

from specklegen.datasets.store.places import length, stored_bytes
from specklegen.datasets.store.store import Store


def info(folder: str | os.PathLike, shards: range | None = None) -> dict[str, Any]:
    """Describe a store from the store alone; all of it, or some of its shards without a look at the others.

    Parameters
    ----------
    folder
        The folder of the store, or its address.
    shards
        Of which to count samples, shards and bytes; by default of all.

    Returns
    -------
    dict
        title, split, seed, data_version, device, fingerprint, done and total (samples), shards_done, shards,
        shard_samples, bytes (on the disk, as file lengths), parameters (names), arrays (key: shape, dtype as
        stored, dims, units, description), recipe.
    """
    store = Store(folder)
    counted = range(store.shard_count) if shards is None else shards
    there = [store.valid_in(shard) for shard in counted]
    identity = store.attributes["identity"]
    return {
        "title": store.attributes["title"],
        **{key: identity[key] for key in ("split", "seed", "data_version", "device")},
        "fingerprint": store.attributes["fingerprint"],
        "done": sum(int(np.count_nonzero(valid)) for valid in there),
        "total": sum(map(len, there)),
        "shards_done": sum(bool(valid.all()) for valid in there),
        "shards": len(counted),
        "shard_samples": store.shard_samples,
        "epoch_samples": store.attributes["epoch_samples"],
        "bytes": stored_bytes(store.folder) if shards is None else sum(
            length(file) for shard in shards for file in store.files(shard)
        ),
        "parameters": store.parameter_names,
        "arrays": store.describe(),
        "libraries": store.attributes.get("libraries", {}),
        "recipe": store.attributes["recipe"],
    }
