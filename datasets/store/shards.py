"""Reading samples straight from shard files: what was never written raises, and every read is checked.

zarr returns zeros, without an error, for a sample that is not there, and spends about a millisecond on
each sample of a shard. This module reads the same files by the zarr v3 specification: a shard ends in an
index of (offset, length) pairs, one for each sample, and a CRC32C; each chunk is
[bytes little-endian, blosc (or nothing), crc32c]. tests/datasets/store/test_store.py holds it equal
to zarr's own reader.
"""

import contextlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import google_crc32c
import numpy as np
from numcodecs import Blosc

from specklegen.core.errors import ToldError
from specklegen.core.whole_files import patiently
from specklegen.datasets.store.encoding import ABSENT
from specklegen.datasets.store.places import File, content, is_remote, opened_at_tail

REMEDY = "Repair the store with `specklegen store verify FOLDER --repair RECIPE`"
_OPEN_FILES = 32
_BLOSC = Blosc()


class MissingSample(ToldError, LookupError):
    """A sample that the store does not hold."""


class UnlistedSample(MissingSample):
    """A sample that the ledger does not list: it was not generated yet, or another process is about to do it anew."""


class DamagedShard(ToldError, OSError):
    """Bytes in a shard that differ from what was written."""


class ForeignShard(DamagedShard):
    """A sound shard of another data set, or of another place in this one."""


def _checked(data: bytes, file: Path) -> bytes:
    if len(data) < 4 or google_crc32c.value(data[:-4]) != int.from_bytes(data[-4:], "little"):
        raise DamagedShard(
            f"{file} is damaged: its CRC32C checksum does not match. {REMEDY}"
        )
    return data[:-4]


def read_table(file: Path, dtype: np.dtype, shape: tuple[int, ...], expected: bool = True) -> np.ndarray:
    """Read a chunk that stands in its own file; one that is expected to be there is waited for, if but shortly.

    Raises
    ------
    MissingSample, DamagedShard
        If the file is not there, or its bytes are not those that were written.
    """
    data = content(file, expected=expected)
    if data is None:
        raise MissingSample(f"{file} is missing")
    rows = _checked(data, file)
    if len(rows) != int(np.prod(shape)) * dtype.itemsize:
        raise DamagedShard(f"{file} has a table of the wrong size. {REMEDY}")
    return np.frombuffer(rows, dtype.newbyteorder("<")).reshape(shape)


def _unpacked_length(data: bytes) -> int:
    """Bytes that a chunk of blosc unpacks to, as its header of 16 bytes says; -1 where it is none of this length."""
    unpacked, _, packed = (int.from_bytes(data[place : place + 4], "little") for place in (4, 8, 12))
    return unpacked if len(data) >= 16 and packed == len(data) else -1


@dataclass(eq=False)
class _OpenShard:
    """A shard's file and its index, and how many threads read it now; closed when it is given up and none does."""

    handle: File
    index: np.ndarray
    path: Path
    readers: int = 0
    given_up: bool = False


class ShardFiles:
    """The shard files of one array, read one sample at a time by any number of threads; keeps a few of them open.

    Parameters
    ----------
    folder : Path
        The folder of the array.
    sample_shape, dtype
        Shape and stored type of one sample.
    shard_samples : int
        Samples in a shard.
    compressed : bool
        Whether chunks went through blosc.
    """

    def __init__(
        self, folder: Path, sample_shape: tuple[int, ...], dtype: np.dtype, shard_samples: int, compressed: bool,
    ) -> None:  # fmt: skip
        self._folder, self._shape = folder, sample_shape
        self._dtype, self._shard_samples, self._compressed = (
            dtype.newbyteorder("<"), shard_samples, compressed,
        )  # fmt: skip
        self._bytes = int(np.prod(sample_shape)) * dtype.itemsize
        self._open: OrderedDict[int, _OpenShard] = OrderedDict()
        self._lock = Lock()  # guards those that are open, and their counts

    def file(self, shard: int) -> Path:
        """Return where a shard stands."""
        return self._folder.joinpath("c", str(shard), *["0"] * len(self._shape))

    def read(self, sample: int) -> np.ndarray:
        """Read one sample.

        Raises
        ------
        MissingSample, DamagedShard
            If the sample was never written, or its bytes are not those that were written.
        """
        file = self.file(sample // self._shard_samples)
        try:
            data = _checked(patiently(lambda: self._chunk(sample)), file)
        except DamagedShard:
            if not is_remote(file):
                raise
            self.close()  # where it was replaced since its index was read, the other one's is read now
            data = _checked(patiently(lambda: self._chunk(sample)), file)
        # What it says that it unpacks to: a kilobyte of a stranger's would otherwise be let grow to gigabytes.
        if (_unpacked_length(data) if self._compressed else len(data)) != self._bytes:
            raise ForeignShard(f"{file} has samples of the wrong size. {REMEDY}")
        if self._compressed:
            try:
                data = _BLOSC.decode(data)
            except RuntimeError as error:
                raise DamagedShard(f"{file} cannot be decompressed. {REMEDY}") from error
        return np.frombuffer(data, self._dtype).reshape(self._shape)

    def _chunk(self, sample: int) -> bytes:
        """Bytes of a sample; a file that a server no longer knows, since it was replaced, is given up."""
        shard, place = divmod(sample, self._shard_samples)
        with self._reading(shard) as there:
            offset, length = int(there.index[place, 0]), int(there.index[place, 1])
            if offset == ABSENT:
                raise MissingSample(f"{there.path} does not hold sample {sample}")
            try:
                return there.handle.part(offset, length)
            except OSError:
                with self._lock:
                    self._give_up(self._open.pop(shard, None))
                raise

    @contextlib.contextmanager
    def _reading(self, shard: int) -> Iterator[_OpenShard]:
        """A shard's file, which nobody closes meanwhile."""
        with self._lock:
            there = self._open.get(shard)
            if there is not None:
                self._open.move_to_end(shard)
                there.readers += 1
        if there is None:
            there = self._opened(shard)  # two threads may open it at once: the later one is kept
            with self._lock:
                there.readers += 1
                self._give_up(self._open.pop(shard, None))
                self._open[shard] = there
                if len(self._open) > _OPEN_FILES:
                    self._give_up(self._open.popitem(last=False)[1])
        try:
            yield there
        finally:
            with self._lock:
                there.readers -= 1
                if there.given_up and not there.readers:
                    there.handle.close()

    def _opened(self, shard: int) -> _OpenShard:
        file, length = self.file(shard), 16 * self._shard_samples + 4
        try:
            handle, tail = patiently(lambda: opened_at_tail(file, length))
        except FileNotFoundError:
            raise MissingSample(f"{file} is missing") from None
        try:
            return _OpenShard(handle, np.frombuffer(_checked(tail, file), "<u8").reshape(-1, 2), file)
        except BaseException:
            handle.close()
            raise

    @staticmethod
    def _give_up(there: _OpenShard | None) -> None:
        """Close a file, or leave that to the last of its readers; under the lock."""
        if there is not None:
            there.given_up = True
            if not there.readers:
                there.handle.close()

    def close(self) -> None:
        """Close every file, those that are being read when they have been; the next read opens its own again."""
        with self._lock:
            while self._open:
                self._give_up(self._open.popitem()[1])

    def __getstate__(self) -> dict:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"} | {"_open": OrderedDict()}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state, _lock=Lock())

    def __del__(self) -> None:
        self.close()
