"""Images of hidden incoherent objects through a wide slab, by Karhunen-Loeve modes of the memory effect.

Object pixel j sends a beam i_j; its speckle is u_j(v) = sum_x e^(-ik(v - i_j) . x) sum_r phi_r(j) G_r(x),
where K(i_j - i_l) = sum_r phi_r(j) phi_r(l) over the pixels and the G_r are independent white fields under
the window. The image I(v) = sum_j O_j |u_j(v)|^2 has the Fourier coefficient at the lag s between cells

    I(s) = sum_rq  [G_r * G_q](s)  sum_j O_j phi_r(j) phi_q(j) e^(ik i_j . s)

Two forms, the cheaper chosen: "pairs" takes the R(R+1)/2 products of modes through one FFT each, which a
medium needs once for all its objects; "points" sums |u_j|^2 over the bright pixels. Both end in the same
transform from lags to camera pixels, exact for any camera pitch that resolves the speckle.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from scipy.fft import next_fast_len
from scipy.signal import correlate

from specklegen.illumination import Profile, illuminated_area, object_sines
from specklegen.sensors import FarFieldGrid, require_resolved
from specklegen.stationary.cells import Axis, cells, window
from specklegen.stationary.kernel import MemoryKernel
from specklegen.stationary.normals import complex_normals
from specklegen.stationary.sampler import mean_intensity, one_torch_thread
from specklegen.streams import Seed

Form = Literal["pairs", "points"]


def object_modes(
    kernel: MemoryKernel, shape: tuple[int, int], pitch: float, wavenumber: float, tolerance: float
) -> np.ndarray:
    """Modes phi float64[h * w, R] with sum_r phi_r(j) phi_r(l) = K(i_j - i_l) up to ``tolerance``.

    Pivoted Cholesky, then a singular value decomposition; what the two leave out adds up to at most
    ``tolerance`` of the intensity, and every pixel's intensity is then restored to 1.
    """
    rows, columns = shape
    dy, dx = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    distance = pitch * wavenumber * np.hypot(dy, dx)
    unique, inverse = np.unique(distance, return_inverse=True)
    table = kernel(unique)[inverse].reshape(shape)
    y, x = dy.ravel(), dx.ravel()
    size = rows * columns
    residual = np.ones(size)
    factor = np.empty((size, 0))
    columns_found = []
    while residual.sum() > 0.25 * tolerance * size and len(columns_found) < size:
        pivot = int(residual.argmax())
        column = table[np.abs(y - y[pivot]), np.abs(x - x[pivot])]
        if columns_found:
            factor = np.stack(columns_found, axis=1)
            column = column - factor @ factor[pivot]
        column = column / np.sqrt(residual[pivot])
        columns_found.append(column)
        residual = np.clip(residual - column**2, 0, None)
    factor = np.stack(columns_found, axis=1)
    u, s, _ = np.linalg.svd(factor, full_matrices=False)
    tail = np.cumsum(np.square(s)[::-1])[::-1]
    rank = max(1, int((tail > 0.75 * tolerance * size).sum()))
    modes = u[:, :rank] * s[:rank]
    return modes / np.linalg.norm(modes, axis=1, keepdims=True)


@dataclass(frozen=True)
class ObjectSampler:
    """Draws media and images objects through them. Made by :func:`object_sampler`.

    Attributes
    ----------
    modes : real[R, h * w]
        Karhunen-Loeve modes over the object's pixels.
    x, y : Axis
        Cells of the exit plane.
    envelope : real[y.count, x.count]
        Window b(x) times the root of the intensity that a pixel of brightness 1 gives.
    lags : (int, int)
        Size of the lag grid (rows, columns), at least twice the cells less one.
    object_rows, object_columns : complex[lag rows, h], complex[lag columns / 2 + 1, w]
        Transforms e^(ik i_j . s) of object pixels.
    camera_rows, camera_columns : complex[H, lag rows], complex[lag columns / 2 + 1, W]
        Transforms from lags to camera pixels.
    shape : (h, w)
    mean : float
        Expected image of an object of total brightness 1.
    overlap : float64[2h - 1, 2w - 1]
        Correlation, at one camera pixel, of the intensities of two object pixels that far apart.
    """

    modes: torch.Tensor
    x: Axis
    y: Axis
    envelope: torch.Tensor
    lags: tuple[int, int]
    object_rows: torch.Tensor
    object_columns: torch.Tensor
    camera_rows: torch.Tensor
    camera_columns: torch.Tensor
    shape: tuple[int, int]
    mean: float
    overlap: np.ndarray

    def expected_contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of the image of an object real[h, w], relative to its expected intensity.

        contrast^2 = sum_jl O_j O_l C_I(i_j - i_l) |W^(i_j - i_l)|^2 / (sum O)^2: pixels further apart than a
        grain add their speckle independently, however far the memory effect reaches.
        """
        lit = np.asarray(brightness, dtype=np.float64)
        pairs = correlate(lit, lit, method="fft")
        return float(np.sqrt(max((pairs * self.overlap).sum(), 0.0)) / lit.sum())

    @property
    def rank(self) -> int:
        """Number of modes, R."""
        return len(self.modes)

    def medium(self, seed: Seed, realization: int = 0) -> torch.Tensor:
        """One medium: the fields b G_r under the window, complex[R, y.count, x.count]."""
        dtype = self.object_rows.dtype
        shape = (self.rank, self.y.count, self.x.count)
        return complex_normals(seed, realization, shape, dtype, self.envelope.device) * self.envelope

    def spectra(self, medium: torch.Tensor) -> torch.Tensor:
        """Lag spectra of the products of a medium's modes, complex[R(R+1)/2, lag rows, lag columns / 2 + 1].

        Objects seen through one medium share them.
        """
        with one_torch_thread():
            views = torch.fft.ifft2(medium, s=self.lags, norm="forward")
            real, imaginary = views.real.contiguous(), views.imag.contiguous()
            products = real.new_empty((self.rank * (self.rank + 1) // 2, *self.lags))
            first = 0
            for r in range(self.rank):
                part = products[first : first + self.rank - r]
                torch.mul(real[r], real[r:], out=part)
                part.addcmul_(imaginary[r], imaginary[r:])
                first += self.rank - r
            return torch.fft.rfft2(products, norm="forward")

    def image(self, medium: torch.Tensor, brightness: np.ndarray, *, form: Form | None = None) -> torch.Tensor:
        """Expected-intensity image of an object through a medium, real[H, W].

        Parameters
        ----------
        medium
            From :meth:`medium`, or :meth:`spectra` (which are worth keeping where many objects share a medium).
        brightness
            real[h, w], at least 0.
        form
            "pairs" or "points"; by default the one with fewer operations.
        """
        lit = torch.as_tensor(np.array(brightness)).to(self.modes)
        with one_torch_thread():
            shared = medium.shape[-2:] != self.envelope.shape
            if form is None:
                form = "pairs" if shared or self._pairs_cheaper(lit) else "points"
            if form == "pairs":
                spectrum = self._from_pairs(medium if shared else self.spectra(medium), lit)
            else:
                spectrum = self._from_points(medium, lit)
            return ((self.camera_rows @ spectrum) @ self.camera_columns).real.contiguous()

    def _pairs_cheaper(self, brightness: torch.Tensor) -> bool:
        bright = int((brightness > 0).sum())
        cells_count, lag_count = self.x.count * self.y.count, self.lags[0] * self.lags[1]
        transform = 5.0 * lag_count * np.log2(lag_count)
        pairs = self.rank * (self.rank + 1) / 2 * (0.5 * transform + 60 * lag_count)
        return pairs < bright * (8.0 * self.rank * cells_count + transform + 4 * lag_count)

    def _from_pairs(self, spectra: torch.Tensor, brightness: torch.Tensor) -> torch.Tensor:
        r, q = torch.triu_indices(self.rank, self.rank, device=spectra.device)
        maps = self.modes[r] * self.modes[q] * brightness.reshape(-1)
        maps *= torch.where(r == q, 1.0, 2.0).to(maps.dtype)[:, None]  # either order of two modes
        maps = maps.reshape(-1, *self.shape).to(self.object_rows.dtype)
        transform = (self.object_rows @ maps) @ self.object_columns.T
        return transform.mul_(spectra).sum(0)

    def _from_points(self, medium: torch.Tensor, brightness: torch.Tensor) -> torch.Tensor:
        total = torch.zeros(self.lags, dtype=self.modes.dtype, device=medium.device)
        ramps_y, ramps_x = self._ramps()
        for j in torch.nonzero(brightness.reshape(-1)).reshape(-1).tolist():
            row, column = divmod(j, self.shape[1])
            field = torch.tensordot(self.modes[:, j].to(medium.dtype), medium, dims=1)
            field = field * (ramps_y[row][:, None] * ramps_x[column])
            views = torch.view_as_real(torch.fft.ifft2(field, s=self.lags, norm="forward"))
            total += brightness.reshape(-1)[j] * views.square().sum(-1)
        return torch.fft.rfft2(total, norm="forward")

    def _ramps(self) -> tuple[torch.Tensor, torch.Tensor]:
        """e^(ik i_j . x) over the cells: lags 0, 1, ... of the object's transform, from the first cell."""
        return self.object_rows[: self.y.count].T, self.object_columns[: self.x.count].T


def object_sampler(
    kernel: MemoryKernel,
    *,
    wavelength: float,
    object_shape: tuple[int, int],
    object_pitch: float,
    width: float,
    grid: FarFieldGrid,
    profile: Profile = "square",
    tolerance: float = 0.01,
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.complex64,
) -> ObjectSampler:
    """Prepare a sampler for objects of one shape behind one material in front of one camera.

    Parameters
    ----------
    kernel
        K of the material.
    wavelength, width, profile, grid
        As in :class:`Scene`; the camera must resolve the intensity, pitch <= wavelength / (2 width).
    object_shape, object_pitch
        (h, w), and the direction sine between pixels.
    tolerance
        Share of the intensity that the modes may leave out (it is put back evenly).
    device, dtype
        Where and in what precision; complex64 or complex128.

    Raises
    ------
    RuleError
        If the camera undersamples the speckle.
    """
    require_resolved("object_sampler grid pitch", wavelength, width, grid.pitch)
    k = 2 * np.pi / wavelength
    modes = object_modes(kernel, object_shape, object_pitch, k, tolerance)
    axes = []
    for n_object, n_camera in ((object_shape[1], grid.shape[1]), (object_shape[0], grid.shape[0])):
        span = object_pitch * (n_object - 1) + grid.pitch * (n_camera - 1)
        axes.append(cells(wavelength, width, profile, wavelength / (2 * width), span))
    x, y = axes
    lags = (_even_fast_length(2 * y.count), _even_fast_length(2 * x.count))
    area = illuminated_area(width, profile)
    envelope = window(x, y, width, profile) * np.sqrt(mean_intensity(kernel, area))
    # Lag s of the transform is s for s < n/2 and s - n above: the order of an FFT.
    lag_y = np.fft.fftfreq(lags[0], 1 / lags[0]) * y.size
    lag_x = np.arange(lags[1] // 2 + 1) * x.size
    sines = object_sines("object_sampler", object_shape, object_pitch).reshape(*object_shape, 2)
    view_x, view_y = grid.sines
    twice = np.where(np.arange(lags[1] // 2 + 1) == 0, 1.0, 2.0)  # lags of either sign
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    put = lambda a, t: torch.as_tensor(np.ascontiguousarray(a)).to(device=device, dtype=t)  # noqa: E731
    return ObjectSampler(
        modes=put(modes.T, real),
        x=x,
        y=y,
        envelope=put(envelope, real),
        lags=lags,
        object_rows=put(np.exp(1j * k * lag_y[:, None] * sines[:, 0, 1]), dtype),
        object_columns=put(np.exp(1j * k * lag_x[:, None] * sines[0, :, 0]), dtype),
        camera_rows=put(np.exp(-1j * k * view_y[:, None] * lag_y), dtype),
        camera_columns=put(np.exp(-1j * k * lag_x[:, None] * view_x) * twice[:, None], dtype),
        shape=object_shape,
        mean=mean_intensity(kernel, area),
        overlap=_overlap(kernel, window(x, y, width, profile) ** 2, x, y, object_shape, k * object_pitch),
    )


def _overlap(
    kernel: MemoryKernel, power: np.ndarray, x: Axis, y: Axis, shape: tuple[int, int], step: float
) -> np.ndarray:
    """C_I |W^|^2 at the differences between object pixels, ``step`` apart in lateral wavevector."""
    lags = [np.arange(1 - n, n) * step for n in shape]
    rows = np.exp(1j * lags[0][:, None] * y.positions)
    columns = np.exp(1j * lags[1][:, None] * x.positions)
    q = np.hypot(lags[0][:, None], lags[1])
    unique, inverse = np.unique(q, return_inverse=True)
    return np.square(np.abs(rows @ power @ columns.T) * kernel(unique)[inverse].reshape(q.shape))


def _even_fast_length(n: int) -> int:
    return 2 * int(next_fast_len((n + 1) // 2, real=True))  # type: ignore[arg-type]
