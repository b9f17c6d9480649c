"""Facts that the transport of samples needs about their physics: one protocol, one description of an array.

The stream, the store and the cache depend on recipes only through :class:`Renderable`. Whatever renders
pure samples and says how they are laid out can be streamed, stored and read back.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from pydantic import field_validator, model_validator

from specklegen.core.arguments import on_host
from specklegen.core.errors import reject
from specklegen.core.values import Value

RESERVED = ("index", "parameters", "seed", "seal", "valid", "checksum", "file")
"""Names that the transport gives to its own columns; no array of a layout is stored under them."""


class ArraySpec(Value):
    """Layout of one array of a sample.

    Parameters
    ----------
    shape : tuple of int
        Shape of the array in one sample; () for a number.
    dtype : str
        NumPy name of the type that the sample holds, and that readers get back.
    dims : tuple of str
        A name for every axis, as xarray shows it.
    units, description : str
        For readers of the store; "1" is dimensionless.
    counts : bool
        Whole numbers from 0 to 65535, such as camera counts: stored as uint16, or as float32 when asked,
        without loss either way.
    unbounded : tuple of str
        Of the parameters: names of those that may be infinite, since infinity means something there.
    """

    shape: tuple[int, ...] = ()
    dtype: str = "float32"
    dims: tuple[str, ...] = ()
    units: str = "1"
    description: str = ""
    counts: bool = False
    unbounded: tuple[str, ...] = ()

    @field_validator("dtype")
    @classmethod
    def _known(cls, dtype: str) -> str:
        try:
            return np.dtype(dtype).name
        except TypeError:
            reject("ArraySpec.dtype", "the name of a NumPy type", dtype)

    @model_validator(mode="after")
    def _every_axis_has_a_name(self) -> "ArraySpec":
        if len(self.dims) != len(self.shape) or len(set(self.dims)) != len(self.dims):
            reject("ArraySpec.dims", f"one distinct name for each axis of shape {self.shape}", self.dims)
        return self


@runtime_checkable
class Renderable(Protocol):
    """A recipe, seen from the transport: pure samples, addressed by (seed, split, index).

    ``sample`` returns the arrays of ``layout()``, "index" (int64) and "parameters" (a flat dict of float64,
    with the same names in every sample). ``batch`` returns the same keys with a new first axis, the
    parameters as a dict of float64[B], equal to the samples to the bit.
    """

    @property
    def name(self) -> str:
        """Name for people."""
        ...

    @property
    def data_version(self) -> int:
        """Number that is raised whenever pixels change."""
        ...

    def fingerprint(self) -> str:
        """SHA-256 of the canonical JSON."""
        ...

    def canonical_json(self) -> str:
        """Write everything that decides the pixels, and nothing else."""
        ...

    def length(self, split: str) -> int:
        """Return the number of samples in an epoch."""
        ...

    def layout(self) -> Mapping[str, ArraySpec]:
        """Describe every array of a sample."""
        ...

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """Render one sample; a pure function."""
        ...

    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        """Render samples stacked along a new first axis."""
        ...


def stored_arrays(recipe: Renderable) -> dict[str, ArraySpec]:
    """Return the arrays of the recipe's layout that a store holds, checked against one another."""
    layout = {key: spec for key, spec in recipe.layout().items() if key not in ("index", "parameters")}
    lengths: dict[str, int] = {}
    for key, spec in layout.items():
        if key in RESERVED or "/" in key or key.startswith("."):
            reject(f"{recipe.name}.layout", f"free of the reserved names {', '.join(RESERVED)}", key)
        for dim, length in zip(spec.dims, spec.shape, strict=True):
            if dim in ("sample", "parameter") or lengths.setdefault(dim, length) != length:
                reject(f"{recipe.name}.layout[{key!r}].dims",
                       "names with one length each, other than 'sample' and 'parameter'", spec.dims,
                       f"Give the axis of length {length} another name, such as '{key}_{dim}'.")  # fmt: skip
    return layout


def named_file(names: Sequence[str], parameters: Mapping[str, float]) -> dict[str, str]:
    """Name of the file of a sample's object; "" for an object of a mixture that has no file."""
    if not names or "file" not in parameters:
        return {}
    number = int(parameters["file"])
    return {"file": names[number] if number >= 0 else ""}


def _is_finite(column: Any) -> bool:
    if hasattr(column, "isfinite"):  # a tensor: looked at where it lies, which may be a device
        return bool(column.isfinite().all())
    value = np.asarray(column)
    return value.dtype.kind not in "fc" or bool(np.isfinite(value).all())


def require_finite(sample: Mapping[str, Any], recipe: Renderable, seed: int, split: str) -> None:
    """Refuse a sample, or a batch of them, that holds anything but finite numbers; parameters may say ``unbounded``."""
    arrays = [(key, value, False) for key, value in sample.items() if key != "parameters"]
    drawn = [(name, value, True) for name, value in sample["parameters"].items()]
    for name, column, is_parameter in arrays + drawn:
        if _is_finite(column):
            continue
        value = np.asarray(on_host(column))
        spec = recipe.layout().get("parameters")
        free = is_parameter and spec is not None and name in spec.unbounded
        good = ~np.isnan(value) if free else np.isfinite(value)
        if not good.all():
            index = np.atleast_1d(on_host(sample["index"]))
            rows = good.reshape(len(index), -1)
            worst = int(rows.all(1).argmin())
            bad = value.reshape(rows.shape)[worst][~rows[worst]][0]
            address = f"sample (seed={seed}, split={split!r}, index={int(index[worst])})"
            reject(f"{name} of {address}", "finite everywhere", bad.item())
