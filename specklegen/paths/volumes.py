"""A medium as the arrays that kernels read."""

from collections.abc import Sequence

import numpy as np

from specklegen.core.values import remembered
from specklegen.kernels import footprints
from specklegen.kernels.volume import GRID, HOMOGENEOUS, LAYERS, VOXELS, Volume
from specklegen.scene.layers import Layer, Stratified, merged
from specklegen.scene.media import Medium
from specklegen.scene.motion import fastest, flow_rows
from specklegen.scene.scatterers import Scatterer
from specklegen.scene.window import Profile

_FOOTPRINT = {"square": footprints.SQUARE, "disc": footprints.DISC, "gaussian": footprints.GAUSSIAN}


def footprint_code(profile: Profile) -> int:
    """Code by which the kernels know the profile of a window."""
    return _FOOTPRINT[profile]


def spatial(vectors: np.ndarray) -> np.ndarray:
    """Vectors float64[..., d] with three components: flatland (x, z) lies in the plane y = 0."""
    if vectors.shape[-1] == 3:
        return np.ascontiguousarray(vectors)
    return np.stack([vectors[..., 0], np.zeros(vectors.shape[:-1]), vectors[..., 1]], axis=-1)


def materials(medium: Medium) -> tuple[Scatterer, ...]:
    """The scatterers of a medium, in the order in which its voxels number them."""
    return medium.scatterers  # type: ignore[return-value]


@remembered(16)
def volume_of(medium: Medium, dimension: int) -> Volume:
    """Lay out a medium for the kernels."""
    if isinstance(medium, Stratified):
        return _layered(medium, dimension)
    if not medium.has_sides:
        lower = np.array([-np.inf, -np.inf, 0.0])
        upper = np.array([np.inf, np.inf, medium.thickness])
    else:
        lower, upper = spatial(medium.lower), spatial(medium.upper)
        if dimension == 2:
            lower[1], upper[1] = -np.inf, np.inf
    bounds = np.stack([lower, upper])
    if medium.homogeneous:
        # Of polarised light as a layer with sides, whose kernels are compiled for layers anyway.
        kind = HOMOGENEOUS if medium.polarisation == "scalar" or not medium.has_sides else LAYERS
        cells = np.array([[1, 1, 1], [1, 1, 1], [dimension, 1, 0]], kind)
        sigma = np.array([1 / medium.mean_free_path])
        albedo = np.array([float(medium.albedo)])
        mobility, flow = speeds(medium), flow_rows(medium.motions, dimension)
        return Volume(bounds, cells, sigma, albedo, np.zeros(1, np.int64), sigma, np.zeros(3), mobility, flow)
    extinction = np.array(medium.extinction)
    grid = extinction if dimension == 3 else extinction[:, None, :]
    block = _block_size(grid, medium.thickness)
    majorant = _block_maxima(grid, block)
    counts = np.array(grid.shape[::-1])
    material = np.broadcast_to(medium.material, extinction.shape).ravel().astype(np.int64)
    flow = flow_rows(medium.motions, dimension)
    cells = np.array([counts, majorant.shape[::-1], (dimension, block, 0)], GRID)
    return Volume(bounds, cells, extinction.ravel(), np.broadcast_to(medium.albedo, extinction.shape).ravel().copy(),
                  material, majorant.ravel(), np.where(counts > 1, counts / (bounds[1] - bounds[0]), 0.0),
                  speeds(medium)[material] if fastest(medium.motions) else np.empty(0),
                  flow[material] if len(flow) else flow)  # fmt: skip


def speeds(medium: Medium, layers: Sequence[Layer] | None = None) -> np.ndarray:
    """Speed of each of a medium's motions (or of some layers') beside the fastest, float64[n]; float64[0] at rest."""
    ranking = fastest(medium.motions if layers is None else [layer.motion for layer in layers])
    return np.empty(0) if ranking is None else ranking[1]


