"""The command ``specklegen fit twin``: sim-to-real check of camera frames."""

from pathlib import Path

from specklegen.cli.fit_setup import black_level
from specklegen.cli.output import AsJson, require_writable, show_fit
from specklegen.cli.settings import argument, option


def twin(
    frames: list[str] = argument(..., "Files, folders or patterns of frames.", metavar="FRAME..."),
    setup: str | None = option(None, "Recipe to compare with (default: speckle of one point, fitted)."),
    images: int = option(64, "Number of images, or stacks, to simulate."),
    dark: str | None = option(None, "Frames without light, or the black level in counts."),
    envelope: str | None = option(None, "\"fit\", or an image of the light's envelope."),
    points: bool = option(False, "Treat pixels as points, as most simulations do.", "--points"),
    seed: int = option(0, "Random seed of the simulated images."),
    out: Path | None = option(None, "TOML to write: the recipe, with intervals."),
    picture: Path | None = option(None, "PNG to write: your image beside ten simulated ones."),
    as_json: AsJson = False,
) -> None:
    """Compare camera frames with simulated ones, and list differences with possible causes."""
    from specklegen.models.calibration.twin import twin as compare

    require_writable("twin --picture", picture)
    comparison = compare(frames, setup, images=images, envelope=envelope, dark=black_level(dark),
                         pixel_integration=not points, seed=seed)  # fmt: skip
    if out is not None:
        out.write_text(comparison.recipe, encoding="utf-8")
    names = ("verdict", "p_value", "images", "simulated", "recipe", "assumed", "doubts")
    show_fit(comparison, lambda: {name: getattr(comparison, name) for name in names} | {
        "compared": [each._asdict() for each in comparison.compared],
    }, as_json, picture, out)  # fmt: skip
