"""The data card: a page in Markdown beside every store that says what is in it and how to read it."""

import json
from pathlib import Path

from specklegen.core.display.escape import cell, markdown, markdown_code
from specklegen.datasets.store.places import put
from specklegen.datasets.store.store import Store

_PAGE = """# {title}: {split} split

{samples} samples rendered by specklegen from the recipe {code}, seed {seed}, data version {data_version}.
Sample n is a pure function of (recipe, seed, split, n): it can be rendered again from what is stored with it.
Fingerprint of the data set: `{fingerprint}`.

## Arrays

| name | stored as | axes | units | what it is |
|---|---|---|---|---|
{arrays}

Each sample carries its `index`, its `seed` and the parameters that were drawn for it:
`parameters[sample, :]`, in this order: {names}.

## Splits

Train, validation and test are rendered from separate streams of random numbers, never drawn from one pool.
{notes}
## Rendering

{rendering}

## Reading it

Without specklegen, `zarr.open_group("{name}", mode="r")` or `xarray.open_zarr("{name}", consolidated=False)`.
Only samples with `valid` true have been written; all others read as zeros there.
`specklegen.datasets.SpeckleCache("{name}")` never hands out such a sample, and checks what it reads.

Shards hold {shard_samples} samples. Files appear by renaming but are not flushed (no fsync): after a power
cut, run `verify`.

## Recipe

```json
{recipe}
```
"""


def card(store: Store) -> str:
    """Write the data card from the store alone; the notes that it was made with go under the splits."""
    identity, described = store.attributes["identity"], store.describe()
    notes = store.attributes["notes"].strip()
    rows = [
        f"| {markdown_code(key)} | {row['dtype']} | {_axes(row)} | {cell(row['units'])} | {cell(row['description'])} |"
        for key, row in described.items()
    ]
    return _PAGE.format(
        **{key: identity[key] for key in ("split", "seed", "data_version")},
        title=markdown(store.attributes["title"]),
        code=markdown_code(store.attributes["title"]),
        samples=store.samples,
        fingerprint=store.attributes["fingerprint"],
        arrays="\n".join(rows),
        names=", ".join(map(markdown_code, store.parameter_names)) or "none",
        notes=f"\n{notes}\n" if notes else "",
        name=store.folder.name,
        rendering=markdown(store.attributes["rendering"]) or "As the recipe says.",
        shard_samples=store.shard_samples,
        recipe=json.dumps(store.attributes["recipe"], indent=2, sort_keys=True),
    )


def _axes(row: dict) -> str:
    return " × ".join(["sample", *(f"{dim} {n}" for dim, n in zip(row["dims"], row["shape"], strict=True))])


def card_file(folder: Path) -> Path:
    """Return where the card of a store stands: beside it, since zarr warns of strangers inside a group."""
    return folder.with_name(folder.name.removesuffix(".zarr") + ".card.md")


def write_card(store: Store) -> Path:
    """Write the card beside the store."""
    file = card_file(store.folder)
    put(file, card(store).encode())
    return file
