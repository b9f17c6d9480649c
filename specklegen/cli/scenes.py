"""The commands about one scene or slab: ``specklegen render``, ``memory-effect`` and ``reflectance``."""

import csv
import dataclasses
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import Seed
from specklegen.core.errors import reject
from specklegen.core.registry import anchored
from specklegen.core.tables import json_table, read_text, toml_table

if TYPE_CHECKING:
    from specklegen.memory_effects.temporal import TemporalCorrelation
    from specklegen.scene.media import Slab
    from specklegen.scene.scene import Scene

Wavelength = Annotated[float, typer.Option(help="Inside the medium; fixes the unit of every length.")]
Thickness = Annotated[float, typer.Option(help="Thickness of the slab.")]
OpticalDepth = Annotated[float, typer.Option(help="Thickness over mean free path.")]
Albedo = Annotated[float, typer.Option(help="Share of collisions that scatter.")]

_OF_THE_SCENE = (
    "wavelength", "thickness", "optical_depth", "g", "albedo", "width", "tilts", "step", "views", "pitch",
)  # fmt: skip
"""Options of `render` that a scene's file holds instead."""
_OF_THE_MEDIUM = ("optical_depth", "g", "albedo", "index")
"""Options of `memory-effect` that a preset holds instead."""


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
    sampler: Annotated[
        str,
        typer.Option(
            help="How fields are drawn: auto, stationary, paths, covariance, convolution, screens of thin media; or "
            "my_module:Name, a sampler of your own, whose module is run."
        ),
    ] = "auto",
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
        _require_unsaid(context, scene, "render", _OF_THE_SCENE)
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
    light = built.illumination
    fields, images = light.coherent and light.limited, stack.intensity if light.images else stack.intensity[None]
    written = [out / "stack.npz", out / "scene.toml"]
    if fields:
        np.savez(out / "stack.npz", field=stack.field, directions=light.vectors)
    else:
        np.savez(out / "stack.npz", intensity=stack.intensity)
    if images.ndim == 3 and len(images):
        labels = [f"tilt {n}" for n in range(len(images))] if light.images else ["image"]
        written.append(stack_sheet(images, labels, out / "stack.png"))
    typer.echo(f"Rendered {images.shape} in {took:.2f} s: {', '.join(map(str, written))}")


