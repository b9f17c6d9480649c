"""Seals: what ties the bytes of a sample, and of a shard, to the data set and the place that they were made for.

A checksum alone tells damage, and not a whole shard of another seed, or of another number, that was copied into
the store. So what a sample is, and what a shard is, goes into the hash first. Seals are no secret: they tell
mistakes, not forgery.
"""

import hashlib
from collections.abc import Iterable

import google_crc32c
import numpy as np


def seal(fingerprint: str, index: int, seed: int, parameters: np.ndarray, arrays: Iterable[np.ndarray]) -> np.uint64:
    """Return 64 bits of the SHA-256 of all that a sample is.

    Parameters
    ----------
    fingerprint : str
        Of the data set.
    index, seed : int
        Of the sample.
    parameters : float64[p]
        What was drawn for it.
    arrays : iterable of arrays
        Its arrays as they are stored, in the order of the store; each goes in as its CRC32C.
    """
    digest = hashlib.sha256(f"{fingerprint} {seed} {index} ".encode())
    digest.update(np.ascontiguousarray(parameters, "<f8").tobytes())
    for array in arrays:
        stored = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        digest.update(int(google_crc32c.value(stored.tobytes())).to_bytes(4, "little"))
    return np.frombuffer(digest.digest()[:8], "<u8")[0]


def shard_digest(fingerprint: str, seed: int, shard: int, shard_samples: int, contents: Iterable[bytes]) -> bytes:
    """Return the SHA-256 of the data set, the number and the files of a shard."""
    digest = hashlib.sha256(f"{fingerprint} {seed} {shard} {shard_samples} ".encode())
    for data in contents:
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.digest()
