"""A medium as the arrays that kernels read."""

import numpy as np

from specklegen.core.values import remembered
from specklegen.kernels import walk
from specklegen.kernels.volume import Volume
from specklegen.scene.media import Medium, Slab, VoxelGrid
from specklegen.scene.scatterers import Scatterer
from specklegen.scene.window import Profile

_FOOTPRINT = {"square": walk.SQUARE, "disc": walk.DISC, "gaussian": walk.GAUSSIAN}


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
    return medium.scatterers if isinstance(medium, VoxelGrid) else (medium.scatterer,)


@remembered(16)
def volume_of(medium: Medium, dimension: int) -> Volume:
    """Lay out a medium for the kernels."""
    if isinstance(medium, Slab):
        lower = np.array([-np.inf, -np.inf, 0.0])
        upper = np.array([np.inf, np.inf, medium.thickness])
    else:
        lower, upper = spatial(medium.lower), spatial(medium.upper)
        if dimension == 2:
            lower[1], upper[1] = -np.inf, np.inf
    bounds = np.stack([lower, upper])
    if not isinstance(medium, VoxelGrid):
        cells = np.array([[1, 1, 1], [1, 1, 1], [dimension, 1, 0]])
        sigma = np.array([1 / medium.mean_free_path])
        albedo = np.array([float(medium.albedo)])
        return Volume(bounds, cells, sigma, albedo, np.zeros(1, np.int64), sigma, np.zeros(3))
    extinction = np.array(medium.extinction)
    grid = extinction if dimension == 3 else extinction[:, None, :]
    block = _block_size(grid, medium.thickness)
    majorant = _block_maxima(grid, block)
    counts = np.array(grid.shape[::-1])
    return Volume(
        bounds, np.array([counts, majorant.shape[::-1], (dimension, block, 0)]), extinction.ravel(),
        np.broadcast_to(medium.albedo, extinction.shape).ravel().copy(),
        np.broadcast_to(medium.material, extinction.shape).ravel().astype(np.int64), majorant.ravel(),
        np.where(counts > 1, counts / (bounds[1] - bounds[0]), 0.0),
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
