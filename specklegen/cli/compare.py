"""The command ``specklegen check compare``: which sampler is best for one's own scene, by measurement."""

from pathlib import Path
from typing import TYPE_CHECKING

from specklegen.cli.output import AsJson, echo_json, require_writable, writable, write_csv
from specklegen.cli.recipe_options import Seed, Set, load, names_starting_with
from specklegen.cli.scenes import scene_in
from specklegen.cli.settings import argument, option
from specklegen.core.errors import reject
from specklegen.core.tables import json_table, read_text, toml_table

if TYPE_CHECKING:
    from specklegen.scene.scene import Scene

_COLUMNS = ("sampler", "count", "CPU s", "wall s", "MiB", "standard error", "1/(variance × time)")


def compare_command(
    what: str = argument(
        ..., "A packaged recipe, a recipe's TOML file, or a scene as TOML or JSON.", autocompletion=names_starting_with
    ),
    seconds: float = option(20.0, "CPU time for all samplers together."),
    seed: Seed = 0,
    changes: Set = None,
    table: Path | None = option(None, "CSV to write.", "--csv"),
    out: Path | None = option(None, "PNG to write: error against time."),
    as_json: AsJson = False,
) -> None:
    """Run every sampler that serves a scene at growing counts: error, time, memory, and what a second buys."""
    from tqdm import tqdm

    from specklegen.error_time import SAMPLERS, compare, probes_of
    from specklegen.error_time.figure import Panel, error_figure

    if not 0 < seconds < float("inf"):
        reject("--seconds", "greater than 0 and finite", seconds)
    scene = scene_of(what, changes)
    require_writable("compare --out", out)
    if table is not None:
        writable(table.parent, "compare --csv")
    say = (lambda line: None) if as_json else tqdm.write
    say(_line(_COLUMNS))
    rows = []
    with tqdm(unit="run", disable=None, leave=False) as bar:

        def progress(sampler: str, count: int) -> None:
            bar.set_description(f"{sampler}, {count}")
            bar.update()

        for row in compare(scene, seconds=seconds, seed=seed, progress=progress):
            rows.append(row)
            say(_line(_cells(row)))
    probes = probes_of(scene)
    obstacles = {sampler.name: sampler.obstacle(scene, probes) for sampler in SAMPLERS}
    left_out = {name: obstacle for name, obstacle in obstacles.items() if obstacle}
    if as_json:
        runs = [
            {
                "sampler": row.sampler, "count": row.count, "cpu_seconds": row.cost.cpu_seconds,
                "wall_seconds": row.cost.wall_seconds, "memory_bytes": row.cost.memory_bytes,
                "standard_error": row.standard_error, "efficiency": row.efficiency,
            }
            for row in rows
        ]  # fmt: skip
        echo_json({"runs": runs, "left_out": left_out})
    for name, obstacle in left_out.items():
        say(f"{name}: left out: {obstacle}")
    say(
        "Runs use one thread. The error is relative: the root mean square over intensities and tilt covariances of a "
        "few points, as each run reports it. The error of the closed form is the share of light that it neglects."
    )
    if table is not None:
        write_csv(table, _COLUMNS, map(_cells, rows))
    if out is not None:
        curves = {
            name: ([r.cost.cpu_seconds for r in rows if r.sampler == name and r.standard_error > 0],
                   [r.standard_error for r in rows if r.sampler == name and r.standard_error > 0])
            for name in dict.fromkeys(row.sampler for row in rows)
        }  # fmt: skip
        error_figure([Panel(what, "standard error, relative", curves)], out)


def scene_of(what: str, changes: list[str] | None) -> "Scene":
    """The scene of a file, or the first scene of a recipe."""
    path = Path(what)
    if path.suffix in (".json", ".toml"):
        text = read_text(path, "compare")
        table = json_table(text, f"scene {what}") if path.suffix == ".json" else toml_table(text, f"file {what}")
        if path.suffix == ".json" or {"illumination", "sensor"} <= table.keys():
            if changes:
                reject("compare --set", "left out where a file holds a scene", " ".join(changes), f"Change {what}.")
            return scene_in(path)
    plans = load(what, changes).plans()
    if not plans:
        reject("compare recipe", "a recipe that renders scenes", what)
    return plans[0].scene


def _cells(row) -> tuple[str, ...]:
    memory = "" if row.cost.memory_bytes is None else f"{row.cost.memory_bytes / 2**20:.0f}"
    return (
        row.sampler, str(row.count or ""), f"{row.cost.cpu_seconds:.4g}", f"{row.cost.wall_seconds:.4g}", memory,
        f"{row.standard_error:.3g}", f"{row.efficiency:.3g}",
    )  # fmt: skip


def _line(cells: tuple[str, ...]) -> str:
    return f"{cells[0]:32}" + "".join(f"{cell:>12}" for cell in cells[1:5]) + "".join(f"{c:>22}" for c in cells[5:])
