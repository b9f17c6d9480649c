"""Samples of a store as a data set for the Hugging Face hub: Parquet, a card with front matter, Croissant metadata.

    <out>/data/<split>.parquet   a row a sample: index, seed, file (name, of objects of a folder), the arrays,
                                 parameter_<name>
    <out>/README.md              the card; its front matter says where the splits are
    <out>/croissant.json         Croissant 1.0 (MLCommons): files with their SHA-256, and every field

Licence and date of publication are for the publisher to add. Several splits go into one folder, one call each.
Written by pyarrow (extra ``parquet``); the features, as the ``datasets`` library calls them, stand in the schema, so
that ``load_dataset`` gives arrays of the right shape and type.
"""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.whole_files import write_whole
from specklegen.datasets.loading.cache import SpeckleCache

_ROWS = 64
"""Samples in a row group."""
_CONTEXT = {
    "@language": "en", "@vocab": "https://schema.org/", "citeAs": "cr:citeAs", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"}, "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/", "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"}, "extract": "cr:extract",
    "field": "cr:field", "fileProperty": "cr:fileProperty", "fileObject": "cr:fileObject", "fileSet": "cr:fileSet",
    "format": "cr:format", "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath",
    "key": "cr:key", "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path", "recordSet": "cr:recordSet",
    "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated", "replace": "cr:replace",
    "samplingRate": "cr:samplingRate", "sc": "https://schema.org/", "separator": "cr:separator", "source": "cr:source",
    "subField": "cr:subField", "transform": "cr:transform",
}  # fmt: skip
"""The context that the Croissant specification 1.0 prescribes."""
_CITATION = (
    "specklegen; and C. Bar, M. Alterman, I. Gkioulekas, A. Levin, A Monte Carlo Framework for Rendering Speckle "
    "Statistics in Scattering Media, ACM Transactions on Graphics 38(4), 2019"
)


