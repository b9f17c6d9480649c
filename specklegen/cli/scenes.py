"""The commands about one scene or slab: ``specklegen physics render``, ``memory-effect`` and ``reflectance``."""

import dataclasses
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from specklegen.cli.output import AsJson, echo_json, require_left_out, writable, write_csv
from specklegen.cli.recipe_options import Seed
from specklegen.cli.settings import option
from specklegen.core.errors import reject
from specklegen.core.registry import anchored, import_paths, imports_of, is_trusted
from specklegen.core.tables import json_table, read_text, toml_table
from specklegen.core.units import DEGREE, DIFFUSION, LENGTH, SINE, TIME, WAVELENGTH

if TYPE_CHECKING:
    import numpy as np

    from specklegen.memory_effects.curve import MemoryEffect
    from specklegen.memory_effects.temporal import TemporalCorrelation
    from specklegen.scene.media import Slab
    from specklegen.scene.scene import Scene

Wavelength = Annotated[float, WAVELENGTH, typer.Option(help="Inside the medium; fixes the unit of every length.")]
Thickness = Annotated[float, LENGTH, typer.Option(help="Thickness of the slab.")]
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
    g: float = option(0.9, "Anisotropy of scattering, -1 < g < 1.", "--g"),
    albedo: Albedo = 1.0,
    width: Annotated[float, LENGTH] = option(50_000.0, "Side of the illuminated square."),
    tilts: int = option(5, "Number of tilts.", min=1, max=100_000),
    step: Annotated[float, DEGREE] = option(0.0025, "Angle between tilts, degrees."),
    views: int = option(128, "Views along each side of the image.", min=1, max=100_000),
    pitch: Annotated[float, SINE] | None = option(None, "Direction sine between views (default: a third of a grain)."),
    paths: int | None = option(None, "Number of random paths (default 100000).", min=1),
    rel_error: float | None = option(None, "Instead of --paths: relative error to reach."),
    sampler: str = option(
        "auto", "How fields are drawn: auto, stationary, paths, covariance, convolution, screens of thin media; or "
        "my_module:Name, your own sampler, whose module is imported.",
    ),
    scene: Path | None = option(None, "A scene as TOML or JSON, instead of the options above."),
    seed: Seed = 0,
    mean: bool = option(False, "Add the mean (ballistic) field."),
    out: Path = option(Path("render"), "Folder for stack.npz, stack.png and scene.toml."),
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
            illumination=sg.light.CollimatedBeams.tilts(np.deg2rad(step) * np.arange(tilts), width=width),
            sensor=sg.sensors.FarField.grid((views, views), pitch if pitch is not None else wavelength / width / 3),
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
    context: typer.Context, said: Path | str, command: str, names: tuple[str, ...], flag: str = "--scene"
) -> None:
    """Refuse options that a scene's file, or a preset, would silently overrule."""
    sources = {name: context.get_parameter_source(name) for name in names}
    given = [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]
    if given:
        options = ", ".join("--" + name.replace("_", "-") for name in given)
        remedy = "Change the file instead." if flag == "--scene" else f"Leave {flag} out to describe a slab."
        reject(f"{command} {options}", f"left out with {flag}, which states it", str(said), remedy)


def scene_in(file: Path) -> "Scene":
    """Read the scene of a JSON or TOML file."""
    import specklegen as sg

    text = read_text(file, "--scene")
    read = json_table if file.suffix == ".json" else toml_table
    table = anchored(read(text, f"scene {file}"), file.parent)
    with imports_of(table, is_trusted(file)):
        for path in import_paths(table):
            typer.echo(f"{file} imports {path}, which runs its code", err=True)
        return sg.Scene(**table)


