"""docs/performance.md, written from the stored tables; figures beside them."""

import csv
import json
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from specklegen.core.errors import reject
from specklegen.error_time import SAMPLERS, Trend, crossover, fit_trend
from specklegen.error_time.figure import Panel, error_figure

from . import machine, words
from .calibration import LIMITS, Calibrated
from .comparisons import COMPARISONS
from .references import load
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
    """Draw all figures and write the page beside the folder; its path."""
    rows, about = stored_rows(folder), machine.stored(folder)
    names = [name for name in SCENES if any(row.scene == name for row in rows)]
    for name in names:
        figure(name, [row for row in rows if row.scene == name], folder / f"{name}.png")
    shown = [name for name in README_SCENES if name in names]
    if len(shown) == len(README_SCENES):
        readme_figure(rows, folder.parent / "images" / "error-vs-time.png")
    path = folder.parent / "performance.md"
    parts = [
        introduction(names, about), ratios(folder / "benchmark.json"), calibration(folder / "calibration.csv"),
        slopes(rows), crossings(rows), *(section(name, rows, folder) for name in names),
    ]  # fmt: skip
    path.write_text("\n\n".join(part.strip() for part in parts if part) + "\n")
    return path


def introduction(names: Sequence[str], about: dict[str, dict]) -> str:
    """What is measured and how, and on what."""
    known = {name: about[name] for name in names if name in about}
    unique = {key: sorted({each[key] for each in known.values()}) for key in ("machine", "commit", "longest")}
    longest = ", ".join(_seconds(each, known) for each in unique["longest"])
    loads = [float(each["load"]) for each in known.values()]
    crowded = ", ".join(name for name, each in known.items() if machine.busy(each))
    slow = f"; **busy with other work while {crowded} ran: times there are up to twice too long, read ratios.**"
    notes = "".join(f"\n\n{name}: {each['note']}" for name, each in known.items() if "note" in each)
    return f"""# Performance: error against run time

Every sampler and every method to compare with, on {len(names)} scenes, judged against frozen right values that come
from none of them. Written by `scripts/error_vs_time.py`; nothing on this page is typed in by hand but the explanations.

- **Error**: root mean square of |Ĉ − C|/√(C₁₁C₂₂) over a few intensities, and over a few tilt covariances, over runs
  with seeds of their own. Ĉ is the covariance that a run implies, with the random phases averaged out: one speckle
  image scatters by 100 % whatever the paths, and what paths decide is the Gaussian that it is drawn from. The error
  of the NUFFT is not in it: that of a field is below the render's `field_tolerance`, 1e-3 (measured under "Speed"), so
  that "paths" has a floor of at most 2e-3 of a covariance, which a smaller tolerance lowers.
- **Reported**: the standard error that the run itself gives.
- **Time**: processor seconds on one thread of the whole call that a user would make (all tilts and views of the
  scene; of "few points", those alone), planned and compiled before. **Memory**: growth of the process.
- **1/(variance × time)** uses the reported variance; naive Algorithm 2 is the yardstick.
- **Right values**: `scripts/error_time/references/*.npz`, each with its own standard error, command and commit: the
  correlation transfer equation (no Monte Carlo) for isotropic slabs, else Algorithm 1 or 3 as a plain program.

Machine: {"; ".join(unique["machine"])}; commit {", ".join(unique["commit"])};
budgets grow to runs of {longest};
load average {min(loads, default=0):g} to {max(loads, default=0):g}{slow if crowded else "."}

```
python scripts/error_vs_time.py                                          # 15 minutes on two idle cores; --quick: 2
python scripts/error_vs_time.py --scenes transmission-g0-od10 --longest 8    # a wide fit of the slope: 15 more
python scripts/benchmark.py --json docs/performance/benchmark.json
python scripts/error_vs_time.py --tables-only
specklegen compare RECIPE                                                  # the same for your own scene
```{notes}"""


def _seconds(longest: float, about: dict[str, dict]) -> str:
    """So many seconds, and the scenes where they are few."""
    names = [name for name, each in about.items() if each["longest"] == longest]
    return f"{longest:g} s" + (f" ({', '.join(names)})" if 2 * len(names) < len(about) else "")


def ratios(path: Path) -> str:
    """The ratios that the project set itself, by ``scripts/benchmark.py``."""
    if not path.exists():
        return "## Speed\n\nNot run: `python scripts/benchmark.py --json docs/performance/benchmark.json`."
    stored = json.loads(path.read_text())
    obstacles = _obstacles(stored["rows"])
    lines = [
        (
            row["name"], f"{row['median']:.4g} {row['unit']}".strip(), _spread(row["values"]), _bound(row, "must"),
            _bound(row, "aim"), "; ".join(part for part in (row["note"], obstacles.get(row["name"], "")) if part),
        )
        for row in stored["rows"]
    ]  # fmt: skip
    said = ["Busy with other work."] * machine.busy(stored["about"]) + [stored["about"].get("note", "")]
    doubts = "".join(f" **{each}**" for each in said if each)
    return (
        f"## Speed\n\nSlab of optical depth 10, g = 0.9, five tilts, 101 × 101 views, 10⁵ paths; one thread, both "
        f"sides of a ratio run in turn. {stored['about']['machine']}, load {stored['about']['load']:g}, commit "
        f"{stored['about']['commit']}.{doubts}\n\n"
        + _table(("quantity", "median", "least to most", "must", "aim", ""), lines)
    )


