"""Settings and the address that holds it.

The fields of a state are the sliders: each states where it begins and where it may stand. A new slider is a field, and
its place in :mod:`specklegen.explorer.recipe`.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, NamedTuple

from specklegen.datasets.objects import Bars, Blobs, Glyphs, Points, Polygons, Silhouettes, Strokes
from specklegen.scene.screens import GRITS


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


def slider(start: Any, label: str, *steps: Any) -> Any:
    """Return the field of a state that a control sets, with the value that it begins with."""
    return field(default=start, metadata={"control": Control(label, steps)})


_THICKNESSES = (200.0, 300.0, 500.0, 700.0, 1000.0, 1500.0, 2000.0, 3000.0, 4000.0)
_PATHS = (50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 700.0, 1000.0)
_COSINES = (0.1, 0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98)


@dataclass(frozen=True)
class State:
    """Positions of the sliders.

    Lengths are in micrometres, those of a laboratory in millimetres but for its pixels, angles in milliradians inside
    the medium, the lag in milliseconds.
    """

    view: str = slider("seeing through", "look at", "seeing through", "motion", "polarisation", "a lens")
    medium: str = slider("slab", "medium", "slab", "two layers", "ground glass")
    thickness: float = slider(1000.0, "thickness, µm", *_THICKNESSES)
    mean_free_path: float = slider(100.0, "mean free path, µm", *_PATHS)
    lobe: str = slider("HenyeyGreenstein", "phase function", "HenyeyGreenstein", "VonMisesFisher")
    g: float = slider(0.9, "anisotropy g", *_COSINES)
    refractive_index: float = slider(1.0, "refractive index, in air (1: index-matched)", 1.0, 1.2, 1.33, 1.4, 1.5, 1.6)
    second_thickness: float = slider(500.0, "thickness of the second layer, µm", *_THICKNESSES)
    second_mean_free_path: float = slider(50.0, "its mean free path, µm", *_PATHS)
    second_g: float = slider(0.8, "its anisotropy g", *_COSINES)
    grit: str = slider("220", "grit of the glass", *(str(grit) for grit in GRITS))
    gap: float = slider(0.0, "gap to a second glass, µm (0: one alone)", 0.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
    wavelength: float = slider(0.5, "wavelength in the medium, µm", 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2)
    setup: str = slider("angles", "setup in", "angles", "laboratory lengths")
    aperture: float = slider(50_000.0, "aperture, µm", 5e3, 7e3, 1e4, 1.5e4, 2e4, 3e4, 5e4, 7e4, 1e5)
    object: str = slider(
        "Glyphs", "object", *(each.__name__ for each in (Glyphs, Points, Bars, Strokes, Polygons, Blobs, Silhouettes)),
    )
    extent: float = slider(0.1, "width of the object, mrad", 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
    iris: float = slider(5.0, "aperture on the medium, mm", 0.5, 0.7, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
    object_distance: float = slider(200.0, "object to medium, mm", 50.0, 100.0, 200.0, 300.0, 500.0, 1000.0)
    object_width: float = slider(0.3, "width of the object, mm", 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0)
    camera_distance: float = slider(100.0, "medium to camera, mm", 20.0, 50.0, 100.0, 150.0, 200.0, 300.0, 500.0)
    pixel: float = slider(5.0, "pixel of the camera, µm", 2.0, 3.45, 5.0, 6.5, 11.0)
    camera: int = slider(192, "camera, pixels a side", 64, 96, 128, 160, 192, 256)
    photons: float = slider(0.0, "photons a pixel (0: no noise)", 0.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
    tilt: float = slider(0.1, "tilt, mrad", 0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5)
    lag: float = slider(
        2.0, "lag, ms", 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0,
    )
    focus: float = slider(
        0.0, "focus of the lens behind the slab, µm",
        -1000.0, -500.0, -200.0, -100.0, -50.0, 0.0, 50.0, 100.0, 200.0, 500.0, 1000.0,
    )
    lens: float = slider(0.02, "aperture of the lens, a sine in the slab", 0.01, 0.015, 0.02, 0.03, 0.04, 0.05)
    magnification: float = slider(2.0, "magnification, onto pixels of 6.5 µm", 1.0, 2.0, 3.0, 5.0, 10.0, 20.0)
    analysers: str = slider("linear", "light before two analysers", "linear", "circular")
    sample: int = slider(0, "which sample", *range(16))

    def replace(self, **changes: Any) -> "State":
        """Return a state with some controls set otherwise."""
        return replace(self, **changes)


CONTROLS: dict[str, Control] = {each.name: each.metadata["control"] for each in fields(State)}
"""Field of a state to its control."""


_SLABS = {"medium": ("slab", "two layers")}
_IMAGES = {"view": ("seeing through", "motion", "polarisation")}
_ANGLES, _LENGTHS = {"setup": ("angles",)}, {"setup": ("laboratory lengths",)}
_ONLY: dict[str, dict[str, tuple]] = {
    **dict.fromkeys(("thickness", "mean_free_path", "lobe", "g"), _SLABS),
    "refractive_index": {"medium": ("slab",)},
    **dict.fromkeys(("second_thickness", "second_mean_free_path", "second_g"), {"medium": ("two layers",)}),
    **dict.fromkeys(("grit", "gap"), {"medium": ("ground glass",)}),
    **dict.fromkeys(("setup", "object", "photons"), _IMAGES),
    **dict.fromkeys(("aperture", "extent"), _IMAGES | _ANGLES),
    **dict.fromkeys(("iris", "object_distance", "object_width", "camera_distance", "pixel"), _IMAGES | _LENGTHS),
    "tilt": {"view": ("seeing through",)},
    "lag": {"view": ("motion",)},
    **dict.fromkeys(("focus", "lens", "magnification"), {"view": ("a lens",)} | _SLABS),
    "analysers": {"view": ("polarisation",), "medium": ("slab",)},
}
"""Controls that say something under conditions alone: where others must stand."""


def shown(state: State) -> list[str]:
    """Names of the controls that say something of a state."""
    return [
        name for name in CONTROLS if all(getattr(state, other) in steps for other, steps in _ONLY.get(name, {}).items())
    ]


def read(address: Mapping[str, str]) -> tuple[State, tuple[str, ...]]:
    """State that an address holds, and a sentence for each word of it that is not shown as it was asked for."""
    chosen, remarks, begins = {}, [], State()
    for name, text in address.items():
        if name not in CONTROLS:
            remarks.append(f"{name} is no control and is ignored. Controls: {', '.join(CONTROLS)}.")
            continue
        control = CONTROLS[name]
        step, rule = _read(text, control.steps)
        if rule is not None:
            instead = _written(getattr(begins, name) if step is None else step)
            remarks.append(f"{name} must be {rule}; got {text}. Shown is {instead}.")
        if step is not None:
            chosen[name] = step
    return State(**chosen), tuple(remarks)


def _read(text: str, steps: tuple) -> tuple[Any, str | None]:
    """Step that a text means, None where it means none; and the rule that it breaks, if any."""
    if isinstance(steps[0], str):
        return (text, None) if text in steps else (None, f"one of {', '.join(steps)}")
    rule = f"a number from {steps[0]:g} to {steps[-1]:g}"
    try:
        number = float(text)
    except ValueError:
        return None, rule
    if not steps[0] <= number <= steps[-1]:
        return None, rule
    nearest = min(steps, key=lambda step: abs(step - number))
    near = math.isclose(nearest, number, rel_tol=1e-5)  # as many digits as an address has
    return nearest, None if near else f"one of {', '.join(_written(step) for step in steps)}"


def _written(step: Any) -> str:
    return f"{step:g}" if isinstance(step, float) else str(step)


def address_of(state: State) -> dict[str, str]:
    """Return the part of a state that the address holds: all that differs from the initial state."""
    begins = State()
    return {name: _written(value) for name, value in asdict(state).items() if value != getattr(begins, name)}
