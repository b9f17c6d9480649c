"""What a recipe needs on a device, read from it once on the host: sizes, tables, and whether it can be done at all."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy.fft import next_fast_len

from specklegen.datasets.batched.atlas import AtlasTables, atlas_tables
from specklegen.datasets.objects.glyphs import Glyphs
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.multi_image import DynamicSlab, TwoTilts
from specklegen.datasets.recipes.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipes.parts.distributions import Choice, Draw, ends
from specklegen.datasets.recipes.parts.preset import PresetMaterial
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.rendering import RenderedBy
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.datasets.split import SPLITS
from specklegen.samplers.stationary.exit_grid import GUARD, SUPPORT, cells
from specklegen.samplers.stationary.modes import (
    basis,
    distances,
    first_degree,
    folded,
    places,
    polynomials,
)

DRAWN, KEPT, FRESH, STEPS = "drawn media", "kept media", "one material", "step by step"
_KINDS = (HiddenObject, TwoTilts, DynamicSlab, PartiallyCoherent)


@dataclass(frozen=True)
class Tables:
    """What every batch of a recipe with drawn materials needs, on the device.

    Attributes
    ----------
    atlas : AtlasTables
    lengths : int64[n]
        Fast length of a transform of at least so many points.
    steps : float64[d]
        Different distances of two beams, for a lattice of pixels in units of the pitch; of beams in a line none.
    which : int64[h, w]
        Which distance.
    rows, columns, places, basis :
        Of :mod:`specklegen.samplers.stationary.modes`; of beams in a line their polynomials as ``basis`` alone.
    """

    atlas: AtlasTables
    lengths: torch.Tensor
    steps: torch.Tensor
    which: torch.Tensor
    rows: torch.Tensor
    columns: torch.Tensor
    places: torch.Tensor
    basis: torch.Tensor


@dataclass(frozen=True)
class Sizes:
    """Sizes that hold for every medium of a recipe.

    Attributes
    ----------
    cells : (int, int)
        Most cells along y and x.
    lags : (int, int)
        Grid of lags.
    """

    cells: tuple[int, int]
    lags: tuple[int, int]


def way_of(recipe: Recipe) -> tuple[str, list[str]]:
    """How a recipe is rendered on a device, and what keeps it from a faster way, in words."""
    why = []
    chosen = recipe.rendering
    if chosen is None or chosen.sampler is RenderedBy.PATHS:
        why.append("the planner wants path sums")
    elif chosen.sampler is RenderedBy.SCREENS:
        why.append("material.screens, whose envelope moves with the tilt,")
    if type(recipe) not in _KINDS and not isinstance(recipe, TiltStack):
        why.append(f"kind {getattr(recipe, 'kind', type(recipe).__name__)!r} has no batched form")
    if why:
        return STEPS, why
    if recipe.media is not None and type(recipe) in (HiddenObject, TwoTilts):
        return KEPT, why
    if type(recipe) in _KINDS and not _varies(recipe):
        chosen = [name for name, number in _drawn_each(recipe).items() if isinstance(number, Choice)]
        return (STEPS, [f"{chosen[0]} is a choice"]) if chosen else (FRESH, why)
    if type(recipe) in (DynamicSlab, PartiallyCoherent):
        why.append(f"kind {recipe.kind!r} with media of several materials, fields or tilts")
    if recipe.light.halves > 1:
        why.append("light.polarised = false draws two media a sample")
    if recipe.light.bandwidth or recipe.lab is not None:
        why.append("light modes or a laboratory with media that are never seen again")
    if isinstance(recipe.material, PresetMaterial):
        return STEPS, [*why, "material.preset, of which the atlas has no table,"]
    if recipe.material.scatterer is not None:
        why.append("material.scatterer, of which the atlas has no table,")
    if not recipe.material.faces.matched:
        why.append("material.faces, of which the atlas has no table,")
    if isinstance(recipe, TwoTilts):
        why.append("two-tilts with media that are never seen again")
    if recipe.material.kernel != "atlas":
        why.append('material.kernel = "estimate" traces paths for every material')
    if recipe.profile == "disc":
        why.append('window.profile = "disc" is no product of a row and a column')
    numbers = [getattr(recipe.material, name) for name in ("thickness", "optical_depth", "g", "albedo")]
    if recipe.material.by_split is not None:
        numbers += [getattr(recipe.material.by_split, split) for split in SPLITS]
    if isinstance(recipe, HiddenObject):
        numbers += [recipe._field_number, recipe._pixels]
    if isinstance(recipe, TiltStack):
        numbers += [recipe.tilts.step, recipe.tilts.azimuth]
    if any(isinstance(number, Choice) for number in numbers):
        why.append("a drawn number is a choice")
    return (STEPS if why else DRAWN), why


def _varies(recipe: Recipe) -> bool:
    """Whether two media may need different samplers."""
    drawn: list = [recipe._field_number, recipe._pixels] if isinstance(recipe, HiddenObject) else []
    if isinstance(recipe, TwoTilts):
        drawn += [recipe.tilts.step, recipe.tilts.azimuth]
    return recipe.material.varies or any(low < high for low, high in map(ends, drawn))


def _drawn_each(recipe: Recipe) -> dict[str, Draw]:
    """What is drawn for media or samples that share a sampler."""
    if isinstance(recipe, DynamicSlab):
        return {"correlation_time": recipe.dynamics.correlation_time}
    return {"coherence_length": recipe.coherence_length} if isinstance(recipe, PartiallyCoherent) else {}


def draws_objects(recipe: Recipe) -> bool:
    """Whether objects are drawn on the device; all others are made on the host and brought there."""
    return isinstance(recipe, HiddenObject) and isinstance(recipe.objects, Glyphs)


def beams_of(recipe: Recipe) -> tuple[tuple[int, int], int]:
    """Shape of the object, and base tilts."""
    if isinstance(recipe, TiltStack):
        return (1, 1), recipe.tilts.count
    assert isinstance(recipe, HiddenObject)
    return recipe.objects.shape, 1


def sizes_of(recipe: Recipe) -> Sizes:
    """Sizes that no medium of the recipe exceeds: those at the ends of its ranges."""
    found = []
    for axis in (0, 1):  # x, y
        grains = (recipe.camera_shape[1 - axis] - 1) / _pixels_per_grain(recipe)
        if isinstance(recipe, TiltStack):
            low, high = ends(recipe.tilts.azimuth)
            widest = recipe.tilts.angles(max(map(abs, ends(recipe.tilts.step))), low)
            # Where the azimuth varies they may all lie along one axis; a sine is at most its angle.
            reach = np.ptp(np.sin(widest[:, axis])) if low == high else float(np.hypot(*widest[-1]))
            grains += reach * recipe.geometry.width / recipe.wavelength
        else:
            assert isinstance(recipe, HiddenObject)
            across, along = max(recipe.objects.shape), recipe.objects.shape[1 - axis]
            grains += max(_object_grains(recipe)) * (along - 1) / across  # from the first pixel to the last
        # In units of a grain: wavelength 1, width 1.
        found.append(cells(1.0, 1.0, recipe.profile, 0.5, grains * (1 + 1e-9)).count)
    columns, rows = found
    return Sizes((rows, columns), (even_fast_length(2 * rows), even_fast_length(2 * columns)))


def _object_grains(recipe: HiddenObject) -> list[float]:
    if recipe.fits_window:
        assert recipe.camera is not None
        return [pixels / recipe.camera.pixels_per_grain for pixels in ends(recipe._pixels)]
    width = recipe.geometry.width
    pitches = [
        recipe.pitch(recipe.material.known(slab), share)
        for slab in recipe.material.extremes()
        for share in ends(recipe._field_number)
    ]
    return [pitch * max(recipe.objects.shape) * width / recipe.wavelength for pitch in pitches]


def _pixels_per_grain(recipe: Recipe) -> float:
    assert recipe.camera is not None
    return recipe.camera.pixels_per_grain


@lru_cache(maxsize=64)
def even_fast_length(count: int) -> int:
    """Length of the object sampler's lag grid."""
    return 2 * int(next_fast_len((count + 1) // 2, real=True) or 0)


def tables_of(recipe: Recipe, sizes: Sizes, device: torch.device) -> Tables:
    """Bring to the device what batches of drawn materials need."""
    put = lambda array: torch.as_tensor(np.ascontiguousarray(array)).to(device)  # noqa: E731
    # Cells are half the period of the transform, times the support of the window.
    most = int(2 * max(sizes.cells) / SUPPORT[recipe.profile]) + 8
    lengths = np.array([int(next_fast_len(max(n, 1))) for n in range(most + 1)])
    shape, tilts = beams_of(recipe)
    if tilts > 1:
        line = polynomials(tilts, first_degree((tilts, *shape)))
        empty = torch.zeros(0, dtype=torch.int64, device=device)
        return Tables(atlas_tables(device), put(lengths), empty, empty, empty, empty, empty, put(line))
    steps, which = distances(shape)
    degree = first_degree(shape)
    rows, columns = (folded(count, degree).to(device) for count in shape)
    return Tables(
        atlas_tables(device), put(lengths), put(steps), put(which), rows, columns,
        places(shape, degree).to(device), basis(shape, degree).to(device),
    )  # fmt: skip


def guarded_period(span_over_grain: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
    """Period of the transform, int64[B], of views half a grain apart that span so many grains."""
    least = torch.ceil((span_over_grain + GUARD) / 0.5).to(torch.int64) + 1
    # Slabs outside the atlas have no sizes; they are made step by step, whatever is found here.
    return lengths[least.clamp(0, len(lengths) - 1)]
