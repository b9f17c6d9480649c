"""The store: one zarr v3 group for one data set, written shard by shard, that cannot lie about itself.

    <folder>/zarr.json             attributes: identity, fingerprint, the whole recipe, shard size
    <folder>/<array>/              one chunk a sample, many samples a shard file
    <folder>/parameters, index, seed    one row a sample, one file a shard
    <folder>/seal                  ties a sample to its data set and its number, see :mod:`seals`
    <folder>/checksum              SHA-256 of a shard's files, and of which shard it is
    <folder>/valid                 true for the samples that are there; written last, one file a shard
    <folder>/valid/record.json     what every zarr.json says, see :mod:`metadata`
    <folder>/valid/names.json      of objects from files of a user's: their names by number, see :mod:`file_names`
    <folder>/valid/locks           empty; its bytes are locked by those who write, see :mod:`locks`

A shard is the unit of work: rendered whole by one process and written whole. Each file appears by renaming,
so that a reader sees all of it or nothing. Nothing is flushed to the disk (no fsync): after a power cut a
file may be torn, which its CRC32C and the checksum tell. At an address each file is put, whole, in the same
order; claims are objects under ``valid/claims``.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.datasets.store import file_names, metadata
from specklegen.datasets.store.encoding import is_compressed, sample_bytes, shard_bytes, table_bytes
from specklegen.datasets.store.files import reaching
from specklegen.datasets.store.locks import LockState, claim, claim_object
from specklegen.datasets.store.places import content, delete, is_remote, place_of, put
from specklegen.datasets.store.seals import seal, shard_digest
from specklegen.datasets.store.shards import ForeignShard, MissingSample, ShardFiles, read_table

METADATA = 0
"""The byte of the file of locks that stands for the metadata; shard s is byte s + 1."""


def claim_metadata(folder: Path) -> contextlib.AbstractContextManager[LockState]:
    """Claim the metadata of a store, or of a place where one is about to begin, and wait."""
    if is_remote(folder):
        return claim_object(folder / "valid" / "claims" / "metadata", wait=True)
    return claim(folder / "valid" / "locks", METADATA, wait=True)


class Store:
    """An open store.

    Parameters
    ----------
    folder : path
        The folder of the store, or an address that fsspec knows.

    Raises
    ------
    RuleError
        If the folder is not a store of this version, or its metadata are not those that were written.
    """

    def __init__(self, folder: str | os.PathLike) -> None:
        self.folder = place_of(folder)
        with reaching(self.folder):
            self.metadata = metadata.read(self.folder)
        self.attributes: dict[str, Any] = self.metadata.attributes
        self.shard_samples: int = self.attributes["shard_samples"]
        self.parameter_names: list[str] = list(self.metadata.said("parameters")["attributes"]["names"])
        self.keys: list[str] = list(self.attributes["arrays"])
        self.fingerprint: str = self.attributes["fingerprint"]
        self.seed: int = self.attributes["identity"]["seed"]

    def require(self, fingerprint: str) -> None:
        """Refuse a data set other than that of a fingerprint: a path may lead elsewhere by now, as a moved link does.

        Raises
        ------
        ForeignShard
            Naming both.
        """
        if fingerprint != self.fingerprint:
            raise ForeignShard(
                f"{self.folder} was replaced since it was opened: it holds data set {self.fingerprint[:12]}, not "
                f"{fingerprint[:12]}. Open it again"
            )

    @property
    def samples(self) -> int:
        """Number of samples that the store has room for."""
        return self.metadata.samples

    @cached_property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files that objects are from, as they were when the store was begun; () where none are known."""
        return file_names.read(self.folder) if "file" in self.parameter_names else ()  # a missing file is waited for

    @property
    def shard_count(self) -> int:
        """Number of shards."""
        return -(-self.samples // self.shard_samples)

    def span(self, shard: int) -> range:
        """Return the samples of a shard."""
        return range(shard * self.shard_samples, min((shard + 1) * self.shard_samples, self.samples))

    def valid(self) -> np.ndarray:
        """Read the ledger, now: bool[samples]."""
        return np.concatenate([self.valid_in(shard) for shard in range(self.shard_count)])

    def valid_in(self, shard: int, expected: bool = False) -> np.ndarray:
        """Read the ledger of one shard, now, waiting shortly if it is expected: bool[samples in the shard]."""
        try:
            return self.table("valid", shard, expected)[: len(self.span(shard))]
        except MissingSample:
            return np.zeros(len(self.span(shard)), bool)

    def is_complete(self, shard: int) -> bool:
        """Read from the ledger, now, whether every sample of a shard is there."""
        return bool(self.valid_in(shard).all())

    def claimed(self, shard: int, wait: bool = False) -> contextlib.AbstractContextManager[LockState]:
        """Claim a shard; see :mod:`specklegen.datasets.store.locks`."""
        if is_remote(self.folder):
            return claim_object(self.folder / "valid" / "claims" / str(shard), wait)
        return claim(self.locks, shard + 1, wait)

    def claimed_metadata(self) -> contextlib.AbstractContextManager[object]:
        """Claim the metadata, and wait."""
        return claim_metadata(self.folder)

    @property
    def locks(self) -> Path:
        """The file whose bytes are claims, in a folder."""
        return self.folder / "valid" / "locks"

    def files(self, shard: int) -> list[Path]:
        """Return the files that hold a shard's contents, the ledger excepted, in a fixed order."""
        return [self._file(name, shard) for name in [*self.keys, *metadata.COLUMNS]]

    def _file(self, name: str, shard: int) -> Path:
        return self.folder.joinpath(name, "c", str(shard), *["0"] * len(self._shape(name)))

    def _shape(self, name: str) -> tuple[int, ...]:
        """Shape of a sample, or of a row of a table."""
        return tuple(self.metadata.said(name)["shape"][1:])

    def _dtype(self, name: str) -> np.dtype:
        return np.dtype(self.metadata.said(name)["data_type"])

    def digest(self, shard: int) -> bytes:
        """Return the SHA-256 of a shard as it is now: its data set, its number, its files."""
        contents = (content(file) or b"absent" for file in self.files(shard))
        return shard_digest(self.fingerprint, self.seed, shard, self.shard_samples, contents)

    def recorded_digest(self, shard: int) -> bytes:
        """Return the SHA-256 that was written with the shard.

        Raises
        ------
        MissingSample, DamagedShard
            If there is none, or it is not as it was written.
        """
        return read_table(self._file("checksum", shard), np.dtype(np.uint8), (32,)).tobytes()

    def seal(self, index: int, seed: int, parameters: np.ndarray, arrays: Mapping[str, np.ndarray]) -> np.uint64:
        """Return the seal of a sample of this store, of its arrays as they are stored."""
        return seal(self.fingerprint, index, seed, parameters, (arrays[key] for key in self.keys))

    def write_shard(self, shard: int, columns: Mapping[str, np.ndarray]) -> bytes:
        """Write columns of some samples of a shard, its checksum, last its line in the ledger; return the checksum."""
        contents = self._packed(columns, columns["index"] - shard * self.shard_samples)
        checksum = shard_digest(self.fingerprint, self.seed, shard, self.shard_samples, contents.values())
        valid = np.zeros(self.shard_samples, bool)
        valid[columns["index"] - shard * self.shard_samples] = True
        contents["checksum"] = table_bytes(np.frombuffer(checksum, np.uint8))
        contents["valid"] = table_bytes(valid)
        for name, data in contents.items():
            put(self._file(name, shard), data, sweeping=False)
        return checksum

    def _packed(self, columns: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, bytes]:
        """Bytes of the files of a shard, the ledger excepted, by name."""
        contents = {}
        for key in self.keys:
            packed = (sample_bytes(sample, self._dtype(key)) for sample in columns[key])
            contents[key] = shard_bytes(dict(zip(rows.tolist(), packed, strict=True)), self.shard_samples)
        seals = [
            self.seal(int(index), self.seed, columns["parameters"][row], {key: columns[key][row] for key in self.keys})
            for row, index in enumerate(columns["index"])
        ]
        for name in metadata.COLUMNS:
            table = np.zeros((self.shard_samples, *self._shape(name)), self._dtype(name))
            table[rows] = seals if name == "seal" else columns[name]
            contents[name] = table_bytes(table)
        return contents

    def forget_shard(self, shard: int) -> None:
        """Take a shard off the ledger; its files stay, to be replaced: another process may be writing them now."""
        delete(self._file("valid", shard))

    @cached_property
    def shard_files(self) -> dict[str, ShardFiles]:
        """The checked reader of each array."""
        return {
            key: ShardFiles(
                self.folder / key, self._shape(key), self._dtype(key), self.shard_samples,
                is_compressed(self._dtype(key)),
            )
            for key in self.keys
        }  # fmt: skip

    def sample_types(self) -> dict[str, np.dtype]:
        """Return the type of each array in a sample, whatever it is stored as."""
        return {key: np.dtype(str(self.metadata.said(key)["attributes"]["sample_dtype"])) for key in self.keys}

    def stored_types(self) -> dict[str, np.dtype]:
        """Return the type in which each array is stored."""
        return {key: self._dtype(key) for key in self.keys}

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return shape (of a sample), dtype (as stored), dims, units and description of each array."""
        described = {key: self.metadata.said(key) for key in self.keys}
        return {
            key: {
                "shape": self._shape(key),
                "dtype": content["data_type"],
                "dims": tuple(content["dimension_names"][1:]),
                "units": content["attributes"]["units"],
                "description": content["attributes"]["long_name"],
            }
            for key, content in described.items()
        }

    def table(self, name: str, shard: int, expected: bool = True) -> np.ndarray:
        """Read a column of a shard, checked: "parameters", "index", "seed", "seal" or "valid"."""
        shape = (self.shard_samples, *self._shape(name))
        return read_table(self._file(name, shard), self._dtype(name), shape, expected)

    def temporaries(self) -> Iterator[Path]:
        """Find files that are not yet whole, of the living and of the dead; others belong to the user."""
        if is_remote(self.folder):
            return
        for name in ["", *self.metadata.arrays]:
            for file in (self.folder / name).glob("*.partial"):
                if file.name.split(".")[0] in ("zarr", "record", "names"):
                    yield file
        for name in self.metadata.arrays:
            for file in (self.folder / name / "c").rglob("*.partial"):
                if file.relative_to(self.folder / name / "c").parts[0].split(".")[0].isdigit():
                    yield file
