"""The identity of a data set: all that decides its bytes, as one nested dict with a SHA-256.

Threads, folders, shard sizes, the number of samples and display units are no part of it.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from specklegen.core.arguments import choice, whole_number
from specklegen.core.errors import shown
from specklegen.datasets.sample_schema import Renderable

COUNT_TYPES = ("uint16", "float32")


def identity(recipe: Renderable, seed: int, split: str, dtype: str = "uint16") -> dict[str, Any]:
    """Collect what decides the bytes of a store; JSON types only."""
    seed, dtype = whole_number("generate.seed", seed, 0, 2**63 - 1), choice("generate.dtype", dtype, COUNT_TYPES)
    return {
        "data_version": recipe.data_version,
        "device": device_kind(recipe),
        "dtype": dtype,
        # JSON has no infinity: it is written as a word, so that every reader of a store can read its zarr.json.
        "recipe": json.loads(recipe.canonical_json(), parse_constant=str),
        "seed": seed,
        "split": split,
    }


def device_kind(recipe: Renderable) -> str:
    """Return the kind of device that a recipe renders on, such as "cuda": each kind rounds in its own way."""
    return str(getattr(recipe, "device", "cpu")).partition(":")[0]


def fingerprint(entries: Mapping[str, Any]) -> str:
    """Return the SHA-256 of an identity's canonical JSON, in hexadecimal."""
    return hashlib.sha256(json.dumps(entries, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _leaves(value: Any, path: str = "") -> dict[str, Any]:
    if isinstance(value, Mapping) and value:
        pairs = [(f"{path}.{key}" if path else str(key), item) for key, item in value.items()]
    elif isinstance(value, list) and any(isinstance(item, list | Mapping) for item in value):
        pairs = [(f"{path}[{place}]", item) for place, item in enumerate(value)]
    else:
        return {path: value}
    return {name: leaf for key, item in pairs for name, leaf in _leaves(item, key).items()}


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Name the fields in which two identities differ, with both values, one short line each.

    Of two data versions only the version is named: fields that equal their defaults may stand in one of them alone.
    """
    if there.get("data_version") != here.get("data_version"):
        there, here = ({"data_version": each.get("data_version")} for each in (there, here))
    old, new = _leaves(there), _leaves(here)
    absent = object()

    def word(value: object) -> str:
        return "absent" if value is absent else shown(value)

    pairs = {name: (old.get(name, absent), new.get(name, absent)) for name in sorted(old | new)}
    return [f"{name} ({word(a)} there, {word(b)} here)" for name, (a, b) in pairs.items() if a != b]
