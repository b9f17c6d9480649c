"""The memory-effect correlation K of a batch of media, wherever it comes from: here the ways of media part.

What follows (modes, fields, images) asks for nothing but K at lateral wavevector differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from specklegen.core.lazy import LazyModule

if TYPE_CHECKING:
    import torch

    Places = torch.Tensor | slice | list[int]
else:
    torch, Places = LazyModule("torch"), Any


class Correlations(Protocol):
    """K of M media."""

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n] at lateral wavevector differences float64[M, n]; 1 where there is no light."""
        ...

    def at(self, places: Places) -> Self:
        """Those of some of the media."""
        ...

    def __len__(self) -> int:
        """Number of media, M."""
        ...


class Kernel(Protocol):
    """K of one medium, such as :class:`MemoryEffectCorrelation`."""

    @property
    def weights(self) -> np.ndarray:
        """Contributions, all 0 where there is no light."""
        ...

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """K at lateral wavevector differences of any shape."""
        ...


@dataclass(frozen=True)
class Tabulated:
    """K found on the host, medium by medium, and copied to where it is asked for.

    Attributes
    ----------
    kernels : sequence of Kernel
    """

    kernels: Sequence[Kernel]

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n]."""
        if q.device.type == "meta":
            return torch.empty_like(q)
        asked = q.cpu().numpy()
        rows = [k(row) if k.weights.any() else np.ones_like(row) for k, row in zip(self.kernels, asked, strict=True)]
        return torch.from_numpy(np.stack(rows)).to(q.device)

    def at(self, places: Places) -> Tabulated:
        """Those of some of the media."""
        numbers = np.arange(len(self.kernels))[places if isinstance(places, slice) else np.asarray(places)]
        return Tabulated([self.kernels[n] for n in numbers])

    def __len__(self) -> int:
        return len(self.kernels)


@dataclass(frozen=True)
class Mixtures:
    """K as a mixture of functions of q times a radius.

    Attributes
    ----------
    radius, share : float64[M, m]
    mixture : function
        Of q float64[M, n], radius and share: float64[M, n].
    """

    radius: torch.Tensor
    share: torch.Tensor
    mixture: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n]."""
        return self.mixture(q, self.radius, self.share)

    def at(self, places: Places) -> Mixtures:
        """Those of some of the media."""
        return Mixtures(self.radius[places], self.share[places], self.mixture)

    def __len__(self) -> int:
        return len(self.radius)


@dataclass(frozen=True)
class FilmBatch:
    """The memory effect in time of M media that are filmed: of every two frames K(q, x), which falls with x everywhere.

    Attributes
    ----------
    radius : float64[M, m]
        Distances of which K is a mixture.
    shares : float64[M, n, m]
        What is left of the light at each of n different lags between frames, by distances; the first lag is 0.
    mixture : function
        As of :class:`Mixtures`.
    between : int64[F, F]
        Which lag lies between two frames, the same of all media.
    """

    radius: torch.Tensor
    shares: torch.Tensor
    mixture: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]
    between: np.ndarray

    @property
    def lags(self) -> list[Mixtures]:
        """K(q, x) at each lag."""
        return [Mixtures(self.radius, lag.contiguous(), self.mixture) for lag in self.shares.unbind(1)]

    def at(self, places: Places) -> Self:
        """Of some of the media."""
        return type(self)(self.radius[places], self.shares[places], self.mixture, self.between)


@dataclass(frozen=True)
class LightBatch:
    """Modes of the light behind M media, which do not interfere.

    Attributes
    ----------
    shares : float64[M, N]
    modes : tuple of Correlations
        The memory effect of each.
    flat : float64[M]
        Share of modes too weak to show: it comes as an even brightness.
    """

    shares: torch.Tensor
    modes: tuple[Correlations, ...]
    flat: torch.Tensor

    def at(self, places: Places) -> Self:
        """Behind some of the media."""
        some = tuple(mode.at(places) for mode in self.modes)
        return type(self)(self.shares[places], some, self.flat[places])
