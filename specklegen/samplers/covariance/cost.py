"""Cost of a covariance, in counted operations."""

from specklegen.core.budgets import require_time
from specklegen.core.nanoseconds import seconds
from specklegen.core.statistics import BATCHES
from specklegen.paths.pilot import PILOT_PATHS, Pilot, volume_pilot
from specklegen.scene.scene import Scene


def covariance_operations(scene: Scene, pilot: Pilot, paths: int, entries: float | None = None) -> dict[str, float]:
    """Operations of the covariance of so many entries, by default of every two (light, view)."""
    ways, lights, views = 2 if pilot.tracer.bidirectional else 1, len(scene.lights), len(scene.views)
    connections, events = paths * pilot.connections_per_path, paths * pilot.events_per_path
    pairs, both = float(lights * views), connections * ways
    near = both * (lights if scene.illumination.near else 0)
    near += both * (views if scene.sensor.near else 0)
    crossed = 0.0 if scene.medium.homogeneous else max(scene.volume.voxel_counts) / 2
    return {
        "volume path": paths,
        "volume event": events,
        "voxel": (events + both * (lights + views)) * crossed,
        "volume connection": connections,
        "volume end": both * (lights + views) - near,
        "near end": near,
        "product": both * (pairs * pairs / 2 if entries is None else entries),
        "amplitude": both * pairs,
        "batch": min(BATCHES, paths),
    }


MOST_PAIRS = 2048
"""Lights times views up to which a covariance is thought of unasked: its matrix and eigenvectors take 400 MB."""
_EIGENVECTORS, _FIELD = 60.0, 8.0  # flops of eigenvectors, by pairs cubed, and of one field, by pairs squared


def eigen_operations(pairs: float) -> dict[str, float]:
    """Operations of the eigenvectors of a covariance of so many (light, view)."""
    return {"flop": _EIGENVECTORS * pairs**3}


def field_operations(pairs: float) -> dict[str, float]:
    """Operations of one field that is drawn from them."""
    return {"flop": _FIELD * pairs**2, "normal": pairs}


def require_covariance_time(owner: str, scene: Scene, reverse: bool, paths: int, entries: float) -> None:
    """Refuse a covariance that takes more than a month, by the pilot by which the planner predicts it."""
    if paths > 100 * PILOT_PATHS:  # for fewer the pilot would be no small part of it
        took = seconds(covariance_operations(scene, volume_pilot(scene, reverse), paths, entries), 1)
        require_time(f"{owner} paths", took, f"{paths} paths", "Ask for fewer paths, or for chosen pairs.")
