"""Coherent objects in a scene, by the stationary sampler and that of screens: fields of all objects of one medium."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import Cost
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.samplers.sampler import FIXED_BYTES, TORCH_BYTES, Realization, Where
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.scene import Scene
from specklegen.synthesis.coherent import OneObject, wave_grid

if TYPE_CHECKING:
    import torch


class AnyObject(Protocol):
    """Draws any object behind one medium, as :class:`~specklegen.synthesis.coherent.ManyObjects` does."""

    @property
    def normals(self) -> tuple[int, ...]:
        """Shape of the noise."""
        ...

    def medium(self, white: "torch.Tensor") -> "torch.Tensor":
        """Return a medium, from noise."""
        ...

    def light(self, amplitudes: np.ndarray) -> "torch.Tensor":
        """Return the light of objects complex[T, M, M]."""
        ...

    def speckle(self, medium: "torch.Tensor", light: "torch.Tensor") -> "torch.Tensor":
        """Return fields complex64[T, H, W]."""
        ...


Drawing = Callable[[Scene], tuple[OneObject | AnyObject, np.ndarray]]
"""Scene -> what draws the speckle of its objects, and their amplitudes complex128[T, M, M]."""
_TYPICAL_MODES = 8  # of a medium that several objects see, before K is known


@dataclass(frozen=True)
class CoherentRenderer:
    """Media of a sampler under a seed, behind which a scene's coherent objects are seen.

    Attributes
    ----------
    scene : Scene
    drawing : Drawing
        Of the medium.
    seed : Seed
    """

    scene: Scene
    drawing: Drawing
    seed: Seed

    @cached_property
    def _made(self) -> "tuple[OneObject | AnyObject, torch.Tensor | None]":
        """The drawer, and the light of all objects; of one alone the drawer holds that."""
        with one_torch_thread():
            drawn_by, amplitudes = self.drawing(self.scene)
            return drawn_by, None if isinstance(drawn_by, OneObject) else drawn_by.light(amplitudes)

    def _realization(self, number: int) -> np.ndarray:
        """Fields complex64[T, H, W] of one medium, by a few transforms."""
        import torch

        from specklegen.synthesis.gaussian_noise import complex_normals

        drawn_by, light = self._made
        white = complex_normals(self.seed, number, drawn_by.normals, torch.complex64)
        with one_torch_thread():
            if isinstance(drawn_by, OneObject):
                return drawn_by.speckle(white).numpy()
            assert light is not None
            return drawn_by.speckle(drawn_by.medium(white), light).numpy()

    def media(self, count: int) -> Iterator[Realization]:
        """Fields of one medium after the other."""
        return (Realization(self._realization(number)) for number in range(count))

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """All at once."""
        image = self._realization(number)
        yield tuple(slice(0, n) for n in image.shape), image  # type: ignore[misc]


def coherent_cost(scene: Scene, once: Mapping[str, float], modes: int | None = None) -> Cost:
    """Count the operations of one realization, after those that are done ``once``.

    ``modes`` are those of a medium; of fields that are mixed cell by cell as many as there are objects.
    """
    grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
    count = len(amplitudes)
    modes = modes or (1 if count == 1 else _TYPICAL_MODES)
    size, waves = float(np.prod(grid.period)), float(len(grid.sines)) ** 2
    first = {"normal": modes * size, "flop": count * (grid.flops + 8.0 * modes * size)}
    once = {**once, "product": count * modes * len(grid.sines) * (waves + size**0.5 * len(grid.sines))}
    return Cost({name: first.get(name, 0.0) + once.get(name, 0.0) for name in first | once}, once)


def coherent_memory(scene: Scene) -> int:
    """Bytes by which the process grows at most."""
    grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
    modes = 1 if len(amplitudes) == 1 else max(4 * _TYPICAL_MODES, 2 * len(amplitudes))
    size = float(np.prod(grid.period)) * 8
    return int(size * (3 * modes * len(amplitudes) + 4) + TORCH_BYTES + FIXED_BYTES)


def coherent_mean(scene: Scene, intensity: float, depth: float) -> float:
    """Ballistic intensity of the brightest plane wave of the objects over their mean scattered intensity.

    ``intensity`` is the scattered one of a beam of unit irradiance over its area, e^-depth the unscattered share.
    """
    grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
    if scene.side < 0:  # what is not scattered does not come back
        return 0.0
    power = np.square(np.abs(amplitudes)) * (1.0 if scene.polarisers is None else abs(scene.polarisers.straight) ** 2)
    strongest = (power.max(axis=(1, 2)) / np.maximum(power.sum(axis=(1, 2)), 1e-300)).max(initial=0.0)
    return float(np.exp(-depth) * strongest * (grid.side / grid.wavelength) ** 2 / max(intensity, 1e-300))


MOST_FRAMES = 32
"""Objects and frames that are mixed cell by cell, at most."""


def coherent_obstacle(scene: Scene) -> str | None:
    """Say why the memory effect between plane waves does not serve a scene of a volume; None where it may."""
    if scene.medium.has_sides:
        return "needs a medium between two planes, where light walks sideways alike everywhere"
    close = scene.sensor.near or scene.sensor.focused
    if scene.sensor.regular_grid is None and not close:
        return "needs a regular far-field grid, a lens or points"
    if scene.side < 0 and (close or scene.film or scene.polarisers is not None):
        return "draws far fields of scalar light only, where it comes back from a medium at rest"
    if scene.film and scene.volume.flows:
        return "draws no films of coherent objects behind media that flow"
    mixed = scene.film or scene.polarisers is not None or close or scene.side < 0
    if mixed and len(scene.illumination.vectors) > MOST_FRAMES:
        return f"mixes at most {MOST_FRAMES} frames or objects"
    return None


def coherent_probe(scene: Scene) -> CollimatedBeams:
    """Return the outermost plane waves of a scene's objects, of a film at its first time and its last."""
    probe = scene.illumination.outermost(scene.wavelength)  # type: ignore[attr-defined]
    if not scene.film:
        return probe
    times, beams = np.asarray(scene.illumination.times), len(probe.directions)  # type: ignore[attr-defined]
    return probe.replace(directions=np.tile(probe.directions, (2, 1)), times=np.repeat(times[[0, -1]], beams))


def coherent_decision(scene: Scene, ratio: float, mean: bool) -> list[Decision]:
    """Say how the fields of a scene's objects come about, and what of them is ballistic."""
    light = scene.illumination
    waves = len(scene.beams.directions)
    said = Decision(
        "coherent objects", True, f"the fields of {waves} plane waves, illuminated width {scene.beams.width:.4g}, "
        f"add up, for each of {len(light.vectors)}",
    )  # fmt: skip
    reason = "asked for" if mean else "not asked for (mean=True adds it)"
    return [said, Decision("mean (ballistic) field", mean, f"{reason}: at its brightest view it has {ratio:.2g} times "
                           "the speckle's intensity")]  # fmt: skip
