"""Pictures of what was rendered: contact sheets, strips of tilting stacks, memory-effect curves.

Every function takes arrays and writes a PNG; matplotlib is imported only here and only when drawing.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.core.statistics import autocorrelation
from specklegen.memory_effects.curve import MemoryEffect
from specklegen.memory_effects.temporal import TemporalCorrelation
from specklegen.theory.slab import memory_effect_diffusion


def _figure(rows: int, columns: int, width: float, height: float):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(columns * width, rows * height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _show(axes, image: np.ndarray, title: str = "", *, low: float | None = None, high: float | None = None) -> None:
    axes.imshow(image, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
    axes.set_axis_off()
    if title:
        axes.set_title(title, fontsize=9)


def hidden_object_sheet(samples: Sequence[Mapping[str, Any]], out: Path) -> Path:
    """Draw objects, camera images, and the autocorrelations of both to one scale, a column a sample.

    Parameters
    ----------
    samples
        With "object" [h, w], "image" [H, W] and "parameters" (object_pitch, camera_pitch); of a
        coherent object no object_pitch, and no autocorrelations are shown.
    out
        PNG to write.
    """
    incoherent = "object_pitch" in samples[0]["parameters"]  # else the autocorrelation is not the object's
    figure, axes = _figure(4 if incoherent else 2, len(samples), 1.5, 1.6)
    for column, sample in enumerate(samples):
        hidden, image = np.asarray(sample["object"]), np.asarray(sample["image"], dtype=np.float64)
        low, high = (float(level) for level in np.percentile(image, [0.5, 99.5]))
        if not incoherent:
            _show(axes[0, column], hidden, "coherent object" if column == 0 else "", low=0, high=1)
            _show(axes[1, column], image, "camera image" if column == 0 else "", low=low, high=high)
            continue
        scale = float(sample["parameters"]["object_pitch"]) / float(sample["parameters"]["camera_pitch"])
        half = min(round(scale * max(hidden.shape)), min(image.shape) - 1)
        window = _middle(autocorrelation(image), half)
        truth = _middle(autocorrelation_of_object(hidden), round(half / scale))
        rows = (
            (hidden[::-1, ::-1], "object, rotated 180°", 0, 1), (image, "camera image", low, high),
            (window, "autocorrelation", 0, 0.7), (truth, "that of the object", 0, 0.7),
        )  # fmt: skip
        for axis, (picture, title, low, high) in zip(axes[:, column], rows, strict=True):
            _show(axis, picture, title if column == 0 else "", low=low, high=high)
    return _save(figure, out)


def _middle(lags: np.ndarray, half: int) -> np.ndarray:
    """Lags up to ``half`` either way; 0 where there are none."""
    padded = np.pad(lags, [(max(0, half - n // 2),) * 2 for n in lags.shape])
    rows, columns = (n // 2 for n in padded.shape)
    return padded[rows - half : rows + half + 1, columns - half : columns + half + 1]


def autocorrelation_of_object(hidden: np.ndarray) -> np.ndarray:
    """Autocorrelation of a brightness (its mean left in), 1 at zero lag in the middle."""
    from scipy.signal import correlate

    lags = np.clip(correlate(hidden.astype(np.float64), hidden.astype(np.float64), method="fft"), 0, None)
    return lags / max(lags.max(), 1e-300)


def tilt_strip(samples: Sequence[Mapping[str, Any]], out: Path) -> Path:
    """Draw stacks, a row a sample and a column a tilt.

    Each image is marked with how far the pattern of the first has moved (an arrow), and with its correlation with that
    pattern where both see it; the first with a scale of angles.

    Parameters
    ----------
    samples
        With "stack" [T, H, W], "tilts" [T, 2] and "parameters" (optical_depth, g, camera_pitch).
    out
        PNG to write.
    """
    tilts = np.asarray(samples[0]["tilts"])
    figure, axes = _figure(len(samples), len(tilts), 1.7, 1.9)
    for row, sample in enumerate(samples):
        stack, parameters = np.asarray(sample["stack"]), sample["parameters"]
        high = np.percentile(stack, 99.5)
        moves = np.rint((np.asarray(sample["tilts"]) - sample["tilts"][0]) / parameters["camera_pitch"]).astype(int)
        for column, (image, move) in enumerate(zip(stack, moves, strict=True)):
            angle = np.rad2deg(np.hypot(*np.asarray(sample["tilts"])[column]))
            title = f"{angle:.4f}°"
            if column == 0:
                title = f"OD {parameters['optical_depth']:.1f}  g {parameters['g']:.2f}\n" + title
            elif (alike := moved_correlation(stack[0], image, move)) is not None:
                title += f"   C {alike:.2f}"
            panel = axes[row, column]
            _show(panel, image, title, low=0, high=high)
            if row == column == 0:
                _scale(panel, image.shape, parameters["camera_pitch"])
            if move.any():
                panel.annotate("", 4 + np.maximum(move, 0), 4 - np.minimum(move, 0), annotation_clip=False,
                               arrowprops={"arrowstyle": "->", "color": "tab:orange", "lw": 1.5})  # fmt: skip
    return _save(figure, out)


def _scale(axes, shape: tuple[int, ...], pitch: float) -> None:
    """Draw a bar at the foot of an image[H, W], as long as a round angle, with its degrees; ``pitch`` in radians."""
    degrees = round_length(shape[1] * float(np.rad2deg(pitch)) / 3)
    bottom, left = shape[0] - 5, 4
    bar = [left, left + degrees / float(np.rad2deg(pitch))]
    axes.plot(bar, [bottom, bottom], color="tab:orange", lw=2.5, solid_capstyle="butt")
    axes.text(left, bottom - 3, f"{degrees:g}°", color="tab:orange", fontsize=9, va="bottom",
              bbox={"facecolor": "black", "edgecolor": "none", "alpha": 0.7, "pad": 1})  # fmt: skip


def round_length(most: float) -> float:
    """Largest of ``{1, 2, 5}`` times a power of ten that is no longer than ``most``."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(f"{max(step for step in (1, 2, 5) if step * power <= most * (1 + 1e-12)) * power:.1g}")


