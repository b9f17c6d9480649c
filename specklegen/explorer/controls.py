"""What can be set, and the address that holds it.

A state is a frozen tuple. Its fields are the sliders, its defaults where they begin, :data:`CONTROLS` where they may
stand. A new slider is a field, a line of :data:`CONTROLS`, and its place in :mod:`specklegen.explorer.recipe`.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from specklegen.datasets.objects import Bars, Blobs, Glyphs, Points, Polygons, Silhouettes, Strokes


class State(NamedTuple):
    """Where the sliders stand; lengths in micrometres, angles in milliradians inside the slab, the lag in ms."""

    thickness: float = 1000.0
    mean_free_path: float = 100.0
    lobe: str = "HenyeyGreenstein"
    g: float = 0.9
    refractive_index: float = 1.0
    wavelength: float = 0.5
    aperture: float = 50_000.0
    object: str = "Glyphs"
    extent: float = 0.1
    camera: int = 192
    photons: float = 0.0
    tilt: float = 0.1
    lag: float = 2.0
    focus: float = 0.0
    lens: float = 0.02
    magnification: float = 2.0
    analysers: str = "linear"
    sample: int = 0


class Control(NamedTuple):
    """One slider or choice.

    Attributes
    ----------
    label : str
        What stands beside it.
    steps : tuple
        Values that it takes, in order.
    """

    label: str
    steps: tuple


CONTROLS: dict[str, Control] = {
    "thickness": Control("thickness, µm", (200.0, 300.0, 500.0, 700.0, 1000.0, 1500.0, 2000.0, 3000.0, 4000.0)),
    "mean_free_path": Control("mean free path, µm", (50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 700.0, 1000.0)),
    "lobe": Control("lobe", ("HenyeyGreenstein", "VonMisesFisher")),
    "g": Control("anisotropy g", (0.1, 0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98)),
    "refractive_index": Control("refractive index, in air (1: no faces)", (1.0, 1.2, 1.33, 1.4, 1.5, 1.6)),
    "wavelength": Control("wavelength in the slab, µm", (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2)),
    "aperture": Control("aperture, µm", (5e3, 7e3, 1e4, 1.5e4, 2e4, 3e4, 5e4, 7e4, 1e5)),
    "object": Control(
        "object", tuple(each.__name__ for each in (Glyphs, Points, Bars, Strokes, Polygons, Blobs, Silhouettes))
    ),
    "extent": Control("width of the object, mrad", (0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)),
    "camera": Control("camera, pixels a side", (64, 96, 128, 160, 192, 256)),
    "photons": Control("photons a pixel (0: no noise)", (0.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)),
    "tilt": Control("tilt, mrad", (0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5)),
    "lag": Control(
        "lag, ms, of spheres of 0.5 µm in water",
        (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0),
    ),
    "focus": Control(
        "focus of the lens behind the slab, µm",
        (-1000.0, -500.0, -200.0, -100.0, -50.0, 0.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
    ),
    "lens": Control("aperture of the lens, a sine in the slab", (0.01, 0.015, 0.02, 0.03, 0.04, 0.05)),
    "magnification": Control("magnification, onto pixels of 6.5 µm", (1.0, 2.0, 3.0, 5.0, 10.0, 20.0)),
    "analysers": Control("light before two analysers", ("linear", "circular")),
    "sample": Control("which sample", tuple(range(16))),
}
"""Field of a state to its control."""


def state_of(address: Mapping[str, str]) -> State:
    """State that an address holds: numbers go to the nearest step, what it does not hold or say well to the default."""
    read = {name: _read(address[name], control.steps) for name, control in CONTROLS.items() if name in address}
    return State()._replace(**{name: value for name, value in read.items() if value is not None})


def _read(text: str, steps: tuple) -> Any:
    """Step that a text means; None where it means none."""
    if isinstance(steps[0], str):
        return text if text in steps else None
    try:
        number = float(text)
    except ValueError:
        return None
    return min(steps, key=lambda step: abs(step - number)) if abs(number) < float("inf") else None


def address_of(state: State) -> dict[str, str]:
    """What the address holds of a state: all that is not where it begins."""
    begins = State()
    return {name: f"{value:g}" if isinstance(value, float) else str(value)
            for name, value in state._asdict().items() if value != getattr(begins, name)}  # fmt: skip