def _spread(values: Sequence[float]) -> str:
    return f"{min(values):.4g} – {max(values):.4g}" if len(values) > 1 else ""


def _obstacles(rows: Sequence[dict]) -> dict[str, str]:
    """Row that misses its aim to what stands in the way; a row without a reason, or a reason without a row, is loud."""
    missed = {row["name"] for row in rows if _met(row, "aim") is False}
    lost = (missed - words.OBSTACLES.keys()) | (words.OBSTACLES.keys() - {row["name"] for row in rows})
    if lost:
        reject(
            "words.OBSTACLES", "a reason for every row that misses its aim, named as scripts/benchmark.py names it",
            sorted(lost), "Add or rename what is listed there.",
        )  # fmt: skip
    return {name: words.OBSTACLES[name] for name in missed}


def _met(row: dict, key: str) -> bool | None:
    """Whether the median keeps to the bound "must" or "aim"; None where there is none."""
    if row[key] is None:
        return None
    return row["median"] >= row[key] if row["more_is_better"] else row["median"] <= row[key]


def _bound(row: dict, key: str) -> str:
    if row[key] is None:
        return ""
    return f"{'≥' if row['more_is_better'] else '≤'} {row[key]:g}: {'yes' if _met(row, key) else '**no**'}"


def calibration(path: Path) -> str:
    """Whether reported standard errors cover the true ones."""
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
    return (
        "## Are the reported errors right?\n\nz = (estimate − frozen truth)/(reported standard error) of 200 seeds: "
        f"the variance must lie within {LIMITS[0]} and {LIMITS[1]}, the chi-square limits at a false-alarm rate of "
        "1e-6 (of complex covariances the mean of |z|²).\n\n"
        + _table(("sampler", "scene", "quantity", "paths", "mean z", "variance of z", "within"), lines)
    )


def curves(rows: Iterable[Row], scene: str, quantity: str) -> dict[str, list[Row]]:
    """Method to rows, in the order of their counts."""
    chosen = sorted(
        (row for row in rows if row.scene == scene and row.quantity == quantity), key=lambda row: row.count
    )
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
    """Slope of every curve that is long enough."""
    lines, widest = [], (0.0, 0.0)
    for scene in SCENES:
        for quantity in QUANTITIES:
            for method, found in curves(rows, scene, quantity).items():
                fitted = trends(found)
                if fitted is None or min(row.reported for row in found) <= 0:
                    continue
                true, reported = fitted
                widest = max(widest, (true.decades, np.log10(found[-1].cpu_seconds / found[0].cpu_seconds)))
                lines.append(
                    (scene, method, quantity, f"{true.decades:.1f}", f"{true.slope:.2f} ± {true.slope_error:.2f}",
                     f"{reported.slope:.3f} ± {reported.slope_error:.3f}", f"{found[-1].error:.2g}",
                     f"{found[-1].floor:.1g}" if found[-1].floor else "exact")
                )  # fmt: skip
    return (
        "## Slope\n\nError = factor × time^slope, fitted where the time is at least twice that of the smallest run "
        f"(below, fixed costs rule) and the error above {_ABOVE_FLOOR:g} times that of the reference. Independent "
        "paths give −½. The true error is a root mean square of few runs, the reported one of 64 batches in each, so "
        "its slope is the sharper test; a bias shows as a true slope that is flatter than the reported one. The widest "
        f"fit spans {widest[0]:.1f} decades of time, of {widest[1]:.1f} measured.\n\n"
        + _table(
            ("scene", "method", "quantity", "decades of time", "slope, true error", "slope, reported", "last error",
             "error of the reference"),
            lines,
        )  # fmt: skip
    )


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
    """All crossover points, with the reason."""
    lines = []
    for scene in SCENES:
        for quantity in QUANTITIES:
            level = [method for method, found in curves(rows, scene, quantity).items() if ends_level(found)]
            lines += [
                (scene, quantity, f"{one} / {other}", f"{seconds:.2g} s", f"{error:.2g}",
                 words.crossing(one, other, level))
                for one, other, seconds, error in found_crossings(rows, scene, quantity)
            ]  # fmt: skip
    return (
        "## Crossover points\n\nWhere the curves of two methods cross: left of it the one is better, right of it the "
        f"other, each by a factor {_MARGIN:g} somewhere. Reported errors, or the true ones where a bias shows.\n\n"
        + _table(("scene", "quantity", "methods", "at", "error there", "why"), lines)
    )


def section(name: str, rows: Sequence[Row], folder: Path) -> str:
    """Figure and table of one scene."""
    case, reference = SCENES[name](), load(name)
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
    remark = f"\n\n{words.REMARKS[name]}" if name in words.REMARKS else ""
    return (
        f"## {name}\n\n{case.title[0].upper()}{case.title[1:]}: {len(case.scene.lights)} "
        f"lights, {len(case.scene.views)} views. Right values: {reference.source}.{remark}\n\n"
        f"![{case.title}]({folder.name}/{name}.png)\n\n"
        + _table(
            ("method", "quantity", "budgets", "largest count", "CPU s", "wall s", "MiB", "error", "reported",
             "1/(variance × time)", "over naive"),
            lines,
        )  # fmt: skip
    )


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
