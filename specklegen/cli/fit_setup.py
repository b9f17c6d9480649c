"""The command ``specklegen fit setup``: speckle size, aperture, contrast and noise from frames of a point source."""

from pathlib import Path

from specklegen.cli.output import AsJson, require_writable, show_fit
from specklegen.cli.settings import argument, option


def fit_setup(
    frames: list[str] = argument(..., "Files, folders or patterns of frames.", metavar="FRAME..."),
    dark: str | None = option(None, "Frames without light, or the black level in counts."),
    profile: str | None = option(None, "Shape of the aperture, if known: square, disc or gaussian."),
    points: bool = option(False, "Treat pixels as points, as most simulations do.", "--points"),
    target: str | None = option(None, "Image of a known target in place of the point source: fits the memory-effect "
                                      "range too."),
    target_step: float = option(1.0, "Camera pixels for each pixel of the target."),
    picture: Path | None = option(None, "PNG to write: the spectrum, measured and fitted."),
    as_json: AsJson = False,
) -> None:
    """Fit speckle size, aperture, contrast and noise to frames of one point source, or of a known target."""
    from specklegen.measured.measurement import read_measurement
    from specklegen.models.calibration.setup_fit import fit_setup as fit

    require_writable("fit setup --picture", picture)
    shown = None if target is None else read_measurement(target, hot_pixels=False).light[0]
    setup = fit(frames, dark=black_level(dark), profile=profile, pixel_integration=not points, target=shown,
                target_step=target_step)  # fmt: skip
    names = ("profile", "grain", "grain_error", "contrast", "contrast_error", "noise", "noise_error", "behind",
             "p_value", "tiles", "doubts", "range")  # fmt: skip
    table = {name: getattr(setup, name) for name in names}
    show_fit(setup, lambda: table | {"intervals": {"0.95": setup.interval(0.95)}}, as_json, picture)


def black_level(text: str | None) -> str | float | None:
    """A number, if it is one; else the name of files."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text
