"""Images of hidden objects behind thin screens: the stationary sampler's, under the envelope that each beam carries.

    I(v) = sum_j O_j E^2(v - i_j) |F_j(v)|^2,     E^2(v - i) = sum_n g_n(v) P_n(i)

E^2 is smooth over the object, so that a few Legendre polynomials P_n of the beams' directions hold it: each costs one
image of the object times P_n. They are fitted at Gauss nodes, as many as bring the error below :data:`TOLERANCE`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial.legendre import legvander

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.random_streams import Seed
from specklegen.samplers.screens.correlation import screen_correlation
from specklegen.samplers.screens.film import film_error, film_of
from specklegen.samplers.stationary.objects import ObjectSampler, object_sampler
from specklegen.scene.screens import ScreenStack
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.window import Profile, Window
from specklegen.theory.phase_screens import index_correlation, lobes

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

TOLERANCE = 4e-3
"""Error of E^2, over its peak, that the polynomials may leave."""
MOST_DEGREE = 8
_LOST = 0.02  # correlation that may be lost to what objects have no model of


@dataclass(frozen=True)
class ScreenObjects:
    """Draws media and images objects through them, as :class:`ObjectSampler`, whose fields it takes.

    Attributes
    ----------
    inner : ObjectSampler
    polynomials : float64[N, h, w]
        P_n over the object's pixels.
    gains : real[T, N, H, W]
        g_n of every base tilt at the camera's pixels.
    """

    inner: ObjectSampler
    polynomials: np.ndarray
    gains: torch.Tensor

    @cached_property
    def mean(self) -> float:
        """Expected image of an evenly bright object of total brightness 1, over all pixels and base tilts."""
        return self.inner.mean * float(self.gains[:, 0].mean())

    @property
    def rank(self) -> int:
        """Number of modes."""
        return self.inner.rank

    @property
    def spectra_bytes(self) -> int:
        """Memory of one medium's spectra."""
        return self.inner.spectra_bytes

    def medium(self, seed: Seed, realization: int = 0) -> torch.Tensor:
        """One medium; see :meth:`ObjectSampler.medium`."""
        return self.inner.medium(seed, realization)

    def spectra(self, medium: torch.Tensor) -> torch.Tensor:
        """Lag spectra of a medium; see :meth:`ObjectSampler.spectra`."""
        return self.inner.spectra(medium)

    def images(self, medium: torch.Tensor, brightness: np.ndarray) -> torch.Tensor:
        """Expected-intensity images real[T, H, W]; see :meth:`ObjectSampler.images`."""
        light = np.asarray(brightness, np.float64)
        if len(self.polynomials) > 1 and medium.shape[-2:] == self.inner.envelope.shape:
            medium = self.inner.spectra(medium)  # once for all polynomials
        total = 0.0
        for n, polynomial in enumerate(self.polynomials):
            total = total + self.gains[:, n] * self.inner.images(medium, light * polynomial)
        return total  # type: ignore[return-value]

    def contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast at one camera pixel, over media; beams of one object stand under nearly one envelope."""
        return self.inner.contrast(brightness)


def screen_objects(
    stack: ScreenStack, *, wavelength: float, object_shape: tuple[int, int], object_pitch: float, grid: FarFieldGrid,
    base: np.ndarray, width: float, profile: Profile = "square", moved: np.ndarray | None = None, **options: Any,
) -> ScreenObjects:  # fmt: skip
    """Prepare a sampler for objects of one shape behind screens; ``options`` are those of :func:`object_sampler`.

    Of a film ``moved`` float64[T, M, 2] is how far the screens have moved at each base tilt.

    Raises
    ------
    RuleError
        For screens so weak that images are correlated with their mirror image, tilts at which the index tells, or
        films through more than two screens whose frames are not like tilts.
    """
    terms = lobes(stack, wavelength)
    mirrored = terms.mirrored
    if mirrored > _LOST:
        reject(
            "Diffuser.screens", f"so strong that an image's mirror image is correlated with it by {_LOST:g} at most",
            float(f"{mirrored:.2g}"), "Raise the rms phase to 2 or more; render() draws single weak screens.",
        )  # fmt: skip
    base = np.atleast_2d(base)
    half = 0.5 * object_pitch * (np.array(object_shape[::-1]) - 1)
    farthest = np.hypot(*(np.abs(base) + half).T).max(initial=0.0)
    kept = index_correlation(stack, wavelength, np.array([0.0, farthest]))[0, 1] ** 2
    if kept < 1 - _LOST:
        reject(
            "Diffuser.screens", f"of an index that leaves {1 - _LOST:g} of the correlation across object and tilts",
            float(f"{kept:.3g}"), "Use a smaller object, smaller tilts, or a lower rms height.",
        )  # fmt: skip
    if moved is not None:
        window, reach = Window(profile, width), 2 * float(half.max(initial=0.0))
        error = film_error(stack, wavelength, moved, window, reach)
        if error > _LOST:
            reject(
                "Dynamics.velocities", f"such that frames are like tilts within {_LOST:g} in C_I",
                float(f"{error:.2g}"), "Move the screens less, or use two screens, of which it is exact.",
            )  # fmt: skip
        film = film_of(stack, wavelength, moved, window)
        options |= {"like": film.tilts, "kept": film.kept}
    inner = object_sampler(
        screen_correlation(stack, wavelength), wavelength=wavelength, object_shape=object_shape,
        object_pitch=object_pitch, grid=grid, base=base, width=width, profile=profile, **options,
    )  # fmt: skip

    def squared(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
        """E^2 [T, B, len(y), len(x)] of the beams at points x points of the object, rows first, over its half sides."""
        light_x, light_y = (base[:, axis, None] + half[axis] * points for axis in (0, 1))
        lobe = terms.over_grid((x - light_x[..., None])[:, None], (y - light_y[..., None])[:, :, None])
        forward = np.sqrt(1 - np.square(light_x)[:, None] - np.square(light_y)[:, :, None])
        found = lobe * (1 - np.square(x) - np.square(y)[:, None]) / forward[..., None, None]
        return found.reshape(len(base), -1, len(y), len(x))

    x, y = grid.sines
    few_x, few_y = (axis[np.unique(np.linspace(0, len(axis) - 1, 9).astype(int))] for axis in (x, y))
    ends = np.array([-1.0, 0.0, 1.0])
    exact = squared(few_x, few_y, ends)
    for degree in range(MOST_DEGREE + 1):
        points, fit, orders = _fit(degree)
        held = np.einsum("tbhw,bn->tnhw", squared(few_x, few_y, points), fit)
        at = _values(_square(ends), orders)
        if np.abs(np.einsum("tnhw,bn->tbhw", held, at) - exact).max() <= TOLERANCE or not half.any():
            break
    else:
        reject("ObjectField", "of an extent below some of the lobes' widths", object_shape, "Use a smaller object.")
    # The object's pixel (row, column) sends its light along minus its position: object_sines.
    along = [-np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in object_shape]
    pixels = np.stack(np.meshgrid(along[1], along[0]), axis=-1).reshape(-1, 2)
    gains = np.einsum("tbhw,bn->tnhw", squared(x, y, points), fit)
    return ScreenObjects(
        inner, _values(pixels, orders).T.reshape(-1, *object_shape), torch.as_tensor(gains).to(inner.envelope)
    )


@lru_cache(maxsize=MOST_DEGREE + 1)
def _fit(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes float64[b] of either axis, what turns values on their square into coefficients, float64[b * b, N], and
    orders int64[N, 2].
    """
    points, weights = gauss_legendre(degree + 1)
    orders = np.array([[a, total - a] for total in range(degree + 1) for a in range(total, -1, -1)])
    norm = ((2 * orders + 1) / 2).prod(axis=1)
    return points, np.outer(weights, weights).reshape(-1, 1) * _values(_square(points), orders) * norm, orders


def _square(points: np.ndarray) -> np.ndarray:
    """Points (x, y) of a square, float64[n * n, 2], rows first."""
    return np.stack(np.meshgrid(points, points), axis=-1).reshape(-1, 2)


def _values(points: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Products of Legendre polynomials at points float64[B, 2]: float64[B, N]."""
    along = [legvander(points[:, axis], int(orders.max())) for axis in (0, 1)]
    return along[0][:, orders[:, 0]] * along[1][:, orders[:, 1]]
