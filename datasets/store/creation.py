"""Creation of a store: made empty and whole under a temporary name, then renamed; grown; distinguished.

The metadata is written here once, by the process that starts the work; those that fill the store open it.

At an address nothing is renamed. There the first to put the group's ``zarr.json``, which holds the whole identity, has
begun the store; the record comes last. The process that puts them claims the metadata; where it was killed, another one
puts the rest.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from specklegen.core.errors import RuleError, reject, warn_user
from specklegen.core.libraries import library_versions
from specklegen.core.whole_files import making, sweep, unfinished
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store import file_names, metadata
from specklegen.datasets.store.files import json_bytes, reaching, writing
from specklegen.datasets.store.identity import differences, fingerprint, identity
from specklegen.datasets.store.layout import layout_of, rendering_note
from specklegen.datasets.store.places import content, is_remote, listed, put_new
from specklegen.datasets.store.store import Store, claim_metadata

_LISTED = 5  # differences of a message


@dataclass(frozen=True)
class Share:
    """Work of a call in a store.

    Attributes
    ----------
    store : Store
        Open for writing.
    shards : range
        Those of its part.
    missing : list of int
        Those among them that are not there.
    """

    store: Store
    shards: range
    missing: list[int]


def opened(
    recipe: Renderable, wanted: dict[str, Any], folder: Path, samples: int, shard_samples: int | None, notes: str = ""
) -> Store:
    """Open the store of an identity, made as needed; another one is refused, with the fields that differ."""
    if is_remote(folder):
        with reaching(folder):
            if metadata.recorded(folder) is None:
                _begin(recipe, wanted, folder, samples, shard_samples, notes)
    else:
        sweep(unfinished(folder))
        if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
            _create(recipe, wanted, folder, samples, shard_samples, notes)
    store = Store(folder)
    require_same(store, wanted)
    return grown(store, store.samples) if store.metadata.faults else store


def open_for(
    recipe: Renderable, seed: int, split: str, dtype: str, folder: Path, samples: int, shard_samples: int | None,
    notes: str = "", part: tuple[int, int] = (0, 1),
) -> Share:  # fmt: skip
    """Open the store of this recipe at ``folder``, made or grown as needed, for part i of n of its shards.

    Of the ledger the lines of the part alone are read. Raise a `RuleError` if the folder holds something else, or
    another data set: the fields that differ are named.
    """
    store = opened(recipe, identity(recipe, seed, split, dtype), folder, samples, shard_samples, notes)
    metadata.require_bounded("generate.samples", max(samples, store.samples), store.shard_samples)
    grows = samples > store.samples
    if grows:
        _require_same_rendering(store, recipe)
        store = grown(store, samples)
    shards = shards_of(samples, store.shard_samples, part)
    missing = [shard for shard in shards if not store.is_complete(shard)]
    if missing:
        tell_of_other_libraries(store, None if grows else recipe)
    return Share(store, shards, missing)


def shards_of(samples: int, shard_samples: int, part: tuple[int, int]) -> range:
    """Shards of part i of n equal parts of so many samples."""
    count = -(-samples // shard_samples)
    return range(part[0] * count // part[1], (part[0] + 1) * count // part[1])


def tell_of_other_libraries(store: Store, recipe: Renderable | None = None) -> None:
    """Say so where samples will be added by other libraries, or by another plan, than the store was begun with."""
    if recipe is not None:  # a plan takes seconds, and a full store asks for none
        _require_same_rendering(store, recipe)
    then, now = store.attributes.get("libraries", {}), library_versions()
    changed = [
        f"{name} {then.get(name, 'none')} is now {now.get(name, 'none')}"
        for name in sorted(then.keys() | now.keys()) if then.get(name) != now.get(name)
    ]  # fmt: skip
    if then and changed:
        warn_user(
            f"{store.folder} was begun with other libraries: {', '.join(changed)}. New samples may differ from what "
            "those would have given in their last bits, no more: pixels agree to about 1e-6 of an image's mean. For "
            "the same bits install the versions that `specklegen store info` names.",
        )  # fmt: skip


def _require_same_rendering(store: Store, recipe: Renderable) -> None:
    """Say so where a store is now planned otherwise than when it was made, which another version may do."""
    then, now = store.attributes["rendering"], rendering_note(recipe)
    if then == now:
        return
    remedy = "Generate the data set again in another folder, or name one sampler in the recipe."
    if getattr(recipe, "strict", False):
        reject("generate.folder", f'a store that is "{now}"', then, remedy)
    warn_user(f'{store.folder} was "{then}", and is now "{now}". {remedy}')


def require_same(store: Store, wanted: Mapping[str, Any]) -> None:
    """Refuse a store of another data set, naming the fields that differ."""
    _require_same(store.folder, store.attributes, wanted)


def _require_same(folder: Path, attributes: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    fields = differences(attributes["identity"], wanted)
    if fields or attributes["fingerprint"] != fingerprint(wanted):
        more = f"; and {len(fields) - _LISTED} more" if len(fields) > _LISTED else ""
        reject("generate.folder", "a new folder, or a store of the same recipe, seed, split and dtype", str(folder),
               f"The store differs in {'; '.join(fields[:_LISTED]) or 'its fingerprint'}{more}. Choose another "
               "folder, or "
               "use the recipe of the store (`specklegen store info FOLDER` shows it).")  # fmt: skip


def grown(store: Store, samples: int) -> Store:
    """Make room for more samples, and open the store anew; see :mod:`specklegen.datasets.store.metadata`.

    Where locks exclude nobody, others may do so at the same time, to other lengths: the longest is agreed on. At an
    address a process that was stopped for longer than its claim lasts may still state its shorter length late.
    """
    while True:
        with writing(store.folder), store.claimed_metadata():
            now = metadata.read(store.folder)
            wanted = max(samples, now.room)
            _grow(store.folder, now, wanted if wanted > now.samples or now.faults else None)
        store = Store(store.folder)
        if store.samples >= samples:
            return store


def _grow(folder: Path, now: metadata.Metadata, wanted: int | None) -> None:
    """Write the metadata of another length, until the record and the arrays agree on the longest."""
    while wanted is not None:
        if wanted > now.room:
            now.replace(room=wanted).write(folder)
        now.write_arrays(folder, wanted)
        now.replace(samples=wanted, room=wanted).write(folder)
        now = metadata.recorded(folder) or now
        wanted = metadata.disagreed(folder, now)  # whoever writes last finds what the others wrote


def mend_metadata(folder: Path, recipe: Renderable) -> str:
    """Write the metadata of a store again from its recipe, if they are damaged; return what was found.

    Raise a `RuleError` if the folder is not a store of this version, or of another recipe; or nothing tells its seed
    any more.
    """
    metadata.reject_strangers(folder)
    if not is_remote(folder):
        (folder / "valid").mkdir(exist_ok=True)
    with writing(folder), claim_metadata(folder):
        try:
            damage = "; ".join(metadata.read(folder).faults)
            if not damage:
                return ""
        except RuleError as fault:
            damage = str(fault)
        attributes, samples = metadata.stated(folder)
        there = attributes["identity"]
        wanted = identity(recipe, there["seed"], there["split"], there["dtype"])
        _require_same(folder, attributes, wanted)
        _write_all(folder, layout_of(recipe, wanted, samples, attributes["shard_samples"], attributes["notes"]), recipe)
        return damage


def _write_all(folder: Path, layout: metadata.Metadata, recipe: Renderable, new: bool = False) -> None:
    """Write all metadata of a store into its place, the record last."""
    layout.write_arrays(folder, layout.samples)
    file_names.write(folder, getattr(recipe, "file_names", ()))
    layout.write(folder, new)


def _create(
    recipe: Renderable, wanted: dict[str, Any], folder: Path, samples: int, shard_samples: int | None, notes: str,
) -> None:  # fmt: skip
    """Make an empty store under a temporary name, then rename it; of several at once, one wins."""
    layout = layout_of(recipe, wanted, samples, shard_samples, notes)
    with writing(folder):
        try:
            with making(folder) as temporary:
                _write_all(temporary, layout, recipe)
        except FileExistsError:
            if not metadata.is_store(folder):
                raise


def _begin(
    recipe: Renderable, wanted: dict[str, Any], folder: Any, samples: int, shard_samples: int | None, notes: str
) -> None:
    """Make an empty store at an address; of several at once, one begins it, and all agree on what that one says."""
    layout = layout_of(recipe, wanted, samples, shard_samples, notes)
    group = folder / "zarr.json"
    if listed(folder, maxdepth=2) and not metadata.is_store(folder):  # in this order: the group is put first
        return  # of somebody else: refused by whoever opens it
    with writing(folder), claim_metadata(folder):
        if metadata.recorded(folder) is not None:
            return
        if not put_new(group, json_bytes(layout.files["zarr.json"])):  # whoever began it was killed
            stated = json.loads(content(group) or b"{}")
            attributes = stated.get("attributes", {})
            if attributes.get("format") != metadata.FORMAT:
                return
            _require_same(folder, attributes, wanted)
            layout = layout_of(recipe, wanted, samples, attributes["shard_samples"], attributes["notes"])
            lengths = metadata.lengths_of(folder, layout)
            samples = max(samples, *(lengths.get(name, 0) for name in layout.arrays if name != "checksum"))
            layout = metadata.Metadata(samples, samples, {**layout.files, "zarr.json": stated})
        _write_all(folder, layout, recipe, new=content(folder / "valid" / "record.json") is None)
        now = metadata.recorded(folder)
        if now is not None:  # whoever was stopped for longer than its claim lasts finds what others wrote meanwhile
            _grow(folder, now, metadata.disagreed(folder, now))
