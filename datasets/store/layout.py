"""The layout of a store: what its arrays are, found from the recipe."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from specklegen.core.libraries import library_versions
from specklegen.core.memory import require_memory
from specklegen.datasets.recipes.specification import Specification
from specklegen.datasets.sample_schema import ArraySpec, Renderable, stored_arrays
from specklegen.datasets.store import metadata
from specklegen.datasets.store.encoding import group_json, shards_json, table_json
from specklegen.datasets.store.identity import fingerprint

SHARD_BYTES = 32 * 2**20
LEAST_SHARDS = 16


def default_shard_samples(samples: int, sample_bytes: int) -> int:
    """Choose samples a shard: 32 MB uncompressed, and in small sets sixteen shards to share and to resume."""
    return max(1, min(SHARD_BYTES // max(1, sample_bytes), -(-samples // LEAST_SHARDS)))


def stored_type(spec: ArraySpec, dtype: str) -> np.dtype:
    """Return the type in which an array is stored: counts in the one asked for, all else as it is."""
    return np.dtype(dtype if spec.counts else spec.dtype)


def rendering_note(recipe: Renderable) -> str:
    """Sentence about the renderer of samples; empty where a recipe has none."""
    return str(getattr(recipe, "rendering_note", ""))


def whole_recipe(recipe: Renderable, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return all fields of a recipe, for readers of a store: the identity leaves out what equals its default."""
    whole = recipe.physics(context=None) if isinstance(recipe, Specification) else {}
    return {**identity, **json.loads(json.dumps(whole), parse_constant=str)}


def layout_of(
    recipe: Renderable, wanted: Mapping[str, Any], samples: int, shard_samples: int | None, notes: str
) -> metadata.Metadata:
    """Find the metadata of a store of this identity; sample 0 is rendered, for the names of its parameters."""
    arrays = stored_arrays(recipe)
    parameters = recipe.layout().get("parameters")
    names = list(recipe.sample(wanted["seed"], wanted["split"], 0)["parameters"])
    types = {key: stored_type(spec, wanted["dtype"]) for key, spec in arrays.items()}
    size = max((int(np.prod(spec.shape)) * types[key].itemsize for key, spec in arrays.items()), default=1)
    rows = min(shard_samples or default_shard_samples(samples, size), samples)
    metadata.require_bounded("generate.samples", samples, rows)
    each = sum(math.prod(spec.shape) * types[key].itemsize for key, spec in arrays.items())
    require_memory("generate.shard_samples", "held", rows * each, f"{rows} samples of a shard",
                   "Choose smaller shards, or a recipe of fewer pixels.")  # fmt: skip
    attributes = {
        "format": metadata.FORMAT,
        "title": recipe.name,
        "fingerprint": fingerprint(wanted),
        "recipe_fingerprint": recipe.fingerprint(),
        "identity": wanted,
        "recipe": whole_recipe(recipe, wanted["recipe"]),
        "arrays": list(arrays),
        "shard_samples": rows,
        "notes": notes,
        "epoch_samples": recipe.length(wanted["split"]),
        "libraries": library_versions(),
        "rendering": rendering_note(recipe),
    }
    described = _tables(rows, names, parameters.description if parameters else "")
    for key, spec in arrays.items():
        about = {"units": spec.units, "long_name": spec.description, "sample_dtype": spec.dtype}
        described[key] = shards_json(types[key], rows, spec.shape, ("sample", *spec.dims), about)
    files = {f"{name}/zarr.json": described[name] for name in sorted(described)}
    return metadata.Metadata(samples, samples, {"zarr.json": group_json(attributes)} | files)


def _tables(rows: int, names: list[str], about: str) -> dict[str, dict[str, Any]]:
    """Describe the columns that the transport adds: one row a sample (or a shard), one file a shard."""

    def column(dtype: str, description: str) -> dict[str, Any]:
        return table_json(dtype, rows, (), ("sample",), {"units": "1", "long_name": description})

    drawn = {"units": "as described", "long_name": about, "names": names}
    checksum = {"units": "1", "long_name": "SHA-256 of a shard: its data set, its number, its files"}
    return {
        "parameters": table_json("float64", rows, (len(names),), ("sample", "parameter"), drawn),
        "index": column("int64", "index of the sample"),
        "seed": column("int64", "seed of the data set"),
        "seal": column("uint64", "what ties the sample to its data set and its index"),
        "checksum": table_json("uint8", 1, (32,), ("shard", "byte"), checksum),
        "valid": column("bool", "whether the sample is there; one that is not reads as zeros"),
    }
