"""Images of hidden incoherent objects through wide slabs, by Karhunen-Loeve modes of the memory effect, in batches.

Object pixel j sends a beam i_j; its speckle is u_j(v) = sum_x e^(-ik(v - i_j) . x) sum_r phi_r(j) G_r(x),
where K(i_j - i_l) = sum_r phi_r(j) phi_r(l) over the pixels and the G_r are independent white fields under
the window. The image I(v) = sum_j O_j |u_j(v)|^2 has the Fourier coefficient at the lag s between cells

    I(s) = sum_rq  [G_r * G_q](s)  sum_j O_j phi_r(j) phi_q(j) e^(ik i_j . s)

Three forms, the cheapest chosen: "pairs" takes the R(R+1)/2 products of modes through one FFT each, which a
medium needs once for all its objects; "points" sums |u_j|^2 over the bright pixels; "nodes" (:mod:`nodes`) takes a few
of those, which tell the others. All end in the same transform from lags to camera pixels, exact for any camera pitch; a
pixel's area enters it as a sinc.

The object may be seen under several base tilts b_t, added to all its beams: the modes are then those of
all beams i_j + b_t. A stack of tilted beams is an object of one pixel. Light of several modes
(:mod:`spectrum`) adds up over independent fields, in a medium's spectra already. Beams that interfere add up as
fields: with amplitudes a_j,

    u(v) = sum_x e^(-ik v . x) sum_r G_r(x) L_r(x),   L_r(x) = sum_j a_j phi_r(j) e^(ik i_j . x),

and the intensity has the mean sum_x b(x)^2 sum_r |L_r(x)|^2 over media, the same at every view.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np
import torch

from specklegen.core.budgets import require_time
from specklegen.core.errors import counted, reject
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import seconds
from specklegen.kernels.bright_pairs import fill_extent
from specklegen.kernels.bright_points import add_power, fill_tilt_powers, fill_turned
from specklegen.synthesis import optics
from specklegen.synthesis.contrast import speckle_contrast, speckle_variance, window_powers
from specklegen.synthesis.correlations import Correlations, FilmBatch, LightBatch, Places
from specklegen.synthesis.exit_grid import disc_power
from specklegen.synthesis.films import film_root, filmed
from specklegen.synthesis.modes import Modes, by_kernels, karhunen_loeve, memory, one_by_one, polynomial_bytes
from specklegen.synthesis.nodes import Nodes, node_spectrum, nodes_of
from specklegen.synthesis.sight import Sight, centred, lags_between
from specklegen.synthesis.streams import Streams

Box = tuple[slice, slice]
WHOLE: Box = (slice(None), slice(None))
BUCKETS = (1, 2, 3, 4, 6, 8, 11, 16, 22, 28)
"""Numbers of modes that media on a device are rendered with, so that few shapes occur."""
_CHUNK = 32  # bright pixels whose fields are made at once ...
_MOST_VALUES = 2**25  # ... of so many lags together
_MOST_BYTES = 2**27  # of spectra: pairs of very many modes would not fit into memory
_LARGE = 2**25  # bytes of transforms of pairs, beyond which their memory is new each time: twice as slow


@dataclass(frozen=True)
class Imaging:
    """Draws media and images objects through them: M media of one rank R on one grid of lags. See :func:`imagings`.

    Attributes
    ----------
    modes : real[M, T, R, h * w]
        Karhunen-Loeve modes over the object's pixels, for each base tilt.
    mixing : complex[M, N, R, R] or None
        Root of each light mode's share, times what turns the modes of K into its own; None of one mode.
    flat : float64[M]
        Share of the light that comes as an even brightness; of one mode of light 0, ``even`` False.
    cells : int64[M, 2]
        Cells of the exit plane along (y, x).
    size : float64[M, 2]
        Their distances.
    envelope : real[M, y, x]
        Window b(x), its squares of sum 1.
    object_rows, object_columns : complex[M, n, h], complex[M, w, m]
        Transforms e^(ik i_j . s) of object pixels at the lags, of which n x m are distinguished.
    camera_rows, camera_columns : complex[M, T, H, n], real[M, T, W, 2 m]
        Transform from lags to camera pixels; on the CPU half of either. See :func:`optics.seen`.
    variance : float64[M, h, w] or float64[M, 2h - 1, 2w - 1]
        Covariance of the images of two object pixels at one camera pixel, over the square of their mean, by the
        difference (row, column) between them; of a memory effect that is not round by that of either sign.
    lags : (int, int)
        Size of the lag grid.
    shape : (h, w)
        Of the object.
    camera : (H, W)
        Pixels.
    turns : real[M, T or 0, n + m, 2] or None
        On the CPU, phasors of the base tilts at the lags along y and x; 0 of them where all are 1.
    gains, polynomials : real[M, T, P, H, W], real[P, h, w], or None
        Where light stays about its beam: the envelope of a beam at each view, as a sum of products of a map of the
        camera and one of the object.
    merged : bool
        Whether an image is made once, and multiplied by the object's mean envelope at each view; else once for each
        product.
    film : real[M, F R, F R] or None
        Of media that move: root of the covariance of all modes in all frames; see :mod:`films`.
    """

    modes: torch.Tensor
    mixing: torch.Tensor | None
    flat: torch.Tensor
    cells: torch.Tensor
    size: torch.Tensor
    envelope: torch.Tensor
    object_rows: torch.Tensor
    object_columns: torch.Tensor
    camera_rows: torch.Tensor
    camera_columns: torch.Tensor
    variance: torch.Tensor
    lags: tuple[int, int]
    shape: tuple[int, int]
    camera: tuple[int, int]
    turns: torch.Tensor | None = None
    even: bool = True
    gains: torch.Tensor | None = None
    polynomials: torch.Tensor | None = None
    merged: bool = False
    film: torch.Tensor | None = None

    def __len__(self) -> int:
        return len(self.modes)

    def at(self, places: Places) -> "Imaging":
        """Some of the media; one that all share stays as it is."""
        if len(self) == 1:
            return self
        return self.of({name: value[places] for name, value in self.tensors().items()})

    def tensors(self) -> dict[str, torch.Tensor]:
        """All that has a row for each medium, by name."""
        own = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "polynomials"}
        return {name: value for name, value in own.items() if isinstance(value, torch.Tensor)}

    def of(self, tensors: dict[str, torch.Tensor]) -> "Imaging":
        """Replace the media; see :meth:`tensors`."""
        return replace(self, **tensors) if tensors else self

    @property
    def statics(self) -> tuple:
        """All that has none."""
        kinds = self.mixing is None, self.polynomials is None, self.film is None
        return self.lags, self.shape, *kinds, self.merged, self.even

    @property
    def rank(self) -> int:
        """Number of modes, R."""
        return self.modes.shape[2]

    @property
    def draws(self) -> int:
        """Independent fields of each mode: modes of the light."""
        return 1 if self.mixing is None else self.mixing.shape[1]

    @property
    def views(self) -> tuple[int, int, int]:
        """Images of one medium at rest, and their shape: (T, H, W)."""
        return self.modes.shape[1], *self.camera

    @property
    def spectra_bytes(self) -> int:
        """Memory of one medium's :meth:`spectra`."""
        return pair_bytes(self.lags, self.rank, self.object_rows.element_size())

    @property
    def field_bytes(self) -> int:
        """Memory of one frame of one medium's :meth:`fields`, of one polarisation."""
        return self.draws * self.rank * self.envelope[0].numel() * self.object_rows.element_size()

    def fields(
        self, keys: torch.Tensor, still: torch.Tensor, sample: int = 0, shares: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Draw media: the fields b G_r under the window, complex[B, F, N, R, rows, columns], 0 beyond it.

        Of one medium on the CPU on the cells of its window alone, else on the grid of the lags.

        Parameters
        ----------
        keys : int64[B, halves, F, 2]
            Of both polarisations (each of which has half of the light), frame by frame.
        still : float64[B]
            Correlation of the fields of one frame with the next; 0 where a ``film`` says it of all.
        sample
            Number of the realization under the keys.
        shares : float64[B, halves] or None
            Of the light in each polarisation; by default all have the same.
        """
        count, halves, frames, _ = keys.shape
        twice = lambda rows: rows if halves == 1 else rows.repeat_interleave(halves, 0)  # noqa: E731
        envelope = self.envelope if len(self.envelope) == 1 else twice(self.envelope)
        rows, columns = twice(self.cells.expand(count, 2)).unbind(1)
        drawn = optics.fields(
            keys.flatten(0, 1), sample, twice(still), rows, columns, envelope,
            self.draws * self.rank, [*(self.envelope.shape[1:] if one_by_one(keys.device) else self.lags)],
        )  # fmt: skip
        if self.film is not None:
            drawn = filmed(self.film if len(self.film) == 1 else self.film.repeat_interleave(halves, 0), drawn)
        drawn = torch.view_as_complex(drawn)
        drawn = drawn.view(*drawn.shape[:2], self.draws, self.rank, *drawn.shape[3:])
        if self.mixing is not None:
            mixing = self.mixing if len(self.mixing) == 1 else self.mixing.repeat_interleave(halves, 0)
            drawn = (mixing[:, None] @ drawn.flatten(4)).view_as(drawn)
        if halves == 1:
            return drawn
        drawn = drawn.unflatten(0, (count, halves))
        if shares is None:
            return drawn.swapaxes(1, 2).flatten(2, 3) * halves**-0.5
        root = shares.sqrt().reshape(count, halves, *[1] * (drawn.ndim - 2)).to(torch.view_as_real(drawn).dtype)
        return (drawn * root).swapaxes(1, 2).flatten(2, 3)

    def media(self, streams: Streams, sample: int = 0) -> "ImagedMedia":
        """Draw media; see :meth:`fields`."""
        return ImagedMedia(self, self.fields(streams.keys, streams.still, sample, streams.shares))

    def spectra(self, drawn: torch.Tensor) -> torch.Tensor:
        """Lag spectra of the products of modes, complex[B, F, R(R+1)/2, n, m], which all objects behind a medium share.

        Of fields complex[B, F, N, R, rows, columns], on the grid of the lags or on the window's cells alone.
        """
        views = torch.fft.ifft2(drawn.flatten(0, 1), s=self.lags, norm="forward")
        products = optics.pair_products(torch.view_as_real(views))
        products = products.view(*drawn.shape[:2], *products.shape[1:])
        return torch.fft.rfft2(products, norm="forward")

    def images(self, spectra: torch.Tensor, light: torch.Tensor, box: Box = WHOLE) -> torch.Tensor:
        """Images over their expected value of even light, real[B, T or F, H, W], from a medium's :meth:`spectra`.

        Of objects real[B, h, w], at least 0; their sum is what an image is in the mean. Outside of the ``box`` they are
        dark.
        """
        rows, columns = box
        modes = self.modes.expand(len(light), -1, -1, -1)
        if box != WHOLE:
            modes = modes.unflatten(3, self.shape)[..., rows, columns].flatten(3)
        some = self.transforms
        if self.shape != (1, 1):
            some |= {
                "object_rows": self.object_rows[:, :, rows], "object_columns": self.object_columns[:, columns],
            }  # fmt: skip
        if self.polynomials is None or self.merged:
            seen = optics.images(spectra, modes, light[:, rows, columns].to(modes.dtype), some)
            return self._toned(self._even(seen, light), light)
        assert self.gains is not None
        seen = [
            self.gains[:, :, n] * optics.images(spectra, modes, (light * own)[:, rows, columns].to(modes.dtype), some)
            for n, own in enumerate(self.polynomials)
        ]
        return sum(seen[1:], seen[0])

    def images_by_points(
        self, drawn: torch.Tensor, light: torch.Tensor, nodes: list[Nodes] | None = None, box: Box = WHOLE
    ) -> torch.Tensor:
        """Return what :meth:`images` does, from fields complex[1, F, N, R, ...] and one object real[1, h, w].

        By all its bright pixels, or by :meth:`nodes` among them.
        """

        def seen(own: torch.Tensor) -> torch.Tensor:
            if nodes is None:
                return self._from_points(drawn, own)
            return optics.seen(node_spectrum(self, drawn, own, nodes, box), self.transforms)

        if self.polynomials is None or self.merged:
            return self._toned(self._even(seen(light), light), light)
        assert self.gains is not None
        parts = [self.gains[:, :, n] * seen(light * own) for n, own in enumerate(self.polynomials)]
        return sum(parts[1:], parts[0])

    def points_cheaper(self, lit: int, frames: int, draws: int) -> bool:
        """Return whether ``lit`` bright pixels one by one take fewer operations than all pairs of modes.

        What the cheaper form takes is said where it is long, and refused where nobody waits for it; see the budget's.
        """
        by_points, by_pairs = image_operations(self.lags, self.rank, self.modes.shape[1], lit, draws)
        points = self.spectra_bytes * frames > _MOST_BYTES or by_pairs > by_points
        least = by_points if points else by_pairs
        rows, columns = self.lags
        require_time("object_imaging", seconds({"image": frames * least}, 1),
                     f"an image of {lit} bright pixels by {self.rank} modes on {columns} x {rows} points",
                     "Use a narrower illuminated area, a smaller camera, or an object of fewer pixels.")  # fmt: skip
        return points

    def nodes(self, light: torch.Tensor, frames: int, draws: int) -> list[Nodes] | None:
        """Nodes of one object real[1, h, w] for every tilt, where they take the fewest operations; else None.

        In double precision there are none: what they leave out would be seen.
        """
        if self.modes.dtype != torch.float32 or self.shape == (1, 1):
            return None
        count, tilts = int(np.count_nonzero(light.numpy())), self.modes.shape[1]
        views = frames * draws * self.rank * self.lags[0] * self.lags[1] * self.object_rows.element_size()
        if not count or views > _MOST_BYTES:
            return None
        least = min(image_operations(self.lags, self.rank, tilts, count, draws))
        most = most_nodes(self.lags, self.rank, tilts, count, draws, least)
        if most < min(count, self.rank):  # there are no fewer, as a rule
            return None
        lit = torch.nonzero(light.reshape(-1)).reshape(-1)
        found: list[Nodes] = []
        for modes in self.modes[0]:
            own = nodes_of(modes, lit, most)
            if own is None:
                return None
            found.append(own)
        return found

    def superposed(
        self, drawn: torch.Tensor, amplitudes: torch.Tensor, step: float, exit_radius: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Images of beams that interfere, under the first base tilt, over their mean over media: real[B, 1, H, W].

        Parameters
        ----------
        drawn : complex[B, 1, N, R, rows, columns]
            From :meth:`fields`.
        amplitudes : complex[B, h, w]
            Of the beams from the smallest sines y and x; their phases are 0 in the middle of the window.
        step
            Transverse wave number between neighbouring beams, radians per unit length.
        exit_radius : float64[B] or None
            Of a round aperture on the exit face, about the axis.
        """
        if amplitudes.shape[1:] != self.shape:
            reject("superposed amplitudes", f"of shape {self.shape}, one for each beam", tuple(amplitudes.shape[1:]))
        waves = amplitudes
        for axis, count in enumerate(self.shape):
            # Waves are counted from the first cell here, from the middle of the window there.
            beam = torch.arange(count, dtype=torch.float64, device=waves.device) - (count - 1) / 2
            first = -(self.cells[:, axis] - 1) / 2 * self.size[:, axis]
            turn = torch.exp(1j * step * beam * first[:, None])
            waves = waves * (turn[:, :, None] if axis == 0 else turn[:, None])
        waves = waves.flip(1, 2)  # the first beam is that of the largest sines: images of objects are turned
        rows, columns = self.envelope.shape[1:]
        light = self.modes[:, 0].unflatten(2, self.shape) * waves[:, None].to(self.object_rows.dtype)
        light = self.object_rows[:, None, :rows] @ light @ self.object_columns[:, None, :, :columns]
        # Strides decide the last bits of complex products: those of the grid of lags, on every device.
        down, across = (n - m for n, m in zip(self.lags, drawn.shape[-2:], strict=True))
        drawn = torch.nn.functional.pad(drawn[:, 0], (0, across, 0, down))[..., :rows, :columns]
        field, open_share = (drawn * light[:, None]).sum(2), None
        if exit_radius is not None:
            whole = disc_power(2 * exit_radius, self.cells, self.size, rows, columns)
            open_share = whole / whole.amax((1, 2), keepdim=True)
            field = field * open_share.sqrt().to(field.real.dtype)[:, None]
        views = torch.fft.ifft2(field, s=self.lags, norm="forward")
        spectrum = torch.fft.rfft2(torch.view_as_real(views).square().sum(-1).sum(1), norm="forward")[:, None]
        image = optics.seen(torch.view_as_real(spectrum), self.transforms)[:, :1]
        power = torch.view_as_real(light).square().sum((-1, 1)) * self.envelope.square()
        even = self.flat * torch.view_as_real(waves).double().square().sum((1, 2, 3))
        if open_share is not None:
            even = even * (power * open_share).sum((1, 2)) / power.sum((1, 2))
            power = power * open_share
        mean = power.sum((1, 2), dtype=torch.float64) + even
        seen = ((image + even[:, None, None, None]) / mean[:, None, None, None]).to(self.modes.dtype)
        return self._toned(seen, torch.view_as_real(amplitudes).square().sum(-1)) if self.merged else seen

    def contrast(self, light: torch.Tensor, media: Places = slice(None)) -> torch.Tensor:
        """Expected contrast float64[B] of images of objects real[B, h, w] behind B media, under polarised light."""
        own = self.variance if len(self) == 1 else self.variance[media]
        return speckle_contrast(light, own.expand(len(light), -1, -1))

    @property
    def transforms(self) -> dict[str, Any]:
        """Transforms, as :func:`optics.images` wants them."""
        objects = () if self.shape == (1, 1) else ("object_rows", "object_columns")
        some = {name: getattr(self, name) for name in (*objects, "camera_rows", "camera_columns")}
        return some if self.turns is None else some | {"turns": self.turns, "camera": self.camera}

    def _even(self, seen: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        if not self.even:
            return seen
        even = (self.flat * light.sum((1, 2), dtype=torch.float64)).to(seen.dtype)
        return seen + even[:, None, None, None]

    def _toned(self, seen: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Images real[B, T or F, H, W] under the mean envelope of objects real[B, h, w], where there is one."""
        if self.gains is None or self.polynomials is None:
            return seen
        share = torch.einsum("bhw,nhw->bn", light.to(self.polynomials.dtype), self.polynomials)
        total = light.sum((1, 2), dtype=share.dtype).clamp(min=torch.finfo(share.dtype).tiny)
        gains = self.gains.expand(len(light), -1, -1, -1, -1)
        return seen * torch.einsum("bn,btnhw->bthw", share / total[:, None], gains).to(seen.dtype)

    def _from_points(self, drawn: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        bright = light.reshape(-1).to(self.modes.dtype)
        rows, columns = self.envelope.shape[1:]
        if self.shape == (1, 1):  # beams under every tilt, whose ramps are 1
            views = torch.view_as_real(torch.fft.ifft2(drawn[0], s=self.lags, norm="forward")).flatten(3)
            seen = self.modes.new_empty((1, len(views), len(self.modes[0]), *self.lags))
            roots = (self.modes[0, :, :, 0] * bright.sqrt()).numpy()
            for frame, power in zip(views.numpy(), seen[0].flatten(2).numpy(), strict=True):
                fill_tilt_powers(roots, frame, power)
            spectra = torch.fft.rfft2(seen.flatten(1, 2), norm="forward")
            return optics.seen(torch.view_as_real(spectra), self.transforms)
        lit = torch.nonzero(bright).reshape(-1)
        down, across = self.object_rows[0, :rows].mT.numpy(), self.object_columns[0, :, :columns].numpy()
        at_once = min(_CHUNK, max(1, _MOST_VALUES // (self.lags[0] * self.lags[1])))
        turned = torch.zeros(self.lags, dtype=self.object_rows.dtype)  # of one point, which stays in the caches
        held, powers = turned.numpy(), bright.numpy()
        totals = []
        for frame in torch.view_as_real(drawn[0, :, :, :, :rows, :columns].contiguous()).flatten(3):
            for modes in self.modes[0]:
                total = torch.zeros(self.lags, dtype=self.modes.dtype)
                power = total.numpy()
                for chunk in lit.split(at_once) if len(lit) else ():
                    for flat in frame:
                        points = (modes[:, chunk].T @ flat).view(len(chunk), rows, columns, 2)
                        for point, field in zip(chunk.tolist(), torch.view_as_complex(points).numpy(), strict=True):
                            row, column = divmod(point, self.shape[1])
                            fill_turned(field, down[row], across[column], held)
                            views = torch.fft.ifft2(turned, norm="forward")
                            add_power(powers[point], views.numpy(), power)
                totals.append(torch.fft.rfft2(total, norm="forward"))
        return optics.seen(torch.view_as_real(torch.stack(totals)[None]), self.transforms)


def pair_bytes(lags: tuple[int, int], rank: int, each: int) -> int:
    """Memory of the spectra of all pairs of modes, of ``each`` bytes a number."""
    return rank * (rank + 1) // 2 * lags[0] * (lags[1] // 2 + 1) * each


def image_operations(lags: tuple[int, int], rank: int, tilts: int, lit: int, draws: int) -> tuple[float, float]:
    """Operations of a frame by ``lit`` bright pixels one by one, and by all pairs of modes.

    An operation of either takes about 0.1 ns, whatever the rank and the number of tilts (seen at 144 pixels a side).
    """
    cells, count, pairs = lags[0] * lags[1] / 4, lags[0] * lags[1], rank * (rank + 1) // 2
    transform = 5.0 * count * math.log2(count)
    beyond = 1 + (4 * tilts * pairs * count > _LARGE)
    by_pairs = beyond * pairs * (0.2 * transform + (15 + 10 * draws + 25 * tilts) * count)
    return lit * tilts * draws * (1.2 * rank * cells + 0.5 * transform + 2 * count), by_pairs


def most_nodes(lags: tuple[int, int], rank: int, tilts: int, lit: int, draws: int, least: float) -> int:
    """Most nodes of a tilt that take less than ``least`` operations of :func:`image_operations`, their choice included.

    Choosing P of n pixels takes 2 n P^2 of them; what each tilt takes besides was found.
    """
    count = lags[0] * lags[1]
    each = tilts * (math.log2(count) + 25 + (10 + rank) * draws) * count
    left = least - 41.0 * rank * draws * count - 4e6 * tilts - 1e7
    square = 2.0 * lit * tilts
    fit = max(0, int((math.sqrt(each**2 + 4 * square * max(left, 0.0)) - each) / (2 * square)))
    return min(fit, lit, _MOST_BYTES // (8 * lit))


def expected_work(sight: Sight, rank: int, degree: int, lit: int) -> tuple[dict[str, float], float]:
    """Counted operations of the first image of an object behind one medium, and bytes, before any of it is made.

    Parameters
    ----------
    sight
        Of one medium.
    rank, degree
        Modes, and the highest degree of their polynomials.
    lit
        Pixels that shine.
    """
    (h, w), (rows, columns), (high, wide) = sight.shape, sight.most_cells, sight.camera
    lags, tilts = _lags(rows, columns), sight.base.shape[1]
    pairs = pair_bytes(lags, rank, 8)
    by_points, by_pairs = image_operations(lags, rank, tilts, lit, 1)
    one_by_one = pairs > _MOST_BYTES or by_pairs > by_points
    half = lags[1] // 2 + 1
    operations = mode_operations(sight, 1) | {
        "normal": float(rank * rows * columns),
        "image": by_points if one_by_one else by_pairs,
        "phasor": float(lags[0] * (h + high) + half * (w + wide)),
        "product": float(high * half * (lags[0] + wide)),
    }
    held = polynomial_bytes(sight.lattice.full, degree), field_bytes(rows, columns, lags, rank, precise=False)
    return operations, max(held) + 8 * rank * h * w + (0 if one_by_one else 2 * pairs)


@dataclass(frozen=True)
class ImagedMedia:
    """B media as they were drawn: what :meth:`Imaging.media` gives.

    Attributes
    ----------
    imaging : Imaging
        Of each, or of all.
    drawn : complex[B, F, N, R, rows, columns] or None
        Fields.
    spectra : complex[B, F, R(R+1)/2, n, m] or None
        Their products, where many objects share them.
    one_by_one : bool
        Whether an object on the CPU may be looked at before it is transformed; else nothing is asked of numbers.
    """

    imaging: Imaging
    drawn: torch.Tensor | None
    spectra: torch.Tensor | None = None
    one_by_one: bool = True

    def __len__(self) -> int:
        return len(self._held)

    @property
    def _held(self) -> torch.Tensor:
        held = self.drawn if self.spectra is None else self.spectra
        assert held is not None
        return held

    def shared(self) -> Self:
        """Prepare for many objects: spectra instead of fields."""
        assert self.drawn is not None
        return type(self)(self.imaging, None, self.imaging.spectra(self.drawn))

    def images(self, light: torch.Tensor) -> torch.Tensor:
        """Images over their expected value, real[B, T or F, H, W], of objects real[B, h, w].

        Of one object on the CPU the bright pixels alone are transformed.
        """
        total = light.sum((1, 2), dtype=torch.float64)[:, None, None, None]
        seen = self.seen(light, lit_box(light[0]) if self._looked_at(light) else WHOLE)
        return seen / total.to(seen.dtype)

    def seen(self, light: torch.Tensor, box: Box = WHOLE) -> torch.Tensor:
        """Images over that of a pixel of brightness 1; one object on the CPU is imaged in the cheaper form."""
        if self.drawn is not None and self._looked_at(light):
            frames, draws = self.drawn.shape[1:3]
            if (nodes := self.imaging.nodes(light, frames, draws)) is not None:
                return self.imaging.images_by_points(self.drawn, light, nodes, box)
            if self.imaging.points_cheaper(int(np.count_nonzero(light.numpy())), frames, draws):
                return self.imaging.images_by_points(self.drawn, light)
        spectra = self.imaging.spectra(self.drawn) if self.spectra is None else self.spectra  # type: ignore[arg-type]
        return self.imaging.images(spectra, light, box)

    def _looked_at(self, light: torch.Tensor) -> bool:
        return self.one_by_one and len(self) == 1 and all(map(by_kernels, (light, self.imaging.modes, self._held)))

    def superposed(
        self, amplitudes: torch.Tensor, step: float, exit_radius: torch.Tensor | None = None
    ) -> torch.Tensor:
        """See :meth:`Imaging.superposed`."""
        assert self.drawn is not None
        return self.imaging.superposed(self.drawn, amplitudes, step, exit_radius)


def imagings(
    sight: Sight, correlations: Correlations, light: LightBatch | None = None, *, tolerance: float,
    film: FilmBatch | None = None, precise: bool = False,
) -> list[tuple[list[int], Imaging]]:  # fmt: skip
    """Prepare to draw media and image objects through them, those of one rank and grid together, and which they are.

    Raise a `RuleError` if modes, or fields of so many on so many cells, would not fit into memory.

    Parameters
    ----------
    sight
        Windows, beams and cameras of the media.
    correlations
        Their memory effect.
    light
        Modes of the light; by default one.
    tolerance
        Share of the intensity that the modes may leave out (it is put back evenly).
    film
        Their memory effect in time, of media that move, under light of one mode.
    precise
        Fields complex128, images float64.
    """
    _require_time(sight, light)
    lattice, known = sight.lattice, None
    if light is None and lattice.tilts == 1 and correlations.isotropic:
        known = memory(correlations, lattice)
    one = sight.one if one_by_one(sight.device) else sight  # for all, where they are seen in the same way
    variance = speckle_variance(sight, correlations, light, known=known, one=one)
    whole = None
    if sight.bound is not None or len(sight) == 1:
        whole = {"variance": variance} | {name: value.expand(len(sight), *value.shape[1:])
                                          for name, value in _seen(one, precise).items()}  # fmt: skip
    prepared = []
    for places, modes in karhunen_loeve(correlations, lattice, tolerance, known):
        groups = _groups(modes, exact=light is not None and light.shares.shape[1] > 1)
        order = [n for some, _ in groups for n in some]
        at = [places[n] for n in order]
        if order != [*range(len(order))]:
            modes = modes.at(_put(order, variance))
        together = whole if whole is None or at == [*range(len(variance))] else _rows(whole, at)
        first = 0
        for some, rank in groups:
            own, part = at[first : first + len(some)], slice(first, first + len(some))
            seen = (
                {"variance": variance[own]} | _seen(sight.at(own), precise)
                if together is None
                else {name: value[part] for name, value in together.items()}
            )
            lit, moving = None if light is None else light.at(own), None if film is None else film.at(own)
            prepared.append((own, _imaging(seen, sight, modes.at(part), rank, lit, moving)))
            first += len(some)
    return prepared


def _put(numbers: list[int], like: torch.Tensor) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.int64).to(like.device, non_blocking=True)


def _rows(tensors: dict[str, torch.Tensor], at: list[int]) -> dict[str, torch.Tensor]:
    """Some rows of every tensor: a view where they follow each other."""
    if at == [*range(at[0], at[0] + len(at))]:
        return {name: value[at[0] : at[0] + len(at)] for name, value in tensors.items()}
    places = _put(at, tensors["variance"])
    return {name: value[places] for name, value in tensors.items()}


def _groups(modes: Modes, *, exact: bool) -> Iterable[tuple[list[int], int]]:
    """Media that are rendered together, and their rank: each alone on the CPU, those of a few ranks on devices.

    Ranks are ``exact`` where the light has several modes: the fields of one mode of light follow those of the other,
    so that one more would have all that follow draw other numbers.
    """
    ranks, most = _ranks(modes), modes.columns.shape[-1]
    if one_by_one(modes.rank.device):
        return [([place], rank) for place, rank in enumerate(ranks)]
    least = np.asarray(ranks)
    if not exact:
        least = np.minimum(np.append(BUCKETS, most)[np.searchsorted(BUCKETS, least)], most)
    different, first = np.unique(least, return_index=True)
    return [(np.flatnonzero(least == rank).tolist(), int(rank)) for rank in different[np.argsort(first)]]


def _ranks(modes: Modes) -> list[int]:
    """Ranks as the host knows them, the one thing that it waits for; on "meta", where there are no numbers, 3."""
    return [3] * len(modes.rank) if modes.rank.device.type == "meta" else modes.rank.tolist()


def _seen(sight: Sight, precise: bool) -> dict[str, torch.Tensor]:
    """Part of an :class:`Imaging` that does not depend on modes: windows, and transforms of objects and cameras."""
    (rows, columns), cells = sight.most_cells, sight.cells
    if sight.profile == "disc":
        envelope = disc_power(sight.width, *cells, rows, columns).sqrt()
    else:
        along_y, along_x = window_powers(sight)
        envelope = along_y.sqrt()[:, :, None] * along_x.sqrt()[:, None]
    return {
        "cells": cells.number, "size": cells.size, "envelope": envelope.to(torch.float64 if precise else torch.float32),
        **_transforms(sight, _lags(rows, columns), precise),
    }  # fmt: skip


@lru_cache(maxsize=1024)
def _lags(rows: int, columns: int) -> tuple[int, int]:
    return int(lags_between(torch.tensor(rows))), int(lags_between(torch.tensor(columns)))


def _imaging(
    seen: dict[str, torch.Tensor], sight: Sight, modes: Modes, rank: int, light: LightBatch | None,
    film: FilmBatch | None,
) -> Imaging:  # fmt: skip
    envelope = seen["envelope"]
    real, device, (rows, columns) = envelope.dtype, envelope.device, envelope.shape[1:]
    lags, precise = _lags(rows, columns), real == torch.float64
    _require_room(rows, columns, lags, rank * (1 if light is None else light.shares.shape[1]), precise)
    maps, mixing = None, None
    flat = torch.zeros(len(envelope), dtype=torch.float64, device=device) if light is None else light.flat.to(device)
    if light is not None and light.shares.shape[1] > 1:
        roots = torch.stack([modes.mixing(rank, each) for each in light.modes], 1)
        mixing = light.shares.to(device).sqrt()[:, :, None, None] * roots
        # The span of K's modes holds those of each mode of the light only nearly: put back what it leaves out.
        values = modes.values(rank)
        power = (values[:, None] @ mixing).square().sum((1, 3))
        values = values * ((1 - flat)[:, None] / power).sqrt()[..., None]
        maps = values.unflatten(1, (sight.base.shape[1], -1)).mT.contiguous().to(real)
        mixing = mixing.to(torch.complex128 if precise else torch.complex64)
    return Imaging(
        modes=modes.maps(rank, real) if maps is None else maps,
        mixing=mixing,
        flat=flat,
        lags=lags,
        shape=sight.shape,
        camera=sight.camera,
        even=light is not None,
        film=None if film is None else film_root(modes, rank, film).to(real),
        **seen,  # type: ignore[arg-type]
    )


def lit_box(light: torch.Tensor) -> Box:
    """Rows and columns that hold all bright pixels of an object, on the CPU."""
    if light.numel() == 1:
        return WHOLE
    fill_extent(light.detach().numpy(), extent := np.empty(5, np.int64))
    top, left, bottom, right, _ = extent.tolist()
    return slice(top, bottom), slice(left, right)


def _transforms(sight: Sight, lags: tuple[int, int], precise: bool) -> dict[str, torch.Tensor]:
    """Transforms of object and camera at the lags: s for s < n/2 and s - n above along y, the order of an FFT."""
    (rows, columns), device, size = lags, sight.device, sight.cells.size
    number_y = torch.arange(rows, dtype=torch.float64, device=device)
    number_y = torch.where(number_y < rows // 2, number_y, number_y - rows)
    number_x = torch.arange(columns // 2 + 1, dtype=torch.float64, device=device)
    twice = torch.where(number_x == 0, 1.0, 2.0)  # lags of either sign
    lag_y, lag_x = number_y * size[:, 0, None], number_x * size[:, 1, None]
    gain_y, gain_x = (gain * torch.sinc(sight.pixel[:, None] * lag)
                      for gain, lag in ((torch.ones_like(number_y), lag_y), (twice, lag_x)))  # fmt: skip
    one = lambda along: torch.ones_like(along)  # noqa: E731
    sines_y, sines_x = (sight.object_sines(axis) / sight.wavelength for axis in (0, 1))
    seen = {
        "object_rows": torch.view_as_complex(optics.waves(lag_y, sines_y, one(sines_y), precise)),
        "object_columns": torch.view_as_complex(optics.waves(sines_x, lag_x, one(lag_x), precise)),
    }
    if one_by_one(device):
        halves = [centred(n, sight.camera_pitch)[:, n // 2 :] / sight.wavelength for n in sight.camera]
        own = slice(0, rows // 2)  # lags along y of either sign
        waves = (optics.waves(halves[0], lag_y[:, own], gain_y[:, own], precise),
                 optics.waves(halves[1], lag_x, gain_x, precise))  # fmt: skip
        camera_rows, camera_columns = (wave.movedim(3, 1).contiguous() for wave in waves)
        return seen | {"camera_rows": camera_rows, "camera_columns": camera_columns,
                       "turns": _turns(sight, lag_y, lag_x, precise)}  # fmt: skip
    views_y, views_x = (sight.views(axis) / -sight.wavelength for axis in (0, 1))
    flat = lambda views: views.flatten(1)  # noqa: E731
    camera_rows = optics.waves(flat(views_y), lag_y, gain_y, precise).unflatten(1, views_y.shape[1:])
    camera_columns = optics.waves(-flat(views_x), lag_x, gain_x, precise).unflatten(1, views_x.shape[1:])
    return seen | {"camera_rows": torch.view_as_complex(camera_rows), "camera_columns": camera_columns.flatten(3)}


def _turns(sight: Sight, lag_y: torch.Tensor, lag_x: torch.Tensor, precise: bool) -> torch.Tensor:
    """Phasors real[M, T or 0, n + m, 2] that bring every beam's camera onto the axis."""
    beside = (sight.base - sight.base.new_tensor(sight.center)) / sight.wavelength  # (x, y)
    if not beside.any():
        return lag_y.new_empty((len(sight), 0, lag_y.shape[1] + lag_x.shape[1], 2), dtype=(
            torch.float64 if precise else torch.float32))  # fmt: skip
    return torch.cat([
        optics.waves(beside[..., axis].contiguous(), lag, torch.ones_like(lag), precise)
        for axis, lag in ((1, lag_y), (0, lag_x))
    ], 2)  # fmt: skip


def _require_time(sight: Sight, light: LightBatch | None) -> None:
    """Say what the modes of objects of many pixels take on one core, or refuse them; see the budget's."""
    if not one_by_one(sight.device):
        return
    rows, columns = sight.shape
    require_time("object_imaging", seconds(mode_operations(sight, 1 if light is None else light.shares.shape[1]), 1),
                 f"the modes of {columns} x {rows} pixels behind {counted(len(sight), 'medium')}",
                 "Use an object of fewer pixels.")  # fmt: skip


def mode_operations(sight: Sight, lights: int) -> dict[str, float]:
    """Counted operations of the modes of media under so many modes of the light.

    Measured times of a thousand and two thousand pixels a side were 0.86 of the predicted ones.
    """
    (rows, columns), tilts = sight.shape, sight.base.shape[1]
    pixels = float(len(sight) * rows * columns)
    # K is asked at the differences of pixels, for the variance and for the modes: of both signs between tilts.
    differences = lights + (4 * tilts**2 if tilts > 1 else 1)
    return {"object pixel": tilts * pixels, "object difference": differences * pixels}


def field_bytes(rows: int, columns: int, lags: tuple[int, int], modes: int, precise: bool) -> int:
    """Memory of the fields of modes on cells of the exit face, and of their sum over bright points."""
    # White noise of the modes, mixed; fields of a point over the lags, their transform and square; the sum over points.
    return (8 if precise else 4) * (4 * modes * rows * columns + 8 * lags[0] * lags[1])


def _require_room(rows: int, columns: int, lags: tuple[int, int], modes: int, precise: bool) -> None:
    held = field_bytes(rows, columns, lags, modes, precise)
    require_memory(
        "object_imaging", "held", held, f"{counted(modes, 'mode')} on {columns} x {rows} cells of the exit face",
        "Use a narrower illuminated area (window.width) or a smaller field of view.",
    )  # fmt: skip
