"""Panels as HTML: pictures inside the page, so that nothing is fetched from anywhere."""

import base64
import html
import io

import numpy as np
from PIL import Image

from specklegen.explorer.panels import Curve, Moved
from specklegen.models.recoverability.verdict import Verdict

STYLE = """<style>
.sg-panels { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 17rem), 1fr)); gap: 1rem; }
.sg-panel { border: 1px solid #8884; border-radius: 6px; padding: .6rem .8rem; min-width: 0; font-size: .9rem; }
.sg-title { margin: 0 0 .4rem; font-weight: 600; }
.sg-head { font-size: 1.4rem; font-weight: 600; margin-bottom: .6rem; }
.sg-panel img { width: 100%; margin: 0 0 .2rem; image-rendering: pixelated; }
.sg-panel .sg-row { display: flex; gap: .5rem; }
.sg-panel .sg-row > * { flex: 1 1 0; min-width: 0; }
.sg-panel svg { width: 100%; height: auto; }
.sg-panel p { margin: .4rem 0 0; }
.sg-late { opacity: .35; }
.sg-wide { grid-column: 1 / -1; }
.sg-controls { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 20rem), 1fr));
  gap: .3rem 1.5rem; }
</style>"""


def png(image: np.ndarray, low: float | None = None, high: float | None = None) -> bytes:
    """Grey PNG of an image real[H, W], a pixel a pixel; by default from 0 to what one pixel of 200 exceeds."""
    values = np.asarray(image, dtype=np.float64)
    bottom, top = low or 0.0, float(np.percentile(values, 99.5)) if high is None else high
    grey = np.clip(255 * (values - bottom) / max(top - bottom, 1e-300), 0, 255).round().astype(np.uint8)
    out = io.BytesIO()
    Image.fromarray(grey).save(out, "PNG")
    return out.getvalue()


def sheet(images: np.ndarray, columns: int = 8) -> np.ndarray:
    """Images real[n, H, W] side by side, a dark line between them."""
    count, rows, across = images.shape
    lines = -(-count // columns)
    canvas = np.zeros((lines * (rows + 1) - 1, columns * (across + 1) - 1))
    for n, image in enumerate(images):
        top, left = n // columns * (rows + 1), n % columns * (across + 1)
        canvas[top : top + rows, left : left + across] = image
    return canvas


def picture(data: bytes, name: str) -> str:
    """An image inside the page; its name is its alternative text."""
    inside = base64.b64encode(data).decode()
    return f'<img alt="{html.escape(name)}" src="data:image/png;base64,{inside}">'


def panel(title: str, body: str, wide: bool = False) -> str:
    """A panel: a title of ours, and HTML."""
    heading = f'<div class="sg-title">{html.escape(title)}</div>'
    return f'<div class="sg-panel{" sg-wide" if wide else ""}">{heading}{body}</div>'


def row(*parts: str) -> str:
    """Parts side by side."""
    return f'<div class="sg-row">{"".join(f"<div>{part}</div>" for part in parts)}</div>'


def ticks(last: float) -> np.ndarray:
    """Three to six round numbers from 0 to a positive one: steps are ``{1, 2, 5}`` times a power of ten."""
    power = 10 ** np.floor(np.log10(last))
    step = next(step * power for step in (0.2, 0.5, 1.0, 2.0) if last < 6 * step * power)
    return step * np.arange(last // step + 1)


def curve_svg(curve: Curve) -> str:
    """C_I over the angle as SVG, the object as a band, the range as a dashed line."""
    labels = "memory effect", "angle inside the medium, mrad"
    return _svg(curve.angles, curve.c_i, labels, dashed=curve.range, band=curve.extent)


def forgetting_svg(curve: Moved, lag: float) -> str:
    """|g1|^2 over the lag as SVG, the lag of the frames as a dashed line."""
    return _svg(curve.lags, curve.intensity, ("speckle in motion", "lag, ms"), dashed=lag)


def _svg(x: np.ndarray, y: np.ndarray, said: tuple[str, str], dashed: float, band: float | None = None) -> str:
    """A curve of values up to 1 as SVG: its name and axis, a line at an x, and a band that begins at 0."""
    width, height, left, bottom = 320.0, 200.0, 36.0, 34.0
    last = float(x[-1])

    def across(place: float) -> float:
        return left + (width - left - 8) * place / last

    def up(value: float) -> float:
        return 8 + (height - bottom - 8) * (1 - value)

    points = " ".join(f"{across(a):.1f},{up(c):.1f}" for a, c in zip(x, y, strict=True))
    levels = "".join(f'<text x="{left - 5}" y="{up(v) + 4:.1f}" text-anchor="end">{v:g}</text>' for v in (0, 0.5, 1))
    marks = "".join(
        f'<text x="{across(a):.1f}" y="{height - bottom + 14}" text-anchor="middle">{a:.4g}</text>' for a in ticks(last)
    )
    line = "" if not dashed <= last else (
        f'<path d="M{across(dashed):.1f} {up(1):.1f}V{up(0):.1f}" stroke="currentColor" stroke-dasharray="4 3"/>'
    )  # fmt: skip
    shaded = "" if band is None else (
        f'<rect class="sg-object" x="{across(0):.1f}" y="{up(1):.1f}" width="{across(band) - across(0):.1f}" '
        f'height="{up(0) - up(1):.1f}" fill="#e8a33d" opacity=".3"/>'
    )  # fmt: skip
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{said[0]}" font-size="11" '
        f'fill="currentColor" font-family="sans-serif">{shaded}'
        f'<path d="M{left} 8V{up(0):.1f}H{width - 8}" fill="none" stroke="currentColor"/>'
        f'{line}<polyline points="{points}" fill="none" stroke="#2b6cb0" stroke-width="2"/>{levels}{marks}'
        f'<text x="{width / 2}" y="{height - 4}" text-anchor="middle">{said[1]}</text></svg>'
    )


def verdict_html(found: Verdict) -> str:
    """Judgement in a sentence, the errors that it follows from, and each reason against with its remedy."""
    word = "works" if found.works else "fails"
    reasons = "".join(
        f"<li><strong>{html.escape(each.name)}</strong>: {html.escape(each.numbers)}. "
        f"Remedy: {html.escape(each.remedy)}.</li>" for each in found.reasons
    )  # fmt: skip
    beyond = "".join(f" Caution: {name} is outside the fitted range." for name in found.extrapolates)
    low, high = found.interval
    chance = f"probability {found.probability:.2f} ({low:.2f} to {high:.2f})"
    sentence = f"<p><strong>Phase retrieval {word}</strong>, {chance}.{beyond}</p>"
    noise, distortion = found.numbers["noise"], found.numbers["distortion"]
    errors = f"<p>Relative errors of the measured Fourier modulus: noise {noise:.2g}, distortion {distortion:.2g}.</p>"
    return f"{sentence}{errors}<ul>{reasons}</ul>"
