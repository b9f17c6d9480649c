"""Hidden objects as a physics of deepinv, and media as what its generator draws (extra ``deepinv``).

J. Tachella et al., *DeepInverse: a PyTorch library for solving imaging inverse problems with deep learning* (2023).
"""

from functools import lru_cache
from typing import Any, cast

import torch
from deepinv.physics import LinearPhysics  # pyright: ignore[reportMissingImports]
from deepinv.physics.generator import PhysicsGenerator  # pyright: ignore[reportMissingImports]

from specklegen.core.errors import reject
from specklegen.core.random_streams import seed_words
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.split import Split, split_number
from specklegen.synthesis.imaging import ImagedMedia
from specklegen.synthesis.object_operator import ObjectOperator

_NEW = 2**31
"""Media of a recipe that never repeats one, as many as a generator draws from."""


class SpecklePhysics(LinearPhysics):
    """Camera images of hidden objects through media of a recipe: linear in the brightness of the object.

    ``physics(x)`` takes float32[B, 1, h, w] to float32[B, C, H, W], C images (frames times tilts) before the camera's
    noise, which is for a noise model of deepinv. A pixel's expectation over media is the mean brightness of the object:
    ``recipe.sample(...)["image"]`` is ``physics.A(x)`` over it. Its adjoint is exact, and torch differentiates both.

    Parameters
    ----------
    recipe : HiddenObject
        Rendered by the stationary sampler, on the device ``recipe.device``, where x and y lie.
    seed, split
        As for ``recipe.sample``.
    medium : int64[B] or int64[1], optional
        Numbers of the media, one an image or one for all; :class:`MediumGenerator` draws them.
    options
        Of ``deepinv.physics.LinearPhysics``: ``noise_model``, ``sensor_model``, ``max_iter``, ``tol``, ``solver``.

    Raises
    ------
    RuleError
        If the recipe hides no objects, or path sums or screens render it.
    """

    def __init__(
        self, recipe: HiddenObject, seed: int = 0, split: str = "train", medium: torch.Tensor | None = None,
        **options: Any,
    ) -> None:  # fmt: skip
        if not isinstance(recipe, HiddenObject):
            reject("SpecklePhysics.recipe", "a recipe with hidden objects", type(recipe).__name__)
        split_number(split)
        super().__init__(img_size=(1, *recipe.objects.shape), device=recipe.device, **options)
        self.recipe, self.seed, self.split = recipe, seed_words(seed), split
        first = torch.zeros(1, dtype=torch.int64, device=recipe.device)
        self.register_buffer("medium", first if medium is None else medium.to(first))

    def A(self, x: torch.Tensor, medium: torch.Tensor | None = None, **_: Any) -> torch.Tensor:
        """Images without noise, float32[B, C, H, W], through the media that are set, or given now."""
        self.update_parameters(medium=medium)
        return torch.stack([_images(each[0], maps) for each, maps in zip(x, self._maps(len(x)), strict=True)])

    def A_adjoint(self, y: torch.Tensor, medium: torch.Tensor | None = None, **_: Any) -> torch.Tensor:
        """The adjoint of :meth:`A`, float32[B, 1, h, w]."""
        self.update_parameters(medium=medium)
        return torch.stack([_adjoint(each, maps)[None] for each, maps in zip(y, self._maps(len(y)), strict=True)])

    def _maps(self, count: int) -> list[tuple[ObjectOperator, ...]]:
        if len(self.medium) not in (1, count):
            reject("SpecklePhysics.medium", f"one number, or one for each of {count} images", self.medium.tolist())
        numbers = self.medium.expand(count).tolist()
        return [_operators(self.recipe, self.seed, cast(Split, self.split), number) for number in numbers]


class MediumGenerator(PhysicsGenerator):
    """Draws media of a recipe: ``step(batch_size, seed)`` returns {"medium": int64[batch_size]}.

    Parameters
    ----------
    recipe : HiddenObject
        Its ``media`` are drawn from alike; one whose media never repeat has 2^31.
    options
        Of ``deepinv.physics.generator.PhysicsGenerator``: ``rng``, ``device``.
    """

    def __init__(self, recipe: HiddenObject, **options: Any) -> None:
        super().__init__(**options)
        self.media = recipe.media or _NEW

    def step(self, batch_size: int = 1, seed: int | str | None = None, **_: Any) -> dict[str, torch.Tensor]:
        """Numbers of media; a pure function of the seed, where one is given."""
        self.rng_manual_seed(seed)
        return {"medium": torch.randint(self.media, (batch_size,), generator=self.rng, device=self.rng.device)}


@lru_cache(maxsize=64)
def _operators(recipe: HiddenObject, seed: tuple[int, ...], split: Split, medium: int) -> tuple[ObjectOperator, ...]:
    """The maps of one medium, a frame each."""
    seen = recipe.prepare(seed, split, medium).seen
    if not isinstance(seen, ImagedMedia) or seen.imaging.polynomials is not None:
        reject("SpecklePhysics.recipe", "one of slabs that the stationary sampler renders", recipe.name)
    spectra = seen.shared().spectra
    assert spectra is not None
    return tuple(ObjectOperator(seen.imaging, each) for each in spectra[0])


def _unit(of: ObjectOperator) -> float:
    """Ratio of the mean brightness of an object to a pixel's expectation."""
    rows, columns = of.imaging.shape
    return 1 / (rows * columns)


def _images(brightness: torch.Tensor, maps: tuple[ObjectOperator, ...]) -> torch.Tensor:
    return torch.cat([each.image(brightness) * _unit(each) for each in maps])


def _adjoint(images: torch.Tensor, maps: tuple[ObjectOperator, ...]) -> torch.Tensor:
    parts = images.split([len(each.imaging.modes[0]) for each in maps])
    return sum((each.adjoint(part) * _unit(each) for each, part in zip(maps, parts, strict=True)), torch.zeros(()))
