"""Predicted measurements of a slab, with exact derivatives: a batch of slabs at once, from tables.

A slab is five numbers, the columns of x: ln thickness, ln optical depth, ln(1 - g), -ln albedo, ln diffusion. From the
tables come distributions of multiply scattered light over distances r, momentum transfers Y and lengths s; single
scattering, of share sigma, has r = Y = s = 0:

    C_I = K(q)^2,                K = sigma + (1 - sigma) sum_n p_n J0(q r_n)          q = k sin(tilt)
    g2 - 1 = beta g1^2,          g1 = sigma + (1 - sigma) sum_n p_n e^(-2 x Y_n)      x = D k^2 lag
    contrast^2 = sum_ab p_a p_b S(s_a - s_b)^2                                        S the spectrum's transform

and the transmittance; the ballistic share is e^-OD. Rows of tables are differentiated by torch; the sums by their own
derivatives, J0' = -J1.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np
import torch
from scipy.special import j0, j1

from specklegen.datasets.recipes.parts.atlas_batches import AtlasTables, atlas_tables, correlations, stencils
from specklegen.measured.observations import (
    BallisticFraction,
    ContrastVersusBandwidth,
    MemoryCurve,
    Observation,
    TemporalCurve,
    Transmittance,
)

COLUMNS = ("thickness", "optical_depth", "g", "albedo", "diffusion")
THICKNESS, DEPTH, DROP, LOSS, DIFFUSION = range(5)
_CPU = torch.device("cpu")
CURVE_ERROR, CURVE_BEND = 0.013, 1.5
"""Error of C_I over C_I (1 - C_I), and how fast it changes with ln(tilt).

