"""The command ``specklegen retrieve``: phase retrieval from camera images of a setup that nobody described."""

from pathlib import Path

import typer

from specklegen.cli.measurement_options import FrameOptions
from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import Seed
from specklegen.cli.settings import argument, option


def retrieve(
    reading: FrameOptions,
    images: list[str] = argument(..., "Camera images of one object: files, folders or patterns.", metavar="IMAGE..."),
    grain: float | None = option(None, "Speckle size, camera pixels (default: estimated from the spectrum)."),
    extent: float | None = option(None, "The object's diameter, camera pixels (default: estimated from the "
                                        "autocorrelation)."),
    noise: float | None = option(None, "Variance of camera noise over the squared mean (default: estimated from the "
                                       "image)."),
    pixel: float | None = option(None, "Camera pixels in a pixel of the result (default: 1/28 of the extent)."),
    memory_effect: Path | None = option(None, "CSV of the measured C_I: distance on the camera in pixels, C_I."),
    restarts: int = option(20, "Random starts.", min=1, max=10_000),
    seed: Seed = 0,
    out: Path = option(Path("retrieved.png"), "Picture of the result; numbers go beside it as NPY."),
    as_json: AsJson = False,
) -> None:
    """Retrieve the object behind camera images by phase retrieval; what is not given is read off the images."""
    import numpy as np
    from PIL import Image

    from specklegen.measured import read_curve
    from specklegen.models.recoverability.image_retrieval import retrieve_image
    from specklegen.models.retrieval.phase_retrieval import Retrieval

    writable(out.parent)
    found = retrieve_image(
        reading.reader()(images if len(images) > 1 else images[0]), grain=grain, extent=extent, noise=noise,
        pixel=pixel, memory_effect=None if memory_effect is None else read_curve(memory_effect),
        retrieval=Retrieval(restarts=restarts), seed=seed,
    )  # fmt: skip
    picture = np.clip(255 * found.image / found.image.max(), 0, 255).astype(np.uint8)
    Image.fromarray(np.kron(picture, np.ones((4, 4), np.uint8))).save(out)
    np.save(out.with_suffix(".npy"), found.image)
    if as_json:
        numbers = {name: getattr(found, name) for name in ("grain", "extent", "pixel", "noise", "taper", "error")}
        echo_json(numbers | {"doubts": found.measured.doubts})
        return
    for name, value in found.facts().items():
        typer.echo(f"{name}: {value}")
    for doubt in found.measured.doubts:
        typer.echo(f"doubt: {doubt}")
    typer.echo(f"{out}, {out.with_suffix('.npy')}")
