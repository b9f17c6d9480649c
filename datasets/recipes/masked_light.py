"""Recipe kind "masked-light": speckle of coherent light through a mask, of slits, a star or grey, in front of a slab.

Light that passes an opening of the square window of side W is a Fourier series of beams,

    u(x) = sum_m a_m e^{i xi_m . x},   xi_m = 2 pi m / W,   a_m = Psi(xi_m) / W^2 e^{iz sqrt(k^2 - xi_m^2)},

exactly, with the aperture operator Psi (`specklegen.wavetracing.aperture_transform`) and z the distance from mask to
slab. The light on the mask is even, or a Gaussian laser's at its waist. The beams of the recipe's lattice are kept;
what share of the light they carry is among the parameters.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.units import LENGTH, RADIAN
from specklegen.core.values import IDENTITY, NonNegative, Positive, PositiveInt, Value
from specklegen.datasets.distributions import Choice, Draw, drawn, ends, require_above
from specklegen.datasets.recipes.grey_mask import GreyMask
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.partially_coherent import lattice_media
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, generator, substream
from specklegen.kernels.coverage import fill_coverage
from specklegen.scene.media import Slab

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials


class Outlined(Value):
    """A mask that is open inside of loops, and dark outside."""

    def loops(self, numbers: Mapping[str, float]) -> list[np.ndarray]:
        """Corners float64[n, 2] of each opening, counter-clockwise, in sides of the window about its middle."""
        raise NotImplementedError

    def waves(self, numbers: Mapping[str, float], order: np.ndarray, waist: float | None) -> tuple[np.ndarray, float]:
        """See :meth:`GreyMask.waves`."""
        return loop_waves(self.loops(numbers), order, waist)

    def picture(self, numbers: Mapping[str, float], pixels: int) -> np.ndarray:
        """Open share of each pixel of the window, float32[pixels, pixels]."""
        loops = self.loops(numbers)
        edges, covered = [np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in loops], np.empty((pixels, pixels))
        fill_coverage((np.concatenate(edges) + 0.5) * pixels, covered)
        return covered.astype(np.float32)


class Slits(Outlined):
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
    turn: Annotated[Draw, RADIAN] = 0.0

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
            reject("Slits", "within the illuminated area at any rotation: a diagonal below 1",
                   float(np.hypot(across, length)))  # fmt: skip
        return self

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """One mask's numbers."""
        names = ("count", "width", "gap", "length", "turn")
        return {f"slit_{name}": float(drawn(getattr(self, name), rng)) for name in names}

    def loops(self, numbers: Mapping[str, float]) -> list[np.ndarray]:
        """Corners of every slit, see :func:`slit_loops`."""
        return slit_loops(numbers)

    def area(self, numbers: Mapping[str, float]) -> float:
        """Open share of the window."""
        return numbers["slit_count"] * numbers["slit_width"] * numbers["slit_length"]


class Star(Outlined):
    """One star about the middle of the window; all numbers may vary from sample to sample.

    Parameters
    ----------
    points
        Whole numbers of at least 3.
    radius
        Of the points, in sides of the window.
    inner
        Radius of the corners between them, over that of the points: below 1.
    turn
        Angle from the x axis to the first point, radians.
    """

    points: Draw
    radius: Draw
    inner: Draw
    turn: Annotated[Draw, RADIAN] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        numbers = self.points.choice if isinstance(self.points, Choice) else ends(self.points)
        if any(number != int(number) or number < 3 for number in numbers) or (
            not isinstance(self.points, Choice) and numbers[0] != numbers[1]
        ):
            reject("Star.points", "a whole number of at least 3, or a choice of such", self.points)
        for name, most in (("radius", 0.5), ("inner", 1.0)):
            require_above(f"Star.{name}", getattr(self, name), 0)
            if not ends(getattr(self, name))[1] < most:
                reject(f"Star.{name}", f"below {most:g}", getattr(self, name))
        return self

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """One mask's numbers."""
        names = ("points", "radius", "inner", "turn")
        return {f"star_{name}": float(drawn(getattr(self, name), rng)) for name in names}

    def loops(self, numbers: Mapping[str, float]) -> list[np.ndarray]:
        """Corners float64[2 points, 2], counter-clockwise, in sides of the window about its middle."""
        count = 2 * int(numbers["star_points"])
        angle = numbers["star_turn"] + 2 * np.pi * np.arange(count) / count
        radius = numbers["star_radius"] * np.where(np.arange(count) % 2, numbers["star_inner"], 1.0)
        return [radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)]

    def area(self, numbers: Mapping[str, float]) -> float:
        """Open share of the window."""
        points = numbers["star_points"]
        return points * numbers["star_radius"] ** 2 * numbers["star_inner"] * float(np.sin(np.pi / points))


