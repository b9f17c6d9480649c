"""What path sums cost: counted operations and bytes."""

import numpy as np

from specklegen.samplers.path_sums.nufft import TILTS_AT_ONCE, NufftPlan

TILTS_STREAMED = 16  # whose fields on one tile are held at a time
CONNECTIONS_KEPT = 2**20  # of a bank between the pieces of a stream; more are traced anew for each


def nufft_operations(nufft: NufftPlan, tilts: int, connections: float, chunks: int) -> dict[str, float]:
    """Operations to evaluate connections by NUFFT on all tiles, in so many chunks."""
    width = np.ceil(-np.log10(0.3 * nufft.tolerance)) + 1
    precision = np.dtype(nufft.dtype).itemsize // 8
    spreads = nufft.tiles * nufft.spreads * connections
    views = nufft.tiles * float(np.prod(nufft.tiling.shape)) * chunks
    return {
        "end": connections * tilts + spreads,
        "spread": float(spreads * tilts * (width / 5) ** 2 * precision),
        "FFT point": nufft.rank * tilts * 4.0 * views * precision,
        "pattern": nufft.rank * np.ceil(tilts / TILTS_AT_ONCE) * views,
    }


def direct_operations(tilts: int, connections: float, views: int) -> dict[str, float]:
    """Operations to evaluate connections by the direct sum."""
    return {
        "end": connections * tilts,
        "direct view": connections * views,
        "direct tilt": connections * views * tilts,
    }
