"""Packages that come with an extra: which one a missing package belongs to, and public names that load when used.

``pip install specklegen-torch`` brings what scenes, plans, correlations, covariances and path sums need. All else is an
extra, PyTorch too: whoever meets the border is told its name.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from types import MappingProxyType
from typing import Any

import lazy_loader

EXTRAS = {
    "torch": "torch", "skimage": "photographs", "sklearn": "digits", "miepython": "mie", "distributed": "dask",
    "dask": "dask", "dask_jobqueue": "dask", "cloudpickle": "dask", "trimesh": "mesh", "mapbox_earcut": "mesh",
    "shapely": "mesh", "pyarrow": "parquet", "upath": "remote", "lightning": "lightning", "deepinv": "deepinv",
    "embreex": "validate", "treams": "validate", "marimo": "explore", "uvicorn": "explore", "h5py": "hdf5",
    "xarray": "xarray", "av": "video",
}  # fmt: skip
"""The extra of this project that brings a package, by the name that one imports."""

_PYTORCH = " (the build for the CPU is the smaller one: pytorch.org says how to choose)"


def install_line(error: ImportError) -> str | None:
    """Return what to install where an import failed; None where no extra brings the package."""
    name = (error.name or "").partition(".")[0]
    if name not in EXTRAS:
        return None
    advice = f"this needs the package {name}: pip install 'specklegen-torch[{EXTRAS[name]}]'"
    return advice + _PYTORCH * (name == "torch")


@contextmanager
def extras_named() -> Iterator[None]:
    """Let a failing import of an extra's package say what to install; the error stays a ``ModuleNotFoundError``."""
    try:
        yield
    except ModuleNotFoundError as error:
        advice = install_line(error)
        if advice is None or error.msg == advice:
            raise
        raise ModuleNotFoundError(advice, name=error.name) from error


def lazy_names(
    package: str, file: str, moved: Mapping[str, str] = MappingProxyType({})
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, from the names in its ``__init__.pyi``.

    Names that ``moved`` to another place, "package.name", are found with a ``DeprecationWarning`` that says it.
    """
    load, names, public = lazy_loader.attach_stub(package, file)

    def __getattr__(name: str) -> Any:
        with extras_named():
            if name not in moved:
                return load(name)
            warnings.warn(f"{package}.{name} is now {moved[name]}", DeprecationWarning, stacklevel=2)
            place, _, new = moved[name].rpartition(".")
            return getattr(import_module(place), new)

    return __getattr__, names, public
