"""Fields behind an opening as sums of plane waves (angular spectrum).

    u(x, y, z) = (1/4 pi^2) int Psi(xi) e^{i xi.r} e^{iz sqrt(k^2 - |xi|^2)} d^2xi

with Psi the exact transform of the opening, on a lattice of xi out to k and beyond: the plane's grid is refined to half
a wavelength at most. The lattice makes the field periodic, with the period W. Light that reaches a pixel from the
opening has moved sideways by D at most; light of the next period would have moved by W - D at least. So waves of
z xi / sqrt(k^2 - xi^2) above W - D are left out, those below D are kept, and between a smooth step joins the two.
Evanescent waves (|xi| > k) count at less than half a wavelength, where no wave moves far.
Sources: Goodman, *Introduction to Fourier Optics*, section 3.10; Matsushima, Shimobaba, Opt. Express 17, 19662 (2009),
whose sharp limit is made smooth here.
"""

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre
from specklegen.wavetracing.aperture import aperture_transform
from specklegen.wavetracing.light import Light, PlaneWave
from specklegen.wavetracing.mask import Mask
from specklegen.wavetracing.opening import Rim
from specklegen.wavetracing.plane import Plane

MOST = 8192
"""Waves along each axis at most: 1 GiB."""

ORDER = 16
"""Gauss-Legendre nodes along each side of a triangle of two wavelengths at most: errors of 1e-9."""


def spectrum_field(rim: Rim | Mask, light: Light, plane: Plane, padding: float = 2.0) -> np.ndarray:
    """Return the field complex128[H * W] on a plane parallel to the screen.

    Raise a `RuleError` if the plane is tilted, the padding is below 1, or more than 8192 waves along an axis were
    needed.
    """
    if not (np.isfinite(padding) and padding >= 1):
        reject("field_on_plane padding", "at least 1", padding)
    if abs(plane.axes[2, 2] - 1) > 1e-12:
        reject(
            "field_on_plane plane", "parallel to the screen, its normal along +z, for method 'spectrum'", plane.normal,
            'Use "boundary".',
        )  # fmt: skip
    wavelength, (rows, columns) = light.wavelength, plane.shape
    refine = max(1, int(np.ceil(2 * plane.pitch / wavelength)))
    corners = (rim.starts - plane.center[:2]) @ plane.axes[:2, :2].T
    farthest = float(np.abs(corners).max()) + max(rows, columns) * plane.pitch / 2  # D
    coarse = int(np.ceil(padding * 2 * farthest / plane.pitch))  # pixels in a period
    fine = coarse * refine
    if fine > MOST:
        reject(
            "field_on_plane plane", f"resolved by {MOST} waves along an axis", fine,
            "Take a coarser pitch, a smaller window or less padding.",
        )  # fmt: skip
    along = 2 * np.pi * np.fft.fftfreq(fine, plane.pitch / refine)
    psi = _transform(rim, corners, light, plane, along)
    k = 2 * np.pi / wavelength
    axial = np.sqrt((k**2 - along[:, None] ** 2 - along**2).astype(complex))  # +i for evanescent waves
    z = float(plane.center[2])
    psi *= np.exp(1j * z * axial)
    if z > 0:
        psi *= _staying(along, axial.real, z, farthest, coarse * plane.pitch, z < wavelength / 2)
    # The first pixel stands at minus half of the grid; waves that agree on all pixels are added before the transform.
    x, y = plane.coordinates
    psi *= np.exp(1j * along * x[0]) * np.exp(1j * along * y[0])[:, None]
    folded = psi.reshape(refine, coarse, refine, coarse).sum(axis=(0, 2))
    field = np.fft.ifft2(folded) / plane.pitch**2
    return field[:rows, :columns].ravel()


