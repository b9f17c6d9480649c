"""Verifying a store: every byte against its checksum, and mending what is damaged."""

import os
from dataclasses import dataclass

import numpy as np

from specklegen.core.errors import reject
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store.creation import require_same
from specklegen.datasets.store.generate import GenerationError, fill_shard
from specklegen.datasets.store.identity import fingerprint, identity
from specklegen.datasets.store.store import Store


@dataclass(frozen=True)
class Verification:
    """What :func:`verify` found.

    ``damaged`` shards are on the ledger but a file is missing or differs by a byte; ``unfinished`` ones are
    not wholly on the ledger, which is no fault of a store that is being filled; ``orphans`` are temporary
    files that killed processes left.
    """

    shards: int
    damaged: tuple[int, ...]
    unfinished: tuple[int, ...]
    orphans: int

    @property
    def sound(self) -> bool:
        """Whether everything that the ledger lists is there, to the byte."""
        return not self.damaged


def verify(folder: str | os.PathLike, repair: Renderable | None = None) -> Verification:
    """Compare every shard with the checksum written with it; with ``repair``, render again what is bad.

    Parameters
    ----------
    folder : path
        The folder of the store.
    repair : recipe, optional
        The recipe that the store was made from: damaged and unfinished shards are rendered, orphans deleted.

    Returns
    -------
    Verification
        What was found, before the repair.

    Raises
    ------
    RuleError
        If the folder is not a store, its attributes were changed, or the recipe is another one.
    GenerationError
        If a shard could not be rendered again.
    """
    store = Store(folder, writable=repair is not None)
    stated = store.attributes["identity"]
    if fingerprint(stated) != store.attributes["fingerprint"]:
        reject(
            "store.fingerprint",
            f"{fingerprint(stated)}, the SHA-256 of its identity",
            store.attributes["fingerprint"],
        )
    if repair is not None:
        require_same(store, identity(repair, stated["seed"], stated["split"], stated["dtype"]))
    damaged, unfinished = [], []
    for shard in range(store.shard_count):
        state = _state(store, shard)
        if state == "damaged":
            damaged.append(shard)
        elif state == "unfinished":
            unfinished.append(shard)
    orphans = len(list(store.folder.rglob("*.partial")))
    if repair is not None:
        store.sweep()
        for shard in damaged:
            with store.claimed(shard, wait=True):
                if _state(store, shard) == "damaged":  # still: another call may have mended it
                    store.forget_shard(shard)
        outcomes = [fill_shard(store, repair, shard, wait=True) for shard in [*damaged, *unfinished]]
        failed = [outcome.message for outcome in outcomes if outcome.state == "failed"]
        if failed:
            raise GenerationError("\n".join(failed))
    return Verification(store.shard_count, tuple(damaged), tuple(unfinished), orphans)


def _state(store: Store, shard: int) -> str:
    try:
        valid = store.valid_in(shard)
        if valid.any() and store.digest(shard) != store.recorded_digest(shard):
            return "damaged"
    except (OSError, ValueError):  # a flipped byte in the ledger or in the checksums themselves
        return "damaged"
    return "sound" if np.all(valid) else "unfinished"
