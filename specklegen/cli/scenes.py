"""The commands about one scene: ``specklegen render`` and ``specklegen memory-effect``."""

import csv
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import Seed
from specklegen.core.errors import reject
from specklegen.core.tables import read_text

if TYPE_CHECKING:
    from specklegen.scene.media import Slab
    from specklegen.scene.scene import Scene

Sampler = Literal["auto", "paths", "stationary", "covariance"]
Wavelength = Annotated[float, typer.Option(help="Inside the medium; fixes the unit of every length.")]
Thickness = Annotated[float, typer.Option(help="Thickness of the slab.")]
OpticalDepth = Annotated[float, typer.Option(help="Thickness over mean free path.")]
Albedo = Annotated[float, typer.Option(help="Share of collisions that scatter.")]

_OF_THE_SCENE = (
    "wavelength", "thickness", "optical_depth", "g", "albedo", "width", "tilts", "step", "views", "pitch",
)  # fmt: skip
"""Options of `render` that a scene's file holds instead."""


def render(
    context: typer.Context,
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: Annotated[float, typer.Option("--g", help="Anisotropy of scattering, -1 < g < 1.")] = 0.9,
    albedo: Albedo = 1.0,
    width: Annotated[float, typer.Option(help="Side of the illuminated square.")] = 50_000.0,
    tilts: Annotated[int, typer.Option(min=1, max=100_000, help="Number of tilts.")] = 5,
    step: Annotated[float, typer.Option(help="Angle between tilts, degrees.")] = 0.0025,
    views: Annotated[int, typer.Option(min=1, max=100_000, help="Views along each side of the image.")] = 128,
    pitch: Annotated[
        float | None, typer.Option(help="Direction sine between views (default: a third of a grain).")
    ] = None,
    paths: Annotated[int | None, typer.Option(min=1, help="Random paths to trace (default 100000).")] = None,
    rel_error: Annotated[float | None, typer.Option(help="Instead of --paths: relative error to reach.")] = None,
    sampler: Annotated[Sampler, typer.Option(help="How fields are drawn.")] = "auto",
    scene: Annotated[Path | None, typer.Option(help="A scene as TOML or JSON, instead of the options above.")] = None,
    seed: Seed = 0,
    mean: Annotated[bool, typer.Option(help="Add the mean (ballistic) field.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for stack.npz, stack.png and scene.toml.")] = Path("render"),
) -> None:
    """Render one stack of correlated speckle; write it as NPZ, with a picture and its scene."""
    import numpy as np

    import specklegen as sg
    from specklegen.pictures import stack_sheet

    if scene is not None:
        _require_unsaid(context, scene)
        built = scene_in(scene)
    else:
        if not width > 0:
            reject("--width", "greater than 0", width)
        built = sg.Scene(
            wavelength=wavelength,
            medium=slab(thickness, optical_depth, g, albedo),
            illumination=sg.CollimatedBeams.tilts(np.deg2rad(step) * np.arange(tilts), width=width),
            sensor=sg.FarField.grid((views, views), pitch if pitch is not None else wavelength / width / 3),
        )
    writable(out)
    typer.echo(sg.plan(built, paths=paths, rel_error=rel_error, sampler=sampler, mean=mean).explain())
    begin = time.perf_counter()
    stack = sg.render(built, paths=paths, rel_error=rel_error, sampler=sampler, seed=seed, mean=mean)
    took = time.perf_counter() - begin
    (out / "scene.toml").write_text(built.to_toml(), encoding="utf-8")
    coherent = isinstance(built.illumination, sg.CollimatedBeams)
    images = stack.intensity if coherent else stack.intensity[None]
    written = [out / "stack.npz", out / "scene.toml"]
    if coherent:
        np.savez(out / "stack.npz", field=stack.field, directions=built.illumination.directions)  # type: ignore[union-attr]
    else:
        np.savez(out / "stack.npz", intensity=stack.intensity)
    if images.ndim == 3 and len(images):
        labels = [f"tilt {n}" for n in range(len(images))] if coherent else ["image"]
        written.append(stack_sheet(images, labels, out / "stack.png"))
    typer.echo(f"Rendered {images.shape} in {took:.2f} s: {', '.join(map(str, written))}")


