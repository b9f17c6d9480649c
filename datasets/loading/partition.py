"""Which samples go into which batch: pure arithmetic on (length, batch size, world, rank, number).

A round is one batch for every rank. All rounds but the last are full; the last shares out what is left in
parts that differ by at most one sample. So every rank gets the same number of batches, no sample comes
twice, and together the ranks see the whole epoch.
"""

from specklegen.core.errors import reject


def batch_count(length: int, batch_size: int, world: int, drop_last: bool = False) -> int:
    """Return the number of batches of every rank in an epoch of ``length`` samples.

    Raise a `RuleError` if an epoch holds no batch, or if the last round could not give every rank a sample.
    """
    full, rest = divmod(length, batch_size * world)
    if drop_last:
        if not full:
            reject("SpeckleStream.batch_size",
                   f"at most {length // world}, since an epoch has {length} samples for {world} ranks, with drop_last",
                   batch_size)  # fmt: skip
        return full
    if rest and rest < world:
        reject("SpeckleStream.batch_size", f"such that each of {world} ranks has a sample in the last round",
               batch_size, f"{length} samples leave {rest} for that round: choose another batch size, or "
                           "drop_last=True.")  # fmt: skip
    return full + bool(rest)


def batch_range(length: int, batch_size: int, world: int, rank: int, number: int) -> range:
    """Return the places in the epoch that make up batch ``number`` of ``rank``."""
    start = number * batch_size * world
    share = min(batch_size * world, length - start)
    if share == batch_size * world:
        return range(start + rank * batch_size, start + (rank + 1) * batch_size)
    return range(start + rank * share // world, start + (rank + 1) * share // world)
