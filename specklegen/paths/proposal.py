"""Proposals: how random paths are drawn. Any choice is right, a good one is fast."""

import math
from dataclasses import dataclass

import numpy as np

from specklegen.kernels.footprints import UNLIMITED
from specklegen.paths.legs import Ways
from specklegen.paths.volumes import footprint_code
from specklegen.scene.illumination import CollimatedBeams, reference_direction
from specklegen.scene.media import Medium, PlaneMedium


@dataclass(frozen=True)
class Proposal:
    """Proposal of paths; any choice is right, a good one is fast.

    Attributes
    ----------
    reference : float64[3]
        Direction along which first vertices lie and about which first directions spread.
    footprint, extent, radius :
        Kind of beam, size of the sampled footprint (which covers every tilt's), size of the profile.
    probes : float64[n, 3]
        Views at which the contribution of a connection is judged.
    bidirectional : bool
        Whether each path is weighed together with its reversal.
    threshold : float
        Contribution from which a connection is always kept; 0 keeps all.
    max_order : int
        Vertices after which a path is ended.
    transfer : bool
        Whether paths collect their momentum transfer.
    """

    reference: np.ndarray
    footprint: int
    extent: float
    radius: float
    probes: np.ndarray
    bidirectional: bool = False
    threshold: float = 0.0
    max_order: int = 1000
    transfer: bool = False


def default_max_order(medium: Medium) -> int:
    """Vertices that bound a path: ``max(1000, 10 OD^2)``, far beyond what any medium needs."""
    return int(min(max(1000.0, 10 * min(medium.optical_depth, 1e5) ** 2), 2e9))


def beam_proposal(
    medium: PlaneMedium, beams: CollimatedBeams, probes: np.ndarray, *, bidirectional: bool = False,
    ways: Ways | None = None,
) -> Proposal:  # fmt: skip
    """Draw first vertices over the union of all tilts' footprints, first directions from the phase function."""
    reference = reference_direction(beams.directions)
    if ways is None:
        drift = beams.directions[:, :2] / beams.directions[:, 2:] - reference[:2] / reference[2]
        margin = float(np.abs(drift).max(initial=0.0)) * medium.thickness * math.sqrt(2)
    else:
        margin = ways.lights.farthest_apart(beams.directions, reference) * math.sqrt(2)
    square = beams.profile == "square"
    gaussian = beams.profile == "gaussian"
    return Proposal(
        reference=reference,
        footprint=footprint_code(beams.profile),
        # The Gaussian density follows the intensity, whose standard deviation is a quarter of the width.
        extent=(beams.width / 4 if gaussian else beams.width / 2) + margin / (math.sqrt(2) if square else 1),
        radius=beams.width / 2,
        probes=np.ascontiguousarray(np.atleast_2d(probes), dtype=np.float64),
        bidirectional=bidirectional,
        max_order=default_max_order(medium),
    )


def plane_proposal(
    medium: PlaneMedium, direction: np.ndarray, probes: np.ndarray, *, bidirectional: bool = False
) -> Proposal:
    """Paths of an unlimited plane wave; weights are per unit area of the face."""
    return Proposal(reference=direction, footprint=UNLIMITED, extent=1.0, radius=math.inf,
                    probes=np.ascontiguousarray(np.atleast_2d(probes), dtype=np.float64), bidirectional=bidirectional,
                    max_order=default_max_order(medium))  # fmt: skip
