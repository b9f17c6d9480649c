"""Transforms and products between a medium's fields and its images, for batches: the object sampler's in torch.

    u_r(v) = FFT of the cells,   spectra = FFT of Re u_r u_q*,   image = camera (object transform x spectra)

Every function takes tensors with a leading axis of samples and returns new ones.
"""

import numpy as np
import torch

from specklegen.datasets.batched.fused import fused
from specklegen.datasets.batched.words import philox
from specklegen.kernels import rng
from specklegen.kernels.waves import fill_waves


def _waves_on_the_cpu(along: torch.Tensor, across: torch.Tensor, gain: torch.Tensor) -> torch.Tensor:
    out = np.empty((*along.shape, across.shape[1], 2), np.float32)
    for arguments in zip(along.contiguous().numpy(), across.contiguous().numpy(), gain.contiguous().numpy(), out,
                         strict=True):  # fmt: skip
        fill_waves(*arguments)
    return torch.from_numpy(out)


@fused(
    "waves(Tensor along, Tensor across, Tensor gain) -> Tensor",
    lambda a, c, g: a.new_empty((*a.shape, c.shape[1], 2), dtype=torch.float32),
    _waves_on_the_cpu,
)
def waves(along: torch.Tensor, across: torch.Tensor, gain: torch.Tensor) -> torch.Tensor:
    """Real and imaginary part of gain e^(2 pi i along across), float32[B, n, m, 2].

    Of along float64[B, n], across and gain float64[B, m].
    """
    turns = along[:, :, None] * across[:, None, :]
    angle = 2 * torch.pi * (turns - torch.round(turns))
    wave = torch.stack([torch.cos(angle), torch.sin(angle)], -1) * gain[:, None, :, None]
    return wave.to(torch.float32)


def _fields_on_the_cpu(
    key: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, envelope: torch.Tensor, rank: int
) -> torch.Tensor:
    fields = np.zeros((len(key), rank, *envelope.shape[1:], 2), np.float32)
    for place, ((k0, k1), ny, nx) in enumerate(zip(key.tolist(), rows.tolist(), columns.tolist(), strict=True)):
        drawn = np.empty((rank * ny * nx, 2), np.float32)
        rng.fill_normals(k0, k1, 0, drawn)
        drawn *= np.float32(0.5**0.5)
        amplitude = envelope[place % len(envelope), :ny, :nx].numpy()
        fields[place, :, :ny, :nx] = drawn.reshape(rank, ny, nx, 2) * amplitude[..., None]
    return torch.from_numpy(fields)


@fused(
    "fields(Tensor key, Tensor rows, Tensor columns, Tensor envelope, int rank) -> Tensor",
    lambda k, r, c, e, rank: e.new_empty((len(k), rank, *e.shape[1:], 2)),
    _fields_on_the_cpu,
)
def fields(
    key: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, envelope: torch.Tensor, rank: int
) -> torch.Tensor:
    """White fields under a window, real and imaginary part: float32[B, rank, y, x, 2].

    Parameters
    ----------
    key : int64[B, 2]
        Keys of the media.
    rows, columns : int64[B]
        Cells of each; what lies beyond them is 0.
    envelope : float32[B or 1, y, x]
        Amplitude of the window.
    rank
        Fields of each.
    """
    height, width = envelope.shape[1:]
    y = torch.arange(height, device=key.device)[:, None]
    x = torch.arange(width, device=key.device)
    r = torch.arange(rank, device=key.device)[:, None, None]
    ny, nx = rows[:, None, None, None], columns[:, None, None, None]
    pair = (r * ny + y) * nx + x
    words = philox(key[:, None, None, None], pair >> 1)
    second = (pair & 1) == 1
    u, v = (torch.where(second, words[n + 2], words[n]).to(torch.float64) * 2.0**-32 + 2.0**-33 for n in (0, 1))
    radius = torch.sqrt(-torch.log(u)) * envelope[:, None] * ((y < ny) & (x < nx))
    angle = 2 * torch.pi * v
    return torch.stack([radius * torch.cos(angle), radius * torch.sin(angle)], -1).to(torch.float32)


@fused(
    "pair_products(Tensor views) -> Tensor",
    lambda v: v.new_empty((len(v), v.shape[1] * (v.shape[1] + 1) // 2, *v.shape[2:4])),
)
def pair_products(views: torch.Tensor) -> torch.Tensor:
    """Re u_r u_q* for r <= q, float32[B, R(R+1)/2, y, x], from real and imaginary parts float32[B, R, y, x, 2]."""
    real, imaginary = views[..., 0], views[..., 1]
    rank = views.shape[1]
    parts = [
        real[:, r : r + 1] * real[:, r:] + imaginary[:, r : r + 1] * imaginary[:, r:] for r in range(rank)
    ]
    return torch.cat(parts, 1)


def spectra(drawn: torch.Tensor, lags: tuple[int, int]) -> torch.Tensor:
    """Lag spectra of the products of fields float32[B, R, y, x, 2]: complex64[B, R(R+1)/2, rows, columns / 2 + 1]."""
    views = torch.fft.ifft2(torch.view_as_complex(drawn), s=lags, norm="forward")
    return torch.fft.rfft2(pair_products(torch.view_as_real(views)), norm="forward")


@fused(
    "mode_maps(Tensor modes, Tensor light) -> Tensor",
    lambda m, o: m.new_empty((*m.shape[:2], m.shape[2] * (m.shape[2] + 1) // 2, m.shape[3])),
)
def mode_maps(modes: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """O phi_r phi_q, twice for r < q: float32[B, T, R(R+1)/2, P], of modes float32[B, T, R, P], light float32[B, P]."""
    rank = modes.shape[2]
    parts = []
    for r in range(rank):
        part = modes[:, :, r : r + 1] * modes[:, :, r:] * light[:, None, None]
        parts.append(torch.cat([part[:, :, :1], 2 * part[:, :, 1:]], 2))
    return torch.cat(parts, 2)


def images(
    spectra: torch.Tensor, modes: torch.Tensor, light: torch.Tensor, transforms: dict[str, torch.Tensor]
) -> torch.Tensor:
    """Images float32[B, T, H, W] of objects seen through media.

    Parameters
    ----------
    spectra : complex64[B, pairs, n, m]
        From :func:`spectra`.
    modes : float32[B, T, R, h * w]
        Modes over the object's pixels, for each base tilt.
    light : float32[B, h, w]
        The objects.
    transforms
        "object_rows" complex64[B or 1, n, h], "object_columns" [B or 1, m, w], "camera_rows" [B or 1, T, H, n],
        "camera_columns" [B or 1, T, m, W].
    """
    count, tilts, _, _ = modes.shape
    maps = mode_maps(modes, light.flatten(1)).to(spectra.dtype)
    if light.shape[1:] == (1, 1):  # a beam: the transform of one pixel on the axis is 1
        found = (maps[..., 0] @ spectra.flatten(2)).unflatten(2, spectra.shape[2:])
    else:
        turned = transforms["object_rows"][:, None, None] @ maps.unflatten(3, light.shape[1:])
        turned = turned @ transforms["object_columns"][:, None, None].mT
        found = (turned * spectra[:, None]).sum(2)
    seen = (transforms["camera_rows"] @ found) @ transforms["camera_columns"]
    assert seen.shape[:2] == (count, tilts)
    return seen.real
