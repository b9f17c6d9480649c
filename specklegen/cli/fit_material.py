"""The command ``specklegen fit-material``: a slab from tables of measured curves, and a recipe of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from specklegen.cli.output import AsJson, echo_json, picture_file, writable
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.measured import BallisticFraction, Transmittance

_OWNER = "fit-material"
_RELATIVE = 0.02


def fit_material(
    wavelength: Annotated[float, typer.Option(help="Inside the medium; fixes the unit of every length.")],
    tilt: Annotated[Path | None, typer.Option(help="CSV: tilt in radians, C_I, standard error.")] = None,
    movie: Annotated[Path | None, typer.Option(help="CSV: lag, g2, standard error.")] = None,
    bandwidth: Annotated[
        Path | None, typer.Option(help="CSV: full width in wavenumber, contrast, standard error.")
    ] = None,
    transmittance: Annotated[
        str | None, typer.Option(help="Share of the light that leaves behind: .31, or .31+-.01 (else +- 2 %).")
    ] = None,
    ballistic: Annotated[
        str | None, typer.Option(help="Share of the light that goes straight through, such as .05+-.002.")
    ] = None,
    known: Annotated[list[str] | None, typer.Option(help="What is known, such as thickness=1000.")] = None,
    free: Annotated[str, typer.Option(help="What is to be found, apart by commas.")] = "",
    name: Annotated[str, typer.Option(help="Of the recipe.")] = "my-bench",
    out: Annotated[Path | None, typer.Option(help="TOML to write: a recipe of tilt stacks of this material.")] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG to write: the residuals.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a slab to what you measured: memory effect, transmittance, correlation in time, contrast."""
    from specklegen.measured import BallisticFraction, ContrastVersusBandwidth, MemoryCurve, TemporalCurve
    from specklegen.measured import Transmittance as Sphere
    from specklegen.models.calibration.material_fit import fit_material as fit

    if out is not None:
        if out.suffix.lower() != ".toml" or out.is_dir():
            reject(f"{_OWNER} --out", "a file whose name ends in .toml", str(out))
        writable(out.parent, f"{_OWNER} --out")
    if picture is not None:
        picture_file(f"{_OWNER} --picture", picture)
    files = ((MemoryCurve, tilt), (TemporalCurve, movie), (ContrastVersusBandwidth, bandwidth))
    observations = [kind.read(file) for kind, file in files if file is not None]
    shares = ((Sphere, transmittance, "--transmittance"), (BallisticFraction, ballistic, "--ballistic"))
    observations += [_share(kind, text, option) for kind, text, option in shares if text is not None]
    if not observations:
        reject(f"{_OWNER}", "given measurements", "none", "Name a file by --tilt, say.")
    numbers = dict(_number(each) for each in known or [])
    names = tuple(each.strip() for each in free.split(",") if each.strip()) or tuple(
        each for each in ("thickness", "mean_free_path", "g", *(["diffusion"] if movie else [])) if each not in numbers
    )
    material = fit(observations, wavelength=wavelength, known=numbers, free=names)
    if out is not None:
        out.write_text(material.recipe(name), encoding="utf-8")
    if picture is not None:
        figure = material.plot().get_figure()
        assert figure is not None
        figure.savefig(picture, dpi=120)
    if as_json:
        echo_json({
            "values": material.values, "intervals": {"0.68": material.interval(0.68), "0.95": material.interval(0.95)},
            "chi_squared": material.chi_squared, "degrees": material.degrees, "p_value": material.p_value,
            "degenerate": material.degenerate, "doubts": material.doubts,
        })  # fmt: skip
        return
    for key, value in material._facts().items():
        typer.echo(f"{key}: {value}")
    for file in (out, picture):
        if file is not None:
            typer.echo(str(file))


def _share(
    kind: "type[Transmittance | BallisticFraction]", text: str, option: str
) -> "Transmittance | BallisticFraction":  # fmt: skip
    value, _, error = text.replace("±", "+-").partition("+-")
    try:
        number = float(value)
        return kind(number, float(error) if error else _RELATIVE * abs(number))
    except ValueError as broken:
        if type(broken) is not ValueError:
            raise
        reject(f"{_OWNER} {option}", "a number, or a number and its error such as .31+-.01", text)


def _number(text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    try:
        if sign:
            return name.strip(), float(value)
    except ValueError:
        pass
    reject(f"{_OWNER} --known", "a name and a number such as thickness=1000", text)