Of some hundred slabs, optical depths 2.5 to 25, g .5 to .94, against 300 000 paths each, whose noise it contains.
"""
LIGHT_ERROR = 0.001
"""Relative error of the transmittance, of 24 slabs against a million paths each."""
_SOME = np.array([0.0, 1.5, -1.0, 0.0, 0.0])


class Prediction(NamedTuple):
    """Values float64[B, M], their derivatives by the columns float64[B, M, 5], and whether the tables hold the slab."""

    values: np.ndarray
    slopes: np.ndarray
    inside: np.ndarray


class PathTables(NamedTuple):
    """Quantiles at nodes: shares float64[n], ln Y and ln(s / thickness) float32[nodes, n]; axes of the nodes.

    The axes are those of the lookup table, up to an optical depth of its own.
    """

    shares: np.ndarray
    axes: list[torch.Tensor]
    transfer: torch.Tensor
    excess: torch.Tensor


@lru_cache(1)
def _transmittances() -> tuple[torch.Tensor, list[torch.Tensor]]:
    """ln(transmittance) float32[nodes, 1], and its axes: those of the lookup table, absorption more finely."""
    with (files("specklegen") / "data/transmittance-henyey-greenstein.npz").open("rb") as file, np.load(file) as data:
        axes = [*atlas_tables(_CPU).axes[:2], torch.from_numpy(data["absorptions"])]
        return torch.from_numpy(data["table"].reshape(-1, 1)), axes


@lru_cache(1)
def _paths() -> PathTables:
    with (files("specklegen") / "data/paths-henyey-greenstein.npz").open("rb") as file, np.load(file) as data:
        flat = (torch.from_numpy(data[name].reshape(-1, data[name].shape[-1])) for name in ("transfer", "excess"))
        depths, *others = atlas_tables(_CPU).axes
        return PathTables(data["shares"], [depths[: len(data["transfer"])], *others], *flat)


class _Row(NamedTuple):
    """Something interpolated, float64[B, n], and its derivatives by the columns, float64[B, n, 5]."""

    value: np.ndarray
    slopes: np.ndarray


class _Light(NamedTuple):
    """Distribution of light: places in units of the thickness, the first one 0, and shares. Slopes as of `_Row`."""

    place: _Row
    share: _Row


class Tables:
    """Interpolate at slabs float64[B, 5], moved along some of the columns."""

    def __init__(self, slabs: np.ndarray, moved: Sequence[int]) -> None:
        self.slabs, self.sloping = slabs, len(moved) > 0
        self.moved = [column for column in moved if column in (DEPTH, DROP, LOSS)]
        self.each = max(len(self.moved), 1)
        self.tables: AtlasTables = atlas_tables(_CPU)
        self.at = torch.from_numpy(np.repeat(slabs[:, DEPTH:DIFFUSION], self.each, axis=0))
        turned = torch.zeros_like(self.at)
        for n, column in enumerate(self.moved):
            turned[n :: self.each, column - DEPTH] = 1.0
        self.tangent = turned

    def _found(self, function: Callable[..., torch.Tensor]) -> _Row:
        """Values float64[B, n] of a function of optical depth, 1 - g and albedo, and its slopes.

        Forward, as the derivative of the backward one, which is linear in what it is given: J t = d(v J)/dv t.
        """
        if not self.moved:
            with torch.no_grad():
                value = function(*_numbers(self.at))
            return _Row(value.numpy(), np.zeros((*value.shape, 5)))
        with torch.enable_grad():
            at = self.at.clone().requires_grad_()
            value = function(*_numbers(at))
            towards = torch.zeros_like(value, requires_grad=True)
            (back,) = torch.autograd.grad(value, at, towards, create_graph=True)
            (turned,) = torch.autograd.grad(back, towards, self.tangent)
        values = value.detach()[:: self.each].numpy()
        slopes = np.zeros((*values.shape, 5))
        slopes[..., self.moved] = np.moveaxis(turned.numpy().reshape(len(values), self.each, -1), 1, 2)
        return _Row(values, slopes)

    def distances(self) -> _Light:
        """Lateral distances of the light."""

        def both(depth: torch.Tensor, drop: torch.Tensor, albedo: torch.Tensor) -> torch.Tensor:
            light = correlations(self.tables, torch.ones_like(depth), depth, 1 - drop, albedo, np.inf)
            return torch.cat([light.radius, light.share], 1)

        row = self._found(both)
        half = row.value.shape[1] // 2
        return _Light(*(_Row(row.value[:, part], row.slopes[:, part]) for part in (slice(half), slice(half, None))))

    def rows(self, table: torch.Tensor, axes: list[torch.Tensor]) -> _Row:
        """Rows float64[B, n] of a table float32[nodes, n]."""

        def row(depth: torch.Tensor, drop: torch.Tensor, albedo: torch.Tensor) -> torch.Tensor:
            _, _, place, weight = stencils(depth, drop, albedo, axes)
            return (table[place].to(weight.dtype) * weight[:, :, None]).sum(1)

        return self._found(row)

    def light(self, table: torch.Tensor, shares: np.ndarray, distances: _Light) -> _Light:
        """Another distribution of the same light, whose quantiles' logarithms are a table."""
        row = self.rows(table, _paths().axes)
        place = np.exp(row.value)
        single, single_slopes = distances.share.value[:, :1], distances.share.slopes[:, :1]
        share = np.concatenate([single, (1 - single) * shares], 1)
        slopes = np.concatenate([single_slopes, -single_slopes * shares[:, None]], 1)
        value = np.concatenate([np.zeros_like(single), place], 1)
        turned = np.concatenate([np.zeros_like(single_slopes), place[..., None] * row.slopes], 1)
        return _Light(_Row(value, turned), _Row(share, slopes))


