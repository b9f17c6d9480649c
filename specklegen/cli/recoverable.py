"""The command ``specklegen check recoverable``: feasibility of phase retrieval for a scene or camera frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from specklegen.cli.fit_setup import black_level
from specklegen.cli.output import AsJson, echo_json, require_left_out
from specklegen.cli.recipe_options import Images, Seed, Set, load_hidden, names_starting_with
from specklegen.cli.settings import argument, option
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.instrument import Camera


def recoverable(
    what: list[str] = argument(
        ..., "A packaged recipe or a TOML file; or camera images: files, folders or patterns of frames.",
        metavar="RECIPE | IMAGES...", autocompletion=names_starting_with,
    ),
    compensation: bool = option(True, "Divide the autocorrelation by the material's C_I."),
    beam: float | None = option(None, "Sigma of a Gaussian envelope on the camera, in camera sides (default: even)."),
    removal: float = option(0.0, "Sigma of the local mean that removes the envelope, in camera sides; 0: not removed."),
    media: int = option(4, "Media to draw, if the recipe has ranges.", min=1, max=10_000),
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    dark: str | None = option(None, "For camera images: frames without light, or the black level in counts."),
    camera: Path | None = option(None, "For camera images: TOML with a table [exposure], as `fit camera` writes."),
    as_json: AsJson = False,
) -> None:  # fmt: skip
    """Predict whether phase retrieval can reconstruct objects of a recipe or of camera frames, with remedies.

    Camera frames need no description of the setup: they are analysed, and nothing is simulated.
    """
    from specklegen.models.recoverability.verdict import recoverable as predict

    if _are_photographs(what):
        require_left_out("recoverable", "with camera images", beam=beam, set=changes, images=images)
        _photographs(what, dark, camera, as_json)
        return
    require_left_out("recoverable", "with a recipe, which has its camera", dark=dark, camera=camera)
    if beam is not None and not beam > 0:
        reject("--beam", "greater than 0", beam)
    if not 0 <= removal < float("inf"):
        reject("--removal", "at least 0 and finite", removal)
    loaded = load_hidden(what[0], changes, images)
    verdict = predict(loaded, compensation=compensation, beam=float("inf") if beam is None else beam, removal=removal,
                      media=media, seed=seed)  # fmt: skip
    if as_json:
        echo_json({
            "works": verdict.works, "probability": verdict.probability, "interval": verdict.interval,
            "numbers": verdict.numbers,
            "extrapolates": verdict.extrapolates, "reasons": [reason._asdict() for reason in verdict.reasons],
        })  # fmt: skip
    else:
        typer.echo(verdict.explain())


def _are_photographs(what: list[str]) -> bool:
    """Return whether the words are files of frames, and no recipe."""
    from specklegen.datasets import recipe_names
    from specklegen.measured.files import FRAME_FILES

    first = Path(what[0])
    frames = (*FRAME_FILES, ".jpg", ".jpeg", ".mp4")  # the last are refused by who reads them, with the reason
    return len(what) > 1 or (what[0] not in recipe_names() and (
        first.suffix.lower() in frames or any(sign in what[0] for sign in "*?[") or first.is_dir()
    ))  # fmt: skip


def _photographs(what: list[str], dark: str | None, camera: Path | None, as_json: bool) -> None:
    from specklegen.models.recoverability.photograph import judge_photograph

    found = judge_photograph(what, dark=black_level(dark), camera=None if camera is None else _camera(camera))
    if as_json:
        told: dict[str, Any] = {
            "answer": found.answer, "probability": found.probability, "interval": found.interval,
            "frames_needed": found.frames_needed, "numbers": found.numbers, "evidence": found.evidence,
            "reasons": [reason._asdict() for reason in found.reasons], "assumed": found.assumed,
            "doubts": found.measured.doubts,
        }  # fmt: skip
        echo_json(told)
    else:
        typer.echo(found.explain())


def _camera(file: Path) -> "Camera":
    from specklegen.core.tables import read_text, toml_table
    from specklegen.instrument import Camera

    table = toml_table(read_text(file, "recoverable --camera"), f"camera {file}")
    fields = table.get("exposure", table)
    if not isinstance(fields, dict):
        reject("recoverable --camera", "a file with a table [exposure]", str(file))
    return Camera(**{"photons": 1.0} | fields)
