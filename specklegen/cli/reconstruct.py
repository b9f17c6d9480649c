"""The command ``specklegen reconstruct``: one's own camera images, and what was behind the slab."""

import glob
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from specklegen.cli.measurement_options import FrameOptions
from specklegen.cli.output import AsJson, echo_json, json_text, writable
from specklegen.cli.recipe_options import Seed, Set, load_hidden, names_starting_with
from specklegen.cli.settings import argument, option
from specklegen.core.errors import RuleError, reject

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import torch

    from specklegen.datasets.recipes.hidden_object import HiddenObject
    from specklegen.measured import Measurement
    from specklegen.models.learning.posterior import Posterior
    from specklegen.models.likelihood.multiframe import Multiframe
    from specklegen.models.recoverability.assessment import Findings


def reconstruct(
    reading: FrameOptions,
    images: list[Path] = argument(
        ..., "Camera images: TIFF, PNG, BMP, NPY, SPE, AVI, MKV, MOV, HDF5, MATLAB.", metavar="IMAGE..."
    ),
    setup: str = option(
        ..., "Your setup: a recipe with hidden objects, packaged or as TOML (illuminated area, camera, slab, object "
             "pitch).",
        autocompletion=names_starting_with,
    ),
    out: Path = option(Path("reconstruction"), "Folder for pictures and report."),
    frames: bool = option(
        False, "All images and pages show one object through changing states of the medium.", "--frames",
    ),
    together: bool = option(
        False, "All images and pages show objects through one medium at rest.", "--together",
    ),
    memory_effect: Path | None = option(None, "CSV of the measured C_I: distance on the camera in pixels, C_I."),
    grain: float | None = option(
        None, "Speckle size in camera pixels.", show_default="the setup's, or the measured one if images contradict it"
    ),
    fit: bool | None = option(
        None, "Fit the memory-effect range (default: if the setup gives the slab by ranges).",
        "--fit-range/--no-fit-range",
    ),
    draws: int | None = option(None, "Posterior draws of each object, 0 or 2 to 64; the estimate is their mean.",
                               show_default="8; 4 above 160 pixels"),
    fast: bool = option(False, "Return the solver's image without posterior draws, in a seventh of the time.",
                        "--fast"),
    incoherent: bool = option(
        False, "Reconstruct even frames with the contrast of one field (a laser-lit object, or a single point).",
        "--incoherent",
    ),
    seed: Seed = 0,
    changes: Set = None,
    as_json: AsJson = False,
) -> None:
    """Reconstruct what is hidden behind your slab, with a confidence, and advice where it fails."""
    import numpy as np
    import torch

    from specklegen.measured import read_curve
    from specklegen.models.recoverability.assessment import reconstruct

    recipe = load_hidden(setup, changes)
    read = reading.reader()
    pictures, pages, notes, verdicts = [], [], [], []
    for path in images:
        measured = _measured(path, read, notes)
        verdicts.extend([] if together else _verdict(path.name, measured))
        found = measured.images
        if len(found) > 1 and not (frames or together):
            found = _one(path, found, notes)
        pictures.extend(found)
        pages.extend([path.stem] * len(found))
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        reject("reconstruct IMAGE", "images of one size", sorted(shapes), "Give images of one camera and region.")
    if together and (frames or memory_effect is not None or fit or draws or fast):
        reject("reconstruct --together", "given alone",
               "--frames, --memory-effect, --fit-range, --draws or --fast with it",
               "This method uses no memory effect and makes no posterior draws.")  # fmt: skip
    writable(out)
    if not incoherent and any(verdict["answer"] == "coherent object" for verdict in verdicts):
        _write_refusal(verdicts, notes, out, as_json)
        return
    stack = torch.from_numpy(np.stack(pictures))
    if together:
        _write_together(_deconvolved(stack, recipe, seed), _named(pages), notes, out, as_json)
        return
    if grain is None:
        grain, doubts = _found_grain(stack, _named(pages), recipe)
        notes.extend(doubts)
    curve = None if memory_effect is None else read_curve(memory_effect)
    given = stack[None] if frames else stack[:, None]
    found = reconstruct(given, recipe, memory_effect=curve, grain=grain, fit=fit, draws=draws, fast=fast, seed=seed)
    names = [out.name] if frames else _named(pages)
    table = _table(found, names, notes, verdicts)
    _write(found, names, table, out)
    if as_json:
        echo_json(table)
        return
    for verdict in verdicts:
        typer.echo(f"{verdict['name']}, feasibility from the frame alone (phase retrieval): {verdict['said']}")
    for note in notes:
        typer.echo(note)
    for name, each in zip(names, found.each, strict=True):
        confidence = (
            "no confidence (reason below)" if each.probability is None
            else f"confidence {each.probability:.2f} that r > 0.8 on the object's 28 x 28 pixels"
        )  # fmt: skip
        turn = "ambiguous by 180 degrees" if each.turn is None else f"right way up with probability {each.turn:.2f}"
        deviance = f"deviance {each.deviance:.3f} (the true object would have {each.expected:.3f})"
        typer.echo(f"{name}: {confidence}; {turn}; {deviance}")
        if each.draws is not None:
            agreed = f"agreement of {len(each.draws.weights[0])} posterior draws {float(each.draws.agreement[0]):.2f}"
            typer.echo(f"  {agreed}: {out / f'{name}-draws.png'}")
        for reason in each.reasons:
            typer.echo(f"  {reason.name}: {reason.numbers}\n    remedy: {reason.remedy}")
    said = f"memory-effect range, direction sine: {found.range_sine:.4g}"
    if found.fit is not None:
        said += f" (fitted; 95 %: {_between(found.range_sine / found.fit.factor, found.fit.low, found.fit.high)})"
    typer.echo(said)
    typer.echo(f"{out / 'report.json'}, {out / 'reconstructions.png'}")


