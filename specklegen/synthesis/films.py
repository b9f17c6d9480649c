"""Films of media that move: what makes of independent fields, frame by frame, those of all modes in all frames.

    <a_fr a_f'r'*> = M(x_ff')_rr',     phi M(x) phi^T = K(., x) over the beams

phi are the modes of the memory effect at rest, in which M(0) = 1. Between two frames M is no multiple of the identity:
modes that beams far apart need come from paths that scatter often, and are forgotten first. K(q, x) is the sum over all
paths, each with its own momentum transfer, so that fields, not intensities, add up over them, and nothing but x enters.
The root is lower triangular by frames: those that come later change none before, and the first is that of the medium
at rest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from specklegen.core.errors import counted
from specklegen.core.lazy import torch
from specklegen.core.memory import require_memory

if TYPE_CHECKING:
    from specklegen.synthesis.correlations import FilmBatch
    from specklegen.synthesis.modes import Modes

_JITTER = 1e-10  # of every mode's power, new in each frame: far above rounding, 1e-5 of an amplitude


def film_root(modes: Modes, rank: int, film: FilmBatch) -> torch.Tensor:
    """Root float64[M, F rank, F rank], frame after frame, of the covariance of ``rank`` modes of M media."""
    frames = len(film.between)
    require_memory(
        "Dynamics.frames", "held", 8 * 4 * (frames * rank) ** 2, f"{frames} frames of {counted(rank, 'mode')}",
        "Use fewer frames, or a larger mode_tolerance.",
    )  # fmt: skip
    if modes.lattice.size == 1:  # of one beam K(0, x) alone is asked
        first, *later = film.shares.sum(-1)[..., None, None].unbind(1)
    else:
        first, *later = (modes.covariance(rank, lag) for lag in film.lags)
    one = torch.eye(rank, dtype=first.dtype, device=first.device)
    # Least squares leave M(0) a little off 1, and columns beyond a medium's own rank at 0: those are fields of nothing.
    unused = (modes.columns[:, :, :rank].square().sum(1) == 0)[..., None] * one
    root = torch.linalg.cholesky_ex(first + unused)[0]
    blocks = [torch.linalg.solve_triangular(root, each, upper=False) for each in later]
    blocks = [torch.linalg.solve_triangular(root, each.mT, upper=False) for each in blocks]
    known = torch.stack([one.expand_as(first), *blocks], 1)
    between = torch.from_numpy(film.between).to(first.device)
    whole = known[:, between.flatten()].unflatten(1, between.shape).transpose(2, 3).flatten(3).flatten(1, 2)
    jitter = _JITTER * torch.eye(whole.shape[-1], dtype=whole.dtype, device=whole.device)
    return torch.linalg.cholesky_ex(whole + jitter)[0]


def filmed(root: torch.Tensor, white: torch.Tensor) -> torch.Tensor:
    """Fields real[B, F, R, ...] of all frames, of independent ones of this shape and roots real[B or 1, F R, F R]."""
    frames, rank = white.shape[1:3]
    flat = white.flatten(3).flatten(1, 2)
    # Frame by frame, each a product whose shape does not know of those that follow: they change no bit of it.
    drawn = [root[:, f * rank : (f + 1) * rank, : (f + 1) * rank] @ flat[:, : (f + 1) * rank] for f in range(frames)]
    return torch.stack(drawn, 1).view_as(white)