def slit_loops(numbers: Mapping[str, float]) -> list[np.ndarray]:
    """Corners float64[4, 2] of every slit, counter-clockwise, in sides of the window about its middle."""
    count, width, gap, length, turn = (numbers[f"slit_{n}"] for n in ("count", "width", "gap", "length", "turn"))
    middles = (np.arange(int(count)) - (count - 1) / 2) * (width + gap)
    corner = np.array([[-width, -length], [width, -length], [width, length], [-width, length]]) / 2
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return [(corner + [x, 0]) @ turned for x in middles]


def loop_waves(loops: list[np.ndarray], order: np.ndarray, waist: float | None) -> tuple[np.ndarray, float]:
    """Transform complex128[n, n] of light in loops, and the power that passes; see :meth:`GreyMask.waves`."""
    from specklegen.wavetracing import aperture_transform
    from specklegen.wavetracing.angular_spectrum import quadrature
    from specklegen.wavetracing.opening import rim_of

    rim = rim_of("MaskedLight.mask", loops)
    if waist is None:
        return aperture_transform(rim, 2 * np.pi * np.stack(np.meshgrid(order, order), axis=-1)), rim.area
    points, weights = quadrature(rim.triangles, min(1 / len(order), waist))
    beam = np.exp(-np.square(points / waist).sum(axis=1))
    x, y = np.exp(-2j * np.pi * order[None, :, None] * points.T[:, None])
    return (y * (weights * beam)) @ x.T, float(weights @ beam**2)


def _kind_of_mask(given: Any) -> str:
    """Return which mask a table stands for: a grey one names its transmission, a star has points."""
    if isinstance(given, Mapping):
        return "grey" if given.keys() & {"path", "values", "transmission"} else "star" if "points" in given else "slits"
    return "grey" if isinstance(given, GreyMask) else "star" if isinstance(given, Star) else "slits"


