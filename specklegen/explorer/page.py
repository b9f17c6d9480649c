"""The parts of the page as HTML, from panels and drawing; what a state makes impossible is said in its place."""

import html
import io
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from specklegen.core.errors import ToldError
from specklegen.explorer import drawing, recipe
from specklegen.explorer import panels as shown
from specklegen.explorer.controls import CONTROLS, State

toml, python = recipe.toml, recipe.python


def head(said: Iterable[str] = ()) -> str:
    """Style, title, and what the address asked for in vain."""
    lines = "".join(f'<p class="sg-refused" role="alert">{html.escape(line)}</p>' for line in said)
    return f'{drawing.STYLE}<div class="sg-head">specklegen explorer</div>{lines}'


def sliders(elements: Iterable[str]) -> str:
    """Controls, as many a row as there is room for."""
    return f'<div class="sg-controls">{"".join(f"<div>{element}</div>" for element in elements)}</div>'


def buttons(*elements: str) -> str:
    """Buttons in a row that wraps."""
    return f'<p class="sg-buttons">{" ".join(elements)}</p>'


def files(state: State) -> list[tuple[str, str, bytes]]:
    """Downloads: label, file name, contents; none if the view has no such medium."""
    try:
        return [
            ("Recipe as TOML", "explored.toml", toml(state).encode()),
            ("The same as Python", "explored.py", python(state).encode()),
        ]
    except ToldError:
        return []  # its panel says why


def panels(state: State) -> str:
    """Every panel of a state's view."""
    *_, every = coming(state, {})
    return every


def coming(state: State, before: dict[str, str]) -> Iterator[str]:
    """Every panel of a state's view, as they are made: once after each, the camera's first.

    Parameters
    ----------
    state
        What is shown.
    before
        Bodies of panels by their titles, as they stood before: greyed until they are made anew, and written into it.
    """
    panels = [each for each in _PANELS if state.view in each.views]
    late = {each.title: f'<div class="sg-late">{before.get(each.title, "...")}</div>' for each in panels}
    for title, _, body, _ in panels:
        before[title] = late[title] = _said(body, state)
        markup = "".join(drawing.panel(each.title, late[each.title], each.wide) for each in panels)
        yield f'<div class="sg-panels">{markup}</div>'


def has_sixteen(state: State) -> bool:
    """Return whether the view is of single images, of which sixteen can be drawn."""
    return state.view == CONTROLS["view"].steps[0]


def sixteen(state: State) -> tuple[str, bytes]:
    """Sixteen samples: their images as a panel, and all their arrays as the bytes of an NPZ file."""
    samples = shown.sixteen(state)
    out = io.BytesIO()
    np.savez_compressed(out, image=samples.images, object=samples.objects)
    sheets = {"sixteen camera images": samples.images, "their objects": samples.objects}
    pictures = (drawing.picture(drawing.png(drawing.sheet(each)), name) for name, each in sheets.items())
    body = f"<p>{samples.rate:.3g} samples a second, on this machine, at its present load.</p>" + "".join(pictures)
    return f'<div class="sg-panels">{drawing.panel("Sixteen samples", body, True)}</div>', out.getvalue()


def _said(body: Callable[[State], str], state: State) -> str:
    try:
        return body(state)
    except ToldError as error:
        return f'<p class="sg-refused">{html.escape(str(error))}</p>'


def _pictures(*images: tuple[Any, str, str], high: float | None = None) -> str:
    """Pictures in a row: of each its pixels, its alternative text and what stands below it; white is ``high``."""
    return drawing.row(*(drawing.picture(drawing.png(each, high=high), name) + below for each, name, below in images))


def _high(images: np.ndarray) -> float:
    """Brightness that is white in all of some images."""
    return float(np.percentile(images, 99.5))


def _camera(state: State) -> str:
    sample = shown.sample(state)
    turned = np.asarray(sample["object"])[::-1, ::-1]
    return drawing.row(
        drawing.picture(drawing.png(sample["image"]), "camera image") + "the camera's image",
        drawing.picture(drawing.png(turned, high=1.0), "hidden object") + "the object, rotated by 180°",
    )


def _tilt(state: State) -> str:
    tilted = shown.tilted(state)
    before, after = tilted.images
    return _pictures(
        (before, "speckle before", "before"), (after, "speckle after", f"after {state.tilt:g} mrad"),
        high=_high(tilted.images),
    ) + (
        f"<p>One beam, no object. The pattern moves by {tilted.shift:.3g} pixels to the right; "
        f"moved back, it correlates by C<sub>I</sub> = {tilted.correlation:.2f}.</p>"
    )


