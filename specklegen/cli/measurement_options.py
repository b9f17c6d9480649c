"""Options of commands that read a laboratory's frames: what belongs to them, in the words of ``read_measurement``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.measured import Measurement

Dark = Annotated[list[str] | None, typer.Option(help="Frames without light: files, folders or patterns.")]
Flat = Annotated[list[str] | None, typer.Option(help="Frames of even light, which pixels' sensitivity is read off.")]
Envelope = Annotated[str, typer.Option(help='Envelope of the light: "fit", "none", or a file with an image of it.')]
RegionOption = Annotated[
    str | None, typer.Option("--region", help='Part of the frame: "find" what is lit, or top,left,height,width.')
]
Keep = Annotated[str | None, typer.Option(help="Frames of a file that are kept, such as 3 or 0:10.")]
Variable = Annotated[str | None, typer.Option(help="Array in a MATLAB or HDF5 file that has several.")]


def reader(
    dark: list[str] | None, flat: list[str] | None, envelope: str, region: str | None, keep: str | None,
    variable: str | None, background: float = 0.0,
) -> Callable[[Any], "Measurement"]:  # fmt: skip
    """Reader of frames with what these options say; ``background`` is the black level without dark frames.

    Raises
    ------
    RuleError
        If an option cannot be what it should.
    """
    from specklegen.measured import read_measurement

    if dark and background:
        reject("--background", "0 with --dark", background, "Dark frames say what the black level is.")
    options: dict[str, Any] = {
        "dark": dark or background, "flat": flat or None, "envelope": None if envelope == "none" else envelope,
        "region": _region(region), "frames": _frames(keep), "variable": variable,
    }  # fmt: skip

    def read(source: str | Path | Sequence[str | Path] | Any) -> "Measurement":
        return read_measurement(source, **options)

    return read


def _region(text: str | None) -> "str | list[int] | None":
    if text is None or text == "find":
        return text
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        reject("--region", '"find", or four whole numbers: top,left,height,width', text)


def _frames(text: str | None) -> "int | slice | None":
    if text is None:
        return None
    try:
        ends = [int(part) if part.strip() else None for part in text.split(":")]
        if len(ends) == 1 and ends[0] is not None:
            return ends[0]
        if 2 <= len(ends) <= 3:
            return slice(*ends)
    except ValueError:
        pass
    reject("--keep", "a number of a frame, or first:last such as 0:10", text)