class MaskedLight(Recipe):
    """Camera images of the speckle of coherent light through a mask, mean 1 over their expected intensity.

    Samples: ``image`` float32[H, W] (or uint16 counts), ``mask`` float32[h, w], the share of the intensity that each
    pixel of the window lets through, rows y and columns x from the smallest.

    Parameters
    ----------
    mask
        `Slits`, a `Star`, or a `GreyMask` of a picture or an array.
    distance
        From the mask to the slab, in its medium.
    waist
        Radius of a Gaussian laser whose waist lies on the middle of the mask, where its intensity is e^-2 of that on
        the axis; at least the window's width over ``beams``. By default the light is even.
    exit_radius
        Radius of a round aperture about the axis on the slab's exit face; may vary from sample to sample. By default
        the whole face is seen.
    beams
        Along each axis, odd: waves of up to (beams - 1) / 2 periods across the window are kept.
    pixels
        Of the mask's picture along each axis.
    """

    kind: Literal["masked-light"] = "masked-light"
    mask: Annotated[
        Annotated[Slits, Tag("slits")] | Annotated[Star, Tag("star")] | Annotated[GreyMask, Tag("grey")],
        Discriminator(_kind_of_mask),
    ]  # fmt: skip
    distance: Annotated[NonNegative, LENGTH] = 0.0
    waist: Annotated[Positive, LENGTH] | None = None
    exit_radius: Annotated[Draw, LENGTH] | None = None
    beams: Annotated[int, Field(ge=1, le=101)] = 15
    pixels: PositiveInt = 64
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _one_wave(self) -> Self:
        if self.beams % 2 == 0:
            reject("MaskedLight.beams", "odd: one beam along the axis, and equally many on both sides", self.beams)
        if self.lab is not None or self.light.bandwidth:
            reject("MaskedLight.light", "of one wavelength, with material.wavelength instead of a table lab",
                   self.light)
        if self.profile != "square":
            reject("Window.profile", '"square", on which a mask is a Fourier series', self.profile)
        if self.waist is not None and self.waist * self.beams < self.geometry.width:
            least = f"at least window.width / beams = {self.geometry.width / self.beams:.4g}"
            reject("MaskedLight.waist", least, self.waist,
                   "Waves of so few periods make no narrower beam: narrow the window, or take more beams.")
        least = self.wavelength / (2 * self.geometry.grid.pitch * min(self.camera_shape))
        if self.exit_radius is not None and not ends(self.exit_radius)[0] >= least:
            reject("MaskedLight.exit_radius", f"at least {least:.4g}, behind which a grain fills the camera",
                   self.exit_radius, "Widen the aperture, or take a camera of more pixels.")  # fmt: skip
        if not (self.beams - 1) / np.sqrt(2) * self.step < self._k:
            reject("MaskedLight.beams", "few enough that their sines are below 1", self.beams, "Widen the window.")
        return self

    def physics(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Everything that decides a pixel; the picture of a grey mask counts by its content, not by its path."""
        decided = super().physics(context)
        return decided | {"mask": self.mask.identity(context)} if isinstance(self.mask, GreyMask) else decided

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
                description="open share of the illuminated area in front of the slab, from the smallest y and x",
            ),
            "parameters": PARAMETERS,
        }  # fmt: skip

    def split_notes(self) -> str:
        """Say what the splits share, in Markdown sentences for the data card."""
        return f"{super().split_notes()} Masks of all splits are drawn from the same ranges, independently."

    def view(self, slab: Slab) -> MediumView:
        """One medium under the lattice of beams."""
        pitch = self.wavelength / self.geometry.width
        return MediumView(slab, self.geometry, (self.beams, self.beams), pitch, np.zeros((1, 2)))

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, under all beams."""
        return [self.view(slab) for slab in self.material.extremes()]

    def seen_media(self, drawn: "Addresses", numbers: Sequence[int],
                   materials: "Materials") -> DrawnMedia:  # noqa: ARG002
        """Media under the lattice of beams."""
        return lattice_media(
            self, drawn, materials, (self.beams, self.beams), self.wavelength / self.geometry.width
        )  # fmt: skip

    def amplitudes(self, loops: list[np.ndarray]) -> np.ndarray:
        """Amplitudes complex128[beams, beams] on the slab, rows y, of light through a mask, 1 on the axis.

        ``loops`` in sides of the window, as of :func:`slit_loops`.
        """
        return self._behind(loop_waves(loops, *self._lattice)[0])

    def _behind(self, waves: np.ndarray) -> np.ndarray:
        """Amplitudes on the slab, of those on the mask."""
        order, _ = self._lattice
        xi = 2 * np.pi * np.stack(np.meshgrid(order, order), axis=-1)  # over the window's side
        along = np.sqrt(self._k**2 - np.square(xi).sum(axis=-1) / self.geometry.width**2)
        # The phase of the beam along the axis is that of all, and is left out.
        return waves * np.exp(1j * self.distance * (along - self._k))

    @property
    def _lattice(self) -> tuple[np.ndarray, float | None]:
        """Periods of the beams across the window, float[beams], and the laser's waist over its width."""
        waist = None if self.waist is None else self.waist / self.geometry.width
        return np.arange(self.beams) - (self.beams - 1) // 2, waist

    def host_work(self) -> list[str]:
        """Parts made on the host, masks among it."""
        return [*super().host_work(), "masks, and the waves behind them"]

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> Lit:
        """Waves through masks, their pictures, and what was drawn of them."""
        streams = [generator(substream(drawn.seed, drawn.split, Purpose.OBJECT, n)) for n in numbers]
        masks = [self.mask.drawn(rng) for rng in streams]
        waves, passed = map(np.stack, zip(*(self.mask.waves(each, *self._lattice) for each in masks), strict=True))
        waves = self._behind(waves)
        put = lambda rows: torch.from_numpy(np.asarray(rows)).to(drawn.device)  # noqa: E731
        area = np.array([self.mask.area(each) for each in masks])
        parameters = {name: put([each[name] for each in masks]) for name in masks[0]}
        passed = area if self.waist is None else passed
        carried = np.array([float(np.square(np.abs(own)).sum()) for own in waves]) / passed
        parameters |= {"open_share": put(area), "carried_share": put(carried)}
        pictures = np.stack([self.mask.picture(each, self.pixels) for each in masks])
        radius = None
        if self.exit_radius is not None:
            radius = parameters["exit_radius"] = put([_opening(self.exit_radius, rng) for rng in streams])
        return Lit(put(waves), self.step, parameters, {"mask": put(pictures)}, radius)

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """One image."""
        return {"image": images[:, 0]}


def _opening(radius: Draw, rng: np.random.Generator) -> float:
    """Radius of one sample's aperture, drawn after its mask."""
    return float(drawn(radius, rng))
