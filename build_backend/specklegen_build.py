"""The build backend: that of setuptools, with an editable install that every tool can follow.

The folders ``datasets/`` and ``models/`` stand beside ``specklegen/`` and are parts of it. setuptools maps them in an
editable install by an import hook, which type checkers cannot see. The clone holds links that make ``specklegen/``
whole, so a path entry to a folder with nothing in it but a link to ``specklegen/`` does the same, without a hook, and
leaves ``datasets``, ``models`` and ``tests`` out of everyone's way. Where a checkout has no links, setuptools' way is
taken.
"""

import base64
import hashlib
import os
import tempfile
import warnings
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (  # noqa: F401, the hooks that a front end calls
    build_sdist,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ENTRY = ".editable"
"""Folder whose path the editable install adds to Python's; git does not know it."""
_WHEEL = "Wheel-Version: 1.0\nGenerator: specklegen_build\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def build_editable(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """Make the wheel of an editable install: metadata, and a path entry."""
    root = Path.cwd()
    if not _linked(root):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a page about import hooks
            return build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    with tempfile.TemporaryDirectory() as folder:
        info = build_meta.prepare_metadata_for_build_editable(folder, config_settings)
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted((Path(folder) / info).rglob("*"))
            if path.is_file() and path.name not in ("RECORD", "WHEEL")
        }
    files["__editable__.specklegen.pth"] = f"{_entry(root)}\n".encode()
    files[f"{info}/WHEEL"] = _WHEEL.encode()
    rows = [f"{name},sha256={_digest(content)},{len(content)}" for name, content in files.items()]
    files[f"{info}/RECORD"] = "\n".join([*rows, f"{info}/RECORD,,", ""]).encode()
    name = f"{info.removesuffix('.dist-info')}-0.editable-py3-none-any.whl"
    with zipfile.ZipFile(Path(wheel_directory) / name, "w") as wheel:
        for path, content in files.items():
            wheel.writestr(path, content)
    return name


def _linked(root: Path) -> bool:
    """Whether this checkout has its links, and can have one more."""
    if not all((root / "specklegen" / part / "__init__.py").is_file() for part in ("datasets", "models")):
        return False
    try:
        _entry(root)
    except OSError:
        return False
    return True


def _entry(root: Path) -> Path:
    """Make the folder of the path entry."""
    folder = root / ENTRY
    folder.mkdir(exist_ok=True)
    link = folder / "specklegen"
    if not link.is_symlink():
        link.symlink_to(os.path.join("..", "specklegen"), target_is_directory=True)
    return folder


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