def _numbers(at: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Optical depth, 1 - g and albedo float64[B] of columns float64[B, 3]."""
    depth, drop, loss = at.unbind(-1)
    return torch.exp(depth), torch.exp(drop), torch.exp(-loss)


def predict(
    observations: Sequence[Observation], wavelength: float, slabs: np.ndarray, moved: Sequence[int]
) -> Prediction:
    """Predict what was observed, of slabs float64[B, 5], with derivatives by the ``moved`` columns; others are 0.

    For slabs outside the tables stands some other one.
    """
    by_paths = any(isinstance(each, TemporalCurve | ContrastVersusBandwidth) for each in observations)
    axes = _paths().axes if by_paths else [*atlas_tables(_CPU).axes]
    inside = stencils(*_numbers(torch.from_numpy(slabs[:, DEPTH:DIFFUSION])), axes)[0].numpy()
    tables = Tables(np.where(inside[:, None], slabs, _SOME), moved)
    distances = tables.distances()
    values, slopes = [], []
    for each in observations:
        value, slope = _predicted(each, 2 * np.pi / wavelength, tables, distances)
        values.append(value)
        slopes.append(slope)
    return Prediction(np.concatenate(values, 1), np.concatenate(slopes, 1), inside)


def covariance_of_tables(each: Observation) -> np.ndarray:
    """Covariance float64[M, M] of the errors of the tables, where they were measured; 0 elsewhere.

    Errors of C_I at neighbouring tilts are alike, and weigh against a slab what no scatter of the data does: taken as
    a Matern process of order 3/2 in ln(tilt).
    """
    if isinstance(each, MemoryCurve):
        near = np.clip(each.values, 0.0, 1.0)
        scale = CURVE_ERROR * near * (1 - near)
        place = np.log(np.maximum(np.abs(each.at), 1e-300))
        apart = CURVE_BEND * np.abs(place[:, None] - place)
        return scale[:, None] * scale * (1 + apart) * np.exp(-apart)
    if isinstance(each, Transmittance):
        return np.square(LIGHT_ERROR * each.values)[:, None]
    return np.zeros((len(each.values), len(each.values)))


def _predicted(
    each: Observation, wavenumber: float, tables: Tables, distances: _Light
) -> tuple[np.ndarray, np.ndarray]:
    slabs = tables.slabs
    if isinstance(each, MemoryCurve):
        q = wavenumber * np.sin(each.at)
        turned = (lambda x: -j1(x)) if tables.sloping else None
        field, slope = _mixture(q[None] * np.exp(slabs[:, THICKNESS, None]), distances, j0, turned)
        slope[..., THICKNESS] = slope[..., -1]  # q L, as one number
        return field**2, 2 * field[..., None] * slope[..., :5]
    if isinstance(each, TemporalCurve):
        light = tables.light(_paths().transfer, _paths().shares, distances)
        x = 2 * wavenumber**2 * each.at[None] * np.exp(slabs[:, DIFFUSION, None])
        turned = (lambda y: -np.exp(-y)) if tables.sloping else None
        field, slope = _mixture(x, light, lambda y: np.exp(-y), turned)
        slope[..., DIFFUSION] = slope[..., -1]
        return 1 + each.beta * field**2, 2 * each.beta * field[..., None] * slope[..., :5]
    if isinstance(each, ContrastVersusBandwidth):
        light = tables.light(_paths().excess, _paths().shares, distances)
        return _contrast(each, np.exp(slabs[:, THICKNESS]), light)
    if isinstance(each, Transmittance):
        row = tables.rows(*_transmittances())
        return np.exp(row.value), np.exp(row.value)[..., None] * row.slopes
    assert isinstance(each, BallisticFraction)
    depth = np.exp(slabs[:, DEPTH, None])
    slope = np.zeros((len(slabs), 1, 5))
    slope[..., DEPTH] = -depth * np.exp(-depth)
    return np.exp(-depth), slope


def _mixture(scale, light: _Light, function, derivative) -> tuple[np.ndarray, np.ndarray]:
    """Sums over light of f(scale place), float64[B, M], their slopes by the columns and, last, by ln(scale)."""
    x = scale[..., None] * light.place.value[:, None, :]
    value = function(x)
    share = light.share.value[:, None, :]
    slope = np.zeros((*scale.shape, 6))
    if derivative is None:
        return (value * share).sum(-1), slope
    turned = derivative(x)
    slope[..., :5] = value @ light.share.slopes + (turned * share * scale[..., None]) @ light.place.slopes
    slope[..., 5] = (turned * x * share).sum(-1)
    return (value * share).sum(-1), slope


def _contrast(each: ContrastVersusBandwidth, thickness: np.ndarray, light: _Light) -> tuple[np.ndarray, np.ndarray]:
    """Contrast float64[B, M] and its slopes."""
    apart = light.place.value[:, :, None] - light.place.value[:, None, :]
    scale = each.at[None] * thickness[:, None]
    x = scale[:, :, None, None] * apart[:, None]
    if each.spectrum == "flat":
        wave = np.sinc(x / (2 * np.pi))
        turned = np.divide(np.cos(x / 2) - wave, x, out=np.zeros_like(x), where=np.abs(x) > 1e-6)  # d wave / dx
        power, turned = wave**2, 2 * wave * turned
    else:
        power = np.exp(-np.square(x) / (8 * np.log(2)))
        turned = -x / (4 * np.log(2)) * power
    share, slopes = light.share, np.zeros((*scale.shape, 5))
    squared = np.einsum("bmij,bi,bj->bm", power, share.value, share.value)
    slopes += 2 * np.einsum("bmij,bi,bjp->bmp", power, share.value, share.slopes)
    pulled = np.einsum("bmij,bi,bj->bmi", turned, share.value, share.value)  # odd in i and j
    slopes += 2 * scale[..., None] * np.einsum("bmi,bip->bmp", pulled, light.place.slopes)
    slopes[..., THICKNESS] += np.einsum("bmij,bmij,bi,bj->bm", turned, x, share.value, share.value)
    contrast = np.sqrt(squared)
    return contrast, slopes / (2 * contrast[..., None])
