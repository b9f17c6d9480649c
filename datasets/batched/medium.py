"""Media of drawn materials made ready in batches: from sample numbers to all that rendering needs.

Step for step what ``Recipe.prepare`` does for one medium, float64 wherever a shape or a phase is decided.
"""

import math
from dataclasses import dataclass, fields

import torch

from specklegen.datasets.batched.atlas import Kernels, kernels, single_radiance
from specklegen.datasets.batched.fused import fused
from specklegen.datasets.batched.mixtures import half_range, mixture
from specklegen.datasets.batched.plan import Sizes, Tables, beams_of, guarded_period
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.parts.distributions import LogUniform, Uniform
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.datasets.split import Split
from specklegen.samplers.stationary.exit_grid import SUPPORT
from specklegen.samplers.stationary.modes import POLYNOMIAL_SHARE, factor, kept, reached


@dataclass(frozen=True)
class MediumBatch:
    """Media of a batch.

    Attributes
    ----------
    parameters : dict of float64[B]
    columns : float64[B, N, N]
        Cholesky factor of each, its kept columns first.
    rank : int64[B]
        Kept columns; 0 where the medium must be made step by step.
    cells : int64[B, 2]
        Cells along y and x.
    size : float64[B, 2]
        Their distances.
    envelope : float32[B, y, x]
    tilts, base : float64[B, T, 2]
        Base tilts in radians, and their sines.
    object_pitch, camera_pitch : float64[B]
    kernels : Kernels
    """

    parameters: dict[str, torch.Tensor]
    columns: torch.Tensor
    rank: torch.Tensor
    cells: torch.Tensor
    size: torch.Tensor
    envelope: torch.Tensor
    tilts: torch.Tensor
    base: torch.Tensor
    object_pitch: torch.Tensor
    camera_pitch: torch.Tensor
    kernels: Kernels

    def at(self, places: torch.Tensor | slice) -> "MediumBatch":
        """Some of the media, with one name of the parameters: all that rendering and contrast ask for."""
        pick = lambda value: value[places]  # noqa: E731
        return MediumBatch(
            {"width": pick(self.parameters["width"])}, pick(self.columns), self.rank, pick(self.cells),
            pick(self.size), pick(self.envelope), self.tilts, pick(self.base), pick(self.object_pitch),
            pick(self.camera_pitch), Kernels(*(pick(getattr(self.kernels, field.name)) for field in fields(Kernels))),
        )  # fmt: skip


def value_of(number: float | Uniform | LogUniform, uniform: torch.Tensor) -> torch.Tensor:
    """Drawn numbers float64[B] from uniform numbers in [0, 1); constants are themselves."""
    if isinstance(number, Uniform):
        low, high = number.uniform
        return low + (high - low) * uniform
    if isinstance(number, LogUniform):
        low, high = map(math.log, number.log_uniform)
        return torch.exp(low + (high - low) * uniform).clamp(*number.log_uniform)
    return torch.full_like(uniform, number)  # type: ignore[arg-type]


def prepare(
    recipe: Recipe, split: Split, tables: Tables, sizes: Sizes, draws: dict[str, torch.Tensor]
) -> MediumBatch:
    """Make media ready.

    Parameters
    ----------
    recipe, split
        Whose.
    tables, sizes
        Of the recipe, on the device.
    draws
        Uniform numbers float64[B, 4] of the purposes "material", "field" and "tilts".
    """
    names = ("thickness", "optical_depth", "g", "albedo")
    drawn = [value_of(recipe.material.source(n, split), draws["material"][:, i]) for i, n in enumerate(names)]  # type: ignore[arg-type]
    thickness, depth, g, albedo = drawn
    mean_free_path = thickness / depth
    depth = thickness / mean_free_path
    found = kernels(tables.atlas, thickness, depth, g, albedo, recipe.material.kernel_tolerance)
    half, known = half_range(found.radius, found.share, found.single)
    wavelength, (shape, tilt_count) = recipe.wavelength, beams_of(recipe)
    sine = half * wavelength / (2 * torch.pi)
    parameters = {
        "wavelength": torch.full_like(depth, wavelength), "thickness": thickness, "mean_free_path": mean_free_path,
        "optical_depth": depth, "g": g, "albedo": albedo, "ballistic_fraction": torch.exp(-depth),
        "single_share": found.single, "forward_radiance": single_radiance(depth, 1 - g, albedo) / found.single,
        "memory_effect_range": torch.arcsin(sine.clamp(max=1.0)),
        "estimator": torch.full_like(depth, 2.0),
    }
    rendering = recipe.rendering
    assert rendering is not None  # fmt: skip
    camera = recipe.camera
    assert camera is not None
    tilts = torch.zeros((len(depth), tilt_count, 2), dtype=torch.float64, device=depth.device)
    if isinstance(recipe, TiltStack):
        width = torch.full_like(depth, recipe.geometry.width)
        step, azimuth = (
            value_of(number, draws["tilts"][:, i])  # type: ignore[arg-type]
            for i, number in enumerate((recipe.tilts.step, recipe.tilts.azimuth))
        )
        along = torch.stack([torch.cos(azimuth), torch.sin(azimuth)], -1)
        number = torch.arange(tilt_count, dtype=torch.float64, device=depth.device)
        tilts = number[:, None] * (step[:, None] * along)[:, None]
        pitch = wavelength / (width * camera.pixels_per_grain)
        more = {"width": width, "camera_pitch": pitch, "tilt_step": step, "tilt_azimuth": azimuth}
        object_pitch = pitch
    else:
        assert isinstance(recipe, HiddenObject)
        assert recipe.field is not None
        share = value_of(recipe._field_number, draws["field"][:, 0])  # type: ignore[arg-type]
        object_pitch = share if recipe.field.pitch is not None else share * sine / max(shape)
        if recipe.fits_window:
            pixels = value_of(recipe._pixels, draws["field"][:, 1])  # type: ignore[arg-type]
            width = wavelength * (pixels / camera.pixels_per_grain) / (object_pitch * max(shape))
        else:
            width = torch.full_like(depth, recipe.geometry.width)
        pitch = wavelength / (width * camera.pixels_per_grain)
        extent = object_pitch * max(shape)
        more = {"width": width, "camera_pitch": pitch, "object_pitch": object_pitch, "extent_over_range": extent / sine}
    base = torch.sin(tilts)
    triangle, columns, size = _modes(recipe, tables, found, base, object_pitch)
    chosen = kept(triangle, size, getattr(recipe, "mode_tolerance", 0.01))
    enough = 1 - reached(triangle, size) <= POLYNOMIAL_SHARE * getattr(recipe, "mode_tolerance", 0.01)
    enough = enough | columns
    first = torch.sort((~chosen).to(torch.int8), dim=-1, stable=True)[1]
    ordered = triangle.gather(2, first[:, None].expand_as(triangle))
    ordered = ordered * (torch.arange(size_of(ordered), device=depth.device) < chosen.sum(-1)[:, None])[:, None]
    count, distance = _cells(recipe, tables, width, object_pitch, pitch, base, shape)
    for name, value in (("sampler", rendering.sampler), ("expected_error", rendering.expected_error)):
        more[name] = torch.full_like(depth, float(value))
    return MediumBatch(
        parameters | more, ordered, chosen.sum(-1) * (known & found.served & enough), count, distance,
        envelope(recipe, sizes, width, count, distance), tilts, base, object_pitch, pitch, found,
    )  # fmt: skip


