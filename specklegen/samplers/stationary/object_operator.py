"""The image of an object through one medium as a linear map of its brightness, and the adjoint of that map.

What :meth:`ObjectSampler.images` computes from the lag spectra S_rq of a medium's modes m_r, written so that torch can
differentiate it: with C the transform from lags to the camera and E that from the object to lags,

    y = Re C [ sum_r<=q (2 - delta_rq) S_rq E (m_r m_q x) ] + flat mean sum(x)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from specklegen.core.lazy import LazyModule
from specklegen.samplers.stationary.objects import ObjectSampler

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


@dataclass(frozen=True, eq=False)
class ObjectOperator:
    """A linear map from brightness real[..., h, w] to images real[..., T, H, W]. Made by :func:`object_operator`.

    Attributes
    ----------
    sampler : ObjectSampler
    spectra : complex[R(R+1)/2, lag rows, lag columns / 2 + 1]
        Of the medium.
    """

    sampler: ObjectSampler
    spectra: torch.Tensor

    @cached_property
    def _maps(self) -> torch.Tensor:
        """Products of two modes, in either order, real[T, R(R+1)/2, h, w]."""
        modes = self.sampler.modes
        r, q = torch.triu_indices(self.sampler.rank, self.sampler.rank, device=modes.device)
        twice = torch.where(r == q, 1.0, 2.0).to(modes.dtype)[:, None]
        return (modes[:, r] * modes[:, q] * twice).reshape(len(modes), len(r), *self.sampler.shape)

    def image(self, brightness: torch.Tensor) -> torch.Tensor:
        """Images of objects real[..., h, w]: real[..., T, H, W], a pixel's expectation ``sampler.mean`` sum(x)."""
        s = self.sampler
        lit = (self._maps * brightness[..., None, None, :, :]).to(self.spectra.dtype)
        spectrum = (s.object_rows @ lit @ s.object_columns.T * self.spectra).sum(-3)
        even = s.flat * s.mean * brightness.sum((-2, -1))
        return (s.camera_rows @ spectrum @ s.camera_columns).real + even[..., None, None, None]

    def adjoint(self, images: torch.Tensor) -> torch.Tensor:
        """The adjoint: real[..., T, H, W] to real[..., h, w], <image(x), y> = <x, adjoint(y)>."""
        s = self.sampler
        spectrum = s.camera_rows.mH @ images.to(self.spectra.dtype) @ s.camera_columns.mH
        lags = spectrum[..., None, :, :] * self.spectra.conj()
        lit = (s.object_rows.mH @ lags @ s.object_columns.conj()).real * self._maps
        even = s.flat * s.mean * images.sum((-3, -2, -1))
        return lit.sum((-4, -3)) + even[..., None, None]


def object_operator(sampler: ObjectSampler, medium: torch.Tensor) -> ObjectOperator:
    """The map of one medium, given as its fields or as its spectra."""
    fields = medium.shape[-2:] == sampler.envelope.shape
    return ObjectOperator(sampler, sampler.spectra(medium) if fields else medium)
