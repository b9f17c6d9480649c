"""What commands show: JSON, a bar with the remaining time, folders that can be written."""

import json
import tempfile
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from specklegen.core.errors import reject

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of words.")]


def json_text(value: Any) -> str:
    """Write a value as JSON; numbers that are not finite, which JSON has no word for, become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False)


def echo_json(value: Any) -> None:
    """Print a value as JSON; see :func:`json_text`."""
    typer.echo(json_text(value))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # of NumPy
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


class Progress:
    """A bar with the remaining time, fed by (done, total)."""

    def __init__(self, total: int) -> None:
        from tqdm import tqdm

        self.bar = tqdm(total=total, unit="sample", disable=None)
        self.first: int | None = None
        self.done = 0

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *exception: object) -> None:
        self.bar.close()

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` samples are there."""
        if self.first is None:
            self.first = self.bar.initial = done
        self.bar.total = total
        self.bar.update(done - self.done)
        self.done = done


def picture_file(field: str, file: Path) -> None:
    """Check where a picture is to go, before the work starts.

    Raises
    ------
    RuleError
        If its name is not that of a PNG, or its folder cannot be written.
    """
    if file.suffix.lower() != ".png" or file.is_dir():
        reject(field, "a file whose name ends in .png", str(file))
    writable(file.parent, field)


def writable(folder: Path, field: str = "--out") -> None:
    """Make a folder before the work starts, so that an unwritable one is found at once."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        rule = "a writable folder" if field == "--out" else "in a writable folder"
        reject(field, rule, str(folder), str(error.strerror))
