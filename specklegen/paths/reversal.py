"""Which parts of the physics a scene of any geometry needs."""

import numpy as np

from specklegen.core.budgets import Reverse
from specklegen.core.decision import Decision
from specklegen.core.values import remembered
from specklegen.paths.backscattering_wing import excess_bound
from specklegen.paths.volumes import materials
from specklegen.scene.media import Medium
from specklegen.scene.scatterers import Dimensions
from specklegen.scene.scene import Scene


@remembered(64)
def scene_reversal(scene: Scene, reverse: Reverse, tolerance: float) -> Decision:
    """Return whether reversed paths take part in a scene.

    Between directions the rule of physics.md 2 decides. Between points no rule bounds them, so they are kept.
    """
    if scene.thin is not None:
        return Decision("reversed paths", False, "a thin screen reflects no light")
    if reverse == "auto" and (scene.sensor.near or scene.illumination.near):
        return Decision("reversed paths", True, "included: near points their contribution has no bound")
    if np.isinf(scene.volume.mean_free_path):
        return Decision("reversed paths", False, "nothing scatters")
    return reversal_decision(
        scene.volume, scene.wavelength, scene.lights, _nearest_backscattering(scene), reverse, tolerance
    )


def _nearest_backscattering(scene: Scene) -> np.ndarray:
    """Views float64[n, d] that include, for every light, the nearest to exact backscattering."""
    grid = scene.sensor.regular_grid
    if grid is None:
        return scene.views
    if grid.side == "transmission" and scene.lights[:, -1].min(initial=1.0) > 0:
        return grid.corner_directions  # |i + v| >= i_z + v_z decides, and the corners are farthest from the axis
    return grid.nearest(-scene.lights)


def reversal_decision(
    medium: Medium, wavelength: float, light: np.ndarray, views: np.ndarray, reverse: Reverse, tolerance: float
) -> Decision:
    """Reversed paths (coherent backscattering): needed near v = -i.

    What they add is bounded from the phase function of the scatterers (:mod:`specklegen.paths.backscattering_wing`), at
    the pair of light and view that is nearest to backscattering.

    Parameters
    ----------
    light, views
        float64[..., d], all tilts and all views; every pair counts.
    reverse
        True or False decide, "auto" judges.
    tolerance
        Relative intensity below which they are left out.
    """
    part = "reversed paths"
    if isinstance(reverse, bool):
        return Decision(part, reverse, "asked for" if reverse else "as asked")
    if medium.refracts and (views[..., -1] > 0).any():
        return Decision(part, False, "no backscattering direction behind a slab between refracting faces")
    dimension = views.shape[-1]
    nearest = _nearest_sum(light.reshape(-1, dimension), views.reshape(-1, dimension))
    wing = _wing(medium, wavelength, 2 if dimension == 2 else 3, nearest)
    if wing > tolerance:
        return Decision(part, True, f"contribute up to {min(wing, 1):.2g} of the intensity near exact backscattering")
    return Decision(
        part, False,
        f"contribute at most {wing:.2g} of the intensity this far from backscattering (limit {tolerance:g})",
    )  # fmt: skip


def _wing(medium: Medium, wavelength: float, dimensions: Dimensions, nearest: float) -> float:
    """Largest share of the intensity that reversed paths add at |i + v| = ``nearest``, over a medium's materials."""
    if np.isinf(medium.mean_free_path):
        return 0.0
    way = medium.narrowest / max(medium.voxel_counts)  # no flight ends sooner than within one voxel
    # To 9 digits, so that no unit of length sways it.
    turns, depth = (float(f"{x:.9g}") for x in (medium.mean_free_path / wavelength, way / medium.mean_free_path))
    albedo, distance = float(np.max(medium.albedo)), float(f"{min(nearest, 2.0):.9g}")
    return max(excess_bound(each, dimensions, turns, depth, albedo, distance) for each in materials(medium))


def _nearest_sum(light: np.ndarray, views: np.ndarray) -> float:
    """Smallest |i + v| over all pairs, from a tree (grids have a million views)."""
    if len(light) == 0 or len(views) == 0:
        return 2.0
    if views[:, -1].min() > 0 and light[:, -1].min() > 0:
        # Transmission: |i + v| >= i_z + v_z, tight enough and free.
        return float(light[:, -1].min() + views[:, -1].min())
    from scipy.spatial import KDTree

    distance, _ = KDTree(-light).query(views)
    return float(distance.min())
