"""The command line: plan, render, generate, look.

Thin: every command reads its arguments, calls one function of the library, and shows what came out.
"""

import csv
import json
import resource
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from specklegen.cli import bench, learning, recoverable
from specklegen.cli.recipe_options import Images, Seed, Set, load
from specklegen.core.errors import RuleError, reject

app = typer.Typer(
    help="Correlated speckle image stacks, and data sets for seeing through scattering media.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Recipe = Annotated[str, typer.Argument(help="A packaged recipe (see `specklegen recipes`) or a TOML file.")]
Split = Annotated[str, typer.Option(help="train, validation or test; they share no medium and no object.")]
Out = Annotated[Path | None, typer.Option(help="Where to write.")]
Wavelength = Annotated[float, typer.Option(help="Inside the medium; fixes the unit of every length.")]
Thickness = Annotated[float, typer.Option(help="Thickness of the slab.")]
OpticalDepth = Annotated[float, typer.Option(help="Thickness over mean free path.")]
Anisotropy = Annotated[float, typer.Option("--g", help="Anisotropy of scattering, -1 < g < 1.")]
Albedo = Annotated[float, typer.Option(help="Share of collisions that scatter.")]
Paths = Annotated[int | None, typer.Option(help="Random paths to trace (default 100000).")]


recipes = typer.Typer(help="List the packaged recipes, show one, or the schema of its kind.", rich_markup_mode=None)
app.add_typer(recipes, name="recipes", invoke_without_command=True)


@recipes.callback()
def list_recipes(context: typer.Context) -> None:
    """List the packaged recipes."""
    from specklegen.datasets import load_recipe, recipe_names

    if context.invoked_subcommand is None:
        for name in recipe_names():
            typer.echo(f"{name:24s} {load_recipe(name).description}")


@recipes.command("show")
def show_recipe(recipe: Recipe, changes: Set = None) -> None:
    """Print a recipe as TOML, with what it inherits and what you change written out."""
    import tomli_w

    from specklegen.datasets import load_recipe
    from specklegen.datasets.recipes.overrides import changes_of
    from specklegen.datasets.recipes.recipe import merged, recipe_table

    table = changes_of(changes or [])
    load_recipe(recipe, table)
    typer.echo(tomli_w.dumps(merged(recipe_table(recipe), table)))


@recipes.command("schema")
def recipe_schema_command(
    name: Annotated[str, typer.Argument(help="A kind of recipe, or a recipe of that kind.")],
) -> None:
    """Print the JSON schema of a kind of recipe."""
    from specklegen.datasets.recipes.registry import recipe_schema

    typer.echo(json.dumps(recipe_schema(name), indent=2))


@app.command()
def plan(
    recipe: Recipe,
    samples: Annotated[int | None, typer.Option(help="Samples to cost (default: an epoch of train).")] = None,
    changes: Set = None,
    images: Images = None,
) -> None:
    """Tell how a recipe's scenes are rendered, what is left out and why, and what it costs."""
    from specklegen.datasets.store.estimate import estimate

    loaded = load(recipe, changes, images)
    plans = loaded.plans()
    for made in plans:
        typer.echo(made.explain() + "\n")
    count = samples if samples is not None else loaded.length("train")
    cost = estimate(loaded, count)
    # This process has just rendered and stored a few samples: what it took, any other takes too.
    rendered = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    typer.echo(
        f"{count} samples: about {cost['bytes'] / 2**20:.1f} MiB on disk, {cost['seconds']:.1f} s on "
        f"{cost['processes']} cores, at most {(rendered + cost['memory']) / 2**20:.0f} MiB of memory in each process."
    )


@app.command()
def render(
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: Anisotropy = 0.9,
    albedo: Albedo = 1.0,
    width: Annotated[float, typer.Option(help="Side of the illuminated square.")] = 50_000.0,
    tilts: Annotated[int, typer.Option(help="Number of tilts.")] = 5,
    step: Annotated[float, typer.Option(help="Angle between tilts, degrees.")] = 0.0025,
    views: Annotated[int, typer.Option(help="Views along each side of the image.")] = 128,
    pitch: Annotated[
        float | None, typer.Option(help="Direction sine between views (default: a third of a grain).")
    ] = None,
    paths: Paths = None,
    rel_error: Annotated[float | None, typer.Option(help="Instead of --paths: relative error to reach.")] = None,
    sampler: Annotated[str, typer.Option(help="auto, paths or stationary.")] = "auto",
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
        text = read_text(scene)
        built = sg.Scene.from_json(text) if scene.suffix == ".json" else sg.Scene.from_toml(text)
    else:
        built = sg.Scene(
            wavelength=wavelength,
            medium=slab(thickness, optical_depth, g, albedo),
            illumination=sg.CollimatedBeams.tilts(np.deg2rad(step) * np.arange(tilts), width=width),
            sensor=sg.FarField.grid((views, views), pitch if pitch is not None else wavelength / width / 3),
        )
    writable(out)
    typer.echo(
        sg.plan(built, paths=paths, rel_error=rel_error, sampler=sampler, mean=mean).explain()  # type: ignore[arg-type]
    )
    begin = time.perf_counter()
    stack = sg.render(built, paths=paths, rel_error=rel_error, sampler=sampler, seed=seed, mean=mean)  # type: ignore[arg-type]
    took = time.perf_counter() - begin
    (out / "scene.toml").write_text(built.to_toml())
    coherent = isinstance(built.illumination, sg.CollimatedBeams)
    images = stack.intensity if coherent else stack.intensity[None]
    if coherent:
        np.savez(out / "stack.npz", field=stack.field, directions=built.illumination.directions)  # type: ignore[union-attr]
    else:
        np.savez(out / "stack.npz", intensity=stack.intensity)
    if images.ndim == 3 and len(images):
        stack_sheet(images, [f"tilt {n}" for n in range(len(images))] if coherent else ["image"], out / "stack.png")
    typer.echo(
        f"Rendered {images.shape} in {took:.2f} s: {out / 'stack.npz'}, {out / 'stack.png'}, {out / 'scene.toml'}"
    )


@app.command("memory-effect")
def memory_effect_command(
    wavelength: Wavelength = 0.5,
    thickness: Thickness = 1000.0,
    optical_depth: OpticalDepth = 10.0,
    g: Annotated[list[float] | None, typer.Option("--g", help="Anisotropy; give it several times to compare.")] = None,
    albedo: Albedo = 1.0,
    largest: Annotated[float, typer.Option(help="Largest tilt, degrees.")] = 0.04,
    points: Annotated[int, typer.Option(help="Tilts between 0 and the largest.")] = 33,
    mode: Annotated[str, typer.Option(help="transmission or reflection.")] = "transmission",
    paths: Annotated[int, typer.Option(help="Random paths to trace.")] = 200_000,
    seed: Seed = 0,
    out: Annotated[Path, typer.Option(help="Folder for memory-effect.csv and memory-effect.png.")] = Path(
        "memory-effect"
    ),
) -> None:
    """How fast speckle decorrelates under tilt: a table and a figure, with error bars."""
    import numpy as np

    import specklegen as sg
    from specklegen.pictures import memory_effect_figure

    writable(out)
    tilts = np.deg2rad(np.linspace(0, largest, points))
    curves = {
        f"g = {value:g}, OD {optical_depth:g}": sg.memory_effect(
            slab(thickness, optical_depth, value, albedo), wavelength=wavelength, tilts=tilts, mode=mode,  # type: ignore[arg-type]
            paths=paths, seed=seed,
        )
        for value in (g or [0.9])
    }  # fmt: skip
    with (out / "memory-effect.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["curve", "tilt_deg", "q", "intensity_correlation", "standard_error"])
        for label, c in curves.items():
            for row in zip(np.rad2deg(c.tilts), c.q, c.intensity, c.standard_error, strict=True):
                table.writerow([label, *(f"{value:.6g}" for value in row)])
    memory_effect_figure(curves, out / "memory-effect.png")
    for label, curve in curves.items():
        below = np.flatnonzero(curve.intensity < 0.5)
        half = f"{np.rad2deg(curve.tilts[below[0]]):.4f} degrees" if len(below) else f"above {largest:g} degrees"
        typer.echo(
            f"{label}: C_I falls below 1/2 at {half}; largest standard error {np.nanmax(curve.standard_error):.2g}"
        )
    typer.echo(f"{out / 'memory-effect.csv'}, {out / 'memory-effect.png'}")


@app.command()
def generate(
    recipe: Recipe,
    out: Annotated[Path, typer.Option(help="Folder of the store; filled up if it is there already.")],
    samples: Annotated[int | None, typer.Option(help="Samples (default: an epoch of the split).")] = None,
    split: Split = "train",
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    processes: Annotated[int | None, typer.Option(help="Worker processes (default: all cores).")] = None,
    shard_range: Annotated[
        str, typer.Option(metavar="I/N", help="Do part I of N, for N machines with one folder.")
    ] = "0/1",
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Render on a Dask cluster, by its scheduler's address.")
    ] = None,
) -> None:
    """Fill a zarr store with samples of a recipe; run it again to go on where it stopped."""
    from specklegen.datasets.store.generate import generate as fill

    loaded = load(recipe, changes, images)
    count = samples if samples is not None else loaded.length(split)
    part = shard_range.partition("/")
    if not (part[0].isdigit() and part[2].isdigit()):
        reject("generate --shard-range", "of the form I/N", shard_range)
    begin = time.perf_counter()
    with Progress(count) as progress:
        said = fill(
            loaded, seed, split, samples=count, folder=out, processes=processes,
            shard_range=(int(part[0]), int(part[2])), progress=progress,
            notes=loaded.split_notes(), cluster=cluster,
        )  # fmt: skip
    took = time.perf_counter() - begin
    rendered = progress.rendered
    typer.echo(
        f"{said['done']} of {said['total']} samples in {out} ({said['bytes'] / 2**20:.1f} MiB); rendered {rendered} in "
        f"{took:.1f} s" + (f", {rendered / took:.0f} a second" if rendered else "")
    )


@app.command()
def preview(
    what: Annotated[str, typer.Argument(help="A recipe, or the folder of a store.")],
    samples: Annotated[int, typer.Option(help="How many samples to show.")] = 6,
    split: Split = "train",
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    out: Annotated[Path, typer.Option(help="PNG to write.")] = Path("preview.png"),
) -> None:
    """Draw samples of a recipe or of a store as a contact sheet."""
    from specklegen.datasets.store.metadata import is_store
    from specklegen.pictures import sheet

    if is_store(Path(what)):
        from specklegen.datasets import SpeckleCache

        cache = SpeckleCache(what)
        shown = [cache.numpy(n) for n in range(min(samples, len(cache)))]
    else:
        loaded = load(what, changes, images)
        shown = [loaded.sample(seed, split, n) for n in range(samples)]
    if not shown:
        reject("preview --samples", "at least 1", samples)
    writable(out.parent)
    typer.echo(str(sheet(shown, out)))


@app.command()
def info(folder: Annotated[Path, typer.Argument(help="Folder of a store.")]) -> None:
    """Say what a store holds, from the store alone."""
    from specklegen.datasets.store.info import info as describe

    typer.echo(json.dumps(describe(folder), indent=2, default=str))


@app.command()
def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of a store.")],
    repair: Annotated[
        str | None, typer.Option(metavar="RECIPE", help="Render again what is damaged or missing.")
    ] = None,
    changes: Set = None,
    images: Images = None,
) -> None:
    """Check every shard of a store against its checksum."""
    from specklegen.datasets.store.verify import verify as check

    result = check(folder, load(repair, changes, images) if repair else None)
    typer.echo(str(result))
    if repair:
        typer.echo(f"{len(result.damaged) + len(result.unfinished)} shards rendered again")
    elif not result.sound:
        raise typer.Exit(1)


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(help="Folder of a store.")],
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    format: Annotated[str, typer.Option(help="npy or png.")] = "npy",
    samples: Annotated[int | None, typer.Option(help="The first so many (default: all).")] = None,
) -> None:
    """Write samples of a store as files that every program reads."""
    from specklegen.datasets.loading.export import export as write

    written = write(folder, out, format, None if samples is None else range(samples))  # type: ignore[arg-type]
    typer.echo(f"{len(written)} files in {out}")


