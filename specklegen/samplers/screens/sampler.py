"""The screens sampler: Gaussian fields, correlated in closed form, under an envelope about each beam."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import WAVE, Cost
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.paths.gaussianity import DRAWN, EXACT, Gaussianity
from specklegen.samplers.coherent_fields import CoherentRenderer, coherent_cost, coherent_memory
from specklegen.samplers.sampler import (
    FIXED_BYTES,
    TORCH_BYTES,
    Abilities,
    MediaRequest,
    MediaSampler,
    Realization,
    Request,
    Where,
)
from specklegen.samplers.screens.correlation import Envelope, drifts, envelope, screen_correlation, tabulated
from specklegen.samplers.screens.drawn import drawn_cost, drawn_memory
from specklegen.samplers.screens.rule import screens_decision
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.drawn_screens import drawn_scene
from specklegen.synthesis.exit_grid import fft_flops, matrix_flops, stack_axes
from specklegen.theory.phase_screens import scattered_intensity

if TYPE_CHECKING:
    import torch

    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.stacks import StackSampler


@dataclass(frozen=True)
class Screens(MediaSampler, name="screens"):
    """The screens sampler of a scene; see :class:`specklegen.samplers.sampler.Sampler`.

    Attributes
    ----------
    streamed : bool
        Whether the stack comes tilt by tilt.
    drawn : bool
        Whether phases are drawn, of coherent objects that light few correlation lengths.
    """

    scene: Scene
    streamed: bool
    drawn: bool = False

    summation = "FFT or matrix products"
    error_of = "intensity scale, which is exact"
    abilities = Abilities(media="thin")

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """The sampler of a scene with thin screens; None for any other."""
        serves, decision = screens_decision(scene, request)
        return (cls(scene, request.streamed), [decision]) if serves else (None, [])

    @property
    def stack(self) -> ScreenStack:
        """The screens."""
        stack = self.scene.thin
        assert stack is not None
        return stack

    @cached_property
    def moved(self) -> np.ndarray | None:
        """Displacement of each screen at each beam, float64[T, M, 2]; None if all are at rest."""
        times = self.scene.beams.times
        return None if times is None else self.stack.moved(times)

    @cached_property
    def drift(self) -> np.ndarray | None:
        """Shift of the pattern at each beam, float64[T, 2], about the middle of the film."""
        if self.moved is None:
            return None
        shifts = drifts(self.stack, self.scene.wavelength, self.moved)
        return shifts - (shifts.min(axis=0, initial=np.inf) + shifts.max(axis=0, initial=-np.inf)) / 2

    @property
    def intensity(self) -> float:
        """Largest mean intensity."""
        return scattered_intensity(self.scene)

    @property
    def gaussianity(self) -> Gaussianity:  # type: ignore[override]
        """Gaussian, unless phases are drawn."""
        return DRAWN if self.drawn else EXACT

    def cost(self) -> Cost:
        """Count the operations of one stack."""
        if self.drawn:
            return drawn_cost(self.scene)
        if self.scene.illumination.focused:
            return coherent_cost(self.scene, {}, 1 if len(self.stack.screens) == 1 else None)
        x, y = stack_axes(self._beams, self.drift)
        tilts, views, size = len(self.scene.beams.directions), np.prod(self.scene.sensor.shape), x.count * y.count
        transform = min(matrix_flops(x, y, self._grid.shape), fft_flops(x, y))
        first = {
            "normal": tilts * size,
            "flop": tilts * ((8.0 * tilts + WAVE) * size + transform),
            "stack view": tilts * (3 * views + 4.0 * size),
            "envelope": tilts * float(views),
            "lobe": tilts * float(tabulated(self.stack, self.scene.wavelength)),
        }
        return Cost(first, {} if self.streamed else {name: first[name] for name in ("envelope", "lobe")})

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
        if self.drawn:
            return drawn_memory(self.scene)
        if self.scene.illumination.focused:
            return coherent_memory(self.scene)
        held = 1 if self.streamed else len(self.scene.beams.directions)
        return int(8 * float(np.prod(self.scene.sensor.shape)) * held * 8 + TORCH_BYTES + FIXED_BYTES)

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imaging]]":
        """Make media ready: fields as of a slab, under the envelope that each beam carries."""
        if request.waves is not None:
            from specklegen.samplers.screens.coherent import coherent_imagings

            return coherent_imagings(request, drawn=self.drawn)  # type: ignore[return-value]
        from specklegen.samplers.screens.objects import screen_imagings

        return screen_imagings(request)

    def prepare(self, seed: Seed, threads: int | None) -> "ScreensRenderer | CoherentRenderer":
        """Make ready to draw."""
        if self.scene.illumination.focused:
            from specklegen.samplers.screens.coherent import gaussian_scene

            return CoherentRenderer(self.scene, drawn_scene if self.drawn else gaussian_scene, seed)
        return ScreensRenderer(self, seed)

    @property
    def _grid(self) -> FarFieldGrid:
        return self.scene.grid

    @property
    def _beams(self) -> Scene:
        """The scene with an object's beams for the object."""
        return self.scene.replace(illumination=self.scene.beams)


