"""Flows in films: whether their medium moves as one, and how far it carries what the window lights.

Where all particles have one velocity V, the field at a view turns by k (i - v) . V t, whatever the paths, and the
window lights other parts of the medium: nothing else decorrelates.
"""

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.kernels.volume import Volume
from specklegen.paths.bank import PathBank
from specklegen.paths.volumes import drift_of, velocity_at, volume_of
from specklegen.scene.scene import Scene

_LEAST_LIT = 0.01
"""Of the window, by which it may light another part of the medium and nobody sees it: 2 % of a squared correlation."""


def drifted(scene: Scene) -> np.ndarray | None:
    """Displacement of a medium in uniform motion at each beam of a film, float64[T, 3]; None for other media."""
    drift = drift_of(volume_of(scene.volume, scene.dimension)) if scene.film and scene.volume.flows else None
    if drift is None:
        return None
    return (scene.beams.times - scene.beams.times[0])[:, None] * drift  # type: ignore[operator,index]


def drift_phases(scene: Scene, moved: np.ndarray, views: np.ndarray) -> np.ndarray:
    """K (i - v) . d of every beam that the medium has come by d float64[T, 3] at, and view float64[..., 3]."""
    apart = scene.lights.reshape(len(moved), *[1] * (views.ndim - 1), 3) - views
    return scene.wavenumber * (apart * moved.reshape(len(moved), *[1] * (views.ndim - 1), 3)).sum(axis=-1)


def uneven_turn(scene: Scene) -> float:
    """Most radians by which a flow turns a path in a film more at any light and view than at those in the middle.

    k |V| t times the distance of their sines, of the fastest particles between two planes; infinite of a flow that is
    not the same all along them.
    """
    volume = volume_of(scene.volume, scene.dimension)
    if sideways(volume):
        return np.inf
    grid, sines = scene.grid, scene.lights[:, :2]
    depths = np.concatenate([volume.bounds[0, 2:], np.sort(volume.bounds[1:, 2])])
    points = np.zeros((2 * len(depths), 3))
    points[:, 2] = np.concatenate([np.nextafter(depths, -np.inf), depths])  # either side of each face
    speed = float(np.hypot(*velocity_at(volume, points)[:, :2].T).max())
    reach = float(np.hypot(*(grid.corner_directions - grid.center_direction)[:, :2].T).max(initial=0.0))
    reach = max(reach, float(np.ptp(sines, axis=0).max(initial=0.0)))
    return scene.wavenumber * speed * float(np.ptp(np.asarray(scene.beams.times))) * reach


def sideways(volume: Volume) -> bool:
    """Return whether a flow changes along the faces of a medium that is infinite there."""
    return bool(volume.flow[:, [3, 4, 6, 7, 9, 10]].any())


def lit_elsewhere(scene: Scene, bank: PathBank) -> list[Decision]:
    """Error of films by path sums when other particles enter the illuminated area: their paths stay under it."""
    if not (scene.film and scene.volume.flows and len(bank)):
        return []
    velocity = velocity_at(volume_of(scene.volume, scene.dimension), bank.entry)
    moved = float(np.hypot(velocity[:, 0], velocity[:, 1]).max() * np.ptp(np.asarray(scene.beams.times)))
    share = moved / scene.beams.width
    if share <= _LEAST_LIT:
        return []
    if drifted(scene) is not None:
        reject("CollimatedBeams.times", f"so close that the medium moves by at most {_LEAST_LIT:g} of "
               "the illuminated width in path sums", moved,
               'Use sampler="stationary", a wider illuminated area, or a shorter film.')  # fmt: skip
    return [Decision(
        "flow", True, f"particles move by up to {share:.2g} of the illuminated width, but path sums keep the same "
        "paths", doubt=True,
    )]  # fmt: skip
