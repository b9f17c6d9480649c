"""How a store comes to be: made empty and whole under a temporary name, then renamed; grown; told apart.

The metadata is written here once, by the process that starts the work; those that fill the store open it.
"""

import contextlib
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from specklegen.core.errors import reject
from specklegen.core.libraries import library_versions
from specklegen.datasets.sample_schema import ArraySpec, Renderable, stored_arrays
from specklegen.datasets.store.identity import differences, fingerprint, identity
from specklegen.datasets.store.locks import claim
from specklegen.datasets.store.store import FORMAT, METADATA, Store

SHARD_BYTES = 32 * 2**20
LEAST_SHARDS = 16


def default_shard_samples(samples: int, sample_bytes: int) -> int:
    """Choose samples a shard: 32 MB uncompressed, and in small sets sixteen shards to share and to resume."""
    return max(1, min(SHARD_BYTES // max(1, sample_bytes), -(-samples // LEAST_SHARDS)))


def stored_type(spec: ArraySpec, dtype: str) -> np.dtype:
    """Return the type in which an array is stored: counts in the one asked for, all else as it is."""
    return np.dtype(dtype if spec.counts else spec.dtype)


def _codecs(dtype: np.dtype) -> list:
    shuffled = BloscCodec(cname="zstd", clevel=5, shuffle="bitshuffle", typesize=dtype.itemsize)
    return [*([shuffled] if dtype.kind in "ui" else []), Crc32cCodec()]


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
    sweep_creations(folder)
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        _create(recipe, identity(recipe, seed, split, dtype), folder, samples, shard_samples, notes)
    store = Store(folder, writable=True)
    require_same(store, identity(recipe, seed, split, dtype))
    if samples > store.samples:
        store = grown(store, samples)
    return store


def require_same(store: Store, wanted: Mapping[str, Any]) -> None:
    """Refuse a store of another data set, naming the fields that differ."""
    fields = differences(store.attributes["identity"], wanted)
    if fields or store.attributes["fingerprint"] != fingerprint(wanted):
        reject(
            "generate.folder",
            "a new folder, or a store of the same recipe, seed, split and type",
            str(store.folder),
            f"It differs in {'; '.join(fields) or 'its fingerprint'}. Choose another folder, or agree.",
        )


@contextlib.contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    temporary = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}.creating")
    try:
        (temporary / "valid").mkdir(parents=True)
        claims = temporary / "valid" / "claims"
        claims.touch()
        with claim(claims, METADATA):
            yield temporary
    except OSError as error:
        reject("generate.folder", "in a place where you can write", str(folder), f"The system says: {error}.")
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def sweep_creations(folder: Path) -> list[Path]:
    """Delete half-made stores that killed processes left beside ``folder``."""
    swept = []
    for temporary in folder.parent.glob(f".{folder.name}.*.creating"):
        with (
            contextlib.suppress(FileNotFoundError),
            claim(temporary / "valid" / "claims", METADATA) as claimed,
        ):
            if claimed == "held":
                shutil.rmtree(temporary, ignore_errors=True)
                swept.append(temporary)
    return swept


def grown(store: Store, samples: int) -> Store:
    """Make room for more samples, the ledger last, and open the store anew."""
    with claim(store.folder / "valid" / "claims", METADATA, wait=True):
        arrays = dict(zarr.open_group(store.folder, mode="r+", zarr_format=3).arrays())
        for name in sorted(arrays, key=lambda name: name == "valid"):
            rows = -(-samples // store.shard_samples) if name == "checksum" else samples
            if arrays[name].shape[0] < rows:
                arrays[name].resize((rows, *arrays[name].shape[1:]))
    return Store(store.folder, writable=True)


def _tables(samples: int, rows: int, names: list[str], about: str) -> dict[str, dict[str, Any]]:
    """Describe the columns that the transport adds: one row a sample (or a shard), one file a shard."""
    each = {"shape": (samples,), "chunks": (rows,), "dimension_names": ("sample",)}

    def told(description: str, units: str = "1", **more: Any) -> dict[str, Any]:
        return {"attributes": {"units": units, "long_name": description} | more}

    return {
        "parameters": {
            "dtype": "float64",
            "shape": (samples, len(names)),
            "chunks": (rows, max(1, len(names))),
            "dimension_names": ("sample", "parameter"),
        }
        | told(about, units="as described", names=names),
        "index": each | {"dtype": "int64"} | told("index of the sample"),
        "seed": each | {"dtype": "int64"} | told("seed of the data set"),
        "checksum": {
            "dtype": "uint8",
            "shape": (-(-samples // rows), 32),
            "chunks": (1, 32),
            "dimension_names": ("shard", "byte"),
        }
        | told("SHA-256 of the files of a shard"),
        "valid": each
        | {"dtype": "bool"}
        | told("whether the sample is there; one that is not reads as zeros"),
    }


def _create(
    recipe: Renderable,
    wanted: dict[str, Any],
    folder: Path,
    samples: int,
    shard_samples: int | None,
    notes: str,
) -> None:
    """Make an empty store under a temporary name, then rename it; of two at once, one wins."""
    arrays = stored_arrays(recipe)
    parameters = recipe.layout().get("parameters")
    names = list(recipe.sample(wanted["seed"], wanted["split"], 0)["parameters"])
    types = {key: stored_type(spec, wanted["dtype"]) for key, spec in arrays.items()}
    size = max((int(np.prod(spec.shape)) * types[key].itemsize for key, spec in arrays.items()), default=1)
    rows = min(shard_samples or default_shard_samples(samples, size), samples)
    attributes = {
        "format": FORMAT,
        "title": recipe.name,
        "fingerprint": fingerprint(wanted),
        "recipe_fingerprint": recipe.fingerprint(),
        "identity": wanted,
        "recipe": wanted["recipe"],
        "arrays": list(arrays),
        "shard_samples": rows,
        "notes": notes,
        "epoch_samples": recipe.length(wanted["split"]),
        "libraries": library_versions(),
    }
    with _temporary(folder) as temporary:
        group = zarr.create_group(store=temporary, zarr_format=3, attributes=attributes)
        for key, spec in arrays.items():
            group.create_array(
                key,
                shape=(samples, *spec.shape),
                chunks=(1, *spec.shape),
                shards=(rows, *spec.shape),
                dtype=types[key],
                compressors=_codecs(types[key]),
                filters=None,
                fill_value=0,
                dimension_names=("sample", *spec.dims),
                attributes={"units": spec.units, "long_name": spec.description, "sample_dtype": spec.dtype},
            )
        for name, table in _tables(
            samples, rows, names, parameters.description if parameters else ""
        ).items():
            group.create_array(name, **table, compressors=[Crc32cCodec()], filters=None, fill_value=0)
        with contextlib.suppress(OSError):
            os.rename(temporary, folder)
    if not folder.exists():
        reject("generate.folder", "a folder that can be made", str(folder), "Choose another folder.")
