"""The store: one zarr v3 group for one data set, written shard by shard, that cannot lie about itself.

    <folder>/zarr.json             attributes: identity, fingerprint, the whole recipe, shard size
    <folder>/<array>/              one chunk a sample, many samples a shard file
    <folder>/parameters, index, seed    one row a sample, one file a shard
    <folder>/checksum              SHA-256 of a shard's files
    <folder>/valid                 true for the samples that are there; written last, one file a shard

A shard is the unit of work: rendered whole by one process and written whole. Each file appears by renaming,
so that a reader sees all of it or nothing. Nothing is flushed to the disk (no fsync): after a power cut a
file may be torn, which its CRC32C and the checksum tell.
"""

import contextlib
import hashlib
import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from specklegen.core.errors import reject
from specklegen.datasets.store.locks import LockState, claim
from specklegen.datasets.store.shards import MissingSample, ShardFiles, read_table

FORMAT = "specklegen store, version 1"
METADATA = 0
"""The piece of the claims file that stands for the metadata; shard s is piece s + 1."""


class Store:
    """An open store.

    Parameters
    ----------
    folder : path
        The folder of the store.
    writable : bool
        Whether shards will be written.

    Raises
    ------
    RuleError
        If the folder is not a store of this version.
    """

    def __init__(self, folder: str | os.PathLike, writable: bool = False) -> None:
        self.folder = Path(folder).absolute()
        remedy = "Make one with generate."
        if not (self.folder / "zarr.json").is_file():
            reject("store.folder", "a folder that holds a store", str(folder), remedy)
        try:
            with zarr.config.set({"array.write_empty_chunks": True}):
                self._group = zarr.open_group(self.folder, mode="r+" if writable else "r", zarr_format=3)
                self._arrays = dict(self._group.arrays())
            self.attributes: dict[str, Any] = dict(self._group.attrs)
            known = self.attributes.get("format") == FORMAT
            if known:
                self.shard_samples: int = self.attributes["shard_samples"]
                self.parameter_names: list[str] = list(self._arrays["parameters"].attrs["names"])  # type: ignore[arg-type]
                self.keys: list[str] = list(self.attributes["arrays"])
                lost = {*self.keys, "valid", "index", "seed", "checksum"} - self._arrays.keys()
        except (ValueError, KeyError, TypeError) as error:  # damaged JSON, or metadata of something else
            reject("store.folder", "a store whose metadata are whole", str(folder), f"{type(error).__name__}: {error}.")
        if not known:
            reject("store.folder", f"a {FORMAT}", str(folder), remedy)
        if lost:
            reject("store.folder", "a store with all of its arrays", str(folder), f"Lost: {', '.join(sorted(lost))}.")

    @property
    def samples(self) -> int:
        """Number of samples that the store has room for."""
        return self._arrays["valid"].shape[0]

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

    def valid_in(self, shard: int) -> np.ndarray:
        """Read the ledger of one shard, now: bool[samples in the shard]."""
        try:
            return self.table("valid", shard)[: len(self.span(shard))]
        except MissingSample:
            return np.zeros(len(self.span(shard)), bool)

    def is_complete(self, shard: int) -> bool:
        """Read from the ledger, now, whether every sample of a shard is there."""
        return bool(self.valid_in(shard).all())

    def claimed(self, shard: int, wait: bool = False) -> contextlib.AbstractContextManager[LockState]:
        """LockState a shard; see :mod:`specklegen.datasets.store.locks`."""
        return claim(self.folder / "valid" / "claims", shard + 1, wait)

    def files(self, shard: int) -> list[Path]:
        """Return the files that hold a shard's contents, the ledger excepted, in a fixed order."""
        columns = [self._table_file(name, shard) for name in ("parameters", "index", "seed")]
        return [self.shard_files[key].file(shard) for key in self.keys] + columns

    def _table_file(self, name: str, shard: int) -> Path:
        return self.folder.joinpath(name, "c", str(shard), *["0"] * (self._arrays[name].ndim - 1))

    def digest(self, shard: int) -> bytes:
        """Return the SHA-256 of a shard's files as they are now; of a missing file, of its absence."""
        digest = hashlib.sha256()
        for file in self.files(shard):
            data = file.read_bytes() if file.exists() else b"absent"
            digest.update(len(data).to_bytes(8, "little") + data)
        return digest.digest()

    def recorded_digest(self, shard: int) -> bytes:
        """Return the SHA-256 that was written with the shard."""
        return np.asarray(self._arrays["checksum"][shard]).tobytes()

    def write_shard(self, shard: int, columns: Mapping[str, np.ndarray]) -> bytes:
        """Write the columns of a shard, its checksum, last its line in the ledger; return the checksum."""
        place = slice(self.span(shard).start, self.span(shard).stop)
        for name, column in columns.items():
            self._arrays[name][place] = column
        checksum = self.digest(shard)
        self._arrays["checksum"][shard] = np.frombuffer(checksum, np.uint8)
        self._arrays["valid"][place] = True
        return checksum

    def forget_shard(self, shard: int) -> None:
        """Take a shard off the ledger, then delete its files."""
        for file in [
            self._table_file("valid", shard),
            *self.files(shard),
            self._table_file("checksum", shard),
        ]:
            file.unlink(missing_ok=True)

    @cached_property
    def shard_files(self) -> dict[str, ShardFiles]:
        """The checked reader of each array."""
        return {
            key: ShardFiles(
                self.folder / key,
                tuple(self._arrays[key].shape[1:]),
                np.dtype(self._arrays[key].dtype),
                self.shard_samples,
                np.dtype(self._arrays[key].dtype).kind in "ui",
            )
            for key in self.keys
        }

    def sample_types(self) -> dict[str, np.dtype]:
        """Return the type of each array in a sample, whatever it is stored as."""
        return {key: np.dtype(str(self._arrays[key].attrs["sample_dtype"])) for key in self.keys}

    def stored_types(self) -> dict[str, np.dtype]:
        """Return the type in which each array is stored."""
        return {key: np.dtype(self._arrays[key].dtype) for key in self.keys}

    def sample_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each array in a sample."""
        return {key: tuple(self._arrays[key].shape[1:]) for key in self.keys}

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return shape (of a sample), dtype (as stored), dims, units and description of each array."""
        return {
            key: {
                "shape": self.sample_shapes()[key],
                "dtype": str(self._arrays[key].dtype),
                "dims": tuple((self._arrays[key].metadata.dimension_names or ())[1:]),  # type: ignore[union-attr]
                "units": str(self._arrays[key].attrs["units"]),
                "description": str(self._arrays[key].attrs["long_name"]),
            }
            for key in self.keys
        }

    def table(self, name: str, shard: int) -> np.ndarray:
        """Read a column of a shard, checked: "parameters", "index", "seed" or "valid"."""
        array = self._arrays[name]
        shape = (self.shard_samples, *array.shape[1:])
        return read_table(self._table_file(name, shard), np.dtype(array.dtype), shape)

    def sweep(self) -> list[Path]:
        """Delete the temporary files that killed processes left; those of living ones are claimed."""
        swept = []
        for file in sorted(self.folder.rglob("*.partial")):
            parts = file.relative_to(self.folder).parts
            number = parts[2].split(".")[0] if len(parts) > 2 and parts[1] == "c" else ""
            with claim(self.folder / "valid" / "claims", int(number) + 1 if number else METADATA) as claimed:
                if claimed == "held":
                    file.unlink(missing_ok=True)
                    swept.append(file)
        return swept
