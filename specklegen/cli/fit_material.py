"""The command ``specklegen fit material``: a slab from tables of measured curves, and a recipe of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from specklegen.cli.output import AsJson, require_writable, show_fit
from specklegen.cli.settings import option
from specklegen.core.errors import reject
from specklegen.core.units import WAVELENGTH, quantity

if TYPE_CHECKING:
    from specklegen.measured import BallisticFraction, Transmittance

_OWNER = "fit material"
_RELATIVE = 0.02


def fit_material(
    wavelength: Annotated[float, WAVELENGTH] = option(..., "Inside the medium; fixes the unit of every length."),
    tilt: Path | None = option(None, "CSV: tilt in radians, C_I, standard error."),
    movie: Path | None = option(None, "CSV: lag, g2, standard error."),
    bandwidth: Path | None = option(None, "CSV: full width in wavenumber, contrast, standard error."),
    transmittance: str | None = option(None,
                                       "Transmitted share of the light: 0.31, or 0.31+-0.01 (default error: 2 %)."),
    ballistic: str | None = option(None, "Ballistic share of the light, such as 0.05+-0.002."),
    known: list[str] | None = option(None, "Known number, such as thickness=1000 (repeatable)."),
    free: str = option("", "Numbers to fit, separated by commas."),
    name: str = option("my-bench", "Name of the recipe."),
    out: Path | None = option(None, "TOML to write: a recipe of tilt stacks of this material."),
    picture: Path | None = option(None, "PNG to write: the residuals."),
    as_json: AsJson = False,
) -> None:
    """Fit a slab to what you measured: memory effect, transmittance, correlation in time, contrast."""
    from specklegen.measured import BallisticFraction, ContrastVersusBandwidth, MemoryCurve, TemporalCurve
    from specklegen.measured import Transmittance as Sphere
    from specklegen.models.calibration.material_fit import fit_material as fit

    require_writable(f"{_OWNER} --out", out, ".toml")
    require_writable(f"{_OWNER} --picture", picture)
    files = ((MemoryCurve, tilt), (TemporalCurve, movie), (ContrastVersusBandwidth, bandwidth))
    observations = [kind.read(file) for kind, file in files if file is not None]
    shares = ((Sphere, transmittance, "--transmittance"), (BallisticFraction, ballistic, "--ballistic"))
    observations += [_share(kind, text, flag) for kind, text, flag in shares if text is not None]
    if not observations:
        reject(f"{_OWNER}", "given measurements", "none", "Give at least one, such as --tilt FILE.")
    numbers = dict(_number(each) for each in known or [])
    names = tuple(each.strip() for each in free.split(",") if each.strip()) or tuple(
        each for each in ("thickness", "mean_free_path", "g", *(["diffusion"] if movie else [])) if each not in numbers
    )
    material = fit(observations, wavelength=wavelength, known=numbers, free=names)
    if out is not None:
        out.write_text(material.recipe(name), encoding="utf-8")
    show_fit(material, lambda: {
        "values": material.values,
        "intervals": None if material.hopeless else {str(level): material.interval(level) for level in (0.68, 0.95)},
        "chi_squared": material.chi_squared, "degrees": material.degrees, "p_value": material.p_value,
        "degenerate": material.degenerate, "doubts": material.doubts,
    }, as_json, picture, out)  # fmt: skip


def _share(
    kind: "type[Transmittance | BallisticFraction]", text: str, flag: str
) -> "Transmittance | BallisticFraction":  # fmt: skip
    value, _, error = text.replace("±", "+-").partition("+-")
    try:
        number = float(value)
        return kind(number, float(error) if error else _RELATIVE * abs(number))
    except ValueError as broken:
        if type(broken) is not ValueError:
            raise
        reject(f"{_OWNER} {flag}", "a number, or a number and its error such as 0.31+-0.01", text)


def _number(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    try:
        if sign:
            return name.strip(), value if quantity(value) else float(value)
    except ValueError:
        pass
    reject(f"{_OWNER} --known", "a name and a number such as thickness=1000", text)
