"""Tables and figures of docs/notes/performance.md, from the stored measurements; the page's words stay as they are."""

import csv
import json
import re
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from specklegen.core.errors import reject
from specklegen.error_time import SAMPLERS, Trend, crossover, fit_trend
from specklegen.error_time.figure import Panel, error_figure

from . import machine
from .calibration import Calibrated
from .comparisons import COMPARISONS
from .runs import Row
from .scenes import SCENES

METHODS = [*(sampler.name for sampler in SAMPLERS), *COMPARISONS]
QUANTITIES = ("intensity", "tilt covariance")
README_SCENES = ("transmission-g0-od10", "flatland-box")
_OVERHEAD, _ABOVE_FLOOR = 2.0, 3.0
_LEAST_DECADES = 1.0
_BIASED = 2.5  # times what runs report: more than noise
_MARGIN = 1.25  # by which curves are apart on both sides of a crossing


def stored_rows(folder: Path) -> list[Row]:
    """Rows of the CSV; none where there is none."""
    path = folder / "error-vs-time.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [Row.read(line) for line in csv.DictReader(file)]


def write_table(path: Path, columns: Sequence[str], rows: Sequence[dict[str, object]]) -> None:
    """Write a CSV, numbers to six digits."""
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns)
        for row in rows:
            table.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in (row[name] for name in columns)])


def write(folder: Path) -> Path:
    """Draw all figures, and put the tables into the page beside the folder; the page's path."""
    rows = stored_rows(folder)
    names = [name for name in SCENES if any(row.scene == name for row in rows)]
    for name in names:
        figure(name, [row for row in rows if row.scene == name], folder / f"{name}.png")
    if set(README_SCENES) <= set(names):
        readme_figure(rows, folder.parent / "images" / "error-vs-time.png")
    path = folder.parent / "notes" / "performance.md"
    text = path.read_text()
    tables = {"Runs": runs(folder), "Speed": ratios(folder), "Are the reported errors right?": calibration(folder)}
    tables |= {"Slope": slopes(rows), "Crossover points": crossings(rows)}
    for heading, table in (tables | {name: section(name, rows) for name in names}).items():
        text = replaced(text, heading, table) if table else text
    path.write_text(text)
    return path


def replaced(text: str, heading: str, table: str) -> str:
    """Return a page with another table below one of its headings, in the place of the first one there."""
    pattern = rf"(^## {re.escape(heading)}\n(?:(?!## |\|).*\n)*)(?:\|.*(?:\n|\Z))+"
    fresh, count = re.subn(pattern, lambda match: f"{match[1]}{table}\n", text, count=1, flags=re.MULTILINE)
    if not count:
        reject("docs/notes/performance.md", f"a page with a table below the heading {heading!r}", "none", "Add both.")
    return fresh


def runs(folder: Path) -> str:
    """Table of machine, commit and load of every measurement."""
    about = machine.stored(folder)
    path = folder / "benchmark.json"
    speed = {"speed": json.loads(path.read_text())["about"]} if path.exists() else {}
    lines = [
        (name, str(each["machine"]), str(each["commit"]), f"{each['load']:g}", f"{each.get('longest', '')}")
        for name, each in ({name: about[name] for name in SCENES if name in about} | speed).items()
    ]  # fmt: skip
    return _table(("scene", "machine", "commit", "load average", "longest runs, s"), lines) if lines else ""


def ratios(folder: Path) -> str:
    """Table of the ratios that the project set itself, by ``scripts/benchmark.py``."""
    path = folder / "benchmark.json"
    if not path.exists():
        return ""
    lines = [
        (
            row["name"], f"{row['median']:.4g} {row['unit']}".strip(), _spread(row["values"]), _bound(row, "must"),
            _bound(row, "aim"), row["note"],
        )
        for row in json.loads(path.read_text())["rows"]
    ]  # fmt: skip
    return _table(("quantity", "median", "least to most", "must", "aim", ""), lines)


def _spread(values: Sequence[float]) -> str:
    return f"{min(values):.4g} – {max(values):.4g}" if len(values) > 1 else ""


def _bound(row: dict, key: str) -> str:
    """Bound "must" or "aim" of a row, and whether the median keeps to it; nothing where there is none."""
    if row[key] is None:
        return ""
    met = row["median"] >= row[key] if row["more_is_better"] else row["median"] <= row[key]
    return f"{'≥' if row['more_is_better'] else '≤'} {row[key]:g}: {'yes' if met else '**no**'}"


def calibration(folder: Path) -> str:
    """Table of how well reported standard errors cover the true ones."""
    path = folder / "calibration.csv"
    if not path.exists():
        return ""
    with path.open(newline="") as file:
        found = [
            Calibrated(line["sampler"], line["scene"], line["quantity"], int(line["paths"]), int(line["runs"]),
                       float(line["mean"]), float(line["variance"]))
            for line in csv.DictReader(file)
        ]  # fmt: skip
    lines = [
        (c.sampler, c.scene, c.quantity, str(c.paths), "" if np.isnan(c.mean) else f"{c.mean:+.2f}",
         f"{c.variance:.2f}", "yes" if c.passed else "**no**")
        for c in found
    ]  # fmt: skip
    return _table(("sampler", "scene", "quantity", "paths", "mean z", "variance of z", "within"), lines)


def curves(rows: Iterable[Row], scene: str, quantity: str) -> dict[str, list[Row]]:
    """Method to rows, in the order of their counts."""
    chosen = sorted((row for row in rows if row.scene == scene and row.quantity == quantity), key=lambda row: row.count)
    return {name: found for name in METHODS if (found := [row for row in chosen if row.method == name])}


