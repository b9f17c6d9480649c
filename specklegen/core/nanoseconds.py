"""Nanoseconds of counted operations, by name: those of one core of the machine of the README's table.

``scripts/plan_accuracy.py`` fits them. They scale predictions; a choice rests on this table, never on a clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

NANOSECONDS = {
    "path": 60,  # starting a path through a slab
    "event": 11,  # a scattering event, tracing of beams through a slab
    "connection": 370,  # what a connection costs whoever evaluates it: kept, copied, given a phase
    "end": 31,  # one end of a connection at one tilt or view
    "spread": 15,  # spreading one strength, single precision at a tolerance of 1e-3
    "FFT point": 10,  # of the oversampled grid
    "pattern": 9.6,  # a view of one skeleton term
    "moved connection": 300,  # displacements of its particles in a frame of a film, and their phases
    "direct view": 2,  # a connection at a view, summed directly
    "direct tilt": 1.3,  # and at a tilt there
    "normal": 7,  # a complex normal number
    "flop": 0.052,  # of the stationary sampler's products and transforms
    "stack view": 7.3,
    "envelope": 115,  # of a beam behind screens, at a view
    "lobe": 12,  # a term of that in a table
    "phasor": 35,  # of an oblique correlation
    "object pixel": 1000,  # the modes at a pixel of a hidden object ...
    "object difference": 600,  # ... and the memory effect at a difference of two
    "image": 0.5,  # an operation of its image, by pairs of modes or by bright pixels
    "volume path": 200,
    "volume event": 120,  # a scattering event in any geometry
    "voxel": 16,  # one that a flight or a connection crosses
    "volume connection": 160,
    "volume end": 10,  # one end of a connection there, at one light or view
    "near end": 16,  # the same at a point
    "product": 0.19,  # a complex multiplication and addition within a matrix product
    "amplitude": 1.5,  # one of the amplitudes whose products are summed in a covariance
    "batch": 4e5,  # of a covariance's paths, however few they are
    "correlation batch": 1.3e5,  # of those that tell the memory effect
}
WAVE = 700.0
"""Times the time of a "flop" that a complex exponential in double precision takes, where it is counted among those."""
SERIAL = {"normal", "flop", "stack view", "envelope", "lobe", "phasor", "object pixel", "object difference", "image"}
"""Operations that any number of threads leaves to one."""


def seconds(operations: Mapping[str, float], threads: int) -> float:
    """Seconds that operations take on so many threads."""
    return 1e-9 * sum(
        count * NANOSECONDS[name] / (1 if name in SERIAL else threads) for name, count in operations.items()
    )


@dataclass(frozen=True)
class Cost:
    """Counted operations of a sampler, by the names of :data:`NANOSECONDS`.

    Attributes
    ----------
    first : mapping
        Of the first realization.
    once : mapping
        Those among them that are done once, however many realizations follow.
    alternatives : mapping of mapping
        Operations that other ways to the same would take, by what they are.
    """

    first: Mapping[str, float] = field(default_factory=dict)
    once: Mapping[str, float] = field(default_factory=dict)
    alternatives: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def of(self, realizations: int) -> dict[str, float]:
        """Return the operations of so many realizations."""
        once = {name: self.once.get(name, 0.0) for name in self.first}
        return {name: once[name] + realizations * (count - once[name]) for name, count in self.first.items()}

    def seconds(self, realizations: int, threads: int = 1) -> float:
        """Predict the seconds of so many realizations, those of what is done once included."""
        first, once = seconds(self.first, threads), seconds(self.once, threads)
        return once + realizations * max(first - once, 0.0)