@dataclass(frozen=True)
class ScreensRenderer:
    """Media of the screens sampler under a seed."""

    sampler: Screens
    seed: Seed

    @cached_property
    def stacks(self) -> "StackSampler":
        """Sampler that draws F of every beam."""
        from specklegen.synthesis.stacks import stack_sampler

        scene = self.sampler._beams
        correlation = replace(screen_correlation(self.sampler.stack, scene.wavelength), moved=self.sampler.moved)
        return stack_sampler(scene, correlation, drift=self.sampler.drift)

    def media(self, count: int) -> Iterator[Realization]:
        """One transform each."""
        light = self.sampler.scene.illumination
        for number in range(count):
            if not light.coherent:
                shape = self.sampler.scene.sensor.shape
                total = np.zeros((len(light.shares), *shape), np.float32)
                for shares, (_, field) in zip(light.shares.T, self.fields(number), strict=True):
                    power = np.square(field[0].real) + np.square(field[0].imag)
                    for image in np.flatnonzero(shares):
                        total[image] += np.float32(shares[image]) * power
                yield Realization(total.reshape(*light.images, *shape))
            else:
                yield Realization(np.concatenate([field for _, field in self.fields(number)]))

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Tilt by tilt: the noise is held, no stack."""
        rows, columns = self.sampler.scene.sensor.shape
        with one_torch_thread():
            white = self.stacks.white(self.seed, number)
        for t in range(len(self.stacks.shifts)):
            with one_torch_thread():
                field = self._field(white, t)
            yield (slice(t, t + 1), slice(0, rows), slice(0, columns)), field

    def _field(self, white: "torch.Tensor", t: int) -> np.ndarray:
        tilt, gain = slice(t, t + 1), self._envelope(t)
        field = self.stacks.fields(white, tilt).numpy() * gain.direct
        if gain.mirrored is not None:
            field = field + self.stacks.fields(white.conj(), tilt).numpy() * gain.mirrored
        return field.astype(np.complex64)

    def _envelope(self, t: int) -> Envelope:
        """Envelope of tilt t; kept unless the stack comes tilt by tilt, as all of them take the stack's own memory."""
        if t in self._envelopes:
            return self._envelopes[t]
        scene, beam = self.sampler.scene, slice(t, t + 1)
        views = self.sampler._grid.directions
        drift = None if self.sampler.drift is None else self.sampler.drift[beam]
        tilt_envelope = envelope(self.sampler.stack, scene.wavelength, scene.beams.directions[beam], views, drift)
        if not self.sampler.streamed:
            self._envelopes[t] = tilt_envelope
        return tilt_envelope

    @cached_property
    def _envelopes(self) -> dict[int, Envelope]:
        return {}
