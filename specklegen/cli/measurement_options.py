"""Options of commands that read a laboratory's frames: what belongs to them, in the words of ``read_measurement``."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from specklegen.cli.settings import option
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.measured import Measurement


@dataclass(frozen=True)
class FrameOptions:
    """Frames of a laboratory, and how they are read."""

    background: float = option(0.0, "Black level in counts, subtracted first.")
    dark: list[str] | None = option(None, "Frames without light: files, folders or patterns.")
    flat: list[str] | None = option(None, "Frames under even light, for the sensitivity of pixels.")
    envelope: str = option("fit", 'Envelope of the light: "fit", "none", or a file with an image of it.')
    region: str | None = option(None, 'Part of the frame: "find" (the illuminated part), or top,left,height,width.')
    keep: str | None = option(None, "Frames to use of each file, such as 3 or 0:10.")
    variable: str | None = option(None, "Name of the array, if a MATLAB or HDF5 file has several.")

    def reader(self) -> Callable[[Any], "Measurement"]:
        """Return a function that reads frames as these options say; refuse options that do not go together."""
        from specklegen.measured import read_measurement

        if self.dark and self.background:
            reject("--background", "0 with --dark", self.background,
                   "Dark frames already give the black level: leave out one of the two.")
        options: dict[str, Any] = {
            "dark": self.dark or self.background, "flat": self.flat or None,
            "envelope": None if self.envelope == "none" else self.envelope,
            "region": _region(self.region), "frames": _frames(self.keep), "variable": self.variable,
        }  # fmt: skip
        return lambda source: read_measurement(source, **options)


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
