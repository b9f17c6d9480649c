"""The recipes of a state: one a view, which is the one to take along, and that of the tilts."""

import pprint
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from scipy.optimize import brentq

from specklegen.core.errors import reject
from specklegen.datasets.recipes.analysed_object import AnalysedObject
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.lens_stack import LensStack
from specklegen.datasets.recipes.multi_image import DynamicSlab
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.explorer.controls import CONTROLS, State
from specklegen.scene.motion import Brownian
from specklegen.scene.scatterers import VonMisesFisher

SEED = 1
SPLIT = "test"
SIDE = 28
"""Object pixels along a side."""
PIXELS = 3.0
"""Camera pixels in a grain."""
SPHERES = Brownian.of_sphere(radius=0.25, viscosity=1.002e-3, temperature=293.15)
"""What moves: spheres of half a micrometre in water at 20 degrees Celsius, 0.857 um^2 / s."""
SPOT = 100.0
"""Side of the lit window that the lens looks at, micrometres."""
PIXEL = 6.5
"""Micrometres between pixels of the camera behind the lens."""
GLIDE = 1.0
"""How fast the first of the ground glasses is drawn across the light, micrometres a millisecond."""
ANALYSERS = {"linear": ("parallel", "crossed"), "circular": ("circular", "flipped")}
"""What stands before the camera in light of each kind."""
_PATHS = 20_000  # a kernel that no table holds, in a third of a second
_SUMMED = 3000  # behind the lens, where paths are summed


def recipe_table(state: State) -> dict[str, Any]:
    """Table of the hidden-object recipe, as a TOML file holds it."""
    table = {
        "name": "explored",
        "description": "As set in the explorer. Lengths in micrometres, angles in direction sines inside the medium.",
        "kind": "hidden-object", "media": "new", **_scene(state),
        "objects": {"type": state.object, "shape": [SIDE, SIDE]},
    }  # fmt: skip
    if not in_laboratory(state):
        table["field"] = {"pitch": float(f"{np.sin(1e-3 * state.extent) / SIDE:.6g}")}
    return table | ({"exposure": {"photons": state.photons}} if state.photons else {})


def in_laboratory(state: State) -> bool:
    """Return whether the setup is given by a laboratory's lengths."""
    return state.setup != "angles"


def of_glass(state: State) -> bool:
    """Return whether the medium is ground glass."""
    return state.medium == "ground glass"


def index_of(state: State) -> float:
    """Refractive index of the medium over the air around it: of slabs alone."""
    return state.refractive_index if state.medium == "slab" else 1.0


def extent_of(state: State) -> float:
    """Width of the object, milliradians inside the medium."""
    if not in_laboratory(state):
        return state.extent
    return 1e3 * float(np.arcsin(state.object_width / (index_of(state) * state.object_distance)))


def tilts_table(state: State) -> dict[str, Any]:
    """Table of the recipe of one beam at two tilts, through the same slab onto the same camera."""
    return _scene(state) | {
        "name": "explored-tilt", "kind": "tilt-stack", "tilts": {"count": 2, "step": 1e-3 * state.tilt},
    }  # fmt: skip


def motion_table(state: State) -> dict[str, Any]:
    """Table of the recipe of two frames of the same hidden object, while spheres move, or the first glass does."""
    still = recipe_table(state)
    if of_glass(state):
        velocities = [[GLIDE * state.lag, 0.0], [0.0, 0.0]][: len(still["material"]["screens"])]
        return still | {
            "name": "explored-motion", "kind": "dynamic-slab", "dynamics": {"frames": 2, "velocities": velocities},
        }  # fmt: skip
    asked = {"kernel": "estimate"} if state.medium == "slab" else {}  # the atlas knows no momentum transfer
    return still | {
        "name": "explored-motion", "kind": "dynamic-slab", "material": still["material"] | asked,
        "dynamics": {
            "model": "brownian", "frames": 2, "interval": 1e-3 * state.lag, "diffusion": SPHERES.diffusion,
        },
    }  # fmt: skip


