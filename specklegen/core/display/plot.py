"""Display of results: a line by ``repr``, a picture by ``.plot()``, and in a notebook the picture above a table.

A result states its facts once and draws itself on one pair of axes; all else is here, and the command line prints the
same facts. matplotlib is imported when something is drawn; where it is missing, a notebook shows the table alone.
"""

import base64
import html
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.display.repr import shown, summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from specklegen.core.decision import Decision

SHOWN = 6
"""Images of a stack that a picture shows."""


class Pictured:
    """Value with a line, a table of facts and a picture; a subclass names its facts and draws itself.

    Dataclasses need ``repr=False``, or the line is that of the dataclass.
    """

    _named: ClassVar[Mapping[str, str]] = {}
    """Names of facts, with units, and the attributes that hold them; ``<attribute>_error`` holds standard errors.

    By default those of all fields of a dataclass.
    """

    def __repr__(self) -> str:
        return summary(self, self._named.values() or shown(self))

    def _facts(self) -> Mapping[str, object]:
        """Rows of the table: those of ``_named`` and what one attribute does not tell."""
        named = self._named or {name.replace("_", " "): name for name in shown(self)}
        return {name: self._fact(attribute) for name, attribute in named.items()}

    def _fact(self, attribute: str) -> object:
        value, error = attrgetter(attribute)(self), getattr(self, f"{attribute}_error", None)
        return f"{value:.5g} ± {error:.2g}" if isinstance(value, float) and error is not None else value

    def facts(self) -> dict[str, str]:
        """Return the rows of the table that a notebook shows and a command prints: names and values as text."""
        return {name: written(value) for name, value in self._facts().items()}

    def _draw(self, axes: "Axes", label: str | None = None) -> None:
        """Draw on these axes; a label names a curve in a legend. Where none bears it, it becomes the title."""
        raise NotImplementedError

    def plot(self, axes: "Axes | None" = None, label: str | None = None) -> "Axes":
        """Draw on axes of matplotlib, by default on those of a new figure, and return them.

        ``label`` names a curve in a legend, and is the title of anything else.
        """
        if axes is not None:
            return self._titled(axes, label)
        from matplotlib import pyplot

        figure, axes = pyplot.subplots(layout="constrained")
        self._titled(axes, label)
        if axes.get_aspect() == 1:  # of images: nothing is left white above and below a strip of them
            across, up = (abs(high - low) for low, high in (axes.get_xlim(), axes.get_ylim()))
            wide, high = figure.get_size_inches()
            figure.set_size_inches(wide, min(high, wide * up / across + 0.8))
        return axes

    def _titled(self, axes: "Axes", label: str | None) -> "Axes":
        self._draw(axes, label)
        if label and not any(label in name for name in axes.get_legend_handles_labels()[1]):
            axes.set_title(label)
        return axes

    def _repr_html_(self) -> str:
        return card(type(self).__name__, self.facts(), self._draw)


