"""The metadata of a store: every ``zarr.json``, and a record of them all that tells when one has changed.

``valid/record.json`` holds what each ``zarr.json`` says, the number of samples, and the SHA-256 of it all. A process
that opens a store compares. zarr looks into no folder of an array, so plain readers do not meet the record.

A store grows in this order: the record says to what length, the arrays follow, the record says that it is done.
So a kill in between leaves arrays of the old or of the new length, and nothing else passes.
"""

import dataclasses
import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from specklegen.core.arguments import whole_number
from specklegen.core.errors import reject
from specklegen.core.whole_files import WAITS
from specklegen.datasets.store.files import json_bytes, reaching
from specklegen.datasets.store.identity import differences, fingerprint
from specklegen.datasets.store.places import content as bytes_of
from specklegen.datasets.store.places import is_remote, put, put_new

FORMAT = "specklegen store, version 2"
COLUMNS = ("parameters", "index", "seed", "seal")
"""Tables with a row a sample, the ledger excepted."""

MOST_SAMPLES, MOST_SHARDS = 10**9, 10**6
"""The ledger of so many samples takes 1 GB, and opening it a file for each of so many shards: a minute."""

_REMEDY = "`specklegen store verify --repair RECIPE` writes it again from the recipe; the samples stay."


@dataclass(frozen=True)
class Metadata:
    """Description of a store.

    Attributes
    ----------
    samples : int
        Samples that it has room for.
    room : int
        Samples that it is being made room for; equal to ``samples`` unless a call is growing it, or died at it.
    files : dict
        What each ``zarr.json`` says, by its path in the store; lengths along the samples are left out.
    faults : tuple of str
        Arrays at an address whose ``zarr.json`` states another length: a process that was stopped for longer than its
        claim lasts wrote it late. The record holds; the next call that opens the store for writing mends it.
    """

    samples: int
    room: int
    files: Mapping[str, Any]
    faults: tuple[str, ...] = ()

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the group: identity, fingerprint, recipe, shard size."""
        return self.files["zarr.json"]["attributes"]

    @property
    def arrays(self) -> list[str]:
        """Names of the arrays, tables included."""
        return [name.removesuffix("/zarr.json") for name in self.files if "/" in name]

    def rows(self, name: str, samples: int) -> int:
        """Length of an array of a store of so many samples."""
        return -(-samples // self.attributes["shard_samples"]) if name == "checksum" else samples

    def said(self, name: str) -> dict[str, Any]:
        """Return what the ``zarr.json`` of an array says, its length included."""
        content = self.files[f"{name}/zarr.json"]
        return content | {"shape": [self.rows(name, self.samples), *content["shape"][1:]]}

    def replace(self, **lengths: int) -> Self:
        """Return the metadata of a store of other lengths."""
        return dataclasses.replace(self, faults=(), **lengths)

    def write(self, folder: Path, new: bool = False) -> None:
        """Write the record; one that is ``new`` leaves a record that is there as it is."""
        content = {"samples": self.samples, "room": self.room, "files": self.files}
        (put_new if new else put)(_record(folder), json_bytes({"sha256": fingerprint(content), "content": content}))

    def write_arrays(self, folder: Path, samples: int) -> None:
        """Write every ``zarr.json`` that does not say what it should for so many samples; the ledger's last."""
        for name in sorted(self.files, key=lambda name: name == "valid/zarr.json"):
            content = self.files[name]
            if "/" in name:
                content = content | {"shape": [self.rows(Path(name).parent.name, samples), *content["shape"][1:]]}
            if bytes_of(folder / name, expected=False) != json_bytes(content):
                put(folder / name, json_bytes(content))


def _record(folder: Path) -> Path:
    return folder / "valid" / "record.json"


