"""The file of a model: numbers and a few words, nothing that runs, and a SHA-256 over all of it.

The layout is that of safetensors (https://github.com/huggingface/safetensors): eight bytes, little-endian, with the
length of a JSON header; the header, which names type, shape and place of each tensor; then their bytes. Metadata in the
header hold what the model is, and the SHA-256 of the file in which those 64 digits stand as zeros. A file is written
beside its place and moved into it, so that a stopped program leaves the old one or the new one.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.errors import RuleError, reject
from specklegen.core.file_limits import LARGEST_HEADER, LARGEST_MODEL
from specklegen.core.whole_files import write_whole

_KINDS = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2"), "I8": np.dtype("i1"), "I64": np.dtype("<i8")}
_DIGEST = re.compile(rb'"sha256":"([0-9a-f]{64})"')
_ZEROS = b"0" * 64


def write_model(path: Path, stated: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Write a model.

    Parameters
    ----------
    path
        Of the file.
    stated
        What the model is; JSON types.
    tensors
        float32, float16, int8 or int64.
    """
    arrays = {name: tensor.detach().cpu().contiguous().numpy() for name, tensor in tensors.items()}
    table: dict[str, Any] = {"__metadata__": {"model": json.dumps(stated, sort_keys=True), "sha256": "0" * 64}}
    place = 0
    for name, array in arrays.items():
        kind = next(kind for kind, dtype in _KINDS.items() if dtype == array.dtype)
        table[name] = {"dtype": kind, "shape": list(array.shape), "data_offsets": [place, place + array.nbytes]}
        place += array.nbytes
    header = json.dumps(table, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    content = len(header).to_bytes(8, "little") + header + b"".join(array.tobytes() for array in arrays.values())
    digest = hashlib.sha256(content).hexdigest().encode()
    content = content.replace(b'"sha256":"' + _ZEROS, b'"sha256":"' + digest, 1)
    write_whole(path, content)


def read_model(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Read the file of :func:`write_model`: the model's description, and its tensors.

    Raise a `RuleError` if there is no such file, it is something else, or one of its bits is not as it was written.
    """
    if not path.is_file():
        reject("model", "an existing file", str(path), "Check the path.")
    size = path.stat().st_size
    if size > LARGEST_MODEL:
        reject("model", f"a file of at most {LARGEST_MODEL // 2**20} MiB", str(path))
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    digest = _DIGEST.search(content, 8, 8 + min(length, LARGEST_HEADER))
    if size < 8 or length > min(LARGEST_HEADER, size - 8) or digest is None:
        reject("model", "a file written by Reconstructor.save", str(path))
    blank = content[: digest.start(1)] + _ZEROS + content[digest.end(1) :]
    if hashlib.sha256(blank).hexdigest().encode() != digest[1]:
        reject("model", "as it was written", str(path), "Its SHA-256 does not match: the file is damaged.")
    try:
        table = json.loads(content[8 : 8 + length])
        stated = json.loads(table.pop("__metadata__")["model"])
        return stated, {name: _tensor(entry, content[8 + length :]) for name, entry in table.items()}
    except RuleError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        reject("model", "a file written by Reconstructor.save", str(path))


def _tensor(entry: Mapping[str, Any], data: bytes) -> Tensor:
    dtype, shape, (start, stop) = _KINDS[entry["dtype"]], tuple(entry["shape"]), entry["data_offsets"]
    if not 0 <= start <= stop <= len(data) or prod(shape) * dtype.itemsize != stop - start:
        raise ValueError("a tensor outside the file")
    return torch.from_numpy(np.frombuffer(data[start:stop], dtype).reshape(shape).copy())


_SCALE = ":scale"
"""Ends the name of the scales that belong to a rounded weight."""


def rounded(key: str, weight: Tensor) -> dict[str, Tensor]:
    """A weight as int8 rows and their scales; what has no rows as float16."""
    if weight.ndim < 2:
        return {key: weight.half()}
    scale = weight.flatten(1).abs().amax(1).clamp_min(torch.finfo(weight.dtype).tiny) / 127
    rows = (weight / scale.reshape(-1, *[1] * (weight.ndim - 1))).round().to(torch.int8)
    return {key: rows, key + _SCALE: scale}


def restored(kept: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights float32 of the tensors of a file, rounded or not.

    Raise a `RuleError` if rows and scales do not belong together, or a weight is not finite.
    """
    weights = {key: _restored(key, kept) for key in kept if not key.endswith(_SCALE)}
    for key, weight in weights.items():
        if not weight.isfinite().all():
            reject("model", "a file of finite weights", key,
                   "Its training diverged, or another program wrote it. Train again, or use another file.")
    return weights


def _restored(key: str, kept: Mapping[str, Tensor]) -> Tensor:
    if key + _SCALE not in kept:
        return kept[key].float()
    rows, scale = kept[key], kept[key + _SCALE]
    if len(scale) != len(rows):
        reject("model", "a file with a scale for each row", key)
    return rows * scale.reshape(-1, *[1] * (rows.ndim - 1))
