"""Layouts of slabs as the tests of sums want them, and the direct sum of a bank at any views."""

import numpy as np

import specklegen as sg
from specklegen.paths.endpoints import AXIS
from specklegen.paths.layout import Layout, plane_layout, scene_layout
from specklegen.paths.proposal import Proposal
from specklegen.paths.roulette import slab_roulette
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.samplers.path_sums.direct import direct_field


def beam_layout(wavelength: float, medium: sg.Slab, beams: sg.CollimatedBeams, side: float = 1.0) -> Layout:
    """Beams on a slab, seen along the axis from the side of the sign given."""
    sensor = sg.FarField(directions=side * AXIS[None])
    return scene_layout(sg.Scene(wavelength=wavelength, medium=medium, illumination=beams, sensor=sensor))


def wave_layout(medium: sg.Slab, wavelength: float, lights: np.ndarray, side: float = 1.0) -> Layout:
    """Unlimited plane waves on a slab, seen along the axis from the side of the sign given."""
    return plane_layout(medium, wavelength, np.atleast_2d(lights), side * AXIS[None])


def direct(bank, layout: Layout, phases, views, *, reverse: bool = False, threads: int | None = None) -> np.ndarray:
    """The direct sum at views float64[V, 3]."""
    return direct_field(layout.of_views(views), bank, (phases, phases if reverse else None), threads=threads)


def roulette_threshold(medium: sg.Slab, proposal: Proposal, layout: Layout, light: np.ndarray, seed: int) -> float:
    """Contribution from which a proposal's connections are always kept."""
    return slab_roulette(SlabTracer(layout, medium, proposal), light, seed).proposal.threshold
