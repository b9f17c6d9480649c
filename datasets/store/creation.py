"""How a store comes to be: made empty and whole under a temporary name, then renamed; grown; told apart.

The metadata is written here once, by the process that starts the work; those that fill the store open it.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from specklegen.core.errors import RuleError, reject, warn_user
from specklegen.core.libraries import library_versions
from specklegen.core.whole_files import making, sweep, unfinished
from specklegen.datasets.sample_schema import Renderable
from specklegen.datasets.store import file_names, metadata
from specklegen.datasets.store.files import writing
from specklegen.datasets.store.identity import differences, fingerprint, identity
from specklegen.datasets.store.layout import layout_of, rendering_note, write_empty
from specklegen.datasets.store.locks import claim
from specklegen.datasets.store.store import METADATA, Store


def open_for(
    recipe: Renderable,
    seed: int,
    split: str,
    dtype: str,
    folder: Path,
    samples: int,
    shard_samples: int | None,
    notes: str = "",
) -> Store:
    """Open the store of this recipe at ``folder``, made or grown as needed.

    Raises
    ------
    RuleError
        If the folder holds something else, or another data set: the fields that differ are named.
    """
    sweep(unfinished(folder))
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        _create(recipe, identity(recipe, seed, split, dtype), folder, samples, shard_samples, notes)
    store = Store(folder, writable=True)
    require_same(store, identity(recipe, seed, split, dtype))
    if samples > store.samples or not store.valid().all():
        _require_same_rendering(store, recipe)  # a plan takes seconds, and a full store asks for none
    metadata.require_bounded("generate.samples", max(samples, store.samples), store.shard_samples)
    if samples > store.samples:
        store = grown(store, samples)
    _tell_of_other_libraries(store)
    return store


def _tell_of_other_libraries(store: Store) -> None:
    """Say so where samples will be added by other libraries than those that the store was begun with."""
    then, now = store.attributes.get("libraries", {}), library_versions()
    changed = [
        f"{name} {then.get(name, 'none')} is now {now.get(name, 'none')}"
        for name in sorted(then.keys() | now.keys()) if then.get(name) != now.get(name)
    ]  # fmt: skip
    if then and changed and not store.valid().all():
        warn_user(
            f"{store.folder} was begun with other libraries: {', '.join(changed)}. New samples may differ from what "
            "those would have given in their last bits, no more: pixels agree to about 1e-6 of an image's mean. For "
            "the same bits install the versions that `specklegen info` names.",
        )  # fmt: skip


def _require_same_rendering(store: Store, recipe: Renderable) -> None:
    """Say so where a store is now planned otherwise than when it was made, which another version may do."""
    then, now = store.attributes["rendering"], rendering_note(recipe)
    if then == now:
        return
    remedy = "Render all of it anew in another folder, or ask for one sampler by name."
    if getattr(recipe, "strict", False):
        reject("generate.folder", f'a store that is "{now}"', then, remedy)
    warn_user(f'{store.folder} was "{then}", and is now "{now}". {remedy}')


def require_same(store: Store, wanted: Mapping[str, Any]) -> None:
    """Refuse a store of another data set, naming the fields that differ."""
    _require_same(store.folder, store.attributes, wanted)


def _require_same(folder: Path, attributes: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    fields = differences(attributes["identity"], wanted)
    if fields or attributes["fingerprint"] != fingerprint(wanted):
        reject(
            "generate.folder",
            "a new folder, or a store of the same recipe, seed, split and type",
            str(folder),
            f"It differs in {'; '.join(fields) or 'its fingerprint'}. Choose another folder, or agree.",
        )


def grown(store: Store, samples: int) -> Store:
    """Make room for more samples, and open the store anew; see :mod:`specklegen.datasets.store.metadata`.

    Where locks exclude nobody, others may do so at the same time, to other lengths: the longest is agreed on.
    """
    with writing(store.folder), claim(store.locks, METADATA, wait=True):
        now = metadata.read(store.folder)
        wanted = max(samples, now.room) if max(samples, now.room) > now.samples else None
        while wanted is not None:
            if wanted > now.room:
                now.replace(room=wanted).write(store.folder)
            now.write_arrays(store.folder, wanted)
            now.replace(samples=wanted, room=wanted).write(store.folder)
            now = metadata.recorded(store.folder) or now
            wanted = metadata.disagreed(store.folder, now)  # whoever writes last finds what the others wrote
    return Store(store.folder, writable=True)


def mend_metadata(folder: Path, recipe: Renderable) -> str:
    """Write the metadata of a store again from its recipe, if they are damaged; return what was found.

    Raises
    ------
    RuleError
        If the folder is not a store of this version, or of another recipe; or nothing tells its seed any more.
    """
    metadata.reject_strangers(folder)
    with writing(folder), claim(_with_parent(folder / "valid" / "locks"), METADATA, wait=True):
        try:
            metadata.read(folder)
            return ""
        except RuleError as fault:
            damage = str(fault)
        attributes, samples = metadata.stated(folder)
        there = attributes["identity"]
        wanted = identity(recipe, there["seed"], there["split"], there["dtype"])
        _require_same(folder, attributes, wanted)
        layout = layout_of(recipe, wanted, samples, attributes["shard_samples"], attributes["notes"])
        with tempfile.TemporaryDirectory() as temporary:
            record = write_empty(Path(temporary), layout)
        record.write_arrays(folder, samples)
        record.write(folder)
        file_names.write(folder, layout.file_names)
        return damage


def _with_parent(file: Path) -> Path:
    file.parent.mkdir(exist_ok=True)
    return file


def _create(
    recipe: Renderable,
    wanted: dict[str, Any],
    folder: Path,
    samples: int,
    shard_samples: int | None,
    notes: str,
) -> None:
    """Make an empty store under a temporary name, then rename it; of several at once, one wins."""
    layout = layout_of(recipe, wanted, samples, shard_samples, notes)
    with writing(folder):
        try:
            with making(folder) as temporary:
                write_empty(temporary, layout)
        except FileExistsError:
            if not metadata.is_store(folder):
                raise
