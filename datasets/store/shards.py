"""Reading samples straight from shard files: what was never written raises, and every read is checked.

zarr returns zeros, without an error, for a sample that is not there, and spends about a millisecond on
each sample of a shard. This module reads the same files by the zarr v3 specification: a shard ends in an
index of (offset, length) pairs, one for each sample, and a CRC32C; each chunk is
[bytes little-endian, blosc (or nothing), crc32c]. tests/test_store.py holds it equal to zarr's own reader.
"""

from collections import OrderedDict
from pathlib import Path

import google_crc32c
import numpy as np
from numcodecs import Blosc

from specklegen.core.errors import ToldError
from specklegen.datasets.store.places import File, opened

_ABSENT = 2**64 - 1
_OPEN_FILES = 32
_BLOSC = Blosc()


class MissingSample(ToldError, LookupError):
    """A sample that the store does not hold."""


class DamagedShard(ToldError, OSError):
    """Bytes in a shard that differ from what was written."""


class ForeignShard(DamagedShard):
    """A sound shard of another data set, or of another place in this one."""


def _checked(data: bytes, file: Path) -> bytes:
    if len(data) < 4 or google_crc32c.value(data[:-4]) != int.from_bytes(data[-4:], "little"):
        raise DamagedShard(
            f"{file} is damaged: its CRC32C does not match; mend the store with verify --repair"
        )
    return data[:-4]


def read_table(file: Path, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    """Read a chunk that stands in its own file.

    Raises
    ------
    MissingSample, DamagedShard
        If the file is not there, or its bytes are not those that were written.
    """
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise MissingSample(f"{file} is not there") from None
    content = _checked(data, file)
    if len(content) != int(np.prod(shape)) * dtype.itemsize:
        raise DamagedShard(f"{file} holds a table of another size; mend the store with verify --repair")
    return np.frombuffer(content, dtype.newbyteorder("<")).reshape(shape)


class ShardFiles:
    """The shard files of one array, read one sample at a time; keeps a few of them open.

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
        self,
        folder: Path,
        sample_shape: tuple[int, ...],
        dtype: np.dtype,
        shard_samples: int,
        compressed: bool,
    ) -> None:
        self._folder, self._shape = folder, sample_shape
        self._dtype, self._shard_samples, self._compressed = (
            dtype.newbyteorder("<"),
            shard_samples,
            compressed,
        )
        self._bytes = int(np.prod(sample_shape)) * dtype.itemsize
        self._open: OrderedDict[int, tuple[File, np.ndarray, Path]] = OrderedDict()

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
        shard, place = divmod(sample, self._shard_samples)
        handle, index, file = self._shard(shard)
        offset, length = int(index[place, 0]), int(index[place, 1])
        if offset == _ABSENT:
            raise MissingSample(f"{file} does not hold sample {sample}")
        data = _checked(handle.part(offset, length), file)
        if self._compressed:
            data = _BLOSC.decode(data)
        if len(data) != self._bytes:
            raise ForeignShard(f"{file} holds samples of another size; mend the store with verify --repair")
        return np.frombuffer(data, self._dtype).reshape(self._shape)

    def _shard(self, shard: int) -> tuple[File, np.ndarray, Path]:
        if shard in self._open:
            self._open.move_to_end(shard)
            return self._open[shard]
        file, length = self.file(shard), 16 * self._shard_samples + 4
        try:
            handle = opened(file)
        except FileNotFoundError:
            raise MissingSample(f"{file} is not there") from None
        try:
            tail = handle.part(max(0, handle.size - length), length)
            index = np.frombuffer(_checked(tail, file), "<u8").reshape(-1, 2)
        except BaseException:
            handle.close()
            raise
        self._open[shard] = handle, index, file
        if len(self._open) > _OPEN_FILES:
            self._open.popitem(last=False)[1][0].close()
        return handle, index, file

    def close(self) -> None:
        """Close every file; the next read opens its own again."""
        while self._open:
            self._open.popitem()[1][0].close()

    def __getstate__(self) -> dict:
        return self.__dict__ | {"_open": OrderedDict()}

    def __del__(self) -> None:
        self.close()