def write_parquet(cache: SpeckleCache, chosen: Sequence[int], out: Path) -> tuple[list[Path], list[dict]]:
    """Write the chosen samples of a store; return the files and, for each sample, nothing more to tabulate.

    Raise a `RuleError` if pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        reject("export.format", "one other than parquet, without pyarrow", "parquet",
               "pip install 'specklegen-torch[parquet]'")  # fmt: skip
    split = cache.identity["split"]
    file = out / "data" / f"{split}.parquet"
    file.parent.mkdir(parents=True, exist_ok=True)
    first = cache.numpy(chosen[0])
    arrays = {key: first[key] for key in cache.keys}
    drawn = {f"parameter_{name}": name for name in first["parameters"]}  # an array may have the name of a parameter
    fields = [pa.field("index", pa.int64()), pa.field("seed", pa.int64())]
    named = ["file"] if "file" in first else []  # objects from a folder
    fields += [pa.field(name, pa.string()) for name in named]
    fields += [_array_field(pa, key, array) for key, array in arrays.items()]
    fields += [pa.field(name, pa.float64()) for name in drawn]
    features = {"info": {"features": _features(arrays, list(drawn), named)}}
    schema = pa.schema(fields, metadata={"huggingface": json.dumps(features)})
    with pq.ParquetWriter(file, schema, compression="zstd") as writer:
        for start in range(0, len(chosen), _ROWS):
            samples = [cache.numpy(n) for n in chosen[start : start + _ROWS]]
            columns: dict[str, Any] = {"index": [s["index"] for s in samples]}
            columns["seed"] = [cache.identity["seed"]] * len(samples)
            columns |= {name: [s[name] for s in samples] for name in named}
            columns |= {key: [s[key].tolist() for s in samples] for key in arrays}
            columns |= {column: [s["parameters"][name] for s in samples] for column, name in drawn.items()}
            writer.write_table(pa.table(columns, schema=schema))
    rows = {path.stem: pq.read_metadata(path).num_rows for path in sorted(file.parent.glob("*.parquet"))}
    write_whole(out / "README.md", _card(cache, rows).encode())
    croissant = json.dumps(_croissant(cache, arrays, list(drawn), named, out), indent=2)
    write_whole(out / "croissant.json", croissant.encode())
    return [file, out / "README.md", out / "croissant.json"], [{}] * len(chosen)


def _array_field(pa: Any, name: str, array: np.ndarray) -> Any:
    """Column of nested lists, marked as the extension type that the ``datasets`` library takes for an array.

    Without the mark it does not believe the features of the schema. Readers that do not know the type see the lists.
    """
    kind = pa.from_numpy_dtype(array.dtype)
    for _ in array.shape:
        kind = pa.list_(kind)
    if not _has_array_type(array):
        return pa.field(name, kind)
    extension = f"datasets.features.features.Array{array.ndim}DExtensionType"
    shape = json.dumps([array.shape, str(array.dtype)])
    return pa.field(name, kind, metadata={"ARROW:extension:name": extension, "ARROW:extension:metadata": shape})


def _has_array_type(array: np.ndarray) -> bool:
    """Return whether the ``datasets`` library has a type for arrays of so many axes: Array2D to Array5D."""
    return 2 <= array.ndim <= 5


def _features(arrays: dict[str, np.ndarray], parameters: list[str], named: list[str]) -> dict[str, Any]:
    """Features in the words of the ``datasets`` library: Array2D for images, Array3D for stacks of them."""

    def value(dtype: str) -> dict[str, Any]:
        return {"dtype": dtype, "_type": "Value"}

    def feature(array: np.ndarray) -> dict[str, Any]:
        if _has_array_type(array):
            return {"shape": list(array.shape), "dtype": str(array.dtype), "_type": f"Array{array.ndim}D"}
        return value(str(array.dtype)) if array.ndim == 0 else {"feature": value(str(array.dtype)), "_type": "List"}

    features = {"index": value("int64"), "seed": value("int64")} | {name: value("string") for name in named}
    features |= {key: feature(array) for key, array in arrays.items()}
    return features | {name: value("float64") for name in parameters}


def _card(cache: SpeckleCache, rows: dict[str, int]) -> str:
    """The card; names in its front matter are quoted as JSON, which is YAML too."""
    title = cache.store.attributes["title"]
    splits = "".join(f"  - split: {json.dumps(s)}\n    path: {json.dumps(f'data/{s}.parquet')}\n" for s in rows)
    table = "".join(f"| {split} | {count} |\n" for split, count in rows.items())
    recipe = json.dumps(cache.store.attributes["recipe"], indent=2, sort_keys=True)
    return (
        f"---\npretty_name: {json.dumps(title)}\ntags: [speckle, scattering, simulation]\n"
        f"configs:\n- config_name: default\n  data_files:\n{splits}---\n\n# {title}\n\n"
        f"Rendered by specklegen, data version {cache.identity['data_version']}. A sample is a pure function of "
        f"(recipe, seed, split, index); splits share no medium and no object.\n\n"
        f"| split | samples |\n|---|---|\n{table}\n"
        f"```json\n{recipe}\n```\n"
    )


def _croissant(
    cache: SpeckleCache, arrays: dict[str, np.ndarray], parameters: list[str], named: list[str], out: Path
) -> dict[str, Any]:
    files = sorted((out / "data").glob("*.parquet"))
    described = cache.store.describe()

    def field(split: str, name: str, kind: str, about: str, repeated: bool = False) -> dict[str, Any]:
        source = {"fileObject": {"@id": f"{split}.parquet"}, "extract": {"column": name}}
        node = {"@type": "cr:Field", "@id": f"{split}/{name}", "dataType": kind, "description": about, "source": source}
        return node | ({"repeated": True} if repeated else {})

    def record_set(split: str) -> dict[str, Any]:
        numbers = [field(split, name, "sc:Integer", f"{name} of the sample") for name in ("index", "seed")]
        images = [
            field(split, key, "sc:Float" if array.dtype.kind == "f" else "sc:Integer",
                  f"{described[key]['description']}; axes {', '.join(described[key]['dims'])}", array.ndim > 0)
            for key, array in arrays.items()
        ]  # fmt: skip
        numbers += [field(split, name, "sc:Text", "file of the object, within its folder") for name in named]
        drawn = [field(split, name, "sc:Float", "parameter of the sample") for name in parameters]
        return {"@type": "cr:RecordSet", "@id": split, "name": split, "field": [*numbers, *images, *drawn]}

    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": cache.store.attributes["title"],
        "description": f"Speckle images rendered by specklegen; fingerprint {cache.fingerprint}.",
        "citeAs": _CITATION,
        "version": f"{cache.identity['data_version']}.0.0",
        "distribution": [
            {
                "@type": "cr:FileObject", "@id": file.name, "name": file.name, "contentUrl": f"data/{file.name}",
                "encodingFormat": "application/x-parquet", "sha256": _sha256(file),
            }
            for file in files
        ],
        "recordSet": [record_set(file.stem) for file in files],
    }  # fmt: skip


def _sha256(file: Path) -> str:
    with file.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
