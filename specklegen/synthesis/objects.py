"""The image of hidden objects through one medium after the other: :mod:`imaging` for a batch of one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.lazy import torch
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.illumination import require_corner
from specklegen.scene.sensors import FarFieldGrid, require_resolved
from specklegen.scene.window import Profile
from specklegen.synthesis.correlations import LightBatch, Tabulated
from specklegen.synthesis.sight import Sight
from specklegen.synthesis.spectrum import LightModes
from specklegen.synthesis.streams import Streams

if TYPE_CHECKING:
    from specklegen.memory_effects.polarised_fields import PolarisedCorrelation
    from specklegen.synthesis.imaging import ImagedMedia, Imaging


MODE_TOLERANCE = 0.01
"""Share of the intensity that the modes of an object leave out, unless something else is asked for."""
_THINNED = 24
"""Points a side of the lattice on which modes are counted before they are made."""


def _host(value: ArrayLike) -> torch.Tensor:
    return torch.as_tensor(np.asarray(value, np.float64))[None]


def object_sight(
    wavelength: float, shape: tuple[int, int], pitch: float, width: float, profile: Profile, grid: FarFieldGrid, *,
    base: ArrayLike = ((0.0, 0.0),), pixel_integration: bool = False,
) -> Sight:  # fmt: skip
    """Imaging of an object of (h, w) pixels by a camera through one medium; see :func:`object_imaging`."""
    return Sight(wavelength=wavelength, profile=profile, shape=shape, camera=grid.shape, center=grid.center,
                 integrated=pixel_integration, width=_host(width), object_pitch=_host(pitch),
                 camera_pitch=_host(grid.pitch), base=_host(np.atleast_2d(np.asarray(base, np.float64))))  # fmt: skip


def expected_image(
    correlation: MemoryEffectCorrelation | PolarisedCorrelation, sight: Sight, lit: int,
    tolerance: float = MODE_TOLERANCE,
) -> tuple[dict[str, float], float]:  # fmt: skip
    """Counted operations and bytes of the first image of an object of ``lit`` bright pixels, before it is made.

    The modes are counted on a lattice of the same extent and fewer pixels, with a K as good as there is.
    """
    from specklegen.synthesis.imaging import expected_work
    from specklegen.synthesis.modes import karhunen_loeve

    with one_torch_thread():
        ((_, modes),) = karhunen_loeve(Tabulated([correlation]), sight.lattice.thinned(_THINNED), tolerance)
    return expected_work(sight, int(modes.rank[0]), modes.degree, lit)


def object_imaging(
    correlation: MemoryEffectCorrelation | PolarisedCorrelation, *, wavelength: float, object_shape: tuple[int, int],
    object_pitch: float, width: float, grid: FarFieldGrid, profile: Profile = "square", base: ArrayLike = ((0.0, 0.0),),
    light: LightModes | None = None, pixel_integration: bool = False, tolerance: float = MODE_TOLERANCE,
    device: torch.device | str = "cpu", dtype: torch.dtype | None = None,
) -> Imaging:  # fmt: skip
    """Prepare to image objects of one shape behind one material in front of one camera.

    Raise a `RuleError` if the camera undersamples the speckle, and its pixels have no area, or modes would not fit into
    memory.

    Parameters
    ----------
    correlation
        K of the material.
    wavelength, width, profile, grid
        As in :class:`Scene`.
    object_shape, object_pitch
        (h, w), and the direction sine between pixels.
    base
        float[T, 2], direction sines (x, y) of the base tilts, added to all the object's beams.
    light
        Modes of the light; by default one.
    pixel_integration
        Average the intensity over square pixels as wide as the grid's pitch, exactly; otherwise take it at
        their centres, where the grid must resolve it, pitch <= wavelength / (2 width).
    tolerance
        Share of the intensity that the modes may leave out (it is put back evenly).
    device, dtype
        Where and in what precision; complex64 (by default) or complex128.
    """
    from specklegen.synthesis.imaging import imagings

    if not pixel_integration:
        require_resolved("object_imaging grid pitch", wavelength, width, grid.pitch)
    require_corner("object_imaging", object_shape, object_pitch)
    one = lambda value: _host(value).to(device)  # noqa: E731
    sight = object_sight(
        wavelength, object_shape, object_pitch, width, profile, grid, base=base, pixel_integration=pixel_integration
    )
    if torch.device(device).type != "cpu":  # which is not asked for its cells
        sight = replace(sight.on(device), bound=sight.most_cells)
    known = None
    if light is not None:
        known = LightBatch(one(light.shares), tuple(Tabulated([k]) for k in light.correlations), one(light.flat))
    with one_torch_thread():
        ((_, imaging),) = imagings(sight, Tabulated([correlation]), known, tolerance=tolerance,
                                   precise=dtype in (torch.complex128, torch.float64))  # fmt: skip
    return imaging


def object_media(imaging: Imaging, seed: Seed, number: int = 0) -> ImagedMedia:
    """Draw one medium: a pure function of (seed, number)."""
    device = imaging.envelope.device
    keys = torch.tensor([[[stream_key(seed, Stream.STATIONARY)]]], device=device)
    still = torch.ones(1, dtype=torch.float64, device=device)
    with one_torch_thread():
        return imaging.media(Streams(keys, still, keys.new_empty((1, 1, 0))), number)