def analysed_table(state: State) -> dict[str, Any]:
    """Table of the recipe of the same hidden object in polarised light, behind two analysers at right angles."""
    still = recipe_table(state)
    return still | {
        "name": "explored-analysers", "kind": "analysed-object", "material": still["material"] | {"kernel": "estimate"},
        "light": {"polarisation": "projector", "analyser": list(ANALYSERS[state.analysers])},
    }  # fmt: skip


def lens_table(state: State) -> dict[str, Any]:
    """Table of the recipe of a lit spot through a lens, focused on the slab's exit face and on a plane beside it."""
    grain = state.wavelength / (2 * state.lens)
    material = _material(state) | {"kernel_paths": _SUMMED}
    planes = {"planes": 2, "step": state.focus} if state.focus else {}
    return {
        "name": "explored-lens", "kind": "lens-stack", "media": "new",
        "material": {name: value for name, value in material.items() if name != "kernel"},
        "window": {"width": SPOT, "profile": "square"},
        "camera": {"shape": [state.camera, state.camera], "pixels_per_grain": grain * state.magnification / PIXEL},
        "lens": {"aperture": state.lens, "focus": 0.0, **planes},
    }  # fmt: skip


def _scene(state: State) -> dict[str, Any]:
    # The stationary sampler answers at once; where it is unfit, it warns. Screens have a sampler of their own.
    table = {"material": _material(state), "sampler": "screens" if of_glass(state) else "stationary"}
    if not in_laboratory(state):
        return table | {
            "window": {"width": state.aperture, "profile": "square"},
            "camera": {"shape": [state.camera, state.camera], "pixels_per_grain": PIXELS},
        }  # fmt: skip
    own = ("wavelength", "faces")  # which a laboratory says
    return table | {
        "material": {name: value for name, value in table["material"].items() if name not in own},
        "lab": {
            "wavelength": float(f"{state.wavelength * index_of(state):.6g}"), "refractive_index": index_of(state),
            "object_distance": 1e3 * state.object_distance, "object_extent": 1e3 * state.object_width,
            "aperture": 1e3 * state.iris, "profile": "disc", "camera_distance": 1e3 * state.camera_distance,
            "pixel_pitch": state.pixel, "pixels": [state.camera, state.camera],
        },
    }  # fmt: skip


def _material(state: State) -> dict[str, Any]:
    if of_glass(state):
        gaps = [state.gap] if state.gap else []
        screens = [{"type": "GroundGlass", "grit": int(state.grit)} for _ in range(1 + len(gaps))]
        return {"wavelength": state.wavelength, "screens": screens} | ({"gaps": gaps} if gaps else {})
    known = {"wavelength": state.wavelength, "kernel_paths": _PATHS}
    if state.medium == "two layers":
        layers = (
            (state.thickness, state.mean_free_path, state.g),
            (state.second_thickness, state.second_mean_free_path, state.second_g),
        )
        return known | {
            "layers": [{"thickness": thickness, "mean_free_path": path, "scatterer": _scatterer(state.lobe, g)}
                       for thickness, path, g in layers],
        }  # fmt: skip
    faced = state.refractive_index != 1.0  # which no table of the atlas holds
    material = known | {
        "thickness": state.thickness, "albedo": 1.0, "optical_depth": state.thickness / state.mean_free_path,
        "scatterer": _scatterer(state.lobe, state.g), "kernel": "estimate" if faced else "atlas",
    }  # fmt: skip
    return material | ({"faces": {"inside": state.refractive_index, "outside": 1.0}} if faced else {})


def _scatterer(lobe: str, g: float) -> dict[str, Any]:
    if lobe == "HenyeyGreenstein":
        return {"type": lobe, "g": g}
    return {"type": lobe, "concentration": concentration_of(g)}