def memory_effect_command(
    context: typer.Context,
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: list[float] | None = option(None, "Anisotropy of scattering; repeat the option to compare.", "--g"),
    albedo: Albedo = 1.0,
    index: float = option(1.0, "Refractive index of the slab, in air; 1: index-matched."),
    material: str | None = option(
        None, "A preset, such as skin, instead of depth, g, albedo and index; lengths are then in micrometres, the "
        "wavelength that in vacuum.",
    ),
    scene: Path | None = option(None, "The medium of a scene, TOML or JSON, instead: layers, any phase function, "
                                      "screens."),
    largest: Annotated[float, DEGREE] | None = option(
        None, "Largest tilt, degrees (default: where C_I falls to 0.1, estimated from few paths).",
    ),
    points: int = option(33, "Number of tilts from 0 to the largest, both included.", min=2, max=100_000),
    lags: Annotated[float, TIME] | None = option(None, "Instead of tilts: largest lag of a slab that moves."),
    diffusion: Annotated[float, DIFFUSION] | None = option(
        None, "Diffusion coefficient of the particles, length^2 / time (default: lags are in units of 1/(D k^2)).",
    ),
    mode: Literal["transmission", "reflection"] = option("transmission", "Side of the views."),
    paths: int = option(200_000, "Random paths to trace.", min=1),
    seed: Seed = 0,
    out: Path = option(Path("memory-effect"), "Folder for memory-effect.csv and memory-effect.png."),
    as_json: AsJson = False,
) -> None:
    """Print how fast speckle decorrelates under tilt or in time: a table and a figure, with error bars."""
    import numpy as np

    import specklegen as sg
    from specklegen.pictures import memory_effect_figure, temporal_figure

    if lags is None:
        require_left_out("memory-effect", "without --lags", diffusion=diffusion)
    if lags is not None and not 0 < lags < np.inf:
        reject("--lags", "above 0 and finite", lags)
    if largest is not None and not 0 < largest < 90:
        reject("--largest", "above 0 and below 90 degrees", largest)
    media: dict[str, Any]
    if scene is not None:
        _require_unsaid(context, scene, "memory-effect", (*_OF_THE_MEDIUM, "material", "wavelength", "thickness"))
        require_left_out("memory-effect", "with --scene, which states the motion of its medium", diffusion=diffusion)
        built = scene_in(scene)
        media, wavelength = {scene.stem: built.medium}, built.wavelength
    elif material is not None:
        _require_unsaid(context, material, "memory-effect", _OF_THE_MEDIUM, "--material")
        bulk = sg.materials.get(material, wavelength)
        media = {material: bulk if isinstance(bulk, sg.GroundGlass) else bulk.slab(thickness)}
        wavelength = wavelength if isinstance(bulk, sg.GroundGlass) else bulk.wavelength
    else:
        faces = sg.media.Faces(inside=index)
        media = {
            f"g = {value:g}, OD {optical_depth:g}": slab(thickness, optical_depth, value, albedo).replace(faces=faces)
            for value in (g or [0.9])
        }
    if lags is not None and scene is None and not all("motion" in type(each).model_fields for each in media.values()):
        reject("--lags", "left out for thin screens, which do not move by themselves", lags)
    writable(out)
    if lags is not None:
        unit = (wavelength / (2 * np.pi)) ** 2
        fluid = sg.media.Brownian(diffusion=unit if diffusion is None else diffusion)
        moving = {
            label: sg.statistics.temporal_correlation(
                medium if scene is not None else medium.replace(motion=fluid), wavelength=wavelength,
                lags=np.linspace(0, lags, points), mode=mode, paths=paths, seed=seed,
            )
            for label, medium in media.items()
        }  # fmt: skip
        temporal_figure(moving, out / "memory-effect.png")
        columns = {"lag": lambda c: c.lags, "x": lambda c: c.x}
        _show_curves(moving, columns, "static_share", _decay, out, as_json)
        return
    largest = largest or _where_curves_end(media, wavelength, mode)
    tilts = np.deg2rad(np.linspace(0, largest, points))
    curves = {
        label: sg.memory_effect(medium, wavelength=wavelength, tilts=tilts, mode=mode, paths=paths, seed=seed)
        for label, medium in media.items()
    }
    memory_effect_figure(curves, out / "memory-effect.png")
    columns = {"tilt_deg": lambda c: np.rad2deg(c.tilts), "q": lambda c: c.q}
    _show_curves(curves, columns, "single_share", _half_width, out, as_json)


def _where_curves_end(media: "dict[str, Any]", wavelength: float, mode: Any) -> float:
    """Tilt in degrees, rounded, where little is left of every curve; 0.04 where that is nowhere up to 6 degrees."""
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


