"""Results of traced beams: power on receivers, how beams ended, and what they met."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from specklegen.core.display.plot import Pictured, draw_map, written


@dataclass(frozen=True)
class Ledger:
    """Ends of beams: every beam once.

    Attributes
    ----------
    received : int
        Left the scene after crossing a receiver; receivers let light pass.
    absorbed, escaped : int
        On a surface; out of the scene without crossing a receiver.
    stopped : int
        After ``max_events`` interactions.
    failed : int
        No wavevector could be drawn: the opening has no area, or every try was refused.

    Examples
    --------
    >>> from specklegen.wavetracing import Ledger
    >>> Ledger(received=3, absorbed=2, escaped=0, stopped=0, failed=0).total  # every beam ends once
    5
    """

    received: int
    absorbed: int
    escaped: int
    stopped: int
    failed: int

    @property
    def total(self) -> int:
        """All beams."""
        return self.received + self.absorbed + self.escaped + self.stopped + self.failed


@dataclass(frozen=True)
class Statistics:
    """Counts of the events of beams.

    Attributes
    ----------
    surface, open, matter, null : int
        Ordinary surface events; openings and edges passed; surfaces hit with an edge of theirs in the cone; of the
        passed ones those that changed nothing, with nothing open as the mean of the beam sees them.
    uniform, gaussian, local_chirp : int
        Patterns of uniform and of Gaussian light; of the latter those whose phase, too curved for the
        grid, was taken out.
    trials, evanescent : int
        Proposals of the sampler of uniform patterns; draws above the wavenumber, drawn again.
    regions, region_triangles, crossings : int
        Regions looked at, triangles in them, and crossings of receivers.
    region_area : float
        Mean cross-section of a region (an area); 0 without any.

    Examples
    --------
    >>> from specklegen.wavetracing import CollimatedEmitter, Geometry, Plane, perforated_screen, trace
    >>> outline, hole = [[-99, -99], [99, -99], [99, 99], [-99, 99]], [[-2, -2], [2, -2], [2, 2], [-2, 2]]
    >>> screen = perforated_screen(outline, [hole])
    >>> light = CollimatedEmitter([-4, -4, -10], [4, 4, -10], [0, 0, 1], beam_radius=20.0, wavelength=1.0)
    >>> found = trace(Geometry([screen]), light, Plane(center=[0, 0, 500], shape=(8, 8), pitch=50.0), beams=500, seed=1)
    >>> found.statistics.regions > 0
    True
    """

    surface: int
    open: int
    matter: int
    null: int
    uniform: int
    gaussian: int
    trials: int
    evanescent: int
    region_triangles: int
    regions: int
    crossings: int
    local_chirp: int
    region_area: float


@dataclass(frozen=True, repr=False)
class WaveTrace(Pictured):
    """Power on receivers.

    Attributes
    ----------
    irradiance : list of float64[h, w]
        Power through each pixel over its area, one array a receiver.
    standard_error : list of float64[h, w]
        Of each value.
    fluence, fluence_error : list of float64[h, w]
        Power over the area across the light, the sum of w / (A |cos|): what a small sphere receives.
    ledger : Ledger
    statistics : Statistics

    Examples
    --------
    >>> from specklegen.wavetracing import CollimatedEmitter, Geometry, Plane, perforated_screen, trace
    >>> outline, hole = [[-99, -99], [99, -99], [99, 99], [-99, 99]], [[-2, -2], [2, -2], [2, 2], [-2, 2]]
    >>> screen = perforated_screen(outline, [hole])
    >>> light = CollimatedEmitter([-4, -4, -10], [4, 4, -10], [0, 0, 1], beam_radius=20.0, wavelength=1.0)
    >>> found = trace(Geometry([screen]), light, Plane(center=[0, 0, 500], shape=(8, 8), pitch=50.0), beams=500, seed=1)
    >>> found.irradiance[0].shape, found.standard_error[0].shape
    ((8, 8), (8, 8))
    """

    irradiance: list[np.ndarray]
    standard_error: list[np.ndarray]
    fluence: list[np.ndarray]
    fluence_error: list[np.ndarray]
    ledger: Ledger
    statistics: Statistics

    def _facts(self) -> Mapping[str, object]:
        return {"receivers": [written(image) for image in self.irradiance]} | asdict(self.ledger)

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Irradiance of the first receiver."""
        if self.irradiance:
            draw_map(axes, self.irradiance[0], "irradiance", low=0)
        axes.set(xlabel="column of the receiver", ylabel="row")
