"""The command ``specklegen bench``: which sampler is best for one's own scene, by measurement."""

import csv
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from specklegen.cli.recipe_options import Seed, Set, load
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from specklegen.scene.scene import Scene

_COLUMNS = ("sampler", "count", "CPU s", "wall s", "MiB", "standard error", "1/(variance × time)")


def bench_command(
    what: Annotated[str, typer.Argument(help="A packaged recipe, a recipe's TOML file, or a scene as TOML or JSON.")],
    seconds: Annotated[float, typer.Option(help="Processor time for all samplers together.")] = 20.0,
    seed: Seed = 0,
    changes: Set = None,
    table: Annotated[Path | None, typer.Option("--csv", help="CSV to write.")] = None,
    out: Annotated[Path | None, typer.Option(help="PNG to write: error against time.")] = None,
) -> None:
    """Run every sampler that serves a scene at growing counts: error, time, memory, and what a second buys."""
    from tqdm import tqdm

    from specklegen.benchmarking import SAMPLERS, bench, probes_of
    from specklegen.benchmarking.figure import Panel, error_figure

    scene = scene_of(what, changes)
    for file in (table, out):
        if file is not None and not file.parent.is_dir():
            reject("bench output", "in a folder that exists", str(file))
    typer.echo(_line(_COLUMNS))
    rows = []
    with tqdm(unit="run", disable=None, leave=False) as bar:

        def progress(sampler: str, count: int) -> None:
            bar.set_description(f"{sampler}, {count}")
            bar.update()

        for row in bench(scene, seconds=seconds, seed=seed, progress=progress):
            rows.append(row)
            tqdm.write(_line(_cells(row)))
    probes = probes_of(scene)
    for sampler in SAMPLERS:
        obstacle = sampler.obstacle(scene, probes)
        if obstacle:
            typer.echo(f"{sampler.name}: left out: {obstacle}")
    typer.echo(
        "One thread. Errors are those that the runs report, root mean square over intensities and tilt covariances of "
        "a few points, relative; that of the closed form is the light that it leaves out over the light that it gives."
    )
    if table is not None:
        with table.open("w", newline="") as file:
            csv.writer(file).writerows([_COLUMNS, *(_cells(row) for row in rows)])
    if out is not None:
        curves = {
            name: ([r.cost.cpu_seconds for r in rows if r.sampler == name and r.standard_error > 0],
                   [r.standard_error for r in rows if r.sampler == name and r.standard_error > 0])
            for name in dict.fromkeys(row.sampler for row in rows)
        }  # fmt: skip
        error_figure([Panel(what, "standard error, relative", curves)], out)


def scene_of(what: str, changes: list[str] | None) -> "Scene":
    """The scene of a file, or the first scene of a recipe."""
    import specklegen as sg

    path = Path(what)
    if path.suffix in (".json", ".toml") and path.is_file():
        text, is_json = path.read_text(), path.suffix == ".json"
        if is_json or {"illumination", "sensor"} <= tomllib.loads(text).keys():
            if changes:
                reject("bench --set", "left out where a file holds a scene", " ".join(changes), f"Change {what}.")
            return sg.Scene.from_json(text) if is_json else sg.Scene.from_toml(text)
    plans = load(what, changes).plans()
    if not plans:
        reject("bench recipe", "one that renders scenes", what)
    return plans[0].scene


def _cells(row) -> tuple[str, ...]:
    memory = "" if row.cost.memory_bytes is None else f"{row.cost.memory_bytes / 2**20:.0f}"
    return (
        row.sampler, str(row.count or ""), f"{row.cost.cpu_seconds:.4g}", f"{row.cost.wall_seconds:.4g}", memory,
        f"{row.standard_error:.3g}", f"{row.efficiency:.3g}",
    )  # fmt: skip


def _line(cells: tuple[str, ...]) -> str:
    return f"{cells[0]:32}" + "".join(f"{cell:>12}" for cell in cells[1:5]) + "".join(f"{c:>22}" for c in cells[5:])
