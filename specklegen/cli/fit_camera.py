"""The command ``specklegen fit-camera``: gain, read noise, offset, full well and bits from pairs of frames."""

import glob
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperCommand

from specklegen.cli.output import AsJson, echo_json, picture_file, writable
from specklegen.core.errors import reject

if TYPE_CHECKING:
    import numpy as np


class ManyFiles(TyperCommand):
    """A command whose options take as many files as a shell makes of a pattern: ``--dark dark_*.tif``."""

    def parse_args(self, ctx, args):  # noqa: D102
        spread, option = [], None
        for word in args:
            if word.startswith("--"):
                option = word if word in ("--pairs", "--dark") else None
                spread.append(word)
            elif option is not None and spread[-1] != option:
                spread += [option, word]
            else:
                spread.append(word)
        return super().parse_args(ctx, spread)


def fit_camera(
    pairs: Annotated[
        list[str],
        typer.Option(help="Frames in pairs of one light each, in the order of their names; files as of `reconstruct`."),
    ],
    dark: Annotated[list[str], typer.Option(help="At least two frames without light.")],
    out: Annotated[Path | None, typer.Option(help="TOML to write: the table [exposure] of a recipe.")] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG to write: the photon transfer curve.")] = None,
    bit_depth: Annotated[int | None, typer.Option(min=1, max=16, help="Bits of a count, where known.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit your camera to pairs of frames at several levels of light, and to dark frames."""
    import numpy as np

    from specklegen.instrument import fit_camera as fit

    if out is not None:
        if out.suffix.lower() != ".toml" or out.is_dir():
            reject("fit-camera --out", "a file whose name ends in .toml", str(out))
        writable(out.parent, "fit-camera --out")
    if picture is not None:
        picture_file("fit-camera --picture", picture)
    bright = _frames("--pairs", pairs)
    if len(bright) % 2:
        reject("fit-camera --pairs", "an even number of frames", len(bright), "Two of each light, one after the other.")
    both = [np.stack(bright[n : n + 2]) for n in range(0, len(bright), 2)]
    camera = fit(both, np.stack(_frames("--dark", dark)), bit_depth=bit_depth)
    if out is not None:
        out.write_text(camera.to_toml(), encoding="utf-8")
    if picture is not None:
        figure = camera.plot().get_figure()
        assert figure is not None
        figure.savefig(picture, dpi=120)
    if as_json:
        names = ("gain", "read_noise", "offset", "full_well")
        errors = {f"{name}_error": getattr(camera, f"{name}_error") for name in names}
        echo_json(camera.table | errors | {
            "chi_squared": camera.chi_squared, "degrees": camera.degrees, "doubts": camera.doubts,
            "levels": [level._asdict() for level in camera.levels],
        })  # fmt: skip
        return
    for name, value in camera._facts().items():
        typer.echo(f"{name}: {value}")
    for file in (out, picture):
        if file is not None:
            typer.echo(str(file))


def _frames(option: str, patterns: list[str]) -> "list[np.ndarray]":
    """All frames of the files that the patterns name, in the order of their names, numbers by value."""
    from specklegen.measured.files import read_raw

    names = sorted(
        {name for pattern in patterns for name in (glob.glob(pattern) or [pattern])},
        key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)],
    )
    return list(read_raw(f"fit-camera {option}", names).frames)