def _named(stems: list[str]) -> list[str]:
    """Names of what is written, one an image: pages of a file, and files of one name, are numbered."""
    several, found = {stem for stem in stems if stems.count(stem) > 1}, []
    for n, stem in enumerate(stems, 1):
        name = f"{stem}-{stems[:n].count(stem)}" if stem in several else stem
        found.append(name if name not in found else f"{name}-{n}")
    return found


def _measured(path: Path, read: "Callable[..., Measurement]", notes: list[str]) -> "Measurement":
    """Frames of a file; pictures in colours become grey."""
    from specklegen.datasets.objects.pictures import SUFFIXES, read_grey
    from specklegen.measured.files import FRAME_FILES

    suffix = path.suffix.lower()
    if suffix not in (*FRAME_FILES, *SUFFIXES):
        known = ", ".join(sorted({*FRAME_FILES, *SUFFIXES}))
        reject("reconstruct IMAGE", f"a file that ends in {known}", str(path))
    if not (path.exists() or glob.has_magic(str(path))):
        reject("reconstruct IMAGE", "an existing file", str(path), "Check the path.")
    found, refused = None, ""
    try:
        if suffix in FRAME_FILES:
            found = read(path)
    except RuleError as error:
        if suffix not in SUFFIXES or not str(error).startswith("read_measurement source"):
            reject("reconstruct IMAGE", "frames that can be read", str(path), str(error))
        refused = str(error)
    try:
        if found is None:
            found = read(read_grey(path))  # of colours, perhaps
    except (OSError, ValueError) as error:
        why = refused.partition("'. ")[2] or refused or f"Reading it failed: {error}."
        reject("reconstruct IMAGE", "a picture that can be read", str(path), why)
    found.require_speckle(f"reconstruct IMAGE {path}")
    notes.extend(f"{path.name}: {doubt}" for doubt in found.doubts)
    if found.envelope is not None and found.envelope_order != 0:
        fitted = "as given" if found.envelope_order is None else f"fitted, order {found.envelope_order}"
        notes.append(f"{path.name}: an envelope of contrast {found.envelope.std():.2g} was divided out ({fitted})")
    return found


