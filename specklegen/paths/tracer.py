"""Which paths serve a scene: those of beams through a homogeneous slab, or those through anything."""

from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.errors import reject
from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed, Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.bank import PathBank
from specklegen.paths.faces import require_reflection
from specklegen.paths.far_field import middle_light
from specklegen.paths.jones import type_matrices
from specklegen.paths.layout import Layout, plane_layout, scene_layout
from specklegen.paths.phase_tables import common_lobe
from specklegen.paths.proposal import beam_proposal, default_max_order, plane_proposal
from specklegen.paths.roulette import (
    between_probes,
    judging,
    scene_threshold,
    slab_roulette,
    volume_roulette,
    with_capacity,
)
from specklegen.paths.slab_tracer import SlabTracer, events_per_path, require_traceable
from specklegen.paths.starts import close_points, scene_sources
from specklegen.paths.volume_tracer import VolumeTracer
from specklegen.paths.volumes import materials
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.media import PlaneMedium
from specklegen.scene.polarisation import Polarisers
from specklegen.scene.scene import Scene

_SEEN_ACROSS, _MOST_SEEN = 17, 2048  # views that stand for those of a grid along each axis, or for those of a list


class Tracer(Protocol):
    """Random paths of a scene, and what their connections are evaluated at."""

    @property
    def layout(self) -> Layout:
        """The scene as arrays."""
        ...

    @property
    def bidirectional(self) -> bool:
        """True if a path is weighed, and must be evaluated, in both directions."""
        ...

    def trace(
        self, seed: Seed, count: int, *, first: int = 0, sample: int = 0, stream: Stream = Stream.PATHS,
        threads: Threads = None,
    ) -> PathBank:  # fmt: skip
        """Trace paths ``first`` ... ``first + count - 1`` of realization ``sample``.

        The bank is a pure function of the arguments but ``threads``; splitting a range of paths over several
        calls and joining the banks gives the same bank.
        """
        ...


def scene_tracer(scene: Scene, reverse: bool) -> Tracer:
    """Tracer of a scene with or without reversed paths, its roulette set by a pilot."""
    return volume_tracer(scene, reverse) if scene.lock_step_obstacle else slab_tracer(scene, reverse)


@remembered(64)
def slab_tracer(scene: Scene, reverse: bool, aside: bool = True) -> SlabTracer:
    """Tracer of beams through a slab.

    Polarised scenes have the same paths whatever light and analyser are: a seed is one medium.
    Its roulette judges views as they are, or, where lights keep their angles to phase functions, those ``aside`` too as
    which the middle light sees them.
    """
    if scene.film:
        return _filming(slab_tracer(scene.at_rest, reverse, aside), scene)
    if scene.polarisers is not None and scene.polarisers != Polarisers():
        alike = slab_tracer(scene.replace(polarisers=Polarisers()), reverse, aside)
        return replace(alike, layout=scene_layout(scene))
    middle = middle_light(scene) if aside else None
    judging = _judging(scene, reverse, middle is not None)
    if not aside or not judging.proposal.threshold:
        return judging
    tilts = np.zeros((1, 2)) if middle is None else scene.beams.directions[:, :2] - middle[:2]
    share = between_probes(scene.volume.scatterers, 3, seen_views(scene, tilts), judging.proposal.probes)
    return replace(judging, proposal=replace(judging.proposal, threshold=share * judging.proposal.threshold))


@remembered(64)
def _judging(scene: Scene, reverse: bool, turned: bool) -> SlabTracer:
    """Copy with the threshold of its pilot, at views as they are, or ``turned`` as the middle light sees them."""
    views, layout = probe_views(scene), scene_layout(scene)
    if reverse:
        require_reflection(scene.slab, views)
    if turned and layout.middle is not None and len(views):
        views = judged_views(views, scene.beams.directions[:, :2] - layout.middle[:2])
    proposal = beam_proposal(scene.slab, scene.beams, views, bidirectional=reverse, ways=layout.ways)
    tracer = SlabTracer(layout, scene.slab, proposal)
    if not len(views) or not len(scene.beams.directions):
        return tracer
    seed = pilot_seed(scene.unitless_fingerprint())
    about = ("threshold of a slab", scene, reverse, turned)
    return judging(
        tracer, cached_result(float | None, about, lambda: scene_threshold(tracer, proposal.reference, seed))
    )


@remembered(32)
def volume_tracer(scene: Scene, reverse: bool) -> Tracer:
    """Tracer of any scene; of a slab that refracts, which only the paths of beams know, theirs.

    Connections are not thinned where sensor points lie close: what is bright there is not known from a few
    of them. Polarised scenes have the same paths whatever light and analyser are.
    """
    if scene.imaged:
        reject("Scene.sensor", "in the far field for this function, behind refracting faces", scene.sensor.type,
               "Only plan, render and mean_field support points there.")  # fmt: skip
    if scene.film:
        return _filming(volume_tracer(scene.at_rest, reverse), scene)
    if scene.medium.has_sides and scene.polarisers not in (None, Polarisers()):
        alike: Any = volume_tracer(scene.replace(polarisers=Polarisers()), reverse)
        return replace(alike, layout=scene_layout(scene))
    if not scene.medium.has_sides:
        if scene.slab.refracts or scene.polarisers is not None:
            return slab_tracer(scene, reverse)
        require_traceable(scene.slab, events_per_path(scene.slab))
    layout = scene_layout(scene)
    tracer = VolumeTracer(
        layout=layout, sources=scene_sources(scene), lobe=common_lobe(materials(scene.volume), scene.dimension),
        bidirectional=reverse or bool(close_points(scene, layout.volume)), threshold=0.0,
        max_order=default_max_order(scene.volume), matrices=type_matrices(scene.volume),
    )  # fmt: skip
    seed = pilot_seed(scene.unitless_fingerprint())

    def roulette() -> tuple[float, float]:
        ready = with_capacity(tracer if layout.views.near else _spared(volume_roulette(tracer, seed), scene))
        return ready.threshold, ready.capacity

    threshold, capacity = cached_result(tuple[float, float], ("roulette of a volume", scene, reverse), roulette)
    return replace(tracer, threshold=threshold, capacity=capacity)


