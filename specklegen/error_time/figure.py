"""Error against run time as a picture: double logarithmic, a curve a method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

_MARKS = "osD^vP*X<>"


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes
    ----------
    title, label : str
        Above, and beside the error axis.
    curves : mapping
        Method to (seconds, errors), float[n] each.
    reported : mapping
        Method to the errors that its runs report, dashed.
    floor : float
        Below this nothing can be seen, because the reference is no better; 0 for none.
    """

    title: str
    label: str
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    reported: Mapping[str, Sequence[float]] = field(default_factory=dict)
    floor: float = 0.0


def error_figure(panels: Sequence[Panel], out: Path, methods: Sequence[str] = ()) -> Path:
    """Draw panels side by side and write a PNG; ``methods`` fixes each method's colour."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    named = list(methods) or list(dict.fromkeys(name for panel in panels for name in panel.curves))
    figure = Figure(figsize=(5.4 * len(panels) + 0.4, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    shown: dict[str, Any] = {}
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        for name, (seconds, errors) in panel.curves.items():
            number = named.index(name)
            style = {"color": f"C{number % 10}", "marker": _MARKS[number % len(_MARKS)], "ms": 4, "lw": 1.3}
            shown[name] = axes.loglog(seconds, errors, **style)[0]
            if name in panel.reported:
                axes.loglog(seconds, panel.reported[name], "--", color=style["color"], lw=0.8)
        if panel.floor > 0:
            shown["floor: error of the reference"] = axes.axhline(panel.floor, color="0.5", ls=":", lw=1.2)
        _half_slope(axes)
        axes.set(xlabel="CPU seconds, one thread", ylabel=panel.label, title=panel.title)
        axes.grid(alpha=0.25, which="both", lw=0.5)
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=100)
    return out


def _half_slope(axes) -> None:
    """A short line of slope -1/2 in the lower left, for the eye."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    x = left * np.array([1.3, 1.3 * (right / left) ** 0.25])
    y = bottom * (top / bottom) ** 0.3 * np.sqrt(x[0] / x)
    axes.loglog(x, y, "k-", lw=1)
    axes.text(x[1], y[1], " −½", fontsize=8, va="center")
    axes.set(xlim=(left, right), ylim=(bottom, top))
