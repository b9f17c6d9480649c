"""Packages that come with an extra: which one a missing package belongs to, and public names that load when used.

``pip install specklegen-torch`` brings what scenes, plans, correlations, covariances and path sums need. All else is an
extra, PyTorch too: the error of an import that fails names it.
"""

import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

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


_STUB = re.compile(r"^from \.(\S*) import (\w+) as \w+$", re.MULTILINE)


def lazy_names(
    package: str, file: str, moved: Callable[[str], str | None] = lambda name: None, unlisted: Collection[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:  # fmt: skip
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package or a module, from the names in its ``.pyi``.

    ``moved`` returns the new place of an old name, "package.name"; to use that is a ``DeprecationWarning``. Names that
    are ``unlisted`` stand in the stub alone.
    """
    stub = Path(file).with_suffix(".pyi")
    parent = package if stub.stem == "__init__" else package.rpartition(".")[0]
    modules = {name: module for module, name in _STUB.findall(stub.read_text(encoding="utf-8"))}

    def __getattr__(name: str) -> Any:
        with extras_named():
            if name in modules:
                module = import_module(f"{parent}.{modules[name] or name}")
                value = getattr(module, name) if modules[name] else module
                setattr(sys.modules[package], name, value)
                return value
            if place := None if name.startswith("_") else moved(name):
                warnings.warn(f"{package}.{name} is now {place}", DeprecationWarning, stacklevel=2)
                module, _, new = place.rpartition(".")
                return getattr(import_module(module), new)
        raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=sys.modules[package])

    listed = sorted(modules.keys() - set(unlisted))
    return __getattr__, lambda: [*listed], listed
