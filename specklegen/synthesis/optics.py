"""Transforms and products between a medium's fields and its images, for batches: the object sampler's in torch.

    u_r(v) = FFT of the cells,   spectra = FFT of Re u_r u_q*,   image = camera (object transform x spectra)

Every function takes tensors with a leading axis of samples and returns new ones.
"""

from typing import Any

import numpy as np
import torch

from specklegen.kernels.camera_folds import fill_folded, fill_unfolded
from specklegen.kernels.mode_pairs import fill_halves, fill_lag_sums, fill_mode_maps, fill_pair_products, turn
from specklegen.kernels.waves import fill_waves
from specklegen.kernels.windows import fill_fields
from specklegen.synthesis.fused import FORMS, fused
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
    keys, windows, drawn = key.contiguous().numpy(), envelope.numpy(), fields.numpy()
    size = zip(rows.tolist(), columns.tolist(), still.tolist(), strict=True)
    for place, (ny, nx, share) in enumerate(size):
        fill_fields(keys[place], sample, share, windows[place % len(windows), :ny, :nx], drawn[place])
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
    first, second = _pairs(views.shape[2], views.device)
    one, two = views[:, :, first], views[:, :, second]
    return (one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1]).sum(1)


def _pairs(rank: int, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
    """Return r and q of all pairs r <= q, int64[R(R+1)/2], row by row: one graph of the compiler for every rank."""
    rows = torch.arange(rank, device=device)
    starts = rows * rank - rows * (rows - 1) // 2
    number = torch.arange(rank * (rank + 1) // 2, device=device)
    first = torch.searchsorted(starts, number, right=True) - 1
    return first, number - starts[first] + first


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
    first, second = _pairs(modes.shape[2], modes.device)
    maps = modes[:, :, first] * modes[:, :, second] * light.flatten(1)[:, None, None]
    maps = maps * torch.where(first == second, 1.0, 2.0).to(maps.dtype)[:, None]
    return maps.unflatten(3, light.shape[1:]).permute(0, 3, 1, 2, 4).contiguous()


def _lags(turned: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    return spectra.new_empty((len(turned), max(turned.shape[2], spectra.shape[1]), *spectra.shape[3:]))


@fused("lag_sum(Tensor turned, Tensor spectra) -> Tensor", _lags)
def lag_sum(turned: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Object transforms times spectra, added up over the pairs: float32[B, T or F, n, m, 2].

    Of float32[B, n, T, pairs, m, 2] and float32[B, F, pairs, n, m, 2], real and imaginary parts. One of T tilts and F
    frames is 1.
    """
    (a, b), (c, d) = turned.permute(0, 2, 3, 1, 4, 5).unbind(-1), spectra.unbind(-1)
    return torch.stack([(a * c - b * d).sum(2), (a * d + b * c).sum(2)], -1)


_BLOCK_BYTES = 2**22
"""Of transforms of an object's maps that are made at once on the CPU."""


def _map_lags_on_the_cpu(
    maps: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, spectra: torch.Tensor
) -> torch.Tensor:
    """The four parts of the maps about their middle, even or odd along either axis, have real transforms."""
    out = _map_lags(maps, rows, columns, spectra)
    (height, tilts, pairs, width), (count, m) = maps.shape[1:], spectra.shape[3:5]
    half, y, x = count // 2, height // 2 + 1, width // 2 + 1
    together = max(1, _BLOCK_BYTES // (4 * tilts * pairs * m * maps.element_size()))
    halves, down, across = (maps.new_empty(s) for s in ((2, 2, y, tilts * pairs, x), (2, half, y), (2, x, m)))
    out[:, :, half] = 0  # a lag beyond the window
    for n, lags in enumerate(torch.view_as_complex(out).numpy()):
        waves = rows[n % len(rows)].numpy(), columns[n % len(columns)].numpy()
        fill_halves(maps[n].flatten(1, 2).numpy(), *waves, halves.numpy(), down.numpy(), across.numpy())
        flat = torch.bmm(halves.view(2, -1, x), across).view(2, 2, y, -1).movedim(0, 2).reshape(2, y, -1)
        for first in range(0, half, together):
            turned = torch.bmm(down[:, first : first + together], flat).view(2, -1, 2, tilts, pairs, m)
            fill_lag_sums(turned.numpy(), torch.view_as_complex(spectra[n]).numpy(), first, lags)
        turn(waves[0][:, height // 2], waves[1][width // 2], lags)
    return out


def _map_lags(maps: torch.Tensor, _rows: torch.Tensor, _columns: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    return spectra.new_empty((len(maps), max(maps.shape[2], spectra.shape[1]), *spectra.shape[3:]))


@fused("map_lags(Tensor maps, Tensor rows, Tensor columns, Tensor spectra) -> Tensor", _map_lags, _map_lags_on_the_cpu)
def map_lags(maps: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, spectra: torch.Tensor) -> torch.Tensor:
    """Transforms of maps of an object times spectra, added up over the maps: float32[B, T or F, n, m, 2].

    Parameters
    ----------
    maps : float32[B, h, T, pairs, w]
        Of each tilt; see :func:`mode_maps`.
    rows, columns : complex64[B or 1, n, h], complex64[B or 1, w, m]
        Waves of the object's pixels at the lags; rows of lags of either sign are conjugates of each other.
    spectra : float32[B, F, pairs, n, m, 2]
        Real and imaginary parts; one of T and F is 1. Of the lag n / 2 along y, beyond the window, nothing is taken.
    """
    sums = FORMS["lag_sum"](_turned(maps, rows, columns), spectra)
    beyond = torch.arange(sums.shape[2], device=sums.device)[:, None, None] == sums.shape[2] // 2
    return sums.masked_fill(beyond, 0.0)


def _turned(maps: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor) -> torch.Tensor:
    count, height, tilts, pairs, _ = maps.shape
    turned = _product(maps.flatten(1, 3), torch.view_as_real(columns).flatten(2)).view(count, height, -1, 2)
    turned = torch.view_as_real(_product(rows, torch.view_as_complex(turned)))
    return turned.view(count, -1, tilts, pairs, columns.shape[2], 2)


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
        "object_rows" complex64[B or 1, n, h], "object_columns" [B or 1, w, m], neither of one beam on the axis, and
        those of :func:`seen`.
    """
    maps = mode_maps(modes, light)
    parts = torch.view_as_real(spectra)
    if "object_rows" not in transforms:  # a beam: the transform of one pixel on the axis is 1
        sums = (maps[:, :1, :, :, 0] @ parts.flatten(3)).flatten(1, 2).unflatten(2, parts.shape[3:])
    elif light.device.type == "cpu":
        sums = map_lags(maps, transforms["object_rows"], transforms["object_columns"], parts)
    else:
        sums = lag_sum(_turned(maps, transforms["object_rows"], transforms["object_columns"]), parts)
    return seen(sums, transforms)


def seen(spectrum: torch.Tensor, transforms: dict[str, torch.Tensor]) -> torch.Tensor:
    """Images real[B, T or F, H, W] at the camera, of spectra real[B, T or F, n, m, 2] at the lags.

    Of "camera_rows" complex64[B, T, H, n] and "camera_columns" float32[B, T, W, 2 m]. The latter are real and imaginary
    parts of the conjugate: only the real part of the product is wanted. On the CPU they are cosines and sines of half
    of the views, float32[B, 2, y, n / 2] and [B, 2, x, m]. With them come "camera", (H, W), and phasors of beams,
    "turns" float32[B, T, n + m, 2], none along T where all are 1. All may be one for all samples.
    """
    rows, columns = transforms["camera_rows"], transforms["camera_columns"]
    if "turns" in transforms:
        return half_seen(spectrum, rows, columns, transforms["turns"], [*transforms["camera"]])
    seen = torch.view_as_real(rows @ torch.view_as_complex(spectrum)).flatten(3)
    return seen @ columns.mT


def _seen_on_the_cpu(
    spectrum: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, turns: torch.Tensor, camera: list[int]
) -> torch.Tensor:
    out = _seen(spectrum, rows, columns, turns, camera)
    count, n, m = spectrum.shape[1:4]
    folded = spectrum.new_empty((2, n // 2, count, 2, m))
    for place, (own, image) in enumerate(zip(spectrum.contiguous().numpy(), out.numpy(), strict=True)):
        turn = turns[place % len(turns)].numpy()
        fill_folded(own, turn[:, :n], turn[:, n:], folded.numpy())
        along = torch.bmm(rows[place % len(rows)], folded.view(2, n // 2, -1)).view(-1, 2, m).transpose(0, 1)
        parts = torch.bmm(along, columns[place % len(columns)].mT)
        fill_unfolded(parts.view(2, 2, -1, count, parts.shape[-1]).numpy(), image)
    return out


def _seen(spectrum: torch.Tensor, *transforms: Any) -> torch.Tensor:
    return spectrum.new_empty((*spectrum.shape[:2], *transforms[-1]))


@fused(
    "half_seen(Tensor spectrum, Tensor rows, Tensor columns, Tensor turns, int[] camera) -> Tensor",
    _seen, _seen_on_the_cpu,
)  # fmt: skip
def half_seen(
    spectrum: torch.Tensor, rows: torch.Tensor, columns: torch.Tensor, turns: torch.Tensor, camera: list[int]
) -> torch.Tensor:
    """Images real[B, P, H, W] by the transforms of one quarter of the camera: see :func:`seen`, and camera_folds."""
    (height, width), count, (n, m) = camera, spectrum.shape[1], spectrum.shape[2:4]
    if turns.shape[1]:
        turn = torch.view_as_complex(turns.contiguous())
        wave = turn[:, :, :n, None] * turn[:, :, None, n:]
        spectrum = torch.view_as_real(torch.view_as_complex(spectrum.contiguous()) * wave)
    up = spectrum[:, :, : n // 2]
    down = torch.cat([torch.zeros_like(up[:, :, :1]), spectrum[:, :, n // 2 + 1 :].flip(2)], 2)
    sums = torch.stack([up + down, (up - down).flip(-1)], 1).permute(0, 1, 3, 2, 5, 4)  # [B, 2, n / 2, P, 2, m]
    along = (rows @ sums.flatten(3)).unflatten(3, (count, 2, m)).movedim(4, 1)  # [B, 2, 2, y, P, m]
    (p, q), (r, t) = ((own @ half.mT[:, None, None]).movedim(-2, 2).unbind(1)
                      for own, half in zip(along.unbind(1), columns.unbind(1), strict=True))  # fmt: skip
    # Views at 0, or half a pixel beside it, and above stand last: those below are in front, without 0 once more.
    even, odd = (torch.cat([minus.flip(2)[:, :, : height // 2], plus], 2) for minus, plus in
                 ((p - q, p + q), (r + t, r - t)))  # fmt: skip
    return torch.cat([(even - odd).flip(3)[..., : width // 2], even + odd], 3)


def _product(one: torch.Tensor, two: torch.Tensor) -> torch.Tensor:
    """Matrices [B or 1, ...] times matrices; one that all share is not copied for each."""
    if len(two) == 1 and len(one) > 1:
        return (one.flatten(0, 1) @ two[0]).unflatten(0, one.shape[:2])
    return one @ two
