"""Verifying a store: every byte against its checksum, and mending what is damaged."""

import os
from dataclasses import dataclass

import numpy as np

from specklegen.core.errors import ToldError
from specklegen.core.whole_files import dead, sweep
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store.creation import mend_metadata, require_same
from specklegen.datasets.store.files import reaching
from specklegen.datasets.store.filling import GenerationError, fill_shard
from specklegen.datasets.store.identity import identity
from specklegen.datasets.store.places import is_remote, place_of
from specklegen.datasets.store.reading import SampleReader
from specklegen.datasets.store.shards import UnlistedSample
from specklegen.datasets.store.store import Store


@dataclass(frozen=True)
class Verification:
    """Result of :func:`verify`.

    ``damaged`` shards are on the ledger but a file is missing or differs by a byte; ``unfinished`` ones are
    not wholly on the ledger, which is no fault of a store that is being filled; ``orphans`` are temporary
    files that killed processes left. ``metadata`` says what was wrong with them before a repair wrote them again;
    without a repair such a store is refused.
    """

    shards: int
    damaged: tuple[int, ...]
    unfinished: tuple[int, ...]
    orphans: int
    metadata: str = ""

    @property
    def sound(self) -> bool:
        """True if everything that the ledger lists is there, to the byte, and from this data set."""
        return not self.damaged and not self.metadata


def verify(folder: str | os.PathLike, repair: Renderable | None = None) -> Verification:
    """Compare every shard with the checksum written with it; with ``repair``, render again what is bad.

    Raise a `RuleError` if the folder is not a store, its metadata were changed (and there is no recipe), or the recipe
    is another one. Raise a `GenerationError` if a shard could not be rendered again.

    Parameters
    ----------
    folder : path
        The folder of the store, or its address.
    repair : recipe, optional
        The recipe that the store was made from: damaged metadata are written again, damaged and unfinished shards
        are rendered, orphans deleted.

    Returns
    -------
    Verification
        What was found, before the repair.
    """
    metadata_damage = mend_metadata(place_of(folder), repair) if repair is not None else ""
    store = Store(folder)
    metadata_damage = metadata_damage or "; ".join(store.metadata.faults)
    stated = store.attributes["identity"]
    if repair is not None:
        require_same(store, identity(repair, stated["seed"], stated["split"], stated["dtype"]))
    damaged, unfinished = [], []
    for shard in range(store.shard_count):
        with reaching(store.folder):
            state = _state(store, shard)
        if state == "damaged":
            damaged.append(shard)
        elif state == "unfinished":
            unfinished.append(shard)
    orphans = len(dead(store.temporaries()))
    if repair is not None:
        sweep(store.temporaries())
        for shard in damaged:
            with store.claimed(shard, wait=True):
                if _state(store, shard) == "damaged":  # still: another call may have mended it
                    store.forget_shard(shard)
        outcomes = [fill_shard(store, repair, shard, wait=True) for shard in [*damaged, *unfinished]]
        failed = [outcome.message for outcome in outcomes if outcome.state == "failed"]
        if failed:
            raise GenerationError("\n".join(failed))
    return Verification(store.shard_count, tuple(damaged), tuple(unfinished), orphans, metadata_damage)


def _state(store: Store, shard: int) -> str:
    """Compare the bytes, then read each sample that is listed, as a cache does: what is sound can be read."""
    try:
        valid = store.valid_in(shard)
        # One that is being filled up, or whose writer died at it, has no checksum yet.
        if valid.all() and store.digest(shard) != store.recorded_digest(shard):
            return "damaged"
        reader = SampleReader(store)
        for row in np.flatnonzero(valid).tolist():
            reader.read(store.span(shard)[row])
    except UnlistedSample:  # taken off the ledger meanwhile, by a call that does it anew
        return "unfinished"
    except (OSError, LookupError) as error:  # a byte flipped in the ledger, or in the checksums; a file that is gone
        if is_remote(store.folder) and not isinstance(error, ToldError | FileNotFoundError | LookupError):
            raise  # an address that gives no answer: nothing is known of its shards
        return "damaged"
    return "sound" if valid.all() else "unfinished"
