"""Images of hidden incoherent objects through a wide slab, by Karhunen-Loeve modes of the memory effect.

Object pixel j sends a beam i_j; its speckle is u_j(v) = sum_x e^(-ik(v - i_j) . x) sum_r phi_r(j) G_r(x),
where K(i_j - i_l) = sum_r phi_r(j) phi_r(l) over the pixels and the G_r are independent white fields under
the window. The image I(v) = sum_j O_j |u_j(v)|^2 has the Fourier coefficient at the lag s between cells

    I(s) = sum_rq  [G_r * G_q](s)  sum_j O_j phi_r(j) phi_q(j) e^(ik i_j . s)

Two forms, the cheaper chosen: "pairs" takes the R(R+1)/2 products of modes through one FFT each, which a
medium needs once for all its objects; "points" sums |u_j|^2 over the bright pixels. Both end in the same
transform from lags to camera pixels, exact for any camera pitch; a pixel's area enters it as a sinc.

The object may be seen under several base tilts b_t, added to all its beams: the modes are then those of
all beams i_j + b_t. A stack of tilted beams is an object of one pixel. Light of several modes
(:mod:`spectrum`) adds up over independent fields, in a medium's spectra already.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import next_fast_len

from specklegen.core.errors import counted
from specklegen.core.lazy import LazyModule
from specklegen.core.memory import require_memory
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.kernels.waves import fill_waves
from specklegen.samplers.stationary.contrast import speckle_variance
from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
from specklegen.samplers.stationary.exit_grid import Axis, cells, sampled_amplitude
from specklegen.samplers.stationary.gaussian_noise import complex_normals
from specklegen.samplers.stationary.modes import Lattice, karhunen_loeve
from specklegen.samplers.stationary.spectrum import LightModes, monochromatic
from specklegen.samplers.stationary.stacks import mean_intensity
from specklegen.scene.illumination import object_sines
from specklegen.scene.sensors import FarFieldGrid, require_resolved
from specklegen.scene.window import Profile, Window

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

Form = Literal["pairs", "points"]
_CHUNK = 32  # bright pixels transformed at once ...
_MOST_VALUES = 2**25  # ... of so many lags together
_MOST_BYTES = 2**27  # of spectra: pairs of very many modes would not fit into memory


@dataclass(frozen=True)
class ObjectSpeckle:
    """What is known of an object's images before any is drawn. Made by :func:`object_speckle`.

    Attributes
    ----------
    shape : (h, w)
        Of the object.
    mean : float
        Expected image of an object of total brightness 1.
    variance : real[2h - 1, 2w - 1]
        Covariance of the images of two object pixels at one camera pixel, over the square of their mean, by
        the difference (row, column) between them.
    """

    shape: tuple[int, int]
    mean: float
    variance: np.ndarray

    def contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of an object's image, over media, of what one camera pixel sees.

        Its square is sum_jl O_j O_l V(j - l) / (sum O)^2, V the covariance of two pixels' images.
        """
        power = np.square(np.abs(np.fft.rfft2(np.asarray(brightness, np.float64), self._padded)))
        twice = np.ones(power.shape[1])
        twice[1 : (self._padded[1] + 1) // 2] = 2
        variance = (power * self._variance_spectrum * twice).sum() / np.prod(self._padded)
        return float(np.sqrt(max(variance, 0.0)) / np.sum(brightness, dtype=np.float64))

    @property
    def _padded(self) -> tuple[int, int]:
        return 2 * self.shape[0] - 1, 2 * self.shape[1] - 1

    @cached_property
    def _variance_spectrum(self) -> np.ndarray:
        return np.fft.rfft2(np.fft.ifftshift(self.variance)).real


@dataclass(frozen=True)
class ObjectSampler(ObjectSpeckle):
    """Draws media and images objects through them. Made by :func:`object_sampler`.

    Attributes
    ----------
    modes : real[T, R, h * w]
        Karhunen-Loeve modes over the object's pixels, for each base tilt.
    mixing : complex[N, R, R]
        Root of each light mode's share, times what turns the modes of K into its own.
    flat : float
        Share of the light that comes as an even brightness.
    x, y : Axis
        Cells of the exit plane.
    envelope : real[y.count, x.count]
        Window b(x) times the root of the intensity that a pixel of brightness 1 gives.
    lags : (int, int)
        Size of the lag grid (rows, columns), at least twice the cells less one.
    object_rows, object_columns : complex[lag rows, h], complex[lag columns / 2 + 1, w]
        Transforms e^(ik i_j . s) of object pixels.
    camera_rows, camera_columns : complex[T, H, lag rows], complex[T, lag columns / 2 + 1, W]
        Transforms from lags to camera pixels.
    """

    modes: torch.Tensor
    mixing: torch.Tensor
    flat: float
    x: Axis
    y: Axis
    envelope: torch.Tensor
    lags: tuple[int, int]
    object_rows: torch.Tensor
    object_columns: torch.Tensor
    camera_rows: torch.Tensor
    camera_columns: torch.Tensor

    @property
    def rank(self) -> int:
        """Number of modes, R."""
        return self.modes.shape[1]

    @property
    def spectra_bytes(self) -> int:
        """Memory of one medium's :meth:`spectra`."""
        lags = self.lags[0] * (self.lags[1] // 2 + 1)
        return self.rank * (self.rank + 1) // 2 * lags * self.object_rows.element_size()

    def medium(self, seed: Seed, realization: int = 0) -> torch.Tensor:
        """One medium: the fields b G_r under the window for each mode of light, complex[N, R, y.count, x.count].

        Media joined along the first axis add up incoherently (the two polarisations, say, each times
        sqrt(1/2)); those added field by field interfere.
        """
        dtype = self.object_rows.dtype
        shape = (len(self.mixing), self.rank, self.y.count * self.x.count)
        white = complex_normals(seed, realization, shape, dtype, self.envelope.device)
        if len(self.mixing) > 1:  # else the mixing is 1
            with one_torch_thread():
                white = self.mixing @ white
        return white.reshape(*shape[:2], *self.envelope.shape) * self.envelope

    def spectra(self, medium: torch.Tensor) -> torch.Tensor:
        """Lag spectra of the products of a medium's modes, complex[R(R+1)/2, lag rows, lag columns / 2 + 1].

        Objects seen through one medium share them.
        """
        rank = self.rank
        with one_torch_thread():
            products = self.envelope.new_zeros((rank * (rank + 1) // 2, *self.lags))
            for draw in medium:
                views = torch.fft.ifft2(draw, s=self.lags, norm="forward")
                real, imaginary = views.real.contiguous(), views.imag.contiguous()
                first = 0
                for r in range(rank):
                    part = products[first : first + rank - r]
                    part.addcmul_(real[r], real[r:]).addcmul_(imaginary[r], imaginary[r:])
                    first += rank - r
            return torch.fft.rfft2(products, norm="forward")

    def image(self, medium: torch.Tensor, brightness: np.ndarray, *, form: Form | None = None) -> torch.Tensor:
        """Image under the first base tilt, real[H, W]; see :meth:`images`."""
        return self.images(medium, brightness, form=form)[0]

    def images(self, medium: torch.Tensor, brightness: np.ndarray, *, form: Form | None = None) -> torch.Tensor:
        """Expected-intensity images of an object through a medium under every base tilt, real[T, H, W].

        Parameters
        ----------
        medium
            From :meth:`medium`, or :meth:`spectra` (which are worth keeping where many objects share a medium).
        brightness
            real[h, w], at least 0.
        form
            "pairs" or "points"; by default the one with fewer operations.
        """
        light = torch.as_tensor(np.array(brightness)).to(self.modes)
        with one_torch_thread():
            shared = medium.shape[-2:] != self.envelope.shape
            if form is None:
                form = "pairs" if shared or self._pairs_cheaper(light, len(medium)) else "points"
            if form == "pairs":
                spectra = medium if shared else self.spectra(medium)
                box = _lit_box(np.asarray(brightness))
                spectrum = torch.stack([self._from_pairs(spectra, light, modes, box) for modes in self.modes])
            else:
                spectrum = torch.stack([self._from_points(medium, light, modes) for modes in self.modes])
            images = ((self.camera_rows @ spectrum) @ self.camera_columns).real.contiguous()
            return images.add_(self.flat * self.mean * light.sum()) if self.flat else images

    def _pairs_cheaper(self, brightness: torch.Tensor, draws: int) -> bool:
        bright = int((brightness > 0).sum()) * len(self.modes)
        cells_count, lag_count = self.x.count * self.y.count, self.lags[0] * self.lags[1]
        transform = 5.0 * lag_count * np.log2(lag_count)
        pairs = self.rank * (self.rank + 1) / 2 * (0.5 * transform + (20 * draws + 40 * len(self.modes)) * lag_count)
        if self.spectra_bytes > _MOST_BYTES:
            return False
        return pairs < bright * draws * (4.0 * self.rank * cells_count + transform + 4 * lag_count)

    def _from_pairs(
        self, spectra: torch.Tensor, brightness: torch.Tensor, modes: torch.Tensor, box: tuple[slice, slice]
    ) -> torch.Tensor:
        r, q = self._pairs
        maps = modes[r] * modes[q] * brightness.reshape(-1)
        maps *= torch.where(r == q, 1.0, 2.0).to(maps.dtype)[:, None]  # either order of two modes
        rows, columns = box
        maps = maps.reshape(-1, *self.shape)[:, rows, columns].to(self.object_rows.dtype)
        transform = (self.object_rows[:, rows] @ maps) @ self.object_columns[:, columns].T
        return transform.mul_(spectra).sum(0)

    @cached_property
    def _pairs(self) -> tuple[torch.Tensor, torch.Tensor]:
        r, q = torch.triu_indices(self.rank, self.rank, device=self.modes.device)
        return r, q

    def _from_points(self, medium: torch.Tensor, brightness: torch.Tensor, modes: torch.Tensor) -> torch.Tensor:
        total = torch.zeros(self.lags, dtype=self.modes.dtype, device=medium.device)
        ramps_y, ramps_x = self._ramps()
        bright = brightness.reshape(-1)
        lit = torch.nonzero(bright).reshape(-1)
        at_once = min(_CHUNK, max(1, _MOST_VALUES // (self.lags[0] * self.lags[1])))
        for chunk in lit.split(at_once) if len(lit) else ():
            row, column = chunk // self.shape[1], chunk % self.shape[1]
            ramps = ramps_y[row][:, :, None] * ramps_x[column][:, None, :]
            for draw in medium:
                flat = torch.view_as_real(draw).reshape(self.rank, -1)
                fields = torch.view_as_complex((modes[:, chunk].T @ flat).reshape(len(chunk), *draw.shape[1:], 2))
                views = torch.fft.ifft2(fields * ramps, s=self.lags, norm="forward")
                power = torch.view_as_real(views).square_()
                power = power[..., 0] + power[..., 1]  # sum(-1), four times as fast
                total += torch.tensordot(bright[chunk], power, dims=1)
        return torch.fft.rfft2(total, norm="forward")

    def _ramps(self) -> tuple[torch.Tensor, torch.Tensor]:
        """e^(ik i_j . x) over the cells: lags 0, 1, ... of the object's transform, from the first cell."""
        return self.object_rows[: self.y.count].T, self.object_columns[: self.x.count].T


def exit_axes(
    *, wavelength: float, object_shape: tuple[int, int], object_pitch: float, width: float, grid: FarFieldGrid,
    profile: Profile, base: np.ndarray,
) -> tuple[Axis, Axis]:  # fmt: skip
    """Cells along x and y of the face that light leaves, fine enough for every beam and every view."""
    span = [
        object_pitch * (object_shape[1 - axis] - 1) + grid.pitch * (grid.shape[1 - axis] - 1)
        + float(np.ptp(base[:, axis])) for axis in (0, 1)
    ]  # fmt: skip
    x, y = (cells(wavelength, width, profile, wavelength / (2 * width), each) for each in span)
    return x, y


def lags_between(x: Axis, y: Axis, modes: int = 1, dtype: torch.dtype | None = None) -> tuple[int, int]:
    """Lags (y, x) of cells for which there is room.

    Raises
    ------
    RuleError
        If fields of so many modes on the cells would not fit into memory; one mode is the least.
    """
    lags = (_even_fast_length(2 * y.count), _even_fast_length(2 * x.count))
    # White noise of the modes, mixed; fields of a point over the lags, their transform and square; the sum over points.
    held = (8 if dtype == torch.complex128 else 4) * (4 * modes * x.count * y.count + 8 * lags[0] * lags[1])
    require_memory(
        "object_sampler", "held", held, f"{counted(modes, 'mode')} on {x.count} x {y.count} cells of the exit face",
        "Use a narrower window (window.width) or a smaller field of view.",
    )  # fmt: skip
    return lags


def object_speckle(
    kernel: MemoryEffectCorrelation,
    *,
    wavelength: float,
    object_shape: tuple[int, int],
    object_pitch: float,
    width: float,
    grid: FarFieldGrid,
    profile: Profile = "square",
    base: ArrayLike = ((0.0, 0.0),),
    light: LightModes | None = None,
    pixel_integration: bool = False,
) -> ObjectSpeckle:
    """Find what is known of an object's images before any is drawn, whatever draws them.

    Parameters
    ----------
    kernel, wavelength, object_shape, object_pitch, width, grid, profile, base, light, pixel_integration
        As in :func:`object_sampler`.

    Raises
    ------
    RuleError
        If the lags of a window that is no product of its sides would not fit into memory.
    """
    light = light or monochromatic(kernel)
    window = Window(profile, width)
    x, y = exit_axes(
        wavelength=wavelength, object_shape=object_shape, object_pitch=object_pitch, width=width, grid=grid,
        profile=profile, base=np.atleast_2d(np.asarray(base, np.float64)),
    )  # fmt: skip
    if not window.separable:
        lags_between(x, y)
    seen = (grid.pitch / wavelength) if pixel_integration else 0.0
    variance = speckle_variance(light, x, y, window, 2 * np.pi / wavelength, object_shape, object_pitch, seen)
    return ObjectSpeckle(object_shape, mean_intensity(kernel, window.area), variance)


def object_sampler(
    kernel: MemoryEffectCorrelation,
    *,
    wavelength: float,
    object_shape: tuple[int, int],
    object_pitch: float,
    width: float,
    grid: FarFieldGrid,
    profile: Profile = "square",
    base: ArrayLike = ((0.0, 0.0),),
    like: ArrayLike | None = None,
    kept: np.ndarray | None = None,
    light: LightModes | None = None,
    pixel_integration: bool = False,
    tolerance: float = 0.01,
    device: torch.device | str = "cpu",
    dtype: torch.dtype | None = None,
) -> ObjectSampler:
    """Prepare a sampler for objects of one shape behind one material in front of one camera.

    Parameters
    ----------
    kernel
        K of the material.
    wavelength, width, profile, grid
        As in :class:`Scene`.
    object_shape, object_pitch
        (h, w), and the direction sine between pixels.
    base
        float[T, 2], direction sines (x, y) of the base tilts, added to all the object's beams.
    like, kept
        Of a medium that moves between them: float[T, 2], sines by which K sees every base tilt besides, and
        float64[T, T], what is left of it in any case.
    light
        Modes of the light; by default one.
    pixel_integration
        Average the intensity over square pixels as wide as the grid's pitch, exactly; otherwise take it at
        their centres, where the grid must resolve it, pitch <= wavelength / (2 width).
    tolerance
        Share of the intensity that the modes may leave out (it is put back evenly).
    device, dtype
        Where and in what precision; complex64 (by default) or complex128.

    Raises
    ------
    RuleError
        If the camera undersamples the speckle, and its pixels have no area.
    """
    dtype = dtype or torch.complex64
    if not pixel_integration:
        require_resolved("object_sampler grid pitch", wavelength, width, grid.pitch)
    light = light or monochromatic(kernel)
    k = 2 * np.pi / wavelength
    base = np.atleast_2d(np.asarray(base, np.float64))
    sines = object_sines("object_sampler", object_shape, object_pitch)
    seen_as = base if like is None else base + np.asarray(like, np.float64)
    modes = karhunen_loeve(kernel, Lattice(object_shape, k * object_pitch, k * seen_as, kept), tolerance)
    values = modes.values
    x, y = exit_axes(
        wavelength=wavelength, object_shape=object_shape, object_pitch=object_pitch, width=width, grid=grid,
        profile=profile, base=base,
    )  # fmt: skip
    lags = lags_between(x, y, values.shape[1] * len(light.shares), dtype)
    speckle = object_speckle(
        kernel, wavelength=wavelength, object_shape=object_shape, object_pitch=object_pitch, width=width, grid=grid,
        profile=profile, base=base, light=light, pixel_integration=pixel_integration,
    )  # fmt: skip
    window = Window(profile, width)
    amplitude = sampled_amplitude(x, y, window)
    # Lag s of the transform is s for s < n/2 and s - n above: the order of an FFT.
    lag_y = np.fft.fftfreq(lags[0], 1 / lags[0]) * y.size
    lag_x = np.arange(lags[1] // 2 + 1) * x.size
    sines = sines.reshape(*object_shape, 2)
    view_x, view_y = (axis - base[:, i, None] for i, axis in enumerate(grid.sines))  # [T, W], [T, H]
    twice = np.where(np.arange(lags[1] // 2 + 1) == 0, 1.0, 2.0)  # lags of either sign
    seen = (grid.pitch / wavelength) if pixel_integration else 0.0
    area_y, area_x = np.sinc(seen * lag_y), np.sinc(seen * lag_x)
    if len(light.shares) == 1:
        mixing = np.ones((1, 1, 1))
    else:
        roots = [modes.mixing(each) for each in light.kernels]
        mixing = np.sqrt(light.shares)[:, None, None] * np.stack(roots)
        # The span of K's modes holds those of each mode of the light only nearly: put back what it leaves out.
        power = np.square(np.einsum("pr,nrq->npq", values, mixing)).sum(axis=(0, 2))
        values = values * np.sqrt((1 - light.flat) / power)[:, None]
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    put = lambda a, t: torch.as_tensor(np.ascontiguousarray(a)).to(device=device, dtype=t)  # noqa: E731
    waves = lambda a, b, gain: _waves(a, b, gain, real).to(device)  # noqa: E731
    return ObjectSampler(
        modes=put(values.reshape(len(base), -1, values.shape[1]).swapaxes(1, 2), real),
        mixing=put(mixing, dtype),
        flat=light.flat,
        x=x,
        y=y,
        envelope=put(amplitude * np.sqrt(speckle.mean), real),
        lags=lags,
        object_rows=waves(lag_y, sines[:, 0, 1] / wavelength, np.ones(object_shape[0])),
        object_columns=waves(lag_x, sines[0, :, 0] / wavelength, np.ones(object_shape[1])),
        camera_rows=torch.stack([waves(view / -wavelength, lag_y, area_y) for view in view_y]),
        camera_columns=torch.stack([waves(view / -wavelength, lag_x, twice * area_x).T for view in view_x]),
        shape=object_shape,
        mean=speckle.mean,
        variance=speckle.variance,
    )


def _waves(along: np.ndarray, across: np.ndarray, gain: np.ndarray, real: torch.dtype) -> torch.Tensor:
    """gain[m] e^(2 pi i along[n] across[m]), complex[n, m]."""
    waves = torch.empty((len(along), len(across), 2), dtype=real)
    fill_waves(along, across, gain, waves.numpy())
    return torch.view_as_complex(waves)


def _lit_box(brightness: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that hold all bright pixels."""
    lit = [np.flatnonzero((brightness != 0).any(axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(int(n[0]), int(n[-1]) + 1) if len(n) else slice(0, 0) for n in lit)
    return rows, columns


def _even_fast_length(n: int) -> int:
    return 2 * int(next_fast_len((n + 1) // 2, real=True) or 0)
