"""The command ``specklegen fit camera``: gain, read noise, offset, full well and bits from pairs of frames."""

import glob
import re
from pathlib import Path
from typing import TYPE_CHECKING

from specklegen.cli.output import AsJson, require_writable, show_fit
from specklegen.cli.settings import Generated, option
from specklegen.core.errors import reject

if TYPE_CHECKING:
    import numpy as np


class ManyFiles(Generated):
    """A command whose options take as many files as a shell makes of a pattern: ``--dark dark_*.tif``."""

    def parse_args(self, ctx, args):  # noqa: D102
        spread, several = [], None
        for word in args:
            if word.startswith("--"):
                several = word if word in ("--pairs", "--dark") else None
                spread.append(word)
            elif several is not None and spread[-1] != several:
                spread += [several, word]
            else:
                spread.append(word)
        return super().parse_args(ctx, spread)


def fit_camera(
    pairs: list[str] = option(
        ..., "Pairs of frames, each pair under equal light, in the order of names; file types as of `reconstruct`.",
    ),
    dark: list[str] = option(..., "At least two frames without light."),
    out: Path | None = option(None, "TOML to write: the table [exposure] of a recipe."),
    picture: Path | None = option(None, "PNG to write: the photon transfer curve."),
    bit_depth: int | None = option(None, "Bits of a count, if known.", min=1, max=16),
    as_json: AsJson = False,
) -> None:
    """Fit your camera to pairs of frames at several levels of light, and to dark frames."""
    import numpy as np

    from specklegen.instrument import fit_camera as fit

    require_writable("fit camera --out", out, ".toml")
    require_writable("fit camera --picture", picture)
    bright = _frames("--pairs", pairs)
    if len(bright) % 2:
        reject("fit camera --pairs", "an even number of frames", len(bright),
               "Take two frames at each light level, one after the other.")
    both = [np.stack(bright[n : n + 2]) for n in range(0, len(bright), 2)]
    camera = fit(both, np.stack(_frames("--dark", dark)), bit_depth=bit_depth)
    if out is not None:
        out.write_text(camera.to_toml(), encoding="utf-8")
    names = ("gain", "read_noise", "offset", "full_well")
    show_fit(camera, lambda: camera.table | {f"{name}_error": getattr(camera, f"{name}_error") for name in names} | {
        "chi_squared": camera.chi_squared, "degrees": camera.degrees, "doubts": camera.doubts,
        "levels": [level._asdict() for level in camera.levels],
    }, as_json, picture, out)  # fmt: skip


def _frames(flag: str, patterns: list[str]) -> "list[np.ndarray]":
    """All frames of the files that the patterns name, in the order of their names, numbers by value."""
    from specklegen.measured.files import read_raw

    names = sorted(
        {name for pattern in patterns for name in (glob.glob(pattern) or [pattern])},
        key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)],
    )
    return list(read_raw(f"fit camera {flag}", names).frames)