def size_of(matrix: torch.Tensor) -> int:
    """Columns of a matrix."""
    return matrix.shape[-1]


def _modes(
    recipe: Recipe, tables: Tables, found: Kernels, base: torch.Tensor, pitch: torch.Tensor
) -> tuple[torch.Tensor, bool, int]:
    """Cholesky factor float64[B, N, N] of the modes; whether the polynomials are complete; the number of beams."""
    wavenumber = 2 * torch.pi / recipe.wavelength
    shape, tilts = beams_of(recipe)
    if tilts > 1:
        gap = base[:, :, None] - base[:, None]
        q = wavenumber * torch.sqrt(gap.square().sum(-1))
        memory = mixture(q.flatten(1), found.radius, found.share).unflatten(1, (tilts, tilts))
        matrix = tables.basis.T @ memory @ tables.basis
        return factor(matrix, tilts), tables.basis.shape[1] == tilts, tilts
    memory = mixture((wavenumber * pitch)[:, None] * tables.steps, found.radius, found.share)[:, tables.which]
    between = tables.rows @ memory @ tables.columns.T
    matrix = between.flatten(1)[:, tables.places]
    size = shape[0] * shape[1]
    return factor(matrix, size), tables.basis.shape[1] == size, size


def _cells(
    recipe: Recipe, tables: Tables, width: torch.Tensor, object_pitch: torch.Tensor, pitch: torch.Tensor,
    base: torch.Tensor, shape: tuple[int, int],
) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
    """Cells int64[B, 2] along y and x, and their distances float64[B, 2]: ``exit_grid.cells``."""
    grain = recipe.wavelength / width
    spans = [object_pitch * (n - 1) + pitch * (m - 1) for n, m in zip(shape, recipe.camera_shape, strict=True)]
    span = torch.stack(spans, -1)
    if base.shape[1] > 1:
        span = span + (base.amax(1) - base.amin(1)).flip(1)  # (x, y) to (y, x)
    period = guarded_period(span / grain[:, None], tables.lengths)
    distance = recipe.wavelength / (period * (recipe.wavelength / (2 * width))[:, None])
    count = torch.ceil(SUPPORT[recipe.profile] * width[:, None] / distance - 1e-9).to(torch.int64).clamp(min=1)
    return count, distance


@fused(
    "profile_power(Tensor width, Tensor count, Tensor distance, int most, bool gaussian) -> Tensor",
    lambda width, count, distance, most, gaussian: width.new_empty((len(width), most)),
)
def profile_power(
    width: torch.Tensor, count: torch.Tensor, distance: torch.Tensor, most: int, gaussian: bool
) -> torch.Tensor:
    """b^2 along one axis, float64[B, most] with sum 1, square or Gaussian: ``exit_grid.profile_power``."""
    cell = torch.arange(most, dtype=torch.float64, device=width.device)
    position = (cell - (count[:, None] - 1) / 2) * distance[:, None]
    if gaussian:
        power = torch.exp(-8 * (position / width[:, None]).square())
    else:
        half, side = 0.5 * distance[:, None], 0.5 * width[:, None]
        power = (torch.minimum(position + half, side) - torch.maximum(position - half, -side)).clamp(min=0)
    power = power * (cell < count[:, None])
    return power / power.sum(1, keepdim=True)


def envelope(
    recipe: Recipe, sizes: Sizes, width: torch.Tensor, count: torch.Tensor, distance: torch.Tensor
) -> torch.Tensor:
    """Window b over the cells, float32[B, y, x], the sum of its squares 1."""
    along_y, along_x = (
        profile_power(width, count[:, axis], distance[:, axis], most, recipe.profile == "gaussian")
        for axis, most in enumerate(sizes.cells)
    )
    return (torch.sqrt(along_y)[:, :, None] * torch.sqrt(along_x)[:, None]).to(torch.float32)
