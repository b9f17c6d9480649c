"""A plan: steps, idealisations with their reasons, and cost of a render; stated in words by ``explain``."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from specklegen.core.decision import Decision
from specklegen.core.display.plot import Pictured, decided
from specklegen.core.errors import counted
from specklegen.instrument.lens import Lens
from specklegen.mean.field import ballistic_fraction
from specklegen.paths.gaussianity import Gaussianity, PathMoments
from specklegen.samplers.sampler import Sampler
from specklegen.scene.scene import Scene
from specklegen.scene.validity import implausible_in

_LIGHTS = {"PlaneWaves": "plane wave", "PointSources": "point source", "IncoherentObject": "bright object pixel",
           "CoherentObject": "coherent object"}  # fmt: skip
_FOCI = "focal point"


@dataclass(frozen=True, repr=False)
class Plan(Pictured):
    """Steps of a render, the parts left out with their reasons, and the cost.

    Attributes
    ----------
    scene : Scene
    chosen : Sampler
        The sampler, dimensioned.
    reverse, mean : bool
        Whether reversed paths and the mean field take part.
    decisions : tuple of Decision
        What takes part and what does not, each with its reason.
    operations : dict
        Counted operations of one realization, by the names of :data:`specklegen.core.nanoseconds.NANOSECONDS`.
    seconds : float
        Predicted for one realization on this many threads, the sampler's preparation included and planning not.
    memory_bytes : int
        Predicted peak growth of the process by its first plan and render.
    alternatives : dict
        Seconds that other ways to the same would take, by what they are; other samplers for all realizations.
    realizations : int
        Media for which it was planned.
    setup_seconds : float
        Of ``seconds``, those of what is found once for all realizations.
    lens : Lens or None
        Through which the fields of ``chosen``, over its pupil, become an image.
    pixel : PathMoments or None
        Of what a path adds to a pixel of that image, or to the field of focused light.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> chosen = sg.plan(scene)
    >>> print(chosen.explain().splitlines()[0])
    Scene:       Slab 100 thick, optical depth 5, anisotropy 0.9, albedo 1; 2 tilts, illuminated width 5000; 16x16 views
    """

    scene: Scene
    chosen: Sampler
    reverse: bool
    mean: bool
    decisions: tuple[Decision, ...]
    operations: dict[str, float]
    seconds: float
    memory_bytes: int
    alternatives: dict[str, float]
    realizations: int = 1
    setup_seconds: float = 0.0
    lens: Lens | None = None
    pixel: PathMoments | None = None

    _named = {
        "sampler": "sampler", "summation": "summation", "paths": "paths", "expected error": "expected_error",
        "time": "seconds", "memory": "memory_bytes",
    }  # fmt: skip

    def _facts(self) -> Mapping[str, object]:
        cost = {"time": f"{self.seconds:.2g} s", "memory": f"{self.memory_bytes / 2**20:.0f} MiB"}
        return {**super()._facts(), **cost, "speckle": self.gaussianity, **decided(self.decisions)}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        self.scene.plot(axes, label)

    @property
    def sampler(self) -> str:
        """Name: "paths", "covariance", "stationary", "convolution" or "screens", or that of one of a user's own."""
        return self.chosen.name

    @property
    def summation(self) -> str:
        """Method of its fields: "nufft" or "direct", "eigenvectors", or "FFT or matrix products"."""
        return self.chosen.summation

    @property
    def paths(self) -> int:
        """Paths to trace a realization ("paths"), or once ("stationary", "covariance"; 0 with a lookup table)."""
        return self.chosen.paths

    @property
    def expected_error(self) -> float:
        """Relative error that so many paths leave, between views far apart; ``chosen.error_of`` says of what."""
        return self.chosen.expected_error if self.pixel is None else (self.pixel.relative_variance / self.paths) ** 0.5

    @property
    def correlation_error(self) -> float:
        """Standard error of correlations between tilts, which all seeds share ("stationary"); 0 of other samplers."""
        return self.chosen.correlation_error

    @property
    def image_error(self) -> float:
        """Error between views of one image, up to sqrt 2 times as large by path sums; ``rel_error`` bounds it."""
        if self.pixel is not None:
            return (self.pixel.image_variance / self.paths) ** 0.5
        return getattr(self.chosen, "image_error", self.expected_error)

    @property
    def gaussianity(self) -> Gaussianity:
        """True if so many paths make Gaussian speckle."""
        return self.chosen.gaussianity if self.pixel is None else self.pixel.gaussianity(self.paths)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Requests that were met although the rule of a part is against them."""
        return tuple(f"{d.part}: {d.reason}" for d in self.decisions if d.doubt)

    def explain(self) -> str:
        """Return the steps in words, the parts left out with their reasons, and the cost beside the alternatives'."""
        sampler = f"{self.sampler} ({self.summation}), {self.paths} paths"
        lines = [_field("Scene", self._about), _field("Sampler", sampler)]
        lines += [f"- {v.part}: {'used' if v.needed else 'left out'}: {v.reason}." for v in self.decisions]
        lines += [
            _field("Error", f"{self.expected_error:.2g} expected ({self.chosen.error_of}, relative)"
                   + f", {self.image_error:.2g} within an image; four times the paths halve it" * bool(self.paths)),
            _field("Speckle", str(self.gaussianity)),
            _field("Cost", self._cost),
        ]  # fmt: skip
        lines += _memory_note(self.scene)
        lines += [_field("Alternative", f"{way}, about {cost:.2g} s") for way, cost in self.alternatives.items()]
        if self.scene.illumination.limited:
            lines.append(_field("Ballistic", f"fraction {ballistic_fraction(self.chosen.scene):.2g}"))
        return "\n".join(lines)

    @property
    def checks(self) -> list[str]:
        """Implausible numbers of the scene, a line each."""
        return [f"Check units: {each}." for each in implausible_in(self.scene)]

    def summary(self) -> str:
        """Return a line each for scene, sampler, error, cost, modelled and neglected parts, and doubts if any.

        Implausible numbers of the scene stand first.
        """
        used = [d.part for d in self.decisions if d.needed]
        ideal = [d.part for d in self.decisions if d.idealised]
        without = [d.part for d in self.decisions if not d.needed and d.part not in ideal]
        fields = {
            "Scene": self._about, "Sampler": f"{self.sampler}, {self.paths} paths",
            "Error": f"{self.expected_error:.2g} expected (relative)", "Cost": self._cost, "Modelled": ", ".join(used),
            "Left out": ", ".join(without), "Idealised": ", ".join(ideal),
        }  # fmt: skip
        lines = [*self.checks, *(_field(label, text) for label, text in fields.items() if text)]
        return "\n".join(lines + [_field("Doubtful", doubt) for doubt in self.doubts])

    @property
    def total_seconds(self) -> float:
        """Predicted for all realizations; what is found once counts once."""
        return self.seconds_of(self.realizations)

    def seconds_of(self, realizations: int) -> float:
        """Predicted for so many realizations by this plan."""
        return self.setup_seconds + realizations * max(self.seconds - self.setup_seconds, 0.0)

    @property
    def _cost(self) -> str:
        every = f"{self.total_seconds:.2g} s for all {self.realizations}, " if self.realizations > 1 else ""
        return f"about {self.seconds:.2g} s for the first realization, {every}{self.memory_bytes / 2**20:.0f} MiB"

    @property
    def _about(self) -> str:
        shape = "x".join(str(n) for n in self.scene.sensor.shape)
        return f"{_described(self.scene)}; {_lit(self.scene)}; {shape} {'views' if self.lens is None else 'pixels'}"


