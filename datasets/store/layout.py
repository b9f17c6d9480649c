"""The layout of a store: what its arrays are, found from the recipe, and an empty store of it on the disk."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from specklegen.core.libraries import library_versions
from specklegen.core.memory import require_memory
from specklegen.datasets.recipes.specification import Specification
from specklegen.datasets.sample_schema import ArraySpec, Renderable, stored_arrays
from specklegen.datasets.store import file_names, metadata
from specklegen.datasets.store.identity import fingerprint

SHARD_BYTES = 32 * 2**20
LEAST_SHARDS = 16


def default_shard_samples(samples: int, sample_bytes: int) -> int:
    """Choose samples a shard: 32 MB uncompressed, and in small sets sixteen shards to share and to resume."""
    return max(1, min(SHARD_BYTES // max(1, sample_bytes), -(-samples // LEAST_SHARDS)))


def stored_type(spec: ArraySpec, dtype: str) -> np.dtype:
    """Return the type in which an array is stored: counts in the one asked for, all else as it is."""
    return np.dtype(dtype if spec.counts else spec.dtype)


def _codecs(dtype: np.dtype) -> list:
    shuffled = BloscCodec(cname="zstd", clevel=5, shuffle="bitshuffle", typesize=dtype.itemsize)
    return [*([shuffled] if dtype.kind in "ui" else []), Crc32cCodec()]


@dataclass(frozen=True)
class Layout:
    """Everything that an empty store says.

    Attributes
    ----------
    samples : int
        Samples that there is room for.
    attributes : dict
        Attributes of the group.
    arrays, types : dict
        Description and stored type of each array.
    tables : dict
        What each column of the transport is made with.
    file_names : tuple of str
        Of objects from files of a user's: their names by number.
    """

    samples: int
    attributes: Mapping[str, Any]
    arrays: Mapping[str, ArraySpec]
    types: Mapping[str, np.dtype]
    tables: Mapping[str, dict[str, Any]]
    file_names: tuple[str, ...] = ()


def rendering_note(recipe: Renderable) -> str:
    """What renders the samples, in a sentence; nothing where a recipe does not say."""
    return str(getattr(recipe, "rendering_note", ""))


def whole_recipe(recipe: Renderable, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return all fields of a recipe, for readers of a store: the identity leaves out what equals its default."""
    whole = recipe.physics(context=None) if isinstance(recipe, Specification) else {}
    return {**identity, **json.loads(json.dumps(whole), parse_constant=str)}


def layout_of(
    recipe: Renderable, wanted: Mapping[str, Any], samples: int, shard_samples: int | None, notes: str
) -> Layout:
    """Find the layout of a store of this identity; sample 0 is rendered, for the names of its parameters."""
    arrays = stored_arrays(recipe)
    parameters = recipe.layout().get("parameters")
    names = list(recipe.sample(wanted["seed"], wanted["split"], 0)["parameters"])
    types = {key: stored_type(spec, wanted["dtype"]) for key, spec in arrays.items()}
    size = max((int(np.prod(spec.shape)) * types[key].itemsize for key, spec in arrays.items()), default=1)
    rows = min(shard_samples or default_shard_samples(samples, size), samples)
    metadata.require_bounded("generate.samples", samples, rows)
    each = sum(math.prod(spec.shape) * types[key].itemsize for key, spec in arrays.items())
    require_memory(
        "generate.shard_samples", "held", rows * each, f"{rows} samples of a shard",
        "Choose smaller shards, or a recipe of fewer pixels.",
    )  # fmt: skip
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
    tables = _tables(samples, rows, names, parameters.description if parameters else "")
    files = tuple(getattr(recipe, "file_names", ()))
    return Layout(samples, attributes, arrays, types, tables, files)


def write_empty(folder: Path, layout: Layout) -> metadata.Metadata:
    """Write an empty store into a folder that is there; return its metadata."""
    samples, rows = layout.samples, layout.attributes["shard_samples"]
    group = zarr.create_group(store=folder, zarr_format=3, attributes=dict(layout.attributes))
    for key, spec in layout.arrays.items():
        group.create_array(
            key,
            shape=(samples, *spec.shape),
            chunks=(1, *spec.shape),
            shards=(rows, *spec.shape),
            dtype=layout.types[key],
            compressors=_codecs(layout.types[key]),
            filters=None,
            fill_value=0,
            dimension_names=("sample", *spec.dims),
            attributes={"units": spec.units, "long_name": spec.description, "sample_dtype": spec.dtype},
        )
    for name, table in layout.tables.items():
        group.create_array(name, **table, compressors=[Crc32cCodec()], filters=None, fill_value=0)
    record = metadata.record_of(folder, samples)
    record.write_arrays(folder, samples)  # as this program writes them, whatever the version of zarr
    record.write(folder)
    file_names.write(folder, layout.file_names)
    return record


def _tables(samples: int, rows: int, names: list[str], about: str) -> dict[str, dict[str, Any]]:
    """Describe the columns that the transport adds: one row a sample (or a shard), one file a shard."""
    each = {"shape": (samples,), "chunks": (rows,), "dimension_names": ("sample",)}

    def told(description: str, units: str = "1", **more: Any) -> dict[str, Any]:
        return {"attributes": {"units": units, "long_name": description} | more}

    return {
        "parameters": {
            "dtype": "float64",
            "shape": (samples, len(names)),
            "chunks": (rows, max(1, len(names))),
            "dimension_names": ("sample", "parameter"),
        }
        | told(about, units="as described", names=names),
        "index": each | {"dtype": "int64"} | told("index of the sample"),
        "seed": each | {"dtype": "int64"} | told("seed of the data set"),
        "seal": each | {"dtype": "uint64"} | told("what ties the sample to its data set and its index"),
        "checksum": {
            "dtype": "uint8",
            "shape": (-(-samples // rows), 32),
            "chunks": (1, 32),
            "dimension_names": ("shard", "byte"),
        }
        | told("SHA-256 of a shard: its data set, its number, its files"),
        "valid": each
        | {"dtype": "bool"}
        | told("whether the sample is there; one that is not reads as zeros"),
    }
