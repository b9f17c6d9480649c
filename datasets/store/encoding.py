"""Writing what :mod:`specklegen.datasets.store.shards` reads: the bytes of a shard and of a table, and their zarr.json.

All of it follows the zarr v3 specification and asks nothing of zarr itself, whose settings belong to the program
around: another codec pipeline, or one that leaves out chunks of zeros, would write stores that the checked reader
refuses.
tests/datasets/store/test_store.py reads the stores with zarr.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import google_crc32c
import numpy as np
from numcodecs import Blosc, blosc

ABSENT = 2**64 - 1
"""Offset and length of a sample that a shard does not hold."""

_BLOSC = Blosc(cname="zstd", clevel=5, shuffle=Blosc.BITSHUFFLE)
_CRC = {"name": "crc32c"}


def is_compressed(dtype: np.dtype) -> bool:
    """Say yes for whole numbers, which are packed: floats would gain little."""
    return dtype.kind in "ui"


def shard_bytes(samples: Mapping[int, bytes], shard_samples: int) -> bytes:
    """Join packed samples, by their rows in the shard, and the index that says where each one lies."""
    index = np.full((shard_samples, 2), ABSENT, "<u8")
    end = 0
    for row in sorted(samples):
        index[row] = end, len(samples[row])
        end += len(samples[row])
    return b"".join(samples[row] for row in sorted(samples)) + _checked(index.tobytes())


def sample_bytes(sample: np.ndarray, dtype: np.dtype) -> bytes:
    """Pack a sample of a shard, with its CRC32C."""
    data = np.ascontiguousarray(sample, dtype.newbyteorder("<"))
    blosc.use_threads = False  # as zarr does; else BLOSC_CLEVEL and the like of the environment change the bytes
    return _checked(_BLOSC.encode(data) if is_compressed(dtype) else data.tobytes())


def table_bytes(rows: np.ndarray) -> bytes:
    """Pack the rows of a table that belong to a shard, with their CRC32C."""
    return _checked(np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).tobytes())


def _checked(data: bytes) -> bytes:
    return data + int(google_crc32c.value(data)).to_bytes(4, "little")


def group_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the group of a store to readers of zarr."""
    return {"attributes": dict(attributes), "zarr_format": 3, "node_type": "group"}


def table_json(
    dtype: str, rows: int, shape: Sequence[int], dims: Sequence[str], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe a table, of so many rows a file, each of a shape; its length is left open."""
    return _array_json(np.dtype(dtype), rows, shape, [_numbers(np.dtype(dtype)), _CRC], dims, attributes)


def shards_json(
    dtype: np.dtype, rows: int, shape: Sequence[int], dims: Sequence[str], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe an array of so many samples a shard, each of a shape; its length is left open."""
    packing = {"typesize": dtype.itemsize, "cname": "zstd", "clevel": 5, "shuffle": "bitshuffle", "blocksize": 0}
    blosc = [{"name": "blosc", "configuration": packing}] if is_compressed(dtype) else []
    sharding = {
        "chunk_shape": [1, *shape], "codecs": [_numbers(dtype), *blosc, _CRC],
        "index_codecs": [_numbers(np.dtype(np.uint64)), _CRC], "index_location": "end",
    }  # fmt: skip
    codecs = [{"name": "sharding_indexed", "configuration": sharding}]
    return _array_json(dtype, rows, shape, codecs, dims, attributes)


def _array_json(
    dtype: np.dtype, rows: int, shape: Sequence[int], codecs: list[Any], dims: Sequence[str],
    attributes: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    return {
        "shape": [None, *shape],
        "data_type": dtype.name,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [rows, *(max(1, n) for n in shape)]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": [0.0, 0.0] if dtype.kind == "c" else np.zeros((), dtype).item(),
        "codecs": codecs,
        "attributes": dict(attributes),
        "dimension_names": [*dims],
        "zarr_format": 3,
        "node_type": "array",
        "storage_transformers": [],
    }


def _numbers(dtype: np.dtype) -> dict[str, Any]:
    """Codec of numbers: little-endian, where they have several bytes."""
    return {"name": "bytes"} | ({"configuration": {"endian": "little"}} if dtype.itemsize > 1 else {})