def _field(label: str, text: str) -> str:
    """Write a line of a plan: the label, then the text in a column of its own."""
    return f"{label + ':':<13}{text}"


def _lit(scene: Scene) -> str:
    """A few words about the lights."""
    light = scene.illumination
    number = light.images[0] if light.images else len(scene.lights)
    kind = _LIGHTS.get(type(light).__name__, "tilt")
    words = counted(number, _FOCI if light.focused and not light.gridded else kind)
    if light.limited:
        words += f", illuminated width {scene.beams.width:.4g}"
    return words


def _memory_note(scene: Scene) -> list[str]:
    """Say that g alone does not fix the memory effect, where there is a g."""
    if scene.thin is not None:
        return []
    medium = scene.volume
    models = sorted({each.type for each in medium.scatterers} - {"Isotropic"})
    if not models:
        return []
    return [
        _field("Caution", f"the memory effect is that of {' and '.join(models)}. Other phase functions of the same "
               "anisotropy may have a range several times as long or short (docs/media.md)")
    ]


def _described(scene: Scene) -> str:
    """One line about a medium."""
    stack = scene.thin
    if stack is not None:
        apart = f" over {stack.thickness:.4g}" if len(stack.screens) > 1 else ""
        phases = ", ".join(f"{phase:.3g}" for phase in stack.phases(scene.wavelength))
        return (
            f"{counted(len(stack.screens), 'phase screen')}{apart} of rms phase {phases}, rms angle "
            f"{stack.rms_angle(scene.wavelength):.3g}"
        )  # fmt: skip
    medium = scene.volume
    if medium.has_sides and not medium.homogeneous:
        shape = "x".join(str(n) for n in medium.extinction.shape)
        return (
            f"Grid of {shape} voxels of {len(medium.scatterers)} materials, optical depth at most "
            f"{medium.optical_depth:.4g}"
        )  # fmt: skip
    size = "" if medium.has_sides else f" {medium.thickness:.4g} thick,"
    return (
        f"{type(medium).__name__}{size} optical depth {medium.optical_depth:.4g}, "
        f"anisotropy {medium.scatterer.mean_cosine():.4g}, albedo {medium.albedo:g}"
    )  # fmt: skip
