"""Pictures of training and evaluation, as PNG."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from specklegen.models.judging.evaluation import Case
from specklegen.pictures import _figure, _save, _show


def training_curves(runs: Mapping[str, Sequence[Mapping[str, float]]], out: Path) -> Path:
    """Draw loss and validation over time, a colour a run; rows as in a run's log.csv."""
    figure, axes = _figure(1, 2, 5.0, 3.6)
    for label, rows in runs.items():
        minutes = [row["seconds"] / 60 for row in rows]
        axes[0, 0].plot(minutes, [row["train_loss"] for row in rows], "o-", ms=3, label=label)
        (score,) = {name for row in rows for name in row if name.startswith("validation_")}
        axes[0, 1].plot(minutes, [row[score] for row in rows], "o-", ms=3, label=f"{label}, {score[11:]}")
    for axis, title in zip(axes[0], ("training loss", "validation media"), strict=True):
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("time, minutes")
        axis.grid(alpha=0.3)
    axes[0, 1].legend(frameon=False)
    return _save(figure, out)


class Note(NamedTuple):
    """Text of a sheet about one reconstruction besides its score, and whether it is framed as wrong."""

    text: str
    wrong: bool = False


def contact_sheet(
    cases: Sequence[Case], out: Path, notes: Mapping[str, Sequence[Note]] | None = None, caption: str = ""
) -> Path:
    """Draw cases, a column each: camera image, what each method made of it (with its Pearson correlation), object.

    ``notes`` are of a method's reconstructions, by its name, one for each case; the caption stands below.
    """
    notes = notes or {}
    methods = list(cases[0].reconstructions)
    figure, axes = _figure(2 + len(methods), len(cases), 1.25, 1.36)
    for column, case in enumerate(cases):
        axis = axes[:, column]
        _show(axis[0], case.image, low=0, high=float(np.percentile(case.image, 99.5)))
        for row, name in enumerate(methods, 1):
            image = case.reconstructions[name]
            note = notes[name][column] if name in notes else Note("")
            title = f"{case.scores[name]:.2f}  {note.text}".strip()
            _show(axis[row], image, title, low=min(0.0, float(image.min())), high=max(float(image.max()), 1e-6))
            if note.wrong:
                _frame(axis[row], "tab:red")
        _show(axis[-1], case.object, low=0, high=1)
    for axis, name in zip(axes[:, 0], ("camera image", *methods, "hidden object"), strict=True):
        axis.text(-0.08, 0.5, name, rotation=90, ha="right", va="center", fontsize=10, transform=axis.transAxes)
    figure.supxlabel(caption, fontsize=8)
    return _save(figure, out)


def _frame(axes, colour: str) -> None:
    """Draw a frame about a picture, and colour its title."""
    axes.set_axis_on()
    axes.set(xticks=[], yticks=[])
    for edge in axes.spines.values():
        edge.set(color=colour, linewidth=2)
    axes.title.set_color(colour)
