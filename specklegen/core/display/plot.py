"""What results look like: a picture by ``.plot()``, and in a notebook the picture above a table.

A result states its facts and draws itself on one pair of axes; all else is here. matplotlib is imported when something
is drawn; where it is missing, a notebook shows the table alone.
"""

import base64
import html
import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 6
"""Images of a stack that a picture shows."""


class Pictured:
    """What has a picture and a table; a subclass says both."""

    def _facts(self) -> Mapping[str, object]:
        """Rows of the table."""
        raise NotImplementedError

    def _draw(self, axes: "Axes", label: str | None = None) -> None:
        """Draw on these axes; a label names a curve in a legend, and stands above anything else."""
        raise NotImplementedError

    def plot(self, axes: "Axes | None" = None, label: str | None = None) -> "Axes":
        """Draw on axes of matplotlib, by default on those of a new figure, and return them.

        ``label`` names a curve in a legend, and is the title of anything else.
        """
        if axes is not None:
            self._draw(axes, label)
            return axes
        from matplotlib import pyplot

        figure, axes = pyplot.subplots(layout="constrained")
        self._draw(axes, label)
        if axes.get_aspect() == 1:  # of images: nothing is left white above and below a strip of them
            across, up = (abs(high - low) for low, high in (axes.get_xlim(), axes.get_ylim()))
            wide, high = figure.get_size_inches()
            figure.set_size_inches(wide, min(high, wide * up / across + 0.8))
        return axes

    def _repr_html_(self) -> str:
        return card(type(self).__name__, self._facts(), self._draw)


def card(title: str, facts: Mapping[str, object], draw: "Callable[[Axes], None]") -> str:
    """HTML of a title, a picture and a table; nothing in the facts can be markup."""
    try:
        picture = f'<img alt="{html.escape(title)}" style="max-width:100%" src="data:image/png;base64,{_png(draw)}">'
    except ImportError:
        picture = ""
    rows = "".join(
        f'<tr><th style="text-align:left;padding-right:1em">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(_written(value))}</td></tr>'
        for name, value in facts.items()
    )
    return f"<div><strong>{html.escape(title)}</strong><br>{picture}<table>{rows}</table></div>"


def _written(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


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
    draw_images(axes, flat, [str(n) for n in range(len(flat))])