def _moved(state: State) -> str:
    moved = shown.moved(state)
    now, then = moved.images
    half = f"half way to its floor after {moved.fallen:.3g} ms" if np.isfinite(moved.fallen) else "static"
    return (
        _pictures(
            (now, "first frame", "at first"), (then, "frame after the lag", f"after {state.lag:g} ms"),
            high=_high(moved.images),
        )
        + drawing.forgetting_svg(moved, state.lag)
        + (
            f"<p>|g<sub>1</sub>|² of one beam's speckle, {half}; the lag is the dashed line, where it is "
            f"{moved.correlation:.2f}. {_moving(state)}</p>"
        )
    )


def _moving(state: State) -> str:
    if not recipe.of_glass(state):
        return "Brownian spheres of 0.5 µm in water."
    alone = "The first glass is" if state.gap else "A single glass keeps its pattern until it leaves the light; it is"
    return f"{alone} drawn across the light, {recipe.GLIDE:g} µm a millisecond."


def _analysed(state: State) -> str:
    analysed = shown.analysed(state)
    images = (
        (image, f"image behind the analyser {name}", f"{name}: {share:.1%} of the light")
        for image, name, share in zip(analysed.images, recipe.ANALYSERS[state.analysers], analysed.shares, strict=True)
    )
    degree = analysed.shares[0] - analysed.shares[1]
    return (
        _pictures(*images)
        + f"<p>One object in {state.analysers} light, particles of low contrast. What comes out has a degree of "
        f"polarisation of {degree:.2f}; light behind the second analyser took longer paths, and decorrelates "
        "sooner.</p>"
    )


def _lens(state: State) -> str:
    focused = shown.focused(state)
    labels = "on the face", f"{abs(state.focus):g} µm {'behind' if state.focus > 0 else 'inside'} it"
    images = ((image, f"image {where}", where) for image, where in zip(focused.images, labels, strict=False))
    return _pictures(*images, high=_high(focused.images)) + (
        f"<p>A square of {recipe.SPOT:g} µm is lit on the other side. The camera sees {focused.field:.3g} µm, "
        f"in grains of {focused.grain:.3g} µm.</p>"
    )


def _lags(state: State) -> str:
    lags = shown.autocorrelations(state)
    return _pictures((lags.image, "autocorrelation of the image", "of the image"),
                     (lags.object, "autocorrelation of the object", "of the object"), high=0.7)  # fmt: skip


def _curve(state: State) -> str:
    curve = shown.memory_curve(state)
    half = f"half way to its floor at {curve.range:.3g} mrad" if np.isfinite(curve.range) else "without a range"
    return drawing.curve_svg(curve) + (
        f"<p>C<sub>I</sub>, {half}; the object (band) is {curve.extent:.4g} mrad wide, and between its ends "
        f"C<sub>I</sub> = {curve.across:.2f}.</p>"
    )


def _katz(state: State) -> str:
    estimate = shown.retrieved(state)
    return drawing.row(
        drawing.picture(drawing.png(estimate.image), "phase retrieval") + "phase retrieval",
        drawing.picture(drawing.png(shown.sample(state)["object"], high=1.0), "the object") + "the object",
    ) + (
        f"<p>After the best shift and 180-degree rotation, Pearson correlation {estimate.correlation:.2f}; to the "
        f"object as a lens of this aperture would show it, {estimate.limited:.2f}.</p>"
    )


def _verdict(state: State) -> str:
    doubts = "".join(f"<p><em>Doubt</em>: {html.escape(each)}</p>" for each in shown.doubts(state))
    return drawing.verdict_html(shown.verdict(state)) + doubts


def _text(write: Callable[[State], str]) -> Callable[[State], str]:
    return lambda state: f"<details><summary>show</summary><pre>{html.escape(write(state))}</pre></details>"


class Panel(NamedTuple):
    """Content of the page.

    Attributes
    ----------
    wide : bool
        Whether it takes a whole row.
    body : callable
        HTML of a state.
    views : tuple of str
        Where it stands.
    """

    title: str
    wide: bool
    body: Callable[[State], str]
    views: tuple[str, ...]


_VIEWS = CONTROLS["view"].steps
_SEEING, _MOTION, _POLARISED, _LENS = ((name,) for name in _VIEWS)
_OF_OBJECTS = _SEEING + _MOTION + _POLARISED
_PANELS = (
    Panel("What the camera sees", False, _camera, _OF_OBJECTS),
    Panel("Speckle under tilt", False, _tilt, _SEEING),
    Panel("Speckle in motion", False, _moved, _MOTION),
    Panel("Behind two analysers", False, _analysed, _POLARISED),
    Panel("Through a lens", False, _lens, _LENS),
    Panel("Autocorrelation", False, _lags, _SEEING),
    Panel("Memory effect", False, _curve, _SEEING + _MOTION),
    Panel("Phase retrieval (Katz)", False, _katz, _SEEING),
    Panel("Feasibility", False, _verdict, _SEEING),
    Panel("Recipe", True, _text(toml), _VIEWS),
    Panel("The same as Python", True, _text(python), _VIEWS),
)
