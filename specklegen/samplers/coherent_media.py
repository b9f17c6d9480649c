"""Media of a recipe behind which coherent objects are seen, one after the other: noise, light, and one transform."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.most_recent import MostRecent
from specklegen.core.parallel import one_torch_thread
from specklegen.kernels import rng
from specklegen.samplers.coherent_fields import AnyObject
from specklegen.synthesis.coherent import WaveGrid, one_object

if TYPE_CHECKING:
    from specklegen.synthesis.streams import Streams

_KEPT_BYTES = 2**28  # of media that many objects see


@dataclass(frozen=True, eq=False)
class CoherentImaging:
    """Draws media of one kind; see :class:`specklegen.samplers.sampler.Imager`.

    Attributes
    ----------
    grid : WaveGrid
    divisions : int
        Views across a camera pixel, over which its intensity is averaged.
    intensity : float
        Scattered intensity of a beam of unit irradiance over its area.
    straight : complex128[M, M] or None
        Amplitude of what is not scattered of each plane wave; None where it is blocked or 0.
    walk : float64[Y, X / 2 + 1] or None
        K of one object's light, where every medium is seen once.
    many : AnyObject or None
        Draws media that many objects see: their modes, or the phases of screens.
    shared : bool
        Whether media are worth keeping.
    """

    grid: WaveGrid
    divisions: int
    intensity: float
    straight: np.ndarray | None
    walk: np.ndarray | None = None
    many: AnyObject | None = None
    shared: bool = False
    _kept: MostRecent[tuple, Any] = field(default_factory=lambda: MostRecent(_KEPT_BYTES, 4096))

    def __len__(self) -> int:
        return 1

    def at(self, places: object) -> "CoherentImaging":  # noqa: ARG002 - there is one
        """Return the one imaging."""
        return self

    def media(self, streams: "Streams") -> "CoherentMedia":
        """Draw one medium."""
        (key,) = streams.keys[:, 0, 0].tolist()
        return CoherentMedia(self, tuple(key))

    def contrast(self, light: "torch.Tensor", media: object = None) -> "torch.Tensor":  # noqa: ARG002
        """Contrast 1 of fields that add."""
        return torch.ones(len(light), dtype=torch.float64, device=light.device)


@dataclass(frozen=True, eq=False)
class CoherentMedia:
    """One medium.

    Attributes
    ----------
    imaging : CoherentImaging
    key : (int, int)
        Of its noise.
    """

    imaging: CoherentImaging
    key: tuple[int, ...]

    def __len__(self) -> int:
        return 1

    @property
    def seeds(self) -> tuple[tuple[int, ...], ...]:
        """Key of the noise: there is one polarisation."""
        return (self.key,)

    def images(self, light: "torch.Tensor") -> "torch.Tensor":
        """Refuse objects whose intensities add."""
        raise NotImplementedError("coherent media superpose plane waves")

    def superposed(self, amplitudes: "torch.Tensor", step: float) -> "torch.Tensor":  # noqa: ARG002 - the grid has it
        """Image real[B, 1, H, W], B = 1, of plane waves complex[B, M, M], over their mean scattered intensity."""
        own = self.imaging
        waves = amplitudes[0].cpu().numpy()
        with one_torch_thread():
            if own.many is not None:
                medium = own._kept.get(self.key, self._medium) if own.shared else self._medium()
                speckle = own.many.speckle(medium, own.many.light(waves[None]))[0]
            else:
                assert own.walk is not None
                alone = one_object(own.grid, waves, own.walk, own.intensity)
                speckle = alone.speckle(self._noise(alone.normals))[0]
            if own.straight is not None:
                ballistic = own.grid.far_field(torch.from_numpy(own.grid.field(waves * own.straight)))
                speckle = speckle + ballistic * (own.grid.area / own.grid.wavelength)
        power = torch.view_as_real(speckle).square().sum(-1)
        n, (rows, columns) = own.divisions, own.grid.shape
        if n > 1:
            power = power.reshape(rows // n, n, columns // n, n).mean((1, 3))
        mean = own.intensity * own.grid.side**2 * float(np.square(np.abs(waves)).sum())
        return (power / (mean or 1.0))[None, None].to(amplitudes.device)

    def _medium(self) -> "torch.Tensor":
        assert self.imaging.many is not None
        return self.imaging.many.medium(self._noise(self.imaging.many.normals))

    def _noise(self, shape: tuple[int, ...]) -> "torch.Tensor":
        pairs = np.empty((int(np.prod(shape)), 2), np.float32)
        rng.fill_normals(*self.key, 0, pairs)
        return torch.view_as_complex(torch.from_numpy(pairs).mul_(0.5**0.5)).reshape(shape)


def straight_waves(
    grid: WaveGrid, depth: float, thickness: float, intensity: float, faint: float = 1e-4
) -> np.ndarray | None:
    """Return e^(-depth / 2 cos) e^(ik thickness (cos - 1)) complex128[M, M]; None where nothing is seen of it."""
    if np.exp(-depth) * (grid.side / grid.wavelength) ** 2 < faint * intensity:
        return None
    square = np.square(grid.sines) + np.square(grid.sines)[:, None]
    cosines = np.sqrt(np.clip(1 - square, 1e-12, None))
    phase = -2j * np.pi / grid.wavelength * thickness * square / (1 + cosines)
    return np.exp(phase - 0.5 * depth / cosines)