def _require_unsaid(
    context: typer.Context, said: Path | str, command: str, names: tuple[str, ...], option: str = "--scene"
) -> None:
    """Refuse options that a scene's file, or a preset, would silently overrule."""
    sources = {name: context.get_parameter_source(name) for name in names}
    given = [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if given:
        options = ", ".join("--" + name.replace("_", "-") for name in given)
        remedy = "Change the file instead." if option == "--scene" else f"Leave {option} out to describe a slab."
        reject(f"{command} {options}", f"left out with {option}, which says it", str(said), remedy)


def scene_in(file: Path) -> "Scene":
    """Read the scene of a JSON or TOML file."""
    import specklegen as sg

    text = read_text(file, "--scene")
    read = json_table if file.suffix == ".json" else toml_table
    return sg.Scene(**anchored(read(text, f"scene {file}"), file.parent))


def memory_effect_command(
    context: typer.Context,
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: Annotated[list[float] | None, typer.Option("--g", help="Anisotropy; give it several times to compare.")] = None,
    albedo: Albedo = 1.0,
    index: Annotated[float, typer.Option(help="Refractive index of the slab, in air; 1 for matched faces.")] = 1.0,
    material: Annotated[
        str | None,
        typer.Option(
            help="A preset, such as skin, instead of depth, g, albedo and index; lengths are then in micrometres, the "
            "wavelength that in vacuum."
        ),
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(help="The medium of a scene, TOML or JSON, instead: layers, any lobe, screens.")
    ] = None,
    largest: Annotated[
        float | None, typer.Option(help="Largest tilt, degrees (default: where a tenth of C_I is left, by few paths).")
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=100_000, help="Tilts from 0 to the largest, both of them.")] = 33,
    lags: Annotated[float | None, typer.Option(help="Instead of tilts: largest lag of a slab that moves.")] = None,
    diffusion: Annotated[
        float | None, typer.Option(help="Of its particles, length^2 / time (default: lags are in units of 1/(D k^2)).")
    ] = None,
    mode: Annotated[Literal["transmission", "reflection"], typer.Option(help="Side of the views.")] = "transmission",
    paths: Annotated[int, typer.Option(min=1, help="Random paths to trace.")] = 200_000,
    seed: Seed = 0,
    out: Annotated[Path, typer.Option(help="Folder for memory-effect.csv and memory-effect.png.")] = Path(
        "memory-effect"
    ),
    as_json: AsJson = False,
) -> None:
    """How fast speckle decorrelates under tilt, or in time: a table and a figure, with error bars."""
    import numpy as np

    import specklegen as sg
    from specklegen.pictures import memory_effect_figure, temporal_figure

    if lags is None and diffusion is not None:
        reject("--diffusion", "left out without --lags", diffusion)
    if lags is not None and not 0 < lags < np.inf:
        reject("--lags", "above 0 and finite", lags)
    if largest is not None and not 0 < largest < 90:
        reject("--largest", "above 0 and below 90 degrees", largest)
    media: dict[str, Any]
    if scene is not None:
        _require_unsaid(context, scene, "memory-effect", (*_OF_THE_MEDIUM, "material", "wavelength", "thickness"))
        if diffusion is not None:
            reject("--diffusion", "left out with --scene, which says how its medium moves", diffusion)
        built = scene_in(scene)
        media, wavelength = {scene.stem: built.medium}, built.wavelength
    elif material is not None:
        _require_unsaid(context, material, "memory-effect", _OF_THE_MEDIUM, "--material")
        bulk = sg.materials.get(material, wavelength)
        media = {material: bulk if isinstance(bulk, sg.GroundGlass) else bulk.slab(thickness)}
        wavelength = wavelength if isinstance(bulk, sg.GroundGlass) else bulk.wavelength
    else:
        faces = sg.Faces(inside=index)
        media = {
            f"g = {value:g}, OD {optical_depth:g}": slab(thickness, optical_depth, value, albedo).replace(faces=faces)
            for value in (g or [0.9])
        }
    if lags is not None and scene is None and not all("motion" in type(each).model_fields for each in media.values()):
        reject("--lags", "left out of thin screens, which do not move by themselves", lags)
    writable(out)
    if lags is not None:
        unit = (wavelength / (2 * np.pi)) ** 2
        fluid = sg.Brownian(diffusion=unit if diffusion is None else diffusion)
        moving = {
            label: sg.temporal_correlation(
                medium if scene is not None else medium.replace(motion=fluid), wavelength=wavelength,
                lags=np.linspace(0, lags, points), mode=mode, paths=paths, seed=seed,
            )
            for label, medium in media.items()
        }  # fmt: skip
        _tell_lags(moving, out, as_json)
        temporal_figure(moving, out / "memory-effect.png")
        return
    largest = largest or _where_curves_end(media, wavelength, mode)
    tilts = np.deg2rad(np.linspace(0, largest, points))
    curves = {
        label: sg.memory_effect(medium, wavelength=wavelength, tilts=tilts, mode=mode, paths=paths, seed=seed)
        for label, medium in media.items()
    }
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
        half = (f"falls below 1/2 at {np.rad2deg(curve.tilts[below[0]]):.4f} degrees" if len(below)
                else f"stays above 1/2 up to {largest:g} degrees")  # fmt: skip
        errors = curve.standard_error[np.isfinite(curve.standard_error)]
        worst = f"{errors.max():.2g}" if len(errors) else "unknown from so few paths"
        typer.echo(f"{label}: C_I {half}; largest standard error {worst}")
    typer.echo(f"{out / 'memory-effect.csv'}, {out / 'memory-effect.png'}")


