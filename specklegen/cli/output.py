"""Output of commands: JSON, a bar with the remaining time, folders that can be written."""

import csv
import json
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
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


def require_writable(field: str, file: Path | None, suffix: str = ".png") -> None:
    """Refuse a file, if one is asked for, that has another suffix or cannot be written; call it before the work."""
    if file is None:
        return
    if file.suffix.lower() != suffix or file.is_dir():
        reject(field, f"a file whose name ends in {suffix}", str(file))
    writable(file.parent, field)


def require_left_out(command: str, reason: str, **options: Any) -> None:
    """Refuse options that are given where they have no meaning."""
    for name, value in options.items():
        if value is not None and value is not False and value != []:
            shown = str(value) if isinstance(value, Path) else value
            reject(f"{command} --{name.replace('_', '-')}", f"left out {reason}", shown)


def show_fit(result: Any, table: Callable[[], Any], as_json: bool, picture: Path | None, *files: Path | None) -> None:
    """Save the picture of a result, and print its facts and the files written, or its table as JSON."""
    if picture is not None:
        figure = result.plot().get_figure()
        assert figure is not None
        figure.savefig(picture, dpi=120)
    if as_json:
        echo_json(table())
        return
    for name, value in result.facts().items():
        typer.echo(f"{name}: {value}")
    for file in (*files, picture):
        if file is not None:
            typer.echo(str(file))


def write_csv(file: Path, header: Sequence[str], rows: Iterable[Iterable[Any]], notes: Iterable[str] = ()) -> None:
    """Write a table, below notes that begin with #; numbers get six digits."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        stream.writelines(f"# {note}\n" for note in notes)
        table = csv.writer(stream)
        table.writerow(header)
        table.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)


def writable(folder: Path, field: str = "--out") -> None:
    """Make a folder before the work starts, so that an unwritable one is found at once."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        rule = "a writable folder" if field == "--out" else "in a writable folder"
        reject(field, rule, str(folder), str(error.strerror))
