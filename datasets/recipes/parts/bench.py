"""Unknown differences between setups: the table ``[bench]`` of a recipe with hidden objects.

A network that is trained on one camera, one aperture and one focus learns these too. Here each is drawn anew (Tobin et
al., IROS 2017: domain randomisation), for every sample, aperture and polarisation for every medium:

    object   turned and magnified, as the camera shows it; the ``object`` of the sample is the one that appears
    light    the mean of the pattern along the way that it drifts within the exposure, blurred by a Gaussian;
             (1 - stray) of it over a gradient of brightness, and the share ``stray`` of even light
    camera   pixels of unequal sensitivity; one of several cameras, its exposure chosen by how full pixels are

Light is filtered with the frame mirrored at its edges, so that a margin of four sigma and half the drift holds a little
less contrast than the rest. Sources of the ranges that the package brings stand in their files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.random_streams import Stream
from specklegen.core.units import DEGREE
from specklegen.core.values import Value
from specklegen.datasets.distributions import Draw, Uniform, ends
from specklegen.datasets.split import Purpose
from specklegen.instrument.camera import AnyCamera, Camera
from specklegen.kernels.quantiles import add_normal

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.parts import exposure
else:
    exposure = LazyModule("specklegen.datasets.recipes.parts.exposure")

_RULES = {
    "rotation": (-180.0, 180.0), "magnification": (0.5, 2.0), "aperture": (0.5, 2.0), "polarisation": (0.0, 1.0),
    "blur": (0.0, 8.0), "drift": (0.0, 16.0), "gradient": (0.0, 0.95), "stray": (0.0, 0.95), "unevenness": (0.0, 0.3),
    "brightness": (1e-4, 1.0),
}  # fmt: skip
_MARGIN = 4.0  # sigmas of the blur
_PER_SAMPLE = ("rotation", "magnification", "blur", "drift", "gradient", "stray", "unevenness", "brightness")
_PLACES = ("drift_angle", "gradient_angle", "camera")


class Bench(Value):
    """Differences between setups; every number is a constant, a range or a choice.

    Parameters
    ----------
    rotation
        Of the camera about its axis, degrees: the object appears turned by it.
    magnification
        Of the object on the camera, over what is said; what leaves the object's frame is cut off.
    aperture
        Width of the window over what is said: ``width`` among the parameters stays as it is said.
    polarisation
        Degree of polarisation of the light at the camera: 1 behind an analyser, 0 of depolarised light without one.
    blur
        Standard deviation of a Gaussian blur, camera pixels.
    drift
        Way that the pattern moves within the exposure, evenly, camera pixels.
    gradient
        Brightness falls by this share of the mean from the middle to the darker edge, in any direction.
    stray
        Share of the light that is even, and shows no image.
    unevenness
        Standard deviation of the pixels' sensitivity; a pattern of its own for every sample.
    cameras
        One is drawn for each sample, in place of ``exposure``, whose counts must be of the same kind.
    brightness
        Mean light over what saturates the drawn camera: in place of its ``photons``.

    Raises
    ------
    RuleError
        For a number outside of what is modelled.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> recipe = load_recipe("through-slab", {"bench": {"blur": {"uniform": [0.0, 1.0]}}})
    >>> bool(0 < recipe.sample(0, "train", 0)["parameters"]["bench_blur"] < 1)
    True
    """

    rotation: Annotated[Draw, DEGREE] = 0.0
    magnification: Draw = 1.0
    aperture: Draw = 1.0
    polarisation: Draw = 1.0
    blur: Draw = 0.0
    drift: Draw = 0.0
    gradient: Draw = 0.0
    stray: Draw = 0.0
    unevenness: Draw = 0.0
    cameras: tuple[AnyCamera, ...] = ()
    brightness: Draw = 0.1

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name, (low, high) in _RULES.items():
            smallest, largest = ends(getattr(self, name))
            if not low <= smallest <= largest <= high:
                reject(f"Bench.{name}", f"from {low:g} to {high:g}", getattr(self, name))
        if any(type(camera) is not Camera or camera.oversampling != 1 for camera in self.cameras):
            names = [type(camera).__name__ for camera in self.cameras]
            reject("Bench.cameras", "plain cameras without oversampling", names,
                   "Give Camera values with oversampling = 1; other cameras go into [exposure].")  # fmt: skip
        if any(math.isinf(camera.saturation) for camera in self.cameras):
            reject("Bench.cameras", "cameras that saturate", "neither full_well nor bit_depth",
                   "Give one of them: brightness is a share of the saturation level.")  # fmt: skip
        return self

    @property
    def polarises(self) -> bool:
        """True if some light is depolarised."""
        return ends(self.polarisation)[0] < 1

    @property
    def host_work(self) -> list[str]:
        """Parts made on the host, whatever the device, in words."""
        return ["the sensitivity of pixels"] if _moves(self.unevenness, 0.0) else []

    def of_media(self, drawn: Addresses, numbers: Sequence[int]) -> tuple[torch.Tensor, torch.Tensor]:
        """Aperture and degree of polarisation float64[M] of media."""
        aperture, degree = drawn.numbers(Purpose.BENCH_OF_MEDIUM, (self.aperture, self.polarisation), numbers)
        return aperture, degree

    def of_samples(self, drawn: Addresses, numbers: Sequence[int]) -> dict[str, torch.Tensor]:
        """Draw the numbers float64[B] of samples by name, angles in radians, and which camera."""
        sources = [getattr(self, name) for name in _PER_SAMPLE]
        rows = drawn.numbers(Purpose.BENCH, [*sources, *(Uniform(uniform=(0.0, 1.0)) for _ in _PLACES)], numbers)
        settings: dict[str, torch.Tensor] = dict(zip((*_PER_SAMPLE, *_PLACES), rows, strict=True))
        for name in ("drift_angle", "gradient_angle"):
            settings[name] = settings[name] * (2 * math.pi)
        settings["camera"] = torch.floor(settings["camera"] * max(1, len(self.cameras))).clamp(max=len(self.cameras))
        settings["rotation"] = torch.deg2rad(settings["rotation"])
        return settings

    @staticmethod
    def found(parameters: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Names of the numbers that :meth:`told` returns."""
        return {name.removeprefix("bench_"): value for name, value in parameters.items() if name.startswith("bench_")}

    def told(self, found: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Parameters that samples hold."""
        return {f"bench_{name}": value for name, value in found.items()}

    def moved(self, objects: torch.Tensor, found: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Objects real[B, h, w] turned and magnified about the middle of their frame, between pixels linearly."""
        if not any(_moves(getattr(self, name), still) for name, still in (("rotation", 0.0), ("magnification", 1.0))):
            return objects
        rows, columns = objects.shape[1:]
        transformed = []
        for one, turn, size in zip(objects, found["rotation"], found["magnification"], strict=True):
            c, s = torch.cos(turn) / size, torch.sin(turn) / size
            ratio = rows / columns  # grids run from -1 to 1 along either side
            zero = torch.zeros_like(c)
            affine = torch.stack([torch.stack([c, s * ratio, zero]), torch.stack([-s / ratio, c, zero])])
            grid = torch.nn.functional.affine_grid(affine[None].to(one), [1, 1, rows, columns], align_corners=False)
            seen = torch.nn.functional.grid_sample(one[None, None], grid, align_corners=False)
            transformed.append(seen[0, 0])
        return torch.stack(transformed)

    def seen(self, images: torch.Tensor, found: Mapping[str, torch.Tensor], keys: torch.Tensor) -> torch.Tensor:
        """Light on the pixels, real[B, n, H, W] over its mean; ``keys`` int64[B, 2] of the pixels' sensitivity."""
        numbers = {name: value.tolist() for name, value in found.items()}  # from a device once, not sample by sample
        return torch.stack([
            self._one(image, {name: values[n] for name, values in numbers.items()}, key)
            for n, (image, key) in enumerate(zip(images, keys.tolist(), strict=True))
        ])  # fmt: skip

    def _one(self, image: torch.Tensor, found: dict[str, float], key: list[int]) -> torch.Tensor:
        """One sample's frames real[n, H, W]."""
        rows, columns = image.shape[-2:]
        seen = _filtered(image, found["blur"], found["drift"], found["drift_angle"])
        if found["gradient"]:
            y, x = (torch.linspace(-1, 1, n, dtype=image.dtype, device=image.device) for n in (rows, columns))
            c, s = math.cos(found["gradient_angle"]), math.sin(found["gradient_angle"])
            seen = seen * (1 + found["gradient"] * (c * x + s * y[:, None]) / (abs(c) + abs(s)))
        seen = (1 - found["stray"]) * seen + found["stray"]
        if found["unevenness"]:
            gains = np.zeros(rows * columns)
            add_normal(*key, found["unevenness"], gains)
            own = torch.from_numpy(np.maximum(1 + gains, 0.0)).reshape(rows, columns).to(seen)
            seen = seen * own
        return seen

    def exposed(
        self, images: torch.Tensor, found: Mapping[str, torch.Tensor], keys: torch.Tensor, camera: Camera
    ) -> torch.Tensor:
        """Counts of images real[B, n, H, W] by the camera of each; by ``camera`` where none is drawn."""
        if not self.cameras:
            return exposure.expose(camera, images, keys)
        counts, chosen, brightness = [], found["camera"].tolist(), found["brightness"].tolist()
        for n in range(len(images)):
            own = self.cameras[int(chosen[n])]
            photons = max(brightness[n] * own.saturation, 1.0)
            counts.append(exposure.expose(own.replace(photons=photons), images[n : n + 1], keys[n : n + 1])[0])
        return torch.stack(counts)

    @staticmethod
    def keys(drawn: Addresses, numbers: Sequence[int]) -> torch.Tensor:
        """Keys int64[B, 2] of the pixels' sensitivity."""
        return drawn.keys(Stream.CAMERA, drawn.words(numbers, [Purpose.UNEVENNESS]))[:, 0]


def _moves(draw: Any, still: float) -> bool:
    return ends(draw) != (still, still)


def _filtered(image: torch.Tensor, blur: float, drift: float, angle: float) -> torch.Tensor:
    """Frames real[n, H, W], blurred and smeared, mirrored at their edges."""
    if not blur and not drift:
        return image
    margin = [min(n - 1, math.ceil(_MARGIN * blur + drift / 2) + 1) for n in image.shape[-2:]]
    padding = (margin[1], margin[1], margin[0], margin[0])
    wide = torch.nn.functional.pad(image[None], padding, mode="reflect")[0]
    fy = torch.fft.fftfreq(wide.shape[-2], dtype=image.dtype, device=image.device)[:, None]
    fx = torch.fft.rfftfreq(wide.shape[-1], dtype=image.dtype, device=image.device)
    passed = torch.exp(-2 * (math.pi * blur) ** 2 * (fx.square() + fy.square()))
    passed = passed * torch.sinc(drift * (math.cos(angle) * fx + math.sin(angle) * fy))
    blurred = torch.fft.irfft2(torch.fft.rfft2(wide) * passed, s=wide.shape[-2:])
    rows, columns = image.shape[-2:]
    return blurred[:, margin[0] : margin[0] + rows, margin[1] : margin[1] + columns].clamp(min=0)
