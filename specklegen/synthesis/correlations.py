"""The memory-effect correlation K of a batch of media, wherever it comes from: here the ways of media part.

What follows (modes, fields, images) asks for nothing but K at lateral wavevector differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from specklegen.core.lazy import torch

if TYPE_CHECKING:
    Places = torch.Tensor | slice | list[int]
else:
    Places = Any

_AT_ONCE = 2**14  # distances at which K is asked together


class Correlations(Protocol):
    """K of M media."""

    @property
    def isotropic(self) -> bool:
        """True if K of all depends on |q| alone; else they have ``planar``."""
        ...

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n] at lateral wavevector differences float64[M, n]; 1 where there is no light."""
        ...

    def planar(self, qx: torch.Tensor, qy: torch.Tensor) -> torch.Tensor:
        """K float64[M, ...] at lateral wavevector differences float64[M, ...], along x and y."""
        ...

    def on_grid(self, dx: torch.Tensor, dy: torch.Tensor) -> torch.Tensor:
        """K float64[k, ny, nx] of one medium at all differences along x float64[k, nx] and y float64[k, ny]."""
        ...

    def at(self, places: Places) -> Self:
        """Return the correlations of some of the media."""
        ...

    def __len__(self) -> int:
        """Number of media, M."""
        ...


def by_distance(
    correlations: Callable[[torch.Tensor], torch.Tensor], dx: torch.Tensor, dy: torch.Tensor
) -> torch.Tensor:
    """K float64[k, ny, nx] of one medium, isotropic, on grids: each distance is asked once.

    K takes the time there.
    """
    distance = torch.hypot(dy[:, :, None], dx[:, None, :])
    found = torch.empty_like(distance)
    at_once = max(1, _AT_ONCE // distance[0].numel())  # few calls of small grids; sorting many takes longer than K
    for some, own in zip(found.split(at_once), distance.split(at_once), strict=True):
        unique, same = torch.unique(own, return_inverse=True)  # of many pairs of pixels it is the same again
        some.copy_(correlations(unique[None])[0][same])
    return found


@dataclass(frozen=True)
class Tabulated:
    """K found on the host, medium by medium, and copied to where it is asked for.

    Attributes
    ----------
    correlations : sequence
        One of each medium, such as :class:`MemoryEffectCorrelation`: K at wavevector differences of any shape,
        ``weights`` (all 0 where there is no light) and ``isotropic``; if it is not, it has ``planar`` instead. A sum
        of products of functions of either axis may have ``on_grid`` besides, of x float64[k, nx], y float64[k, ny].
    """

    correlations: Sequence[Any]

    @property
    def isotropic(self) -> bool:
        """True if K of all depends on |q| alone."""
        return all(k.isotropic for k in self.correlations)

    def planar(self, qx: torch.Tensor, qy: torch.Tensor) -> torch.Tensor:
        """K float64[M, ...]."""
        lengths = torch.hypot(qx, qy)
        if self.isotropic or qx.device.type == "meta":
            return self(lengths.flatten(1)).view_as(lengths)
        along, across, rows = qx.cpu().numpy(), qy.cpu().numpy(), []
        for n, k in enumerate(self.correlations):
            if not k.weights.any():
                rows.append(np.ones(along[n].shape))
            else:
                rows.append(k(np.hypot(along[n], across[n])) if k.isotropic else k.planar(along[n], across[n]))
        return torch.from_numpy(np.stack(rows)).to(qx.device)

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n]."""
        if q.device.type == "meta":
            return torch.empty_like(q)
        asked = q.cpu().numpy()
        rows = [
            k(row) if k.weights.any() else np.ones_like(row) for k, row in zip(self.correlations, asked, strict=True)
        ]
        return torch.from_numpy(np.stack(rows)).to(q.device)

    def on_grid(self, dx: torch.Tensor, dy: torch.Tensor) -> torch.Tensor:
        """K float64[k, ny, nx] of the one medium at all differences along x float64[k, nx] and y float64[k, ny]."""
        (one,) = self.correlations
        separable = getattr(one, "on_grid", None)
        if separable is None or not one.weights.any():
            return by_distance(self, dx, dy)
        return torch.from_numpy(separable(dx.numpy(), dy.numpy()))

    def at(self, places: Places) -> Tabulated:
        """Return the correlations of some of the media."""
        numbers = np.arange(len(self.correlations))[places if isinstance(places, slice) else np.asarray(places)]
        return Tabulated([self.correlations[n] for n in numbers])

    def __len__(self) -> int:
        return len(self.correlations)


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

    @property
    def isotropic(self) -> bool:
        """True: they are functions of |q|."""
        return True

    def planar(self, qx: torch.Tensor, qy: torch.Tensor) -> torch.Tensor:
        """K float64[M, ...]."""
        lengths = torch.hypot(qx, qy)
        return self(lengths.flatten(1)).view_as(lengths)

    def __call__(self, q: torch.Tensor) -> torch.Tensor:
        """K float64[M, n]."""
        return self.mixture(q, self.radius, self.share)

    def on_grid(self, dx: torch.Tensor, dy: torch.Tensor) -> torch.Tensor:
        """K float64[k, ny, nx] of the one medium."""
        return by_distance(self, dx, dy)

    def at(self, places: Places) -> Mixtures:
        """Return the correlations of some of the media."""
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
        """Return the light of some of the media."""
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
