"""Recipe kind "masked-light": speckle of coherent light through a mask of slits in front of a slab.

Light that passes an opening of the square window of side W is a Fourier series of beams,

    u(x) = sum_m a_m e^{i xi_m . x},   xi_m = 2 pi m / W,   a_m = Psi(xi_m) / W^2 e^{iz sqrt(k^2 - xi_m^2)},

exactly, with the aperture operator Psi (`specklegen.wavetracing.aperture_transform`) and z the distance from mask to
slab. The beams of the recipe's lattice are kept; what share of the light they carry is among the parameters.
"""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import NonNegative, PositiveInt, Value, remembered
from specklegen.datasets.recipes.medium_realization import MediumRealization, medium_realization
from specklegen.datasets.recipes.parts.distributions import Choice, Draw, drawn, ends, require_above
from specklegen.datasets.recipes.parts.light import draw_medium
from specklegen.datasets.recipes.recipe import PARAMETERS, Recipe
from specklegen.datasets.recipes.rendering import MediumView, realization
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.kernels.coverage import fill_coverage
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.scene.media import Slab
from specklegen.wavetracing import aperture_transform


class Slits(Value):
    """Parallel slits about the middle of the window; all numbers may vary from sample to sample.

    Parameters
    ----------
    count
        Whole numbers.
    width, gap, length
        Of a slit, between two, and along them: shares of the window's side.
    turn
        Angle from the x axis to the direction across the slits, radians.
    """

    count: Draw = 2.0
    width: Draw
    gap: Draw
    length: Draw
    turn: Draw = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("width", "gap", "length"):
            require_above(f"Slits.{name}", getattr(self, name), 0)
        numbers = self.count.choice if isinstance(self.count, Choice) else ends(self.count)
        if any(number != int(number) or number < 1 for number in numbers) or (
            not isinstance(self.count, Choice) and numbers[0] != numbers[1]
        ):
            reject("Slits.count", "a whole number of at least 1, or a choice of such", self.count)
        count, width, gap, length = (ends(getattr(self, name))[1] for name in ("count", "width", "gap", "length"))
        across = count * width + (count - 1) * gap
        if not np.hypot(across, length) < 1:
            reject("Slits", "within the window, however turned: a diagonal below 1", float(np.hypot(across, length)))
        return self

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """One mask's numbers."""
        names = ("count", "width", "gap", "length", "turn")
        return {f"slit_{name}": float(drawn(getattr(self, name), rng)) for name in names}


def slit_loops(numbers: Mapping[str, float]) -> list[np.ndarray]:
    """Corners float64[4, 2] of every slit, counter-clockwise, in sides of the window about its middle."""
    count, width, gap, length, turn = (numbers[f"slit_{n}"] for n in ("count", "width", "gap", "length", "turn"))
    middles = (np.arange(int(count)) - (count - 1) / 2) * (width + gap)
    corner = np.array([[-width, -length], [width, -length], [width, length], [-width, length]]) / 2
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return [(corner + [x, 0]) @ turned for x in middles]