def _filming(tracer: Any, scene: Scene) -> Any:
    """Trace the paths with their momentum transfer, for all frames of a film."""
    if tracer.layout.ways is not None:
        reject(
            f"{scene.slab.type}.motion", "left out if paths are aimed through layers that refract", scene.slab.motions,
            "Leave out the motion or the index mismatch; only the stationary sampler supports both, near the axis.",
        )  # fmt: skip
    return replace(transferring(tracer), layout=scene_layout(scene))


def transferring(tracer: Any) -> Any:
    """Trace the paths with their momentum transfer and Doppler shifts, for motion."""
    if isinstance(tracer, SlabTracer):
        return replace(tracer, proposal=replace(tracer.proposal, transfer=True))
    return replace(tracer, transfer=True)


def plane_tracer(
    medium: PlaneMedium, wavelength: float, lights: np.ndarray, views: np.ndarray, reverse: bool,
    transfer: bool = False,
) -> SlabTracer:  # fmt: skip
    """Tracer of unlimited plane waves float64[T, 3] on a slab, seen from float64[V, 3], paths starting along the axis.

    Weights are per unit area of the face. Roulette judges the first view, but not where paths serve both ways.
    ``transfer`` collects what motion needs.
    """
    if reverse:
        require_reflection(medium, views)
    axis = np.array([0.0, 0.0, 1.0])
    proposal = replace(plane_proposal(medium, axis, views[:1], bidirectional=reverse), transfer=transfer)
    tracer = SlabTracer(plane_layout(medium, wavelength, lights, views), medium, proposal)
    return tracer if reverse else slab_roulette(tracer, axis, pilot_seed(medium.unitless_fingerprint()))


def _spared(tracer: VolumeTracer, scene: Scene) -> VolumeTracer:
    """Copy with a share of its threshold, for gaps between views and between lights that are directions."""
    if not tracer.threshold:
        return tracer
    share, dimension = 1.0, 3 if scene.dimension == 3 else 2
    for ends in (tracer.layout.views, tracer.layout.lights):
        if not ends.near:
            seen = ends.of(_some(len(ends), _MOST_SEEN)).vectors
            share *= between_probes(scene.volume.scatterers, dimension, seen, ends.probed().vectors)
    return replace(tracer, threshold=share * tracer.threshold)


def _some(count: int, most: int) -> np.ndarray:
    """Numbers of at most so many, evenly among them and the last one too."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))


def seen_views(scene: Scene, tilts: np.ndarray) -> np.ndarray:
    """Views float64[n, 3] of a scene, some of many, as lights of ``tilts`` float64[T, 2] beside the middle see them."""
    grid = scene.sensor.regular_grid
    if grid is None:
        views = scene.views[_some(len(scene.views), _MOST_SEEN)]
    else:
        x, y = (axis[_some(len(axis), _SEEN_ACROSS)] for axis in grid.sines)
        views = directions_of_sines("view", np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), grid.sign)
    if not tilts.any():
        return views
    ends = np.unique([tilts[at] for axis in tilts.T for at in (axis.argmin(), axis.argmax())], axis=0)
    aside, sign = (views[:, None, :2] - ends).reshape(-1, 2), np.repeat(np.sign(views[:, 2]), len(ends))
    inside = np.square(aside).sum(axis=1) < 1
    return directions_of_sines("view", aside[inside]) * np.stack([1 + 0 * sign, 1 + 0 * sign, sign], -1)[inside]


def probe_views(scene: Scene) -> np.ndarray:
    """Views that stand for all in weights and errors: centre and corners of a grid, at most nine others."""
    sensor = scene.sensor.regular_grid
    if sensor is None:
        flat = scene.views
        if not len(flat):
            return flat
        chosen = np.linspace(0, len(flat) - 1, 9).astype(int)
        ahead = flat[:, 2] > 0
        if ahead.any() and not ahead.all():  # both sides
            chosen = np.append(chosen, [flat[:, 2].argmax(), flat[:, 2].argmin()])
        return flat[np.unique(chosen)]
    center, corners = sensor.center_direction[None], sensor.corner_directions
    narrow = np.ptp(corners, axis=0).max() < 0.05 * (1 - abs(scene.slab.scatterer.mean_cosine()))
    return center if narrow else np.concatenate([center, corners])


def judged_views(views: np.ndarray, tilts: np.ndarray) -> np.ndarray:
    """Views float64[n, 3] as the light in the middle sees them where every light keeps its angles: v - t.

    The first view, and the corners of the rectangle of sines around all of them.
    """
    seen = (views[:, None, :2] - tilts).reshape(-1, 2)
    (x0, y0), (x1, y1) = seen.min(axis=0), seen.max(axis=0)
    corners = np.unique([(x, y) for x in (x0, x1) for y in (y0, y1)], axis=0)
    corners = corners[np.square(corners).sum(axis=1) < 1]
    return np.concatenate([views[:1], directions_of_sines("view", corners, np.sign(views[0, 2]))])