def _show_curves(
    curves: Mapping[str, Any], columns: Mapping[str, Callable[[Any], "np.ndarray"]], share: str,
    describe: Callable[[Any], str], out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Write the table of curves, by its own columns and those of every curve; print it as JSON, or a line a curve."""
    columns = {**columns, "intensity_correlation": lambda c: c.intensity, "standard_error": lambda c: c.standard_error}
    tables = {label: {name: read(c) for name, read in columns.items()} for label, c in curves.items()}
    rows = ([label, *row] for label, table in tables.items() for row in zip(*table.values(), strict=True))
    notes = [f"{label}: {name} = {value}" for label, c in curves.items() for name, value in c.physics.items()]
    write_csv(out / "memory-effect.csv", ["curve", *columns], rows, notes)
    if as_json:
        echo_json([
            {"curve": label, **tables[label], share: getattr(c, share), "paths": c.paths} for label, c in curves.items()
        ])  # fmt: skip
        return
    for label, curve in curves.items():
        typer.echo(f"{label}: {describe(curve)}")
    typer.echo(f"{out / 'memory-effect.csv'}, {out / 'memory-effect.png'}")


def _half_width(curve: "MemoryEffect") -> str:
    """Say where a curve of tilts falls below one half."""
    import numpy as np

    if np.isnan(curve.intensity).all():
        return "no light comes through"
    tilts, below = np.rad2deg(curve.tilts), np.flatnonzero(curve.intensity < 0.5)
    half = f"falls below 1/2 at {tilts[below[0]]:.4f} degrees" if len(below) else (
        f"stays above 1/2 up to {tilts[-1]:g} degrees"
    )  # fmt: skip
    errors = curve.standard_error[np.isfinite(curve.standard_error)]
    worst = f"{errors.max():.2g}" if len(errors) else "unknown: too few paths"
    return f"C_I {half}; largest standard error {worst}"


def _decay(curve: "TemporalCorrelation") -> str:
    """Say where a curve of lags falls to 1/e."""
    import numpy as np

    below = np.flatnonzero(curve.intensity < np.exp(-1))
    fallen = f"at a lag of {curve.lags[below[0]]:.4g}" if len(below) else f"above {curve.lags.max():.4g}"
    return f"|g1|^2 falls below 1/e {fallen}; static share {curve.static_share:.3g}"


def reflectance(
    optical_depth: OpticalDepth = 10.0,
    g: float = option(0.9, "Anisotropy of scattering, -1 < g < 1.", "--g"),
    albedo: Albedo = 1.0,
    index: float = option(1.0, "Refractive index of the slab, in air; 1: index-matched."),
    angle: Annotated[float, DEGREE] = option(0.0, "Angle of incidence in air, degrees."),
    paths: int | None = option(None, "Number of random paths (default 100000).", min=1),
    rel_error: float | None = option(None, "Instead of --paths: largest error of a share."),
    seed: Seed = 0,
    out: Path | None = option(None, "CSV to write: light over angle."),
    as_json: AsJson = False,
) -> None:
    """Print the reflectance, transmittance and absorptance of a slab, with errors."""
    import numpy as np

    import specklegen as sg

    if not 0 <= angle < 90:
        reject("--angle", "from 0 to below 90 degrees", angle)
    medium = slab(1.0, optical_depth, g, albedo).replace(faces=sg.media.Faces(inside=index))
    light = sg.statistics.reflectance_transmittance(
        medium, angle=np.deg2rad(angle), paths=paths, rel_error=rel_error, seed=seed
    )  # fmt: skip
    if out is not None:
        writable(out.parent)
        columns = light.reflected, light.reflected_error, light.transmitted, light.transmitted_error
        steps = np.rad2deg(light.angles[:-1]), np.rad2deg(light.angles[1:])
        header = ("from_deg", "to_deg", "reflected", "error", "transmitted", "error")
        write_csv(out, header, zip(*steps, *columns, strict=True))
    if as_json:
        echo_json(dataclasses.asdict(light))
        return
    for name, value in light.facts().items():
        typer.echo(f"{name}: {value}")


def slab(thickness: float, optical_depth: float, g: float, albedo: float) -> "Slab":
    """Slab of the command line's options."""
    import specklegen as sg

    for name, value in (("--thickness", thickness), ("--optical-depth", optical_depth)):
        if not 1e-60 < value < 1e60:
            reject(name, "greater than 0 and finite", value)
    return sg.Slab(
        thickness=thickness, mean_free_path=thickness / optical_depth, albedo=albedo,
        scatterer=sg.media.HenyeyGreenstein(g=g)
    )