def _require_unsaid(context: typer.Context, scene: Path) -> None:
    """Refuse options that a scene's file would silently overrule."""
    sources = {name: context.get_parameter_source(name) for name in _OF_THE_SCENE}
    said = [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if said:
        options = ", ".join("--" + name.replace("_", "-") for name in said)
        reject(f"render {options}", "left out with --scene, which says it", str(scene), "Change the file instead.")


def scene_in(file: Path) -> "Scene":
    """Read the scene of a JSON or TOML file."""
    import specklegen as sg

    text = read_text(file, "--scene")
    return sg.Scene.from_json(text) if file.suffix == ".json" else sg.Scene.from_toml(text)


def memory_effect_command(
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: Annotated[list[float] | None, typer.Option("--g", help="Anisotropy; give it several times to compare.")] = None,
    albedo: Albedo = 1.0,
    largest: Annotated[float, typer.Option(help="Largest tilt, degrees.")] = 0.04,
    points: Annotated[int, typer.Option(min=2, max=100_000, help="Tilts from 0 to the largest, both of them.")] = 33,
    mode: Annotated[Literal["transmission", "reflection"], typer.Option(help="Side of the views.")] = "transmission",
    paths: Annotated[int, typer.Option(min=1, help="Random paths to trace.")] = 200_000,
    seed: Seed = 0,
    out: Annotated[Path, typer.Option(help="Folder for memory-effect.csv and memory-effect.png.")] = Path(
        "memory-effect"
    ),
    as_json: AsJson = False,
) -> None:
    """How fast speckle decorrelates under tilt: a table and a figure, with error bars."""
    import numpy as np

    import specklegen as sg
    from specklegen.pictures import memory_effect_figure

    if not 0 < largest < 90:
        reject("--largest", "above 0 and below 90 degrees", largest)
    writable(out)
    tilts = np.deg2rad(np.linspace(0, largest, points))
    curves = {
        f"g = {value:g}, OD {optical_depth:g}": sg.memory_effect(
            slab(thickness, optical_depth, value, albedo), wavelength=wavelength, tilts=tilts, mode=mode,
            paths=paths, seed=seed,
        )
        for value in (g or [0.9])
    }  # fmt: skip
    with (out / "memory-effect.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["curve", "tilt_deg", "q", "intensity_correlation", "standard_error"])
        for label, c in curves.items():
            for row in zip(np.rad2deg(c.tilts), c.q, c.intensity, c.standard_error, strict=True):
                table.writerow([label, *(f"{value:.6g}" for value in row)])
    memory_effect_figure(curves, out / "memory-effect.png")
    if as_json:
        echo_json([
            {
                "curve": label, "tilt_deg": np.rad2deg(c.tilts), "q": c.q, "intensity_correlation": c.intensity,
                "standard_error": c.standard_error, "single_share": c.single_share, "paths": c.paths,
            }
            for label, c in curves.items()
        ])  # fmt: skip
        return
    for label, curve in curves.items():
        if np.isnan(curve.intensity).all():
            typer.echo(f"{label}: no light comes through")
            continue
        below = np.flatnonzero(curve.intensity < 0.5)
        half = f"{np.rad2deg(curve.tilts[below[0]]):.4f} degrees" if len(below) else f"above {largest:g} degrees"
        errors = curve.standard_error[np.isfinite(curve.standard_error)]
        worst = f"{errors.max():.2g}" if len(errors) else "unknown from so few paths"
        typer.echo(f"{label}: C_I falls below 1/2 at {half}; largest standard error {worst}")
    typer.echo(f"{out / 'memory-effect.csv'}, {out / 'memory-effect.png'}")


def slab(thickness: float, optical_depth: float, g: float, albedo: float) -> "Slab":
    """Slab of the command line's options."""
    import specklegen as sg

    for option, value in (("--thickness", thickness), ("--optical-depth", optical_depth)):
        if not 1e-60 < value < 1e60:
            reject(option, "greater than 0 and finite", value)
    return sg.Slab(
        thickness=thickness,
        mean_free_path=thickness / optical_depth,
        albedo=albedo,
        scatterer=sg.HenyeyGreenstein(g=g),
    )
