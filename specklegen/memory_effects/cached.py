"""The memory effect of a medium, estimated once: a property of the medium, and of no run that asks for it.

Its paths walk under a seed of the medium's own, that of the medium in units of its thickness, as pilots do. What they
say is cached in the process and on disk (:mod:`specklegen.disk_cache`), and is the same to the bit wherever it comes
from. So all seeds of a render share one estimate, and its error: more paths lower it, more realizations do not.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.most_recent import MostRecent
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.values import read_only
from specklegen.memory_effects.camera import estimate_camera_correlation
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.memory_effects.oblique import ObliqueCorrelation, estimate_oblique_correlation
from specklegen.memory_effects.polarised_fields import (
    PolarisedCorrelation,
    PolarisedFields,
    estimate_polarised_correlation,
    estimate_polarised_fields,
)
from specklegen.scene.media import PlaneMedium
from specklegen.scene.polarisation import Polarisers

_CACHE: MostRecent[tuple, Any] = MostRecent(2**28)
_ANEW: ContextVar[Seed | None] = ContextVar("anew", default=None)
Estimate = TypeVar("Estimate")


@contextmanager
def estimated_anew(seed: Seed) -> Iterator[None]:
    """Estimate all under a seed meanwhile, and cache nothing: for who measures how long it takes, or how far it is off.

    A sequence of seeds is a sequence of independent estimates.
    """
    before = _ANEW.set(seed)
    try:
        yield
    finally:
        _ANEW.reset(before)


def estimated_under() -> Seed | None:
    """Seed of :func:`estimated_anew`; None where estimates are cached."""
    return _ANEW.get()


def medium_seed(medium: PlaneMedium) -> int:
    """Seed of the paths that tell what a medium is like: the same in any unit of length."""
    return pilot_seed(medium.unitless_fingerprint())


def axial_correlation(medium: PlaneMedium, paths: int, *, threads: int | None = None) -> MemoryEffectCorrelation:
    """K of a medium along the axis, from ``paths`` paths of its own, traced once."""
    return _cached(MemoryEffectCorrelation, medium, paths, (),
                   lambda seed: estimate_correlation(medium, paths, seed, threads=threads))  # fmt: skip


def oblique_correlation(
    medium: PlaneMedium, light: np.ndarray, view: np.ndarray, paths: int, *, transfer: bool = False,
    threads: int | None = None,
) -> ObliqueCorrelation:  # fmt: skip
    """K of a medium about a light and a view float64[3], from ``paths`` paths of its own, traced once."""
    return _cached(
        ObliqueCorrelation, medium, paths, (_written(light), _written(view), transfer),
        lambda seed: estimate_oblique_correlation(
            medium, light, view, paths, seed, transfer=transfer, threads=threads
        ),
    )  # fmt: skip


def camera_correlation(
    medium: PlaneMedium, half: np.ndarray, paths: int, *, threads: int | None = None
) -> MemoryEffectCorrelation:
    """K of a medium over a camera of half sides float64[2], from ``paths`` paths of its own, traced once."""
    return _cached(MemoryEffectCorrelation, medium, paths, ("camera", _written(half)),
                   lambda seed: estimate_camera_correlation(medium, half, paths, seed, threads=threads))  # fmt: skip


def polarised_fields(
    medium: PlaneMedium, polarisers: Polarisers, light: np.ndarray, view: np.ndarray, paths: int, *,
    transfer: bool = False, threads: int | None = None,
) -> PolarisedFields:  # fmt: skip
    """Both components of the fields of ``paths`` paths about a light and a view float64[3], traced once."""
    return _cached(
        PolarisedFields, medium, paths, (polarisers.fingerprint(), _written(light), _written(view), transfer),
        lambda seed: estimate_polarised_fields(
            medium, polarisers, light, view, paths, seed, transfer=transfer, threads=threads
        ),
    )  # fmt: skip


def polarised_correlation(
    medium: PlaneMedium, polarisers: Polarisers, paths: int, *, threads: int | None = None
) -> PolarisedCorrelation:
    """K of a medium along the axis behind an analyser, from ``paths`` paths of its own, traced once."""
    return _cached(
        PolarisedCorrelation, medium, paths, (polarisers.fingerprint(),),
        lambda seed: estimate_polarised_correlation(medium, polarisers, paths, seed, threads=threads),
    )  # fmt: skip


def _written(vector: np.ndarray) -> tuple[float, ...]:
    return tuple(vector.tolist())


def _cached(
    kind: type[Estimate], medium: PlaneMedium, paths: int, about: tuple, estimate: Callable[[Seed], Estimate]
) -> Estimate:
    """Return what is in the process, on disk, or estimated now; nobody can write into its arrays."""
    anew = estimated_under()
    if anew is not None:
        return estimate(anew)
    about = (kind.__name__, medium, paths, *about)

    def compute() -> Estimate:
        made = estimate(medium_seed(medium))
        for value in vars(made).values():
            if isinstance(value, np.ndarray):
                read_only(value)
        return made

    return _CACHE.get(about, lambda: cached_result(kind, about, compute, "correlations"))