def _found_grain(
    stack: "torch.Tensor", names: list[str], recipe: "HiddenObject"
) -> tuple[float | None, list[str]]:
    """Grain that camera frames show, where they contradict the setup's, and what they say; else None and nothing.

    They have to show a thin medium, and to have room enough.
    """
    import math

    import numpy as np

    from specklegen.models.calibration.grain_fit import DOUBTED, LARGEST_EXTENT, SHAPES, SMALLEST_EXTENT, fit_grain
    from specklegen.models.learning.solver import EXTENT
    from specklegen.models.recoverability.assessment import setup_of

    setup = setup_of(recipe) if hasattr(recipe.material, "screens") else None
    if setup is None or setup.range_sine != float("inf") or setup.optics.profile not in SHAPES:
        return None, []
    grain, extent = float(setup.optics.grain), math.ceil(float(setup.optics.step) * EXTENT)
    short, long = sorted(stack.shape[-2:])
    if not SMALLEST_EXTENT <= extent <= LARGEST_EXTENT or short < 2 * extent or long < 4 * extent:
        return None, []
    found = fit_grain(stack, extent, setup.optics.profile)
    said = [
        f"{name}: the speckle size is {grain:.3g} pixels by the setup, but {found.grain[n]:.2f} in the image "
        f"({found.low[n]:.2f} to {found.high[n]:.2f}; {against:.0f} nats more probable)"
        for n, (name, against) in enumerate(zip(names, found.against(grain), strict=True)) if against > DOUBTED
    ]  # fmt: skip
    if not said:
        return None, []
    own = float(np.median(found.grain))
    return own, [*said, f"a speckle size of {own:.2f} pixels is used; for that of the setup, give --grain {grain:.3g}"]


def _deconvolved(stack: "torch.Tensor", recipe: "HiddenObject", seed: Seed) -> "Multiframe":
    """Objects of a setup's images, which have one medium in common; the frame has room for where they lie."""
    from specklegen.models.learning.solver import EXTENT
    from specklegen.models.likelihood.multiframe import multiframe_deconvolution
    from specklegen.models.recoverability.assessment import setup_of

    if len(stack) < 2:
        reject("reconstruct IMAGE", "two or more images, with --together", len(stack), "Give an image of each object.")
    optics, side = setup_of(recipe).optics, max(recipe.objects.shape)
    step = float(optics.step) * EXTENT / side  # between the setup's pixels, not the solver's
    size = min(side + _ROOM, int(min(stack.shape[-2:]) / step))
    return multiframe_deconvolution(stack, optics._replace(step=step), size, seed=seed)


_ROOM = 8  # object pixels, for objects that lie aside of each other
_AGREED = 0.9  # of starts: below, images were more often wrong than right (docs/notes/likelihood.md)


def _write_together(found: "Multiframe", names: list[str], notes: list[str], out: Path, as_json: bool) -> None:
    """Write report.json, one NPY an image, and all of them in one picture; say how far they are to be believed."""
    import numpy as np
    from PIL import Image

    table = {"notes": notes, "names": names, "agreement": found.agreement, "explained": found.explained}
    (out / "report.json").write_text(json_text(table))
    for name, image in zip(names, found.image.numpy(), strict=True):
        np.save(out / f"{name}.npy", image)
    row = np.clip(255 * np.hstack([*found.image.numpy()]), 0, 255).astype(np.uint8)
    Image.fromarray(np.kron(row, np.ones((4, 4), np.uint8))).save(out / "reconstructions.png")
    if as_json:
        echo_json(table)
        return
    for note in notes:
        typer.echo(note)
    believed = "" if found.agreement >= _AGREED else (
        ". This is too low to trust the images. Check that all frames show one medium at rest, and that objects are "
        "within its memory effect and at most a fifth of the camera wide."
    )  # fmt: skip
    typer.echo(
        f"{len(names)} objects through one medium: explained power {found.explained:.2f}, "
        f"agreement of searches {found.agreement:.2f}{believed}"
    )
    typer.echo(f"{out / 'report.json'}, {out / 'reconstructions.png'}")


def _verdict(name: str, measured: "Measurement") -> list[dict]:
    """Return the feasibility of the camera frame; an empty list if the frame is too small for it."""
    from specklegen.models.recoverability.photograph import LEAST, judge_photograph

    if min(measured.light.shape[1:]) < LEAST:
        return []
    found = judge_photograph(measured)
    return [{"name": name, "answer": found.answer, "probability": found.probability, "interval": found.interval,
             "frames_needed": found.frames_needed, "said": found.headline,
             "remedies": [each.remedy for each in found.reasons]}]  # fmt: skip