app.command()(learning.train)
app.command()(learning.evaluate)
app.command()(recoverable.recoverable)
app.command("bench")(bench.bench_command)


class Progress:
    """A bar with the remaining time, fed by (done, total)."""

    def __init__(self, total: int) -> None:
        from tqdm import tqdm

        self.bar = tqdm(total=total, unit="sample", disable=None)
        self.first: int | None = None
        self.done = 0

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *exception: object) -> None:
        self.bar.close()

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` samples are there."""
        if self.first is None:
            self.first = self.bar.initial = done
        self.bar.total = total
        self.bar.update(done - self.done)
        self.done = done

    @property
    def rendered(self) -> int:
        """Samples that this run added."""
        return self.done - (self.first or 0)


def slab(thickness: float, optical_depth: float, g: float, albedo: float):
    """Slab of the command line's options."""
    import specklegen as sg

    if not optical_depth > 0:
        reject("--optical-depth", "greater than 0", optical_depth)
    return sg.Slab(
        thickness=thickness,
        mean_free_path=thickness / optical_depth,
        albedo=albedo,
        scatterer=sg.HenyeyGreenstein(g=g),
    )


def read_text(path: Path) -> str:
    """Read a file that a user named."""
    try:
        return path.read_text()
    except OSError as error:
        reject("--scene", "a readable file", str(path), str(error.strerror))


def writable(folder: Path) -> None:
    """Make a folder before the work starts, so that an unwritable one is found at once."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".specklegen-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        reject("--out", "a writable folder", str(folder), str(error.strerror))


def main() -> None:
    """Run the command line; a broken rule is a message, not a traceback."""
    from specklegen.datasets.store.generate import GenerationError
    from specklegen.datasets.store.shards import DamagedShard, MissingSample

    try:
        app()
    except (RuleError, GenerationError, MissingSample, DamagedShard) as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