@lru_cache
def concentration_of(g: float) -> float:
    """Concentration of the von Mises-Fisher phase function of an anisotropy: coth kappa - 1 / kappa = g."""
    log: Any = brentq(lambda x: VonMisesFisher(concentration=float(np.exp(x))).mean_cosine() - g, -10, 20, xtol=1e-12)
    return float(f"{np.exp(log):.6g}")


def _begun(state: State, *names: str) -> State:
    """The state with some sliders where they begin, and what no recipe depends on: the view, the sample's number."""
    begins = State()
    return state.replace(**{name: getattr(begins, name) for name in (*names, "view", "sample")})


_LENS = "focus", "lens", "magnification"
_LATER = *_LENS, "analysers"


class _View(NamedTuple):
    """Recipe of a view: its kind, its table, and the sliders that it does not depend on."""

    kind: type
    table: Callable[[State], dict[str, Any]]
    without: tuple[str, ...]


_HIDDEN = _View(HiddenObject, recipe_table, ("tilt", "lag", *_LATER))
_TILTS = _View(TiltStack, tilts_table, ("object", "extent", "photons", "lag", *_LATER))
_MOTION = _View(DynamicSlab, motion_table, ("tilt", *_LATER))
_ANALYSED = _View(AnalysedObject, analysed_table, ("tilt", "lag", *_LENS))
_LENSED = _View(LensStack, lens_table, ("aperture", "object", "extent", "photons", "tilt", "lag", "analysers"))
_VIEWS = dict(zip(CONTROLS["view"].steps, (_HIDDEN, _MOTION, _ANALYSED, _LENSED), strict=True))
"""View to the recipe of what it shows first."""


@lru_cache(maxsize=16)
def _made(view: _View, state: State) -> Any:
    return view.kind(**view.table(state))


def _recipe(view: _View, state: State) -> Any:
    return _made(view, _begun(state, *view.without))


def imaged(state: State) -> State:
    """The state with every slider where it begins that neither the hidden object nor its image depends on."""
    return _begun(state, *_HIDDEN.without).replace(sample=state.sample)


def recipe_of(state: State) -> HiddenObject:
    """Recipe of the hidden object."""
    return _recipe(_HIDDEN, state)


def tilts_of(state: State) -> TiltStack:
    """Recipe of the two tilts."""
    return _recipe(_TILTS, state)


def motion_of(state: State) -> DynamicSlab:
    """Recipe of the two frames."""
    return _recipe(_MOTION, state)


def lens_of(state: State) -> LensStack:
    """Recipe of the spot through a lens; a ToldError for a ground glass."""
    return shown_of(state.replace(view="a lens"))


def analysed_of(state: State) -> AnalysedObject:
    """Recipe of the hidden object behind two analysers; a ToldError for what is no slab."""
    return shown_of(state.replace(view="polarisation"))


def shown_of(state: State) -> Any:
    """Recipe of what the view shows; a ToldError where the medium has none."""
    if state.view == "a lens" and of_glass(state):
        reject("medium", "a slab or layers, before a lens", state.medium, "A lens before a screen is not simulated.")
    if state.view == "polarisation" and state.medium != "slab":
        reject("medium", "a slab, in polarised light", state.medium, "Thin screens do not change polarisation."
               if of_glass(state) else "Polarised layers are not simulated by recipes.")  # fmt: skip
    return _recipe(_VIEWS[state.view], state)


def toml(state: State) -> str:
    """TOML file of the recipe of the view; a ToldError where the medium has none."""
    shown_of(state)
    return tomli_w.dumps(_VIEWS[state.view].table(state))


def python(state: State) -> str:
    """Python that makes the recipe of the view, and the sample that is shown; a ToldError likewise."""
    kind = type(shown_of(state))
    table = pprint.pformat(_VIEWS[state.view].table(state), width=100, sort_dicts=False)
    return (
        f"from {kind.__module__} import {kind.__name__}\n\n"
        f"recipe = {kind.__name__}(**{table})\n"
        f'sample = recipe.sample({SEED}, "{SPLIT}", {state.sample})   # arrays by name\n'
    )