def require_bounded(field: str, samples: int, shard_samples: int) -> None:
    """Refuse more samples or shards than anybody can go through: each shard has files of its own."""
    remedy = "Split it into several stores, by seeds."
    whole_number(f"{field} (samples)", samples, 1, MOST_SAMPLES, remedy=remedy)
    whole_number(f"{field} (samples in a shard)", shard_samples, 1, MOST_SAMPLES, remedy=remedy)
    whole_number(f"{field} (shards)", -(-samples // shard_samples), 1, MOST_SHARDS, remedy=remedy)


def is_store(folder: Path) -> bool:
    """Return whether a folder is meant as a store, be it a damaged one."""
    with reaching(folder):
        return any(bytes_of(file, expected=False) is not None for file in (folder / "zarr.json", _record(folder)))


def recorded(folder: Path) -> Metadata | None:
    """Read the record of a store; None if it is not there, or not as it was written."""
    return _parsed(_bytes(_record(folder)))


def _bytes(file: Path) -> bytes:
    """Content of a file that should be there; b"" where it is not."""
    return bytes_of(file) or b""


def _parsed(data: bytes) -> Metadata | None:
    try:
        written = json.loads(data)
        content = written["content"]
        return Metadata(**content) if fingerprint(content) == written["sha256"] else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def read(folder: Path) -> Metadata:
    """Read the metadata of a store, every file compared with the record.

    Raises
    ------
    RuleError
        If the folder is not a store of this version, or its metadata are not those that were written: the file and
        the fields are named, and the remedy.
    """
    reject_strangers(folder)
    waits = iter(WAITS)
    while True:
        data = _bytes(_record(folder))
        there = _parsed(data)
        faults = ["valid/record.json (missing or changed)"]
        if there is not None:
            for samples in (there.samples, there.room):
                require_bounded("store metadata", samples, there.attributes["shard_samples"])
            faults = list(_faults(folder, there))
            if not faults:
                return there
        if not data and is_remote(folder) and is_store(folder) and not _bytes(_record(folder)):
            reject("store.folder", "a store whose creation has ended", str(folder),
                   "A call of generate is creating it, or was killed meanwhile: run generate again.")  # fmt: skip
        if _bytes(_record(folder)) != data:
            continue  # another call is growing it, or, if lengths alone differ, may be
        only_lengths = all("(length" in fault for fault in faults)
        if only_lengths and there is not None and is_remote(folder):
            return Metadata(there.samples, there.room, there.files, tuple(faults))
        wait = next(waits, None) if only_lengths else None
        if wait is None:
            reject("store metadata", f"as written when the store was made, in {folder}", "; ".join(faults), _REMEDY)
        time.sleep(wait)


def lengths_of(folder: Path, there: Metadata) -> dict[str, int]:
    """Lengths of the arrays as their files state them, of those that are there."""
    contents = {name: _json(folder / name / "zarr.json") for name in there.arrays}
    return {name: content["shape"][0] for name, content in contents.items() if content is not None}


def disagreed(folder: Path, there: Metadata) -> int | None:
    """Return the greatest of the lengths that the record of a store and its arrays state; None where all agree."""
    lengths = lengths_of(folder, there)
    if there.room == there.samples and all(lengths[name] == there.rows(name, there.samples) for name in lengths):
        return None
    return max(there.room, *(length for name, length in lengths.items() if name != "checksum"))


def reject_strangers(folder: Path) -> None:
    """Refuse a folder that is not a store, or a store of another version."""
    if is_store(folder) and recorded(folder) is not None:
        return
    content = _json(folder / "zarr.json") if is_store(folder) else None
    if bytes_of(folder / "zarr.json", expected=False) is None:
        reject("store.folder", "a folder that holds a store", str(folder),
               "Check the path, or make a store with `specklegen generate`.")
    attributes = content.get("attributes") if isinstance(content, dict) else {}
    stated = attributes.get("format") if isinstance(attributes, dict) else None
    if content is not None and not str(stated).startswith("specklegen store"):
        reject("store.folder", "a folder that holds a store", str(folder),
               "Check the path, or make a store with `specklegen generate`.")
    if content is not None and stated != FORMAT:
        reject("store.folder", f"a {FORMAT}", f"{folder}, a {stated}",
               "Generate it again in a new folder, from the recipe and the seed in its zarr.json.")  # fmt: skip


def _json(file: Path) -> Any:
    """Content of a file; None where it is missing or no JSON."""
    try:
        return json.loads(_bytes(file))
    except (ValueError, RecursionError):
        return None


def _faults(folder: Path, there: Metadata) -> Iterator[str]:
    """Name the files that do not say what the record says, with the fields that differ."""
    for name, expected in there.files.items():
        content = _json(folder / name)
        if not isinstance(content, dict):
            yield f"{name} ({'missing' if bytes_of(folder / name, expected=False) is None else 'damaged'})"
            continue
        if "/" in name:
            allowed = [there.rows(name.partition("/")[0], n) for n in (there.samples, there.room)]
            shape = content.get("shape")
            length = shape[0] if isinstance(shape, list) and shape else None
            if isinstance(length, bool) or length not in allowed:
                yield f"{name} (length {length!r} instead of {allowed[0]})"
            content = content | {"shape": [None, *shape[1:]]} if isinstance(shape, list) else content
        if _digest(content) != _digest(expected):
            yield f"{name} ({'; '.join(differences(content, expected)) or 'other types of numbers'})"


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def stated(folder: Path) -> tuple[dict[str, Any], int]:
    """Return the attributes and the number of samples of a store whose metadata are damaged.

    They come from the record, or else from the files; the longest array counts, so that no sample is given up.
    """
    known = recorded(folder)
    if known is not None:
        return known.attributes, known.room
    content = _json(folder / "zarr.json")
    try:
        attributes = content["attributes"]
        if fingerprint(attributes["identity"]) != attributes["fingerprint"]:
            raise ValueError
        names = [*attributes["arrays"], *COLUMNS, "valid"]
        lengths = [_json(folder / name / "zarr.json") for name in names]
        samples = max(int(one["shape"][0]) for one in lengths if one is not None)
        if not isinstance(attributes["shard_samples"], int) or attributes["shard_samples"] < 1 or samples < 1:
            raise ValueError
    except (KeyError, TypeError, ValueError, IndexError):
        reject("store metadata", f"readable in valid/record.json, or in every zarr.json of {folder}", "neither",
               "Generate the samples again in a new folder.")  # fmt: skip
    return attributes, samples