def straight(found: Sequence[Row]) -> list[Row]:
    """The part of a curve where paths take the time and the reference is good enough to see the error."""
    least = min(row.cpu_seconds for row in found)
    return [
        row for row in found
        if row.cpu_seconds >= _OVERHEAD * least and max(row.error, row.reported) > _ABOVE_FLOOR * row.floor
    ]  # fmt: skip


def trends(found: Sequence[Row]) -> tuple[Trend, Trend] | None:
    """Slopes of the true and of the reported error over the straight part; None where it is short."""
    used = straight(found)
    if len(used) < 3:
        return None
    seconds = [row.cpu_seconds for row in used]
    repeats = np.array([row.repeats for row in used], dtype=np.float64)
    true = fit_trend(seconds, [row.error for row in used], repeats)
    if true.decades < _LEAST_DECADES:
        return None
    return true, fit_trend(seconds, [row.reported for row in used], 32 * repeats)  # 64 batches a run


def slopes(rows: Sequence[Row]) -> str:
    """Table of the slope of every curve that is long enough."""
    lines = []
    for scene in SCENES:
        for quantity in QUANTITIES:
            for method, found in curves(rows, scene, quantity).items():
                fitted = trends(found)
                if fitted is None or min(row.reported for row in found) <= 0:
                    continue
                true, reported = fitted
                lines.append(
                    (scene, method, quantity, f"{true.decades:.1f}", f"{true.slope:.2f} ± {true.slope_error:.2f}",
                     f"{reported.slope:.3f} ± {reported.slope_error:.3f}", f"{found[-1].error:.2g}",
                     f"{found[-1].floor:.1g}" if found[-1].floor else "exact")
                )  # fmt: skip
    return _table(
        ("scene", "method", "quantity", "decades of time", "slope, true error", "slope, reported", "last error",
         "error of the reference"),
        lines,
    )  # fmt: skip


def found_crossings(rows: Sequence[Row], scene: str, quantity: str) -> list[tuple[str, str, float, float]]:
    """(method, method, seconds, error) of every two curves that cross by more than noise."""
    drawn = {method: smooth(found) for method, found in curves(rows, scene, quantity).items()}
    crossed = []
    for one, other in combinations(drawn, 2):
        at = crossover(drawn[one], drawn[other], _MARGIN)
        if at is not None:
            crossed.append((one, other, *at))
    return crossed


def smooth(found: Sequence[Row]) -> tuple[list[float], list[float]]:
    """Seconds and errors of a curve: those that runs report, which have little noise, unless they hide a bias.

    A closed form has one error from its time on.
    """
    seconds = [row.cpu_seconds for row in found]
    errors = [row.error if ends_level(found) else row.reported for row in found]
    return (seconds, errors) if len(found) > 1 else ([seconds[0], 1e6 * seconds[0]], [found[0].error] * 2)


def ends_level(found: Sequence[Row]) -> bool:
    """Whether a bias shows at the end of a curve: a closed form's, or an error far above the one that runs report."""
    return len(found) == 1 or found[-1].error > _BIASED * found[-1].reported


def crossings(rows: Sequence[Row]) -> str:
    """Table of all crossover points."""
    lines = [
        (scene, quantity, f"{one} / {other}", f"{seconds:.2g} s", f"{error:.2g}")
        for scene in SCENES for quantity in QUANTITIES
        for one, other, seconds, error in found_crossings(rows, scene, quantity)
    ]  # fmt: skip
    return _table(("scene", "quantity", "methods", "at", "error there"), lines)


def section(name: str, rows: Sequence[Row]) -> str:
    """Table of one scene: the largest run of every method."""
    lines = []
    for quantity in QUANTITIES:
        drawn = curves(rows, name, quantity)
        yardstick = drawn.get("naive Algorithm 2", [None])[-1]
        for method, found in drawn.items():
            last = found[-1]
            gain = f"{last.efficiency / yardstick.efficiency:.3g}" if yardstick and last.reported > 0 else ""
            lines.append(
                (method, quantity, str(len(found)), str(last.count or ""), f"{last.cpu_seconds:.3g}",
                 f"{last.wall_seconds:.3g}", f"{last.memory_bytes / 2**20:.0f}" if last.memory_bytes >= 0 else "",
                 f"{last.error:.2g}", f"{last.reported:.2g}", f"{last.efficiency:.3g}", gain)
            )  # fmt: skip
    return _table(
        ("method", "quantity", "budgets", "largest count", "CPU s", "wall s", "MiB", "error", "reported",
         "1/(variance × time)", "over naive"),
        lines,
    )  # fmt: skip


def panel(rows: Sequence[Row], scene: str, quantity: str, title: str) -> Panel:
    """Curves of one scene and quantity."""
    drawn = curves(rows, scene, quantity)
    return Panel(
        title, f"relative error of the {quantity}",
        {name: ([r.cpu_seconds for r in found], [r.error for r in found]) for name, found in drawn.items()},
        {name: [r.reported for r in found] for name, found in drawn.items() if min(r.reported for r in found) > 0},
        next(iter(drawn.values()))[0].floor,
    )  # fmt: skip


def figure(name: str, rows: Sequence[Row], out: Path) -> None:
    """Two panels: intensities and tilt covariances; dashed, what the runs report."""
    title = SCENES[name]().title
    error_figure([panel(rows, name, quantity, f"{title}: {quantity}") for quantity in QUANTITIES], out, METHODS)


def readme_figure(rows: Sequence[Row], out: Path) -> None:
    """Tilt covariances of two scenes, for the front page."""
    error_figure(
        [panel(rows, name, "tilt covariance", SCENES[name]().title) for name in README_SCENES], out, METHODS
    )  # fmt: skip


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
