"""Memory-effect range of a named material, and its uncertainty in the literature.

The range is the half range q = k sin(tilt) L of physics.md 4. A material's numbers leave it open by factors: each is
moved to the ends of its range alone, then all are drawn together, and so is the refractive index outside.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from specklegen.core.arguments import positive_number, whole_number
from specklegen.core.errors import reject
from specklegen.core.quantities import Like, with_units
from specklegen.core.random_streams import Seed, Stream, pilot_seed, stream_key
from specklegen.core.units import LENGTH, MICROMETRES, UNIT
from specklegen.materials.preset import BulkMaterial
from specklegen.materials.registry import NUMBERS, about, get, known_wavelength, require_measured
from specklegen.scene.media import Slab

_SIGMA = (15.865, 84.135)
_TWO_SIGMA = (2.5, 97.5)
_MOST_DRAWS = 100_000  # each is an estimate of its own


@dataclass(frozen=True)
class MemoryRange:
    """Half range of a layer of a named material, q = k sin(tilt) L, with its interval.

    Attributes
    ----------
    name : str
    value : float
        With the numbers that are taken by default, or given; behind the first index outside.
    interval, wide_interval : (float, float)
        That hold 68 and 95 % of materials whose numbers are drawn evenly from their ranges, the index outside among
        those named, the phase functions among their families.
    each : Mapping[str, tuple[float, float]]
        With one number at either end of its range and the others by default.
    outside : Mapping[float | None, float]
        Behind each index outside, None for matched faces.
    lobes : Mapping[str, float]
        With each family of phase functions that it may have, of the same g; empty where it may have one.
    sine : float
        Direction sine, in vacuum, of a q of 1: tilts in air are q times it.
    """

    name: str
    value: float
    interval: tuple[float, float]
    wide_interval: tuple[float, float]
    each: Mapping[str, tuple[float, float]]
    outside: Mapping[float | None, float]
    sine: float
    lobes: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        (low, high), (least, most) = self.interval, self.wide_interval
        degrees = np.rad2deg(np.arcsin(min(self.value * self.sine, 1.0)))
        lines = [f"{self.name}: memory range q = {self.value:.2g} ({degrees:.2g} degrees in air); 68 %: {low:.2g} to "
                 f"{high:.2g}; 95 %: {least:.2g} to {most:.2g}"]  # fmt: skip
        lines += [f"  {number} at the ends of its range: {a:.2g}, {b:.2g}" for number, (a, b) in self.each.items()]
        lines += [f"  {'matched faces' if index is None else f'index {index:g} outside'}: {value:.2g}"
                  for index, value in self.outside.items()]  # fmt: skip
        lines += [f"  {family} lobes: {value:.2g}" for family, value in self.lobes.items()]
        return "\n".join(lines)


@with_units
def memory_range(
    name: str, wavelength: Annotated[float, MICROMETRES], thickness: Annotated[float, LENGTH], *,
    outside: Sequence[float | None] = (1.0, 1.33),
    unit: Annotated[float, UNIT] = 1e-6, draws: int = 32, paths: int = 10_000, seed: Seed = 0,
    lobe: str | None = None, **numbers: Annotated[float, Like(NUMBERS)],
) -> MemoryRange:  # fmt: skip
    """Memory range of a layer of a named material, along the axis in transmission, with its interval.

    Parameters
    ----------
    name
        Of the material, one of ``specklegen.materials.list()``.
    wavelength
        In vacuum, micrometres.
    unit
        Metres in the unit of length of the thickness; micrometres by default.
    **numbers
        Of the material, in the units that ``specklegen.materials.about(name)`` states: they are taken as known, and all
        else is drawn for the interval.
    thickness
        Of the layer, in units of ``unit`` metres.
    outside
        Refractive indices that may be before and behind it, None for matched faces; the first is that of ``value``.
    draws
        Materials drawn for the intervals.
    paths
        Of each estimate, which leave some sqrt(60 / paths) of the range.
    seed
        Of the draws.
    lobe
        Family of the phase functions, one of ``about(name).lobes``, where it is known; it is drawn for the interval
        otherwise.

    Raises
    ------
    RuleError
        As of :func:`specklegen.materials.get`, for a thin medium, an empty ``outside``, or paths of which none comes
        through.

    Examples
    --------
    >>> from specklegen import materials
    >>> found = materials.memory_range("intralipid", 0.633, 500.0, draws=4, paths=1000)
    >>> found.interval[0] <= found.interval[1], sorted(found.each)
    (True, ['dilution'])
    """
    wavelength = known_wavelength(name, wavelength)
    thickness = positive_number("materials.memory_range thickness", thickness)
    unit = positive_number("materials.memory_range unit", unit)
    if not isinstance(outside, Sequence) or isinstance(outside, str) or not outside:
        reject("materials.memory_range outside", "at least one refractive index, or None", outside)
    draws = whole_number("materials.memory_range draws", draws, 1, _MOST_DRAWS)
    paths = whole_number("materials.memory_range paths", paths, 64)
    require_measured(name, wavelength, numbers)
    free = about(name).left_open(numbers)

    lobes = about(name).lobes if lobe is None else ()

    def value(index: float | None, family: str | None = lobe, moved: Mapping[str, float] | None = None) -> float:
        material = get(name, wavelength, unit=unit, lobe=family, **(numbers | dict(moved or {})))
        if not isinstance(material, BulkMaterial):
            reject("materials.memory_range name", "a bulk", name, "One thin medium has no range: docs/screens.md.")
        return _half_range(material.slab(thickness, index), paths)

    rng = np.random.default_rng(stream_key(seed, Stream.MATERIALS))
    moved = [
        (outside[int(rng.integers(len(outside)))], {number: one.drawn(rng) for number, one in free.items()})
        for _ in range(draws)
    ]
    families = [lobes[int(n)] for n in rng.integers(len(lobes), size=draws)] if lobes else [lobe] * draws
    spread = [value(index, family, given) for (index, given), family in zip(moved, families, strict=True)]
    behind = {index: value(index) for index in outside}
    return MemoryRange(
        name=name,
        value=behind[outside[0]],
        interval=_ends(spread, _SIGMA),
        wide_interval=_ends(spread, _TWO_SIGMA),
        each={number: (value(outside[0], lobe, {number: one.low}), value(outside[0], lobe, {number: one.high}))
              for number, one in free.items() if one.low < one.high},
        outside=behind,
        sine=wavelength * 1e-6 / unit / (2 * np.pi * thickness),
        lobes={family: value(outside[0], family) for family in lobes},
    )  # fmt: skip


def _half_range(slab: Slab, paths: int) -> float:
    # With the kernels: materials need none.
    from specklegen.memory_effects.correlation import estimate_correlation
    from specklegen.paths.analog_walk import require_walkable

    require_walkable("materials.memory_range", slab, paths)
    correlation = estimate_correlation(slab, paths, pilot_seed(slab.unitless_fingerprint()))
    if not correlation.weights.any():
        reject("materials.memory_range paths", "enough that some light is transmitted", paths,
               "Or use a thinner layer.")
    return correlation.half_range() * slab.thickness


def _ends(values: list[float], shares: tuple[float, float]) -> tuple[float, float]:
    low, high = np.percentile(values, shares, method="closest_observation")  # ranges may be infinite
    return float(low), float(high)
