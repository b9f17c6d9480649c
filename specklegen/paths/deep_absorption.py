"""No figure from paths that have not seen the light that crosses an absorbing medium.

Paths that are drawn there (:mod:`specklegen.paths.stretching`) have seen it. Others, that serve both ways, views on
both sides of a slab, or any geometry, are held against what has to be crossed: no pilot can tell that has seen none of
it.
"""

from dataclasses import replace

import numpy as np

from specklegen.core.errors import reject
from specklegen.kernels import walk
from specklegen.kernels.volume import Volume
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import End, endpoint_factors
from specklegen.paths.endpoints import Endpoints
from specklegen.paths.layout import Layout, scene_layout
from specklegen.paths.steps import without_steps
from specklegen.paths.stretching import crossing_variance, decay, flat_decay
from specklegen.paths.volumes import materials
from specklegen.scene.media import Medium, Slab
from specklegen.scene.scatterers import Scatterer
from specklegen.scene.scene import Scene

LEAST = 10
"""Least ratio of a run's paths to this variance: an error of 30 % is the most that is handed out."""
MOST_PATHS = 10**12
"""Paths of one run: days on a thousand cores."""
DARK = 1e-3
"""Share of the brightest view's light below which a view is dark: 30 times its error, or never seen."""
_INSETS = (0.0, 0.1, 0.5, 0.9, 1.0)  # of a medium's sides, at which light is looked for
_OPAQUE = 1e6  # optical depth behind which nothing is left, and nothing is lit
_MOST_RATES = 64  # of the albedos of a material
_SLIVER = 1e-3  # of a side, or a tenth of a mean free path: thinner ones are not looked at


def dark_views(variances: tuple[float, ...], powers: np.ndarray) -> str | None:
    """Why a scene's dark views are not to be trusted beside its bright ones; None where all are lit alike.

    Parameters
    ----------
    variances
        Of :func:`crossing_variances`; none where paths are drawn across the medium.
    powers
        float64[n], intensities that paths found at lights and views, or at a few of them.
    """
    lit = float(np.max(powers, initial=0.0))
    dark = float(np.min(powers, initial=lit))
    if lit > 0 and dark < DARK * lit:
        doubt = f"some views have {dark / lit:.1g} of the brightest intensity"
    elif variances and min(variances) == 0 < max(variances):
        doubt = "hardly any path crosses the absorbing medium to some views"
    else:
        return None
    return (
        f"{doubt}, by which paths are chosen: light and error of dark views may be far too low. Render them in a "
        "separate scene"
    )


def require_reach(owner: str, variance: float, paths: int) -> None:
    """Refuse a run whose paths are too few to have seen the light that crosses a medium.

    Parameters
    ----------
    owner
        Function that is asked, for the message.
    variance
        Least of :func:`crossing_variances`.
    paths
        Paths of the run.
    """
    if paths >= LEAST * variance and paths <= MOST_PATHS:
        return
    needed = LEAST * variance
    enough = f"Trace {needed:.1e} paths or more" if needed <= MOST_PATHS / 10 else "Use a thinner medium"
    if variance > 0:
        reject(f"{owner} paths", "enough that light crosses the absorbing medium in some of them", paths,
               f"About one of {variance:.1e} paths carries the light behind it. {enough}; or use a Slab of "
               "index-matched faces, beams, far-field views behind it and reverse=False in render or memory_effect, "
               "which sample paths across it.")  # fmt: skip
    reject(f"{owner} paths", f"at most {MOST_PATHS:.0e}", paths, "Ask for a larger rel_error.")


def _rates(medium: Medium, volume: Volume, dimension: int) -> np.ndarray:
    """Decay nu of light in each voxel, float64[voxels]; 0 where nothing is absorbed."""
    out = np.empty(len(volume.albedo))
    for number, scatterer in enumerate(materials(medium)):
        held = volume.material == number
        if not held.any():
            continue
        # Of very many albedos a few, and the brighter neighbour for those between them, of which nu is less.
        albedos = np.unique(volume.albedo[held])
        few = albedos[np.unique(np.linspace(0, len(albedos) - 1, _MOST_RATES).astype(int))]
        rates = np.array([_nu(scatterer, float(albedo), dimension) for albedo in few])
        out[held] = rates[np.searchsorted(few, volume.albedo[held])]
    return out


