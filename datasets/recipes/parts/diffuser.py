"""The diffuser of a recipe: thin screens, whose numbers may be drawn anew for every medium.

In TOML a ``[material]`` with screens instead of a slab:

    [material]
    wavelength = 0.532
    screens = [{ type = "GroundGlass", angle = { uniform = [0.1, 0.2] } }, { type = "GroundGlass", grit = 600 }]
    gaps = [{ log_uniform = [200.0, 2000.0] }]
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, PrivateAttr, TypeAdapter, WithJsonSchema, model_validator

from specklegen.core.errors import reject
from specklegen.core.quantities import Like
from specklegen.core.units import LENGTH, NEAR_LIGHT, WAVELENGTH, unit_of
from specklegen.core.values import Positive, Value
from specklegen.datasets.distributions import Draw, drawn, ends, is_draw
from specklegen.datasets.recipes.parts.material import Estimator
from specklegen.datasets.split import Split
from specklegen.instrument.lab import LabSetup
from specklegen.samplers.screens.correlation import ScreenCorrelation, screen_correlation
from specklegen.scene.screens import Screen, ScreenStack

_DRAW = TypeAdapter(Draw)


def _read(screen: Any) -> Any:
    if isinstance(screen, Value):
        screen = screen.model_dump(exclude_none=True)
    if not isinstance(screen, Mapping):
        reject("Diffuser.screens", 'tables such as {type = "GroundGlass", grit = 220}', screen)
    return {name: _DRAW.validate_python(value) if is_draw(value) else value for name, value in screen.items()}


DrawnScreen = Annotated[
    dict[str, Any],
    BeforeValidator(_read),
    Like(Screen),
    WithJsonSchema({"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}),
]
"""A screen's table, with distributions in place of numbers."""


def _in_unit(screens: Sequence[dict[str, Any]], metres: float) -> tuple[dict[str, Any], ...]:
    """Screens whose ground glasses know the unit of length, unless they say another or it is the micrometre."""
    if metres == 1e-6:
        return tuple(screens)
    glasses = [each.get("type") == "GroundGlass" and "unit" not in each for each in screens]
    return tuple(each | {"unit": metres} if glass else each for each, glass in zip(screens, glasses, strict=True))


