"""A plan: what a render will do, what it leaves out and why, and what that costs; told in words by ``explain``."""

from dataclasses import dataclass

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import counted
from specklegen.core.showing import summary
from specklegen.mean.field import ballistic_fraction
from specklegen.paths.chunks import Chunks
from specklegen.paths.gaussianity import Gaussianity
from specklegen.paths.slab_tracer import Proposal
from specklegen.samplers.path_sums.nufft import NufftPlan
from specklegen.samplers.stationary.rule import Kernel
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject
from specklegen.scene.media import Medium, Slab, VoxelGrid
from specklegen.scene.scene import Scene

_LIGHTS = {"PlaneWaves": "plane wave", "PointSources": "point source", "IncoherentObject": "lit pixel"}


@dataclass(frozen=True)
class Plan:
    """What a render will do, what it leaves out and why, and what that costs.

    Attributes
    ----------
    scene : Scene
    paths : int
        Paths to trace a realization ("paths"), or once for the memory-effect kernel ("stationary").
    sampler, summation : str
        "paths" with "nufft" or "direct", "covariance" with "eigenvectors", or "stationary".
    reverse, mean : bool
        Whether reversed paths and the mean field take part.
    decisions : tuple of Decision
        Every gate, with its reason.
    proposal : Proposal or None
        How paths are drawn through a slab; None where the general engine serves (any geometry).
    nufft : NufftPlan or None
        The view factors, where the NUFFT is used.
    kernel : "axial", "oblique" or None
        The memory-effect kernel of the stationary sampler: of the axis, or about the middle of the beams and views.
    expected_error : float
        Root of the excess correlation of intensities from a finite number of paths, at the worst view
        ("paths"); relative standard error of the intensity scale ("stationary").
    gaussianity : Gaussianity
        Whether so many paths make Gaussian speckle.
    connections_per_path, events_per_path : float
        From the pilot.
    chunks : Chunks
        Paths that are traced and summed at a time.
    operations : dict
        Counted operations of one realization, by the names of :data:`specklegen.core.nanoseconds.NANOSECONDS`.
    seconds : float
        Predicted for one realization on this many threads, the sampler's preparation included and planning not.
    memory_bytes : int
        Predicted peak growth of the process by its first plan and render.
    alternatives : dict
        Seconds that other ways to the same would take, by what they are.
    """

    scene: Scene
    paths: int
    sampler: str
    summation: str
    reverse: bool
    mean: bool
    decisions: tuple[Decision, ...]
    proposal: Proposal | None
    nufft: NufftPlan | None
    kernel: Kernel | None
    expected_error: float
    gaussianity: Gaussianity
    connections_per_path: float
    events_per_path: float
    chunks: Chunks
    operations: dict[str, float]
    seconds: float
    memory_bytes: int
    alternatives: dict[str, float]

    def __repr__(self) -> str:
        return summary(
            self, sampler=self.sampler, summation=self.summation, paths=self.paths, expected_error=self.expected_error,
            seconds=self.seconds, memory_bytes=self.memory_bytes,
        )  # fmt: skip

    @property
    def field_dtype(self) -> type:
        """Precision in which fields are summed."""
        return self.nufft.dtype if self.nufft else np.complex128

    def explain(self) -> str:
        """Tell in words what will be done, what is left out and why, what it costs and what else would cost."""
        shape = "x".join(str(n) for n in self.scene.sensor.shape)
        lines = [
            f"{_described(self.scene.medium)}; {_lit(self.scene)}, {shape} views.",
            f"Sampler: {self.sampler} ({self.summation}), {self.paths} paths.",
        ]
        lines += [f"- {v.part}: {'used' if v.needed else 'left out'}: {v.reason}." for v in self.decisions]
        what = "intensity scale" if self.sampler == "stationary" else "false intensity correlation"
        lines += [
            f"Expected error ({what}, relative): {self.expected_error:.2g}; four times the paths halve it.",
            f"Speckle: {self.gaussianity}",
            f"Cost: about {self.seconds:.2g} s for the first realization, {self.memory_bytes / 2**20:.0f} MiB.",
        ]
        lines += [f"Instead, {way} would take about {cost:.2g} s." for way, cost in self.alternatives.items()]
        if isinstance(self.scene.illumination, CollimatedBeams | IncoherentObject):
            lines.append(f"Ballistic fraction: {ballistic_fraction(self.scene):.2g}.")
        return "\n".join(lines)


def _lit(scene: Scene) -> str:
    """A few words about the lights."""
    light = scene.illumination
    words = counted(len(scene.lights), _LIGHTS.get(type(light).__name__, "tilt"))
    if isinstance(light, CollimatedBeams | IncoherentObject):
        words += f" through a window {light.width:.4g} wide"
    return words


def _described(medium: Medium) -> str:
    """One line about a medium."""
    if isinstance(medium, VoxelGrid):
        shape = "x".join(str(n) for n in medium.extinction.shape)
        return (
            f"Grid of {shape} voxels of {len(medium.scatterers)} materials, optical depth at most "
            f"{medium.optical_depth:.4g}"
        )  # fmt: skip
    size = f" {medium.thickness:.4g} thick" if isinstance(medium, Slab) else ""
    return (
        f"{type(medium).__name__}{size} of optical depth {medium.optical_depth:.4g}, "
        f"anisotropy {medium.scatterer.g:.4g}, albedo {medium.albedo:g}"
    )  # fmt: skip
