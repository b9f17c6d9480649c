"""The image of an object through one medium as a linear map of its brightness, and the adjoint of that map.

What :meth:`Imaging.images` computes from the lag spectra S_rq of a medium's modes m_r, written so that torch can
differentiate it: with C the transform from lags to the camera and E that from the object to lags,

    y = Re C [ sum_r<=q (2 - delta_rq) S_rq E (m_r m_q x) ] + flat sum(x)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch

from specklegen.synthesis.imaging import Imaging


@dataclass(frozen=True, eq=False)
class ObjectOperator:
    """A linear map from brightness real[..., h, w] to images real[..., T, H, W].

    Attributes
    ----------
    imaging : Imaging
        Of one medium, without an envelope.
    spectra : complex[R(R+1)/2, lag rows, lag columns / 2 + 1]
        Of the medium, in one frame.
    """

    imaging: Imaging
    spectra: torch.Tensor

    @cached_property
    def _maps(self) -> torch.Tensor:
        """Products of two modes, in either order, real[T, R(R+1)/2, h, w]."""
        modes = self.imaging.modes[0]
        r, q = torch.triu_indices(self.imaging.rank, self.imaging.rank, device=modes.device)
        twice = torch.where(r == q, 1.0, 2.0).to(modes.dtype)[:, None]
        return (modes[:, r] * modes[:, q] * twice).reshape(len(modes), len(r), *self.imaging.shape)

    @cached_property
    def _rows(self) -> torch.Tensor:
        """Transform from lags to the camera's rows, complex[T or 1, H, lag rows]."""
        rows, n = self.imaging.camera_rows[0], self.imaging.lags[0]
        if self.imaging.turns is None:
            return rows
        wave = torch.complex(rows[0], -rows[1])
        wave = torch.cat([wave, torch.zeros_like(wave[:, :1]), wave[:, 1:].conj().flip(1)], 1)
        return _either_side(wave, self.imaging.camera[0]) * self._turns[:, None, :n]

    @cached_property
    def _turns(self) -> torch.Tensor:
        """Phasors of beams at the lags along y and x, complex[T or 1, n + m]."""
        assert self.imaging.turns is not None
        turns = torch.view_as_complex(self.imaging.turns[0].contiguous())
        return turns if len(turns) else turns.new_ones((1, turns.shape[1]))

    @cached_property
    def _columns(self) -> torch.Tensor:
        """Transform from lags to the camera's columns, complex[T, lag columns / 2 + 1, W]."""
        columns = self.imaging.camera_columns[0]
        if self.imaging.turns is None:
            return torch.view_as_complex(columns.unflatten(2, (-1, 2)).contiguous()).mH
        wave = _either_side(torch.complex(columns[0], -columns[1]), self.imaging.camera[1])
        return (wave * self._turns[:, None, self.imaging.lags[0] :]).mT

    def image(self, brightness: torch.Tensor) -> torch.Tensor:
        """Images of objects real[..., h, w]: real[..., T, H, W], a pixel's expectation sum(x)."""
        s = self.imaging
        lit = (self._maps * brightness[..., None, None, :, :]).to(self.spectra.dtype)
        spectrum = (s.object_rows[0] @ lit @ s.object_columns[0] * self.spectra).sum(-3)
        even = s.flat[0].to(brightness.dtype) * brightness.sum((-2, -1))
        return (self._rows @ spectrum @ self._columns).real + even[..., None, None, None]

    def adjoint(self, images: torch.Tensor) -> torch.Tensor:
        """The adjoint: real[..., T, H, W] to real[..., h, w], <image(x), y> = <x, adjoint(y)>."""
        s = self.imaging
        spectrum = self._rows.mH @ images.to(self.spectra.dtype) @ self._columns.mH
        lags = spectrum[..., None, :, :] * self.spectra.conj()
        lit = (s.object_rows[0].mH @ lags @ s.object_columns[0].mH).real * self._maps
        even = s.flat[0].to(images.dtype) * images.sum((-3, -2, -1))
        return lit.sum((-4, -3)) + even[..., None, None]


def _either_side(wave: torch.Tensor, count: int) -> torch.Tensor:
    """Waves complex[count, n] at all of ``count`` views, of those at 0 and above: below 0 they are the conjugates."""
    return torch.cat([wave.conj().flip(0)[: count // 2], wave])