def _transform(rim: Rim | Mask, corners: np.ndarray, light: Light, plane: Plane, along: np.ndarray) -> np.ndarray:
    """Psi complex128[y, x] in the frame of the plane, whose middle is its origin."""
    count = len(along)
    turn = plane.axes[:2, :2]
    if isinstance(rim, Rim) and isinstance(light, PlaneWave):
        bounds = np.cumsum([len(loop) for loop in rim.loops])[:-1]
        tilt = light.wavenumber * turn @ light.direction[:2]
        origin = light.field(np.append(plane.center[:2], 0.0))
        xi = np.stack(np.meshgrid(along - tilt[0], along - tilt[1]), axis=-1)
        return origin * aperture_transform(np.split(corners, bounds), xi)
    from finufft import nufft2d1

    nodes, strengths = light_strengths(rim, light)
    step = along[1] if count > 1 else 0.0
    x, y = np.ascontiguousarray(((nodes - plane.center[:2]) @ turn.T * step).T)
    return np.asarray(nufft2d1(y, x, strengths, (count, count), isign=-1, eps=1e-12, modeord=1, nthreads=1))


def _staying(
    along: np.ndarray, axial: np.ndarray, z: float, near: float, period: float, evanescent: bool
) -> np.ndarray:
    """Weight float64[y, x] of each wave: 1 below ``near``, 0 above ``period`` - ``near`` sideways, along x and y."""
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = z * np.maximum(np.abs(along), np.abs(along)[:, None]) / axial
    step = np.clip((moved - near) / max(period - 2 * near, 1e-9 * near), 0, 1)
    weights = np.ones_like(axial)
    between = (step > 0) & (step < 1)
    t = step[between]
    weights[between] = 1 / (1 + np.exp(np.clip(1 / (1 - t) - 1 / t, -700, 700)))
    weights[step == 1] = 0
    weights[axial == 0] = evanescent
    return weights


def light_strengths(rim: Rim | Mask, light: Light) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes float64[P, 2] in the opening, and the light there times their weights, complex128[P]."""
    given = isinstance(rim, Mask)
    nodes, weights = rim.quadrature(light.wavelength) if given else quadrature(rim.triangles, light.wavelength)
    field = np.asarray(light.field(np.column_stack([nodes, np.zeros(len(nodes))])), dtype=np.complex128)
    if field.shape != weights.shape or not np.isfinite(field).all():
        reject("field_on_plane light", "finite, one value a point", field)
    return nodes, weights * field


def quadrature(triangles: np.ndarray, wavelength: float) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes float64[P, 2] and weights float64[P] for integrals of u e^{-i xi.r}, |xi| <= k, over triangles.

    Triangles are halved across their longest sides to two wavelengths at most. Each is a square with one side drawn
    together (Duffy's map), with 16 x 16 Gauss-Legendre nodes.
    """
    done, left = [], triangles
    while len(left):
        sides = np.linalg.norm(np.roll(left, -1, axis=1) - left, axis=2)
        fine = sides.max(axis=1) <= 2 * wavelength
        done.append(left[fine])
        left, sides = left[~fine], sides[~fine]
        if sum(map(len, done)) + 2 * len(left) > 1 << 17:
            reject("field_on_plane opening", "resolved by 131 072 triangles of two wavelengths", "a larger one")
        longest = sides.argmax(axis=1)[:, None]
        row = np.arange(len(left))[:, None]
        a, b, c = (left[row, (longest + n) % 3][:, 0] for n in range(3))
        middle = (a + b) / 2
        left = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    cut = np.concatenate(done) if done else np.empty((0, 3, 2))
    x, w = gauss_legendre(ORDER)
    s, w = (x + 1) / 2, w / 2
    first, second = np.meshgrid(s, s, indexing="ij")
    shares = np.stack([1 - first, first * (1 - second), first * second], axis=-1).reshape(-1, 3)
    jacobian = (w[:, None] * w * first).ravel()
    u, v = cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0]
    twice = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    return np.einsum("qc,tcx->tqx", shares, cut).reshape(-1, 2), (twice[:, None] * jacobian).ravel()