def mobility_at(volume: Volume, points: np.ndarray) -> np.ndarray:
    """Speed of the particles at points float64[n, 3] of a volume beside the fastest, float64[n]."""
    if len(volume.mobility) <= 1:
        return np.full(len(points), volume.mobility[0] if len(volume.mobility) else 0.0)
    return volume.mobility[_cells_at(volume, points)]


def velocity_at(volume: Volume, points: np.ndarray) -> np.ndarray:
    """V(x) float64[n, 3] of the flow at points float64[n, 3] of a volume, 0 where nothing flows."""
    if not len(volume.flow):
        return np.zeros((len(points), 3))
    rows = volume.flow[_cells_at(volume, points) if len(volume.flow) > 1 else np.zeros(len(points), np.int64)]
    return rows[:, :3] + np.einsum("nij,nj->ni", rows[:, 3:].reshape(-1, 3, 3), points)


def drift_of(volume: Volume) -> np.ndarray | None:
    """The velocity float64[3] of all particles of a volume, where they have one; None where they do not."""
    rows = volume.flow
    return rows[0, :3] if len(rows) and (rows == rows[0]).all() and not rows[0, 3:].any() else None


def collects_flow(volume: Volume) -> bool:
    """Return whether paths have to collect their Doppler shifts: not of one velocity, which the ends tell."""
    return len(volume.flow) > 0 and drift_of(volume) is None


def _cells_at(volume: Volume, points: np.ndarray) -> np.ndarray:
    """Number of the voxel or layer at points float64[n, 3], int64[n]."""
    counts = volume.cells[VOXELS]
    if len(volume.bounds) > 2:  # layers
        return np.searchsorted(volume.bounds[2:, 2], points[:, 2], side="right")
    finite = np.where(np.isfinite(volume.bounds[0]), volume.bounds[0], 0.0)
    x, y, z = np.clip(((points - finite) * volume.per_length).astype(np.int64), 0, counts - 1).T
    return (z * counts[1] + y) * counts[0] + x


def _layered(medium: Stratified, dimension: int) -> Volume:
    """Voxels without sides, one for each layer, the depths between them below the corners."""
    layers, known = merged(medium.layers), [each.canonical_json() for each in materials(medium)]
    inner = np.cumsum([layer.thickness for layer in layers])[:-1]
    bounds = np.zeros((len(layers) + 1, 3))
    bounds[0, :2], bounds[1, :2] = -np.inf, np.inf
    bounds[1, 2], bounds[2:, 2] = medium.thickness, inner
    extinction = np.array([1 / layer.mean_free_path for layer in layers])
    mobility = speeds(medium, layers)
    if medium.indices and len(mobility):  # motion turns phases by the square of its layer's wavenumber
        inside = medium.faces.inside
        mobility = mobility * np.square([(layer.index or inside) / inside for layer in layers])
    kind = LAYERS if len(layers) > 1 else HOMOGENEOUS
    return Volume(
        bounds, np.array([[1, 1, len(layers)], [1, 1, 1], [dimension, 1, 0]], kind), extinction,
        np.array([layer.albedo for layer in layers]),
        np.array([known.index(layer.scatterer.canonical_json()) for layer in layers]), extinction.max(keepdims=True),
        np.zeros(3), mobility, flow_rows([layer.motion for layer in layers], dimension),
    )  # fmt: skip


def _block_maxima(grid: np.ndarray, block: int) -> np.ndarray:
    """Largest value in each cube of ``block`` voxels a side; cubes at the upper ends may be cut."""
    for axis in range(3):
        grid = np.maximum.reduceat(grid, np.arange(0, grid.shape[axis], block), axis=axis)
    return np.ascontiguousarray(grid)


def _block_size(grid: np.ndarray, thickness: float) -> int:
    """Voxels a side of a majorant's block: the cheapest in face crossings plus tentative collisions of a crossing."""
    sizes = [2**n for n in range(int(np.log2(max(grid.shape))) + 2)]
    costs = [grid.shape[0] / size + _block_maxima(grid, size).mean() * thickness for size in sizes]
    return sizes[int(np.argmin(costs))]