def _where_curves_end(media: "dict[str, Any]", wavelength: float, mode: Any) -> float:
    """Tilt in degrees, rounded, where little is left of every curve; .04 where that is nowhere up to 6 degrees."""
    import numpy as np

    import specklegen as sg

    tilts = np.geomspace(1e-6, 0.1, 120)  # where small tilts are what they are taken for
    ends = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sg.DoubtWarning)  # the curve itself will say so
        for medium in media.values():
            curve = sg.memory_effect(medium, wavelength=wavelength, tilts=tilts, mode=mode, paths=2000, seed=0)
            floor = curve.single_share**2
            fallen = np.flatnonzero(curve.intensity < floor + 0.1 * (1 - floor))
            ends += [np.rad2deg(tilts[fallen[0]])] if len(fallen) else []
    if not ends:
        return 0.04
    size = 10.0 ** np.floor(np.log10(max(ends)))
    return float(next(size * step for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if size * step >= max(ends)))


def _tell_lags(curves: "dict[str, TemporalCorrelation]", out: Path, as_json: bool) -> None:
    """Write the table of curves in time, and say where they fall to 1/e."""
    import numpy as np

    with (out / "memory-effect.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["curve", "lag", "x", "intensity_correlation", "standard_error"])
        for label, c in curves.items():
            for row in zip(c.lags, c.x, c.intensity, c.standard_error, strict=True):
                table.writerow([label, *(f"{value:.6g}" for value in row)])
    if as_json:
        echo_json([
            {
                "curve": label, "lag": c.lags, "x": c.x, "intensity_correlation": c.intensity,
                "standard_error": c.standard_error, "static_share": c.static_share, "paths": c.paths,
            }
            for label, c in curves.items()
        ])  # fmt: skip
        return
    for label, c in curves.items():
        below = np.flatnonzero(c.intensity < np.exp(-1))
        fallen = f"at a lag of {c.lags[below[0]]:.4g}" if len(below) else f"above {c.lags.max():.4g}"
        typer.echo(f"{label}: |g1|^2 falls below 1/e {fallen}; static share {c.static_share:.3g}")
    typer.echo(f"{out / 'memory-effect.csv'}, {out / 'memory-effect.png'}")


def reflectance(
    optical_depth: OpticalDepth = 10.0,
    g: Annotated[float, typer.Option("--g", help="Anisotropy of scattering, -1 < g < 1.")] = 0.9,
    albedo: Albedo = 1.0,
    index: Annotated[float, typer.Option(help="Refractive index of the slab, in air; 1 for matched faces.")] = 1.0,
    angle: Annotated[float, typer.Option(help="Of the light from the normal, in air, degrees.")] = 0.0,
    paths: Annotated[int | None, typer.Option(min=1, help="Random paths to walk (default 100000).")] = None,
    rel_error: Annotated[float | None, typer.Option(help="Instead of --paths: largest error of a share.")] = None,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="A CSV for the light over the angle.")] = None,
    as_json: AsJson = False,
) -> None:
    """How much light a slab reflects, transmits and absorbs, with errors."""
    import numpy as np

    import specklegen as sg

    if not 0 <= angle < 90:
        reject("--angle", "from 0 to below 90 degrees", angle)
    medium = slab(1.0, optical_depth, g, albedo).replace(faces=sg.Faces(inside=index))
    light = sg.reflectance_transmittance(
        medium, angle=np.deg2rad(angle), paths=paths, rel_error=rel_error, seed=seed
    )  # fmt: skip
    if out is not None:
        writable(out.parent)
        with out.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(["from_deg", "to_deg", "reflected", "error", "transmitted", "error"])
            columns = light.reflected, light.reflected_error, light.transmitted, light.transmitted_error
            steps = np.rad2deg(light.angles[:-1]), np.rad2deg(light.angles[1:])
            table.writerows([f"{value:.6g}" for value in row] for row in zip(*steps, *columns, strict=True))
    if as_json:
        echo_json(dataclasses.asdict(light))
        return
    for name, value in light._facts().items():
        typer.echo(f"{name}: {value:.4g}" if isinstance(value, float) else f"{name}: {value}")


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