def _nu(scatterer: Scatterer, albedo: float, dimension: int) -> float:
    if albedo == 0:
        return 1.0
    if dimension == 2:
        return flat_decay(scatterer, albedo)
    return decay(Slab(thickness=1.0, mean_free_path=1.0, albedo=albedo, scatterer=scatterer))


def crossing_variances(scene: Scene) -> tuple[float, ...]:
    """Var w / (E w)^2 of paths, where pilots cannot know it, else 0: at pairs of a few lights and views.

    Light that reaches a view has to cross, by scattering, what no straight way in and straight way out spare it. It
    falls by the decay of each material that it crosses.
    """
    if not len(scene.lights) or not np.prod(scene.sensor.shape) or not np.any(scene.medium.albedo):
        return ()
    if scene.refracts_inside:
        scene = scene.replace(medium=without_steps(scene.slab))  # faces that reflect only add to what is to be crossed
    layout = scene_layout(scene).probed()
    layout = replace(layout, lights=layout.lights.probed(), views=layout.views.probed())
    rates = _rates(scene.volume, layout.volume, scene.dimension)
    if not rates.any():
        return ()
    depths = _depths(scene, layout)
    if (rates == rates[0]).all():
        return tuple(crossing_variance(float(rates[0]), float(depth)) for depth in depths)
    falling = replace(layout, volume=layout.volume._replace(extinction=layout.volume.extinction * rates))
    fallen = np.minimum(_depths(scene, falling), depths)
    return tuple(
        crossing_variance(float(fall / depth) if depth else 0.0, float(depth))
        for fall, depth in zip(fallen, depths, strict=True)
    )


def _depths(scene: Scene, layout: Layout) -> np.ndarray:
    """Least optical depth, over points of the medium, of the straight way in and out: of pairs of lights and views."""
    clear = replace(layout, volume=layout.volume._replace(extinction=np.zeros_like(layout.volume.extinction)))
    points = _points(layout, scene.medium.mean_free_path)
    records, n = np.zeros((len(points), walk.RECORD)), len(points)
    records[:, walk.ENTRY : walk.ENTRY + 3] = records[:, walk.EXIT : walk.EXIT + 3] = points
    types, bounces = np.zeros((n, 2), np.int32), np.zeros((n, 2), np.int8)
    bank = PathBank(records, np.ones(n, np.int32), np.arange(n), types, bounces, n)
    into = _lost(layout, clear, bank, layout.lights, "entry")
    out = _lost(layout, clear, bank, layout.views, "exit")
    depths = (into[:, None] + out).min(axis=-1).ravel()
    # Straight ways may lead aslant through a slab; what has to be crossed is no deeper than it.
    return depths if scene.medium.has_sides else np.minimum(depths, scene.optical_depth)


def _lost(layout: Layout, clear: Layout, bank: PathBank, endpoints: Endpoints, end: End) -> np.ndarray:
    """Optical depth float64[n, M] from points to lights or views, from what is left of the light."""
    with np.errstate(divide="ignore", invalid="ignore"):
        left = endpoint_factors(layout, bank, endpoints, end) / endpoint_factors(clear, bank, endpoints, end)
        return np.nan_to_num(-2 * np.log(np.abs(left)), nan=np.inf).clip(max=_OPAQUE)


def _points(layout: Layout, mean_free_path: float) -> np.ndarray:
    """Points float64[M, 3] all over a medium, and just within its faces; beside the lights where it has no sides."""
    axes = []
    for axis, (low, high) in enumerate(layout.volume.bounds[:2].T):
        if np.isfinite([low, high]).all():
            inset = min(_SLIVER, 0.1 * mean_free_path / (high - low)) if high > low else _SLIVER
            axes.append(low + (high - low) * np.clip(_INSETS, inset, 1 - inset))
        else:
            beside = [end.vectors[:, axis] for end in (layout.lights, layout.views) if end.near]
            axes.append(np.unique(np.concatenate([[0.0], *beside])))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