class MaskedLight(Recipe):
    """Camera images of the speckle of coherent light through a mask, mean 1 over their expected intensity.

    Samples: ``image`` float32[H, W] (or uint16 counts), ``mask`` float32[h, w], the open share of each pixel of the
    window, rows y and columns x from the smallest.

    Parameters
    ----------
    mask
        The slits.
    distance
        From the mask to the slab, in its medium.
    beams
        Along each axis, odd: waves of up to (beams - 1) / 2 periods across the window are kept.
    pixels
        Of the mask's picture along each axis.
    """

    kind: Literal["masked-light"] = "masked-light"
    mask: Slits
    distance: NonNegative = 0.0
    beams: Annotated[int, Field(ge=1, le=101)] = 15
    pixels: PositiveInt = 64
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _one_wave(self) -> Self:
        if self.beams % 2 == 0:
            reject("MaskedLight.beams", "odd: one along the axis, and as many on either side", self.beams)
        if self.lab is not None or self.light.bandwidth:
            reject("MaskedLight.light", "of one wavelength, in the engine's terms", self.light)
        if self.profile != "square":
            reject("Window.profile", '"square", on which a mask is a Fourier series', self.profile)
        if not (self.beams - 1) / np.sqrt(2) * self.step < self._k:
            reject("MaskedLight.beams", "few enough to travel: sines below 1", self.beams, "Widen the window.")
        return self

    @property
    def _k(self) -> float:
        return 2 * np.pi / self.wavelength

    @property
    def step(self) -> float:
        """Transverse wave number between neighbouring beams."""
        return 2 * np.pi / self.geometry.width

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        return {
            "image": self.observation(self.camera_shape, ("y", "x"), "camera image"),
            "mask": ArraySpec(
                shape=(self.pixels, self.pixels), dtype="float32", dims=("mask_y", "mask_x"),
                description="open share of the window in front of the slab, from the smallest y and x",
            ),
            "parameters": PARAMETERS,
        }  # fmt: skip

    def split_notes(self) -> str:
        """What the splits share and what they do not, in Markdown sentences for the data card."""
        return f"{super().split_notes()} Masks of all splits are drawn from the same ranges, independently."

    def view(self, slab: Slab) -> MediumView:
        """One medium under the lattice of beams."""
        pitch = self.wavelength / self.geometry.width
        return MediumView(slab, self.geometry, (self.beams, self.beams), pitch, np.zeros((1, 2)))

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, under all beams."""
        return [self.view(slab) for slab in self.material.extremes()]

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, for light of every mask."""
        material = self.material_of(seed, split, medium)
        view = self.view(material.slab)
        parameters = material.parameters(self.wavelength) | {
            "width": self.geometry.width,
            "camera_pitch": self.geometry.grid.pitch,
        }
        media = lambda made: [draw_medium(self.light, made, seed, split, medium)]  # noqa: E731
        sampler = partial(_sampler, self, material.slab)
        return realization(self, view, sampler, media, parameters, (seed, split, medium), share=False)

    def amplitudes(self, loops: list[np.ndarray]) -> np.ndarray:
        """Amplitudes complex128[beams, beams] on the slab, rows y, of light of amplitude 1 through a mask.

        ``loops`` as of :func:`slit_loops`.
        """
        order = np.arange(self.beams) - (self.beams - 1) // 2
        xi = 2 * np.pi * np.stack(np.meshgrid(order, order), axis=-1)  # over the window's side
        along = np.sqrt(self._k**2 - np.square(xi).sum(axis=-1) / self.geometry.width**2)
        # The phase of the beam along the axis is that of all, and is left out.
        return aperture_transform(loops, xi) * np.exp(1j * self.distance * (along - self._k))

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One image with its mask and parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        medium = self.medium_number(index)
        numbers = self.mask.drawn(generator(substream(seed, which, Purpose.OBJECT, index)))
        loops = slit_loops(numbers)
        waves = self.amplitudes(loops)
        ready = medium_realization(self, seed, which, medium)
        area = numbers["slit_count"] * numbers["slit_width"] * numbers["slit_length"]
        return {
            "image": self.observed(ready.superposed(waves, self.step)[None], seed, which, index)[0],
            "mask": _picture(loops, self.pixels),
            "index": np.int64(index),
            "parameters": {
                **ready.parameters,
                **numbers,
                "open_share": area,
                "carried_share": float(np.square(np.abs(waves)).sum()) / area,
                "expected_contrast": ready.contrast,
                "medium": float(medium),
            },
        }


def _picture(loops: list[np.ndarray], pixels: int) -> np.ndarray:
    """Open share of each pixel of the window, float32[pixels, pixels]."""
    ends_ = [np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in loops]
    covered = np.empty((pixels, pixels))
    fill_coverage((np.concatenate(ends_) + 0.5) * pixels, covered)
    return covered.astype(np.float32)


@remembered(8)
def _sampler(recipe: MaskedLight, slab: Slab) -> ObjectSampler:
    view = recipe.view(slab)
    material = recipe.material.known(slab)
    return recipe.object_sampler(material, view.seen, view.shape, view.pitch, np.zeros((1, 2)), recipe.mode_tolerance)