def card(title: str, facts: Mapping[str, str], draw: "Callable[[Axes], None]") -> str:
    """HTML of a title, a picture and a table; nothing in the facts can be markup."""
    try:
        picture = f'<img alt="{html.escape(title)}" style="max-width:100%" src="data:image/png;base64,{_png(draw)}"/>'
    except ImportError:
        picture = ""
    rows = "".join(
        f'<tr><th style="text-align:left;padding-right:1em">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    return f"<div><strong>{html.escape(title)}</strong><br/>{picture}<table>{rows}</table></div>"


def written(value: object) -> str:
    """Write a value of a table: four digits, a list of texts on one line, an array by its shape and range."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        return "; ".join(each if isinstance(each, str) else repr(each) for each in value) or "none"
    if getattr(value, "shape", ()):  # of NumPy or torch
        return _spread(value if isinstance(value, np.ndarray) else np.asarray(value))
    return "none" if value in (None, "") else str(value)


def _spread(array: np.ndarray) -> str:
    size = " x ".join(map(str, array.shape))
    if array.dtype == bool:
        return f"{np.count_nonzero(array)} of {size}"
    values = np.ma.compressed(np.abs(array) if np.iscomplexobj(array) else array)
    values = values[np.isfinite(values)]
    missing = array.size - values.size
    known = [f"{values.min():.4g} to {values.max():.4g}"] if values.size else []
    return ", ".join([f"{size} values", *known, *([f"{missing} undefined"] if missing else [])])


def with_interval(value: float, ends: tuple[float, float], unit: str = "") -> str:
    """Write a value with the ends of its 95 % interval."""
    return f"{value:.4g}{unit and ' ' + unit} (95 %: {ends[0]:.4g} to {ends[1]:.4g})"


def decided(decisions: "Iterable[Decision]") -> dict[str, str]:
    """Rows of decisions: which parts were used, and why."""
    return {each.part: f"{'used' if each.needed else 'left out'}: {each.reason}" for each in decisions}


def _png(draw: "Callable[[Axes], None]") -> str:
    """A picture on a figure that pyplot does not know of, as PNG in base 64."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure.subplots())
    out = io.BytesIO()
    figure.savefig(out, dpi=100, bbox_inches="tight")
    return base64.b64encode(out.getvalue()).decode()


def draw_curve(
    axes: "Axes", x: ArrayLike, y: ArrayLike, error: ArrayLike | None = None, label: str | None = None, *,
    fmt: str = "o-", **settings: Any,
) -> None:  # fmt: skip
    """Draw a curve over a grid, with bars of two standard errors; ``settings`` are those of ``axes.set``."""
    axes.errorbar(x, y, None if error is None else np.multiply(2, error), fmt=fmt, ms=3, lw=1, label=label)
    axes.set(**settings)
    axes.grid(alpha=0.3)
    if label:
        axes.legend()


def draw_images(axes: "Axes", images: np.ndarray, titles: Sequence[str] = (), *, high: float | None = None) -> None:
    """Draw images real[n, H, W] side by side, at most six of them, to one scale of grey.

    ``high`` is shown white; by default the brightness that one pixel of 200 exceeds.
    """
    shown = np.asarray(images[:SHOWN], dtype=np.float64)
    count, rows, columns = shown.shape
    gap = max(1, columns // 30)
    strip = np.full((rows, count * (columns + gap) - gap), np.nan)
    for n, image in enumerate(shown):
        strip[:, n * (columns + gap) : n * (columns + gap) + columns] = image
    top = float(np.percentile(shown, 99.5)) if high is None else high
    axes.imshow(strip, cmap="gray", vmin=0, vmax=top or 1.0, interpolation="nearest")
    axes.set_frame_on(False)
    axes.set_yticks([])
    middles = np.arange(count) * (columns + gap) + (columns - 1) / 2
    axes.set_xticks(middles[: len(titles)], list(titles[:count]))
    axes.tick_params(length=0)


def draw_map(
    axes: "Axes", values: np.ndarray, unit: str, *, span: Sequence[float] | None = None, low: float | None = None,
    cmap: str = "magma",
) -> None:  # fmt: skip
    """Draw real[H, W] with its scale beside it, row 0 at the bottom; ``span`` is (left, right, bottom, top)."""
    extent = None if span is None else (span[0], span[1], span[2], span[3])
    shown = axes.imshow(values, cmap=cmap, vmin=low, origin="lower", extent=extent, interpolation="nearest")
    axes.figure.colorbar(shown, ax=axes, label=unit)


def draw_stack(axes: "Axes", images: np.ndarray) -> None:
    """Draw images real[..., H, W] side by side; of a row of views, real[(T,) V], a row a tilt."""
    if images.ndim < 3:
        top = float(np.percentile(images, 99.5)) if images.size else 1.0
        axes.imshow(np.atleast_2d(images), cmap="gray", vmin=0, vmax=top or 1.0, aspect="auto", interpolation="nearest")
        axes.set_axis_off()
        return
    flat = images.reshape(-1, *images.shape[-2:])
    draw_images(axes, flat, [str(n) for n in range(len(flat))] if len(flat) > 1 else [])
