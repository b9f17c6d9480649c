"""The command ``specklegen reconstruct``: one's own camera images, and what was behind the slab."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import Seed, Set, load_hidden, names_starting_with
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.models.recoverability.after_image import Findings


def reconstruct(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Camera images: TIFF, PNG or NPY.")],
    bench: Annotated[
        str,
        typer.Option(
            help="Your bench: a recipe with hidden objects, packaged or as TOML (window, camera, slab, object pitch).",
            autocompletion=names_starting_with,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for pictures and report.")] = Path("reconstruction"),
    frames: Annotated[
        bool, typer.Option("--frames", help="The images are frames of one object through other states of the medium.")
    ] = False,
    background: Annotated[float, typer.Option(help="Image value without light, taken off first.")] = 0.0,
    fit: Annotated[
        bool | None,
        typer.Option("--fit-range/--no-fit-range", help="Fit the memory-effect range (default: of slabs in ranges)."),
    ] = None,
    seed: Seed = 0,
    changes: Set = None,
    as_json: AsJson = False,
) -> None:
    """Reconstruct what is hidden behind your slab, with a certificate, and what would help where it fails."""
    import numpy as np
    import torch

    from specklegen.datasets.objects.pictures import SUFFIXES, read_grey
    from specklegen.models.recoverability.after_image import see_through

    recipe = load_hidden(bench, changes)
    pictures = []
    for path in images:
        if path.suffix.lower() not in SUFFIXES:
            reject("reconstruct IMAGE", f"a file that ends in {', '.join(SUFFIXES)}", str(path))
        try:
            pictures.append(read_grey(path) - background)
        except (OSError, ValueError) as error:
            reject("reconstruct IMAGE", "a picture that can be read", str(path), f"It cannot: {error}.")
    shapes = {picture.shape for picture in pictures}
    if len(shapes) > 1:
        reject("reconstruct IMAGE", "of one size", sorted(shapes), "Give images of one camera.")
    writable(out)
    stack = torch.from_numpy(np.stack(pictures))
    found = see_through(stack[None] if frames else stack[:, None], recipe, fit=fit, seed=seed)
    names = [out.name] if frames else [path.stem for path in images]
    _write(found, names, out)
    if as_json:
        echo_json(_table(found, names))
        return
    for name, each in zip(names, found.each, strict=True):
        typer.echo(
            f"{name}: right (correlation above 0.8) with probability {each.probability:.2f}; "
            f"deviance {each.deviance:.3f}, of the true object {each.expected:.3f}"
        )
        for reason in each.reasons:
            typer.echo(f"  {reason.name}: {reason.numbers}\n    remedy: {reason.remedy}")
    said = f"memory-effect range, direction sine: {found.range_sine:.4g}"
    if found.fit is not None:
        ratio = found.range_sine / found.fit.factor
        said += f" (fitted; 95 %: {ratio * found.fit.low:.4g} to {ratio * found.fit.high:.4g})"
    typer.echo(said)
    typer.echo(f"{out / 'report.json'}, {out / 'reconstructions.png'}")


def _table(found: "Findings", names: list[str]) -> dict:
    fit = found.fit
    return {
        "range_sine": found.range_sine,
        "fit": None if fit is None else {"factor": fit.factor, "low": fit.low, "high": fit.high},
        "images": [
            {"name": name, "probability": each.probability, "deviance": each.deviance, "expected": each.expected,
             "reasons": [reason._asdict() for reason in each.reasons]}
            for name, each in zip(names, found.each, strict=True)
        ],
    }  # fmt: skip


def _write(found: "Findings", names: list[str], out: Path) -> None:
    """Write report.json, one NPY an image, and all of them in one picture."""
    import json

    import numpy as np
    from PIL import Image

    (out / "report.json").write_text(json.dumps(_table(found, names), indent=2))
    for name, each in zip(names, found.each, strict=True):
        np.save(out / f"{name}.npy", each.image)
    row = np.clip(255 * np.hstack([each.image for each in found.each]), 0, 255).astype(np.uint8)
    Image.fromarray(np.kron(row, np.ones((4, 4), np.uint8))).save(out / "reconstructions.png")