def _write_refusal(verdicts: list[dict], notes: list[str], out: Path, as_json: bool) -> None:
    """Write report.json without an image, and say which frames are speckle of one field, why, and what to do."""
    table = {"notes": notes, "photographs": verdicts, "images": []}
    (out / "report.json").write_text(json_text(table))
    if as_json:
        echo_json(table)
        return
    for verdict in verdicts:
        typer.echo(f"{verdict['name']}: {verdict['said']}")
        for remedy in verdict["remedies"] if verdict["answer"] == "coherent object" else ():
            typer.echo(f"  remedy: {remedy}")
    for note in notes:
        typer.echo(note)
    typer.echo(
        "No image was reconstructed: the solver and the packaged networks know objects whose intensities add. "
        "To run them all the same, add --incoherent; to reconstruct the other frames, leave these out."
    )
    typer.echo(str(out / "report.json"))


def _one(path: Path, frames: "np.ndarray", notes: list[str]) -> "np.ndarray":
    """Mean of frames of one pattern, light[1, h, w]; of frames of many it would be no pattern at all."""
    import numpy as np

    first, *rest = frames.reshape(len(frames), -1)
    alike = float(np.mean([np.corrcoef(first, other)[0, 1] for other in rest]))
    if not alike >= _ONE_PATTERN:
        reject("reconstruct IMAGE", "one frame, or frames of one pattern",
               f"{len(frames)} frames that correlate by {alike:.2f}",
               "Add --frames if they show one object through changing states of the medium.")  # fmt: skip
    notes.append(
        f"{path.name}: its {len(frames)} frames show one pattern (correlation {alike:.2f}), so their mean is used"
    )
    return frames.mean(axis=0, keepdims=True)


_ONE_PATTERN = 0.5  # correlation of frames from which on their mean still shows the pattern of each


def _between(unit: float, low: float, high: float) -> str:
    """Interval in words: open where it has no end."""
    if low > 0 and high < float("inf"):
        return f"{unit * low:.4g} to {unit * high:.4g}"
    return f"above {unit * low:.4g}" if low > 0 else f"below {unit * high:.4g}" if high < float("inf") else "any"


def _table(found: "Findings", names: list[str], notes: list[str], verdicts: list[dict]) -> dict:
    fit = found.fit
    return {
        "range_sine": found.range_sine,
        "notes": notes,
        "photographs": verdicts,
        "fit": None if fit is None else {
            "factor": fit.factor, "low": fit.low or None, "high": None if fit.high == float("inf") else fit.high,
        },
        "images": [
            {"name": name, "probability": each.probability, "deviance": each.deviance, "expected": each.expected,
             "turn": each.turn, "draws": None if each.draws is None else _said(each.draws),
             "speckle": each.speckle._asdict(), "reasons": [reason._asdict() for reason in each.reasons]}
            for name, each in zip(names, found.each, strict=True)
        ],
    }  # fmt: skip


def _said(drawn: "Posterior") -> dict:
    return {"weights": drawn.weights[0].tolist(), "agreement": float(drawn.agreement[0]),
            "excess": drawn.excess[0].tolist()}  # fmt: skip


def _write(found: "Findings", names: list[str], table: dict, out: Path) -> None:
    """Write report.json, one NPY an image, and all of them in one picture; of draws a file and a picture an image.

    The picture shows the mean of the draws, how certain each pixel is, and the draws, the best first.
    """
    import numpy as np
    from PIL import Image

    (out / "report.json").write_text(json_text(table))
    for name, each in zip(names, found.each, strict=True):
        np.save(out / f"{name}.npy", each.image)
        if each.draws is not None:
            own = each.draws
            np.savez(out / f"{name}-draws.npz", draws=own.draws[0], weights=own.weights[0], mean=own.mean[0],
                     certain=own.certain[0])  # fmt: skip
            shown = np.hstack([own.mean[0].numpy(), own.certain[0].numpy(), *own.draws[0].numpy()])
            picture = np.kron(np.clip(255 * shown, 0, 255).astype(np.uint8), np.ones((4, 4), np.uint8))
            Image.fromarray(picture).save(out / f"{name}-draws.png")
    row = np.clip(255 * np.hstack([each.image for each in found.each]), 0, 255).astype(np.uint8)
    Image.fromarray(np.kron(row, np.ones((4, 4), np.uint8))).save(out / "reconstructions.png")
