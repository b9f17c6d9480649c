"""Transforms and products between a medium's fields and its images, for batches: the object sampler's in torch.

    u_r(v) = FFT of the cells,   spectra = FFT of Re u_r u_q*,   image = camera (object transform x spectra)

Every function takes tensors with a leading axis of samples and returns new ones.
"""

import numpy as np
import torch

from specklegen.kernels import rng
from specklegen.kernels.mode_pairs import fill_lag_sums, fill_mode_maps, fill_pair_products
from specklegen.kernels.waves import fill_waves
from specklegen.synthesis.fused import fused
from specklegen.synthesis.gaussian_noise import philox


def _real(precise: bool) -> torch.dtype:
    return torch.float64 if precise else torch.float32


def _waves_on_the_cpu(along: torch.Tensor, across: torch.Tensor, gain: torch.Tensor, precise: bool) -> torch.Tensor:
    out = np.empty((*along.shape, across.shape[1], 2), np.float64 if precise else np.float32)
    for arguments in zip(along.contiguous().numpy(), across.contiguous().numpy(), gain.contiguous().numpy(), out,
                         strict=True):  # fmt: skip
        fill_waves(*arguments)
    return torch.from_numpy(out)


@fused(
    "waves(Tensor along, Tensor across, Tensor gain, bool precise) -> Tensor",
    lambda a, c, g, precise: a.new_empty((*a.shape, c.shape[1], 2), dtype=_real(precise)),
    _waves_on_the_cpu,
)
def waves(along: torch.Tensor, across: torch.Tensor, gain: torch.Tensor, precise: bool) -> torch.Tensor:
    """Real and imaginary part of gain e^(2 pi i along across), float32[B, n, m, 2], or float64 where ``precise``.

    Of along float64[B, n], across and gain float64[B, m].
    """
    turns = along[:, :, None] * across[:, None, :]
    angle = 2 * torch.pi * (turns - torch.round(turns))
    wave = torch.stack([torch.cos(angle), torch.sin(angle)], -1) * gain[:, None, :, None]
    return wave.to(_real(precise))


def _fields_on_the_cpu(
    key: torch.Tensor, sample: int, still: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor,
    envelope: torch.Tensor, rank: int, grid: list[int],
) -> torch.Tensor:  # fmt: skip
    fields = envelope.new_zeros((*key.shape[:2], rank, *grid, 2))
    size = zip(rows.tolist(), columns.tolist(), still.tolist(), strict=True)
    for place, (film, (ny, nx, share)) in enumerate(zip(key.tolist(), size, strict=True)):
        amplitude = envelope[place % len(envelope), :ny, :nx, None].numpy() * 0.5**0.5
        drawn, before = np.empty((rank * ny * nx, 2), amplitude.dtype), None
        for frame, (k0, k1) in enumerate(film):
            rng.fill_normals(k0, k1, sample, drawn)
            now = fields[place, frame, :, :ny, :nx].numpy()
            np.multiply(drawn.reshape(rank, ny, nx, 2), amplitude, out=now)
            if before is not None:
                now *= (1 - share**2) ** 0.5
                now += share * before
            before = now
    return fields


@fused(
    "fields(Tensor key, int sample, Tensor still, Tensor rows, Tensor columns, Tensor envelope, int rank, int[] grid)"
    " -> Tensor",
    lambda k, n, s, r, c, e, rank, grid: e.new_empty((*k.shape[:2], rank, *grid, 2)),
    _fields_on_the_cpu,
)
def fields(
    key: torch.Tensor, sample: int, still: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor,
    envelope: torch.Tensor, rank: int, grid: list[int],
) -> torch.Tensor:  # fmt: skip
    """White fields under a window, frame after frame, on the grid of their transform: real[B, F, rank, *grid, 2].

    Their real and imaginary parts, of the envelope's precision. From frame to frame they follow a first-order
    autoregression.

    Parameters
    ----------
    key : int64[B, F, 2]
        Keys of the frames of each medium.
    sample
        Number of the realization under those keys.
    still : float64[B]
        Correlation of one frame with the next.
    rows, columns : int64[B]
        Cells of each; what lies beyond them is 0.
    envelope : real[B or 1, y, x]
        Amplitude of the window.
    rank
        Fields of each.
    grid
        Rows and columns, no fewer than the window's.
    """
    (height, width), (down, across) = envelope.shape[1:], grid
    y = torch.arange(down, device=key.device)[:, None]
    x = torch.arange(across, device=key.device)
    r = torch.arange(rank, device=key.device)[:, None, None]
    ny, nx = rows[:, None, None, None], columns[:, None, None, None]
    pair = (r * ny + y) * nx + x
    second = (pair & 1) == 1
    amplitude = envelope[:, y.clamp(max=height - 1), x.clamp(max=width - 1)]
    amplitude = (amplitude[:, None] * ((y < ny) & (x < nx)))[..., None]
    share = still[:, None, None, None, None]
    frames: list[torch.Tensor] = []
    for frame in range(key.shape[1]):
        words = philox(key[:, frame, None, None, None], pair >> 1, sample)
        u, v = (torch.where(second, words[n + 2], words[n]).to(torch.float64) * 2.0**-32 + 2.0**-33 for n in (0, 1))
        angle, radius = 2 * torch.pi * v, torch.sqrt(-torch.log(u))
        white = torch.stack([radius * torch.cos(angle), radius * torch.sin(angle)], -1) * amplitude
        frames.append(share * frames[-1] + torch.sqrt(1 - share.square()) * white if frames else white)
    return torch.stack(frames, 1).to(envelope.dtype)