def moved_correlation(first: np.ndarray, image: np.ndarray, move: np.ndarray) -> float | None:
    """Correlation of two images[H, W] where the first's pattern, moved by (x, y) whole pixels, lies on the second.

    None where fewer than 64 pixels do.
    """
    (x, y), (height, width) = (int(step) for step in move), first.shape
    if max(height - abs(y), 0) * max(width - abs(x), 0) < 64:
        return None
    parts = []
    for one, right, down in ((first, -x, -y), (image, x, y)):
        parts.append(one[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)])
    return float(np.corrcoef(parts[0].ravel(), parts[1].ravel())[0, 1])


def memory_effect_figure(curves: Mapping[str, MemoryEffect], out: Path) -> Path:
    """Draw C_I over the tilt in units of the slab, with error bars, against q^2/sinh^2 q ([Bar19] Eq. 39).

    Parameters
    ----------
    curves
        Label to curve.
    out
        PNG to write.
    """
    figure, axes = _figure(1, 1, 6.5, 4.2)
    axes = axes[0, 0]
    largest = max((float(np.abs(c.q).max(initial=0.0)) for c in curves.values()), default=1.0)
    q = np.linspace(0, largest, 300)
    axes.plot(q, memory_effect_diffusion(q), "k--", lw=1, label=r"$q^2/\sinh^2 q$ (diffusion)")
    for label, curve in curves.items():
        curve.plot(axes, label=label)
    axes.legend(frameon=False)
    return _save(figure, out)


def temporal_figure(curves: Mapping[str, TemporalCorrelation], out: Path) -> Path:
    """Draw |g1|^2 of labelled curves over the lag, with error bars, into a PNG."""
    figure, axes = _figure(1, 1, 6.5, 4.2)
    for label, curve in curves.items():
        curve.plot(axes[0, 0], label=label)
    axes[0, 0].legend(frameon=False)
    return _save(figure, out)


def stack_sheet(intensity: np.ndarray, titles: Sequence[str], out: Path) -> Path:
    """Draw the images of one rendered stack float[T, H, W] side by side, up to eight a row."""
    columns = min(len(intensity), 8)
    rows = -(-len(intensity) // columns)
    figure, axes = _figure(rows, columns, 2.0, 2.2)
    high = np.percentile(intensity, 99.5)
    for place, (image, title) in enumerate(zip(intensity, titles, strict=True)):
        _show(axes.flat[place], np.atleast_2d(image), title, low=0, high=high)
    for unused in axes.flat[len(intensity) :]:
        unused.set_axis_off()
    return _save(figure, out)


def image_strip(samples: Sequence[Mapping[str, Any]], key: str, out: Path) -> Path:
    """Draw hidden objects (turned by 180 degrees) and all their images, a row a sample.

    Parameters
    ----------
    samples
        With "object" [h, w] and ``key`` [n, H, W].
    out
        PNG to write.
    """
    figure, axes = _figure(len(samples), 1 + len(samples[0][key]), 1.6, 1.75)
    for row, sample in enumerate(samples):
        _show(axes[row, 0], np.asarray(sample["object"])[::-1, ::-1], "" if row else "object, rotated", low=0, high=1)
        images = np.asarray(sample[key], dtype=np.float64)
        low, high = np.percentile(images, [0.5, 99.5])
        for n, image in enumerate(images, 1):
            _show(axes[row, n], image, "" if row else f"{key.removesuffix('s')} {n}", low=low, high=high)
    return _save(figure, out)


def sheet(samples: Sequence[Mapping[str, Any]], out: Path) -> Path:
    """Draw samples of any recipe in the way that their keys call for."""
    keys = samples[0].keys()
    several = [key for key in ("frames", "stack") if key in keys]
    if "object" not in keys:
        if "tilts" in keys:
            return tilt_strip(samples, out)
        if several:
            images = np.concatenate([np.asarray(sample[several[0]], dtype=np.float64) for sample in samples])
            pictures = len(images) // len(samples)
            titles = [f"sample {n // pictures}, picture {n % pictures}" for n in range(len(images))]
            return stack_sheet(images, titles, out)
        titles = [f"contrast {float(sample['parameters']['expected_contrast']):.2f}" for sample in samples]
        return stack_sheet(np.array([sample["image"] for sample in samples], dtype=np.float64), titles, out)
    return image_strip(samples, several[0], out) if several else hidden_object_sheet(samples, out)


def _save(figure, out: Path) -> Path:
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
    return out
