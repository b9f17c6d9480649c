"""The recipes of a state: what is shown is what they render, and what one takes along is the first of them."""

import pprint
from functools import lru_cache
from typing import Any

import numpy as np
import tomli_w
from scipy.optimize import brentq

from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.explorer.controls import State
from specklegen.scene.scatterers import VonMisesFisher

SEED = 1
SPLIT = "test"
SIDE = 28
"""Object pixels along a side."""
PIXELS = 3.0
"""Camera pixels in a grain."""
_PATHS = 20_000  # a kernel that no table holds, in a third of a second


def recipe_table(state: State) -> dict[str, Any]:
    """Table of the hidden-object recipe, as a TOML file holds it."""
    table = {
        "name": "explored",
        "description": "As set in the explorer. Lengths in micrometres, angles in direction sines inside the slab.",
        "kind": "hidden-object", "media": "new", **_scene(state),
        "objects": {"type": state.object, "shape": [SIDE, SIDE]},
        "field": {"pitch": float(f"{np.sin(1e-3 * state.extent) / SIDE:.6g}")},
    }  # fmt: skip
    return table | ({"exposure": {"photons": state.photons}} if state.photons else {})


def tilts_table(state: State) -> dict[str, Any]:
    """Table of the recipe of one beam at two tilts, through the same slab onto the same camera."""
    return _scene(state) | {
        "name": "explored-tilt", "kind": "tilt-stack", "tilts": {"count": 2, "step": 1e-3 * state.tilt},
    }  # fmt: skip


def _scene(state: State) -> dict[str, Any]:
    # No table holds slabs with faces. The stationary sampler answers at once; where it is unfit, it warns.
    faced = state.refractive_index != 1.0
    material = {
        "wavelength": state.wavelength, "thickness": state.thickness, "albedo": 1.0, "kernel_paths": _PATHS,
        "optical_depth": state.thickness / state.mean_free_path, "scatterer": _scatterer(state),
        "kernel": "estimate" if faced else "atlas",
    }  # fmt: skip
    return {
        "material": material | ({"faces": {"inside": state.refractive_index, "outside": 1.0}} if faced else {}),
        "window": {"width": state.aperture, "profile": "square"},
        "camera": {"shape": [state.camera, state.camera], "pixels_per_grain": PIXELS},
        "sampler": "stationary",
    }  # fmt: skip


def _scatterer(state: State) -> dict[str, Any]:
    if state.lobe == "HenyeyGreenstein":
        return {"type": state.lobe, "g": state.g}
    return {"type": state.lobe, "concentration": concentration_of(state.g)}


@lru_cache
def concentration_of(g: float) -> float:
    """Concentration of the von Mises-Fisher lobe of an anisotropy: coth kappa - 1 / kappa = g."""
    log: Any = brentq(lambda x: VonMisesFisher(concentration=float(np.exp(x))).mean_cosine() - g, -10, 20, xtol=1e-12)
    return float(f"{np.exp(log):.6g}")


def recipe_of(state: State) -> HiddenObject:
    """Recipe of the hidden object."""
    return _hidden(state._replace(tilt=State().tilt, sample=0))


def tilts_of(state: State) -> TiltStack:
    """Recipe of the two tilts."""
    begins = State()
    return _tilts(state._replace(object=begins.object, extent=begins.extent, photons=begins.photons, sample=0))


@lru_cache(maxsize=16)
def _hidden(state: State) -> HiddenObject:
    return HiddenObject(**recipe_table(state))


@lru_cache(maxsize=16)
def _tilts(state: State) -> TiltStack:
    return TiltStack(**tilts_table(state))


def toml(state: State) -> str:
    """TOML file of the recipe."""
    return tomli_w.dumps(recipe_table(state))


def python(state: State) -> str:
    """Python that makes the recipe, and the sample that is shown."""
    table = pprint.pformat(recipe_table(state), width=100, sort_dicts=False)
    return (
        "from specklegen.datasets.recipes.hidden_object import HiddenObject\n\n"
        f"recipe = HiddenObject(**{table})\n"
        f'sample = recipe.sample({SEED}, "{SPLIT}", {state.sample})   # image, object, parameters\n'
    )