def _pairs_on_the_cpu(views: torch.Tensor) -> torch.Tensor:
    rank = views.shape[2]
    pairs = views.new_empty((len(views), rank * (rank + 1) // 2, *views.shape[3:5]))
    for medium, products in zip(views.contiguous().numpy(), pairs.numpy(), strict=True):
        fill_pair_products(medium, products)
    return pairs


@fused(
    "pair_products(Tensor views) -> Tensor",
    lambda v: v.new_empty((len(v), v.shape[2] * (v.shape[2] + 1) // 2, *v.shape[3:5])),
    _pairs_on_the_cpu,
)
def pair_products(views: torch.Tensor) -> torch.Tensor:
    """Re u_r u_q* for r <= q, added up over draws of light: float32[B, R(R+1)/2, y, x].

    Of real and imaginary parts float32[B, draws, R, y, x, 2].
    """
    real, imaginary = views[..., 0], views[..., 1]
    rank = views.shape[2]
    parts = [
        (real[:, :, r : r + 1] * real[:, :, r:] + imaginary[:, :, r : r + 1] * imaginary[:, :, r:]).sum(1)
        for r in range(rank)
    ]
    return torch.cat(parts, 1)


def _maps_on_the_cpu(modes: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    maps = _maps(modes, light)
    for arguments in zip(modes.contiguous().numpy(), light.contiguous().numpy(), maps.numpy(), strict=True):
        fill_mode_maps(*arguments)
    return maps


def _maps(modes: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    count, tilts, rank, _ = modes.shape
    return modes.new_empty((count, light.shape[1], tilts, rank * (rank + 1) // 2, light.shape[2]))


@fused("mode_maps(Tensor modes, Tensor light) -> Tensor", _maps, _maps_on_the_cpu)
def mode_maps(modes: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    """O phi_r phi_q, twice for r < q: float32[B, h, T, R(R+1)/2, w], of modes float32[B, T, R, h w], light [B, h, w].

    The rows come first, so that the transforms of all pairs are one product along either axis.
    """
    rank = modes.shape[2]
    parts = []
    for r in range(rank):
        part = modes[:, :, r : r + 1] * modes[:, :, r:] * light.flatten(1)[:, None, None]
        parts.append(torch.cat([part[:, :, :1], 2 * part[:, :, 1:]], 2))
    return torch.cat(parts, 2).unflatten(3, light.shape[1:]).permute(0, 3, 1, 2, 4).contiguous()


def _lags_on_the_cpu(turned: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    lags = _lags(turned, spectra)
    factors = (torch.view_as_complex(each.contiguous()).numpy() for each in (turned, spectra, lags))
    for arguments in zip(*factors, strict=True):
        fill_lag_sums(*arguments)
    return lags


def _lags(turned: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    return spectra.new_empty((len(turned), max(turned.shape[2], spectra.shape[1]), *spectra.shape[3:]))


@fused("lag_sum(Tensor turned, Tensor spectra) -> Tensor", _lags, _lags_on_the_cpu)
def lag_sum(turned: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Object transforms times spectra, added up over the pairs: float32[B, T or F, n, m, 2].

    Of float32[B, n, T, pairs, m, 2] and float32[B, F, pairs, n, m, 2], real and imaginary parts. One of T tilts and F
    frames is 1.
    """
    (a, b), (c, d) = turned.permute(0, 2, 3, 1, 4, 5).unbind(-1), spectra.unbind(-1)
    return torch.stack([(a * c - b * d).sum(2), (a * d + b * c).sum(2)], -1)


def images(
    spectra: torch.Tensor, modes: torch.Tensor, light: torch.Tensor, transforms: dict[str, torch.Tensor]
) -> torch.Tensor:
    """Images float32[B, T or F, H, W] of objects seen through media, under T tilts or in F frames.

    Parameters
    ----------
    spectra : complex64[B, F, pairs, n, m]
        From :func:`spectra`.
    modes : float32[B, T, R, h * w]
        Modes over the object's pixels, for each base tilt.
    light : float32[B, h, w]
        The objects.
    transforms
        "object_rows" complex64[B or 1, n, h], "object_columns" [B or 1, w, m], "camera_rows" [B or 1, T, H, n]; and
        "camera_columns" float32[B or 1, T, W, 2 m], real and imaginary parts of the conjugate, of whose product only
        the real part is wanted.
    """
    maps = mode_maps(modes, light)
    parts = torch.view_as_real(spectra)
    if light.shape[1:] == (1, 1):  # a beam: the transform of one pixel on the axis is 1
        sums = (maps[:, :1, :, :, 0] @ parts.flatten(3)).flatten(1, 2).unflatten(2, parts.shape[3:])
    else:
        count, height, tilts, pairs, _ = maps.shape
        columns = torch.view_as_real(transforms["object_columns"]).flatten(2)
        turned = _product(maps.flatten(1, 3), columns).view(count, height, -1, 2)
        turned = torch.view_as_real(_product(transforms["object_rows"], torch.view_as_complex(turned)))
        sums = lag_sum(turned.view(count, -1, tilts, pairs, *parts.shape[4:]), parts)
    return seen(sums, transforms)


def seen(spectrum: torch.Tensor, transforms: dict[str, torch.Tensor]) -> torch.Tensor:
    """Images real[B, T or F, H, W] at the camera, of spectra real[B, T or F, n, m, 2] at the lags."""
    rows = torch.view_as_real(transforms["camera_rows"] @ torch.view_as_complex(spectrum)).flatten(3)
    return rows @ transforms["camera_columns"].mT


def _product(one: torch.Tensor, two: torch.Tensor) -> torch.Tensor:
    """Matrices [B or 1, ...] times matrices; one that all share is not copied for each."""
    if len(two) == 1 and len(one) > 1:
        return (one.flatten(0, 1) @ two[0]).unflatten(0, one.shape[:2])
    return one @ two