class Diffuser(Value):
    """Thin screens one behind the other; every number may be a constant, a range or a choice.

    Parameters
    ----------
    wavelength
        Between the screens; fixes the unit of every length. Left out where a ``[lab]`` table gives it.
    screens
        Tables of :class:`specklegen.media.PhaseScreen` and :class:`specklegen.GroundGlass`, by their ``type``.
    gaps
        Distances between them, one fewer than there are screens.
    """

    wavelength: Annotated[Positive, WAVELENGTH] | None = None
    screens: tuple[DrawnScreen, ...]
    gaps: tuple[Annotated[Draw, LENGTH], ...] = ()
    _laboratory: float | None = PrivateAttr(None)

    kernel: ClassVar = "closed form"
    kernel_paths: ClassVar = 64  # what a plan is asked for; screens trace none
    by_split: ClassVar = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.wavelength is not None and any(each.get("type") == "GroundGlass" for each in self.screens):
            vars(self)["screens"] = _in_unit(self.screens, self._unit(self.wavelength))
        self.extremes()  # refuses what is no stack
        return self

    def _unit(self, wavelength: float) -> float:
        """Metres in the unit of length, by the wavelength, or as the ground glasses say."""
        stated = [each["unit"] for each in self.screens if "unit" in each]
        unit = unit_of(wavelength)
        metres = stated[0] if stated else unit
        if metres is None or not NEAR_LIGHT[0] <= wavelength * metres <= NEAR_LIGHT[1]:
            reject("Diffuser.wavelength", "0.2 to 20 micrometres, for a ground glass", wavelength,
                   'Write it with its unit, such as "532 nm", or in the unit of all other lengths.')  # fmt: skip
        return metres

    @property
    def varies(self) -> bool:
        """True if two media may have different parameters."""
        return any(low < high for low, high in map(ends, self._draws().values()))

    def _draws(self) -> dict[str, Any]:
        """Distributions by the names under which their numbers are stored."""
        named = {
            f"screen{m}_{name}": screen[name]
            for m, screen in enumerate(self.screens) for name in sorted(screen) if is_draw(screen[name])
        }  # fmt: skip
        return named | {f"gap{n}": gap for n, gap in enumerate(self.gaps) if is_draw(gap)}

    def draw(self, rng: np.random.Generator, split: Split) -> ScreenStack:  # noqa: ARG002 - as of a slab
        """One stack."""
        return self.slab_of({name: drawn(source, rng) for name, source in self._draws().items()})

    def slab_of(self, parameters: Mapping[str, float]) -> ScreenStack:
        """Stack of a sample, from its stored parameters."""
        screens = [
            {name: parameters.get(f"screen{m}_{name}", value) for name, value in screen.items()}
            for m, screen in enumerate(self.screens)
        ]
        gaps = [parameters.get(f"gap{n}", gap) for n, gap in enumerate(self.gaps)]
        return ScreenStack(screens=screens, gaps=gaps)

    def extremes(self) -> list[ScreenStack]:
        """Stacks at the ends of every range."""
        draws = self._draws()
        corners = product(*(sorted(set(ends(source))) for source in draws.values()))
        return [self.slab_of(dict(zip(draws, corner, strict=True))) for corner in corners]

    def labels(self, slab: ScreenStack) -> dict[str, float]:
        """The numbers that were drawn for a stack."""
        numbers = {}
        for name in self._draws():
            place, _, field = name.partition("_")
            if field:
                numbers[name] = float(getattr(slab.screens[int(place.removeprefix("screen"))], field))
            else:
                numbers[name] = float(slab.gaps[int(place.removeprefix("gap"))])
        return numbers

    def in_laboratory(self, lab: LabSetup) -> Self:
        """Return the same screens in the unit of length of a laboratory, which gives the wavelength too."""
        diffuser = self.replace(screens=_in_unit(self.screens, lab.metres))
        diffuser._laboratory = lab.medium_wavelength
        return diffuser

    def realized(self, rng: np.random.Generator, split: Split) -> "KnownDiffuser":
        """One stack with its memory effect."""
        return self.known(self.draw(rng, split))

    def known(self, slab: ScreenStack) -> "KnownDiffuser":
        """Return a stack of this diffuser with its memory effect."""
        wavelength = self.wavelength or self._laboratory
        assert wavelength is not None
        return known(slab, wavelength)


@dataclass(frozen=True)
class KnownDiffuser:
    """A stack of screens with its memory effect, in the place of a slab with its own.

    Attributes
    ----------
    half_range : float
        Lateral wavevector difference at which C_I is half way to its floor; inf of a single screen.
    """

    slab: ScreenStack
    correlation: ScreenCorrelation
    half_range: float
    estimator: Estimator = Estimator.CLOSED_FORM

    def range_sine(self, wavelength: float) -> float:
        """Sine of the memory-effect range; inf where there is none."""
        return self.half_range * wavelength / (2 * np.pi)

    def parameters(self, wavelength: float) -> dict[str, float]:
        """Parameters stored with every sample: the screens, and their effect on light."""
        sine = self.range_sine(wavelength)
        return {
            "wavelength": wavelength,
            "thickness": self.slab.thickness,
            "screens": float(len(self.slab.screens)),
            "rms_angle": self.slab.rms_angle(wavelength),
            "ballistic_fraction": float(np.exp(-self.slab.optical_depth(wavelength))),
            "single_share": self.correlation.single_share,
            "forward_radiance": float(self.correlation.weights.sum()),
            "memory_effect_range": float(np.arcsin(min(sine, 1.0))) if np.isfinite(sine) else np.inf,
            "estimator": float(self.estimator),
        }


@lru_cache(maxsize=64)
def known(stack: ScreenStack, wavelength: float) -> KnownDiffuser:
    """A stack with its memory effect."""
    correlation = screen_correlation(stack.stack, wavelength)
    return KnownDiffuser(stack, correlation, correlation.half_range())
