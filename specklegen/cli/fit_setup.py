"""The command ``specklegen fit-setup``: grain, iris, contrast and noise from photographs of one point's speckle."""

from pathlib import Path
from typing import Annotated

import typer

from specklegen.cli.output import AsJson, echo_json, picture_file


def fit_setup(
    photographs: Annotated[list[str], typer.Argument(help="Files, folders or patterns of frames.")],
    dark: Annotated[str | None, typer.Option(help="Frames without light, or the black level in counts.")] = None,
    profile: Annotated[str | None, typer.Option(help="Of the iris, where known: square, disc or gaussian.")] = None,
    points: Annotated[bool, typer.Option("--points", help="Pixels are points, as those of most simulations.")] = False,
    target: Annotated[
        str | None, typer.Option(help="Image of a known target that shone in place of a point: fits the range too.")
    ] = None,
    target_step: Annotated[float, typer.Option(help="Camera pixels between pixels of the target.")] = 1.0,
    picture: Annotated[Path | None, typer.Option(help="PNG to write: the spectrum, measured and fitted.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find grain, iris, contrast and noise from photographs of speckle of one point of light, or of a known target."""
    from specklegen.measured.measurement import read_measurement
    from specklegen.models.calibration.setup_fit import fit_setup as fit

    if picture is not None:
        picture_file("fit-setup --picture", picture)
    shown = None if target is None else read_measurement(target, hot_pixels=False).light[0]
    setup = fit(photographs, dark=black_level(dark), profile=profile, pixel_integration=not points, target=shown,
                target_step=target_step)  # fmt: skip
    if picture is not None:
        figure = setup.plot().get_figure()
        assert figure is not None
        figure.savefig(picture, dpi=120)
    if as_json:
        names = ("profile", "grain", "grain_error", "contrast", "contrast_error", "noise", "noise_error", "behind",
                 "p_value", "tiles", "doubts", "range")  # fmt: skip
        echo_json({name: getattr(setup, name) for name in names} | {"intervals": {"0.95": setup.interval(0.95)}})
        return
    for key, value in setup._facts().items():
        typer.echo(f"{key}: {value}")
    if picture is not None:
        typer.echo(str(picture))


def black_level(text: str | None) -> str | float | None:
    """A number, if it is one; else the name of files."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text
