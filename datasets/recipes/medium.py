"""One medium of a recipe, ready to be looked through: a batch of one, for whoever wants to see it by himself."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from specklegen.core.random_streams import seed_words
from specklegen.core.shielded import shielded
from specklegen.datasets.recipes.generator import ReadyMedia
from specklegen.datasets.recipes.kept_generators import generator_of
from specklegen.datasets.split import Split

if TYPE_CHECKING:
    from specklegen.datasets.recipes.recipe import Recipe


@dataclass(frozen=True)
class Medium:
    """A medium, ready to be looked through. Made by ``recipe.prepare``.

    Attributes
    ----------
    ready : ReadyMedia
        A batch of this one.
    seen : ImagedMedia or PathMedia
        The medium as it was drawn.
    parameters : dict
        What was drawn for it, and what follows from it.
    tilts : float64[T, 2]
        Tilts of the illumination, radians.
    left : float
        What polarisation and exposure leave of the contrast.
    exposed : function
        What the camera adds up, of :meth:`Recipe.exposed`.
    """

    ready: ReadyMedia
    seen: Any
    parameters: dict[str, float]
    tilts: np.ndarray
    left: float
    exposed: Callable[[torch.Tensor], torch.Tensor]

    @property
    def imaging(self) -> Any:
        """What draws such media and images objects through them."""
        return self.ready.groups[0][1]

    def images(self, brightness: np.ndarray) -> np.ndarray:
        """Expected intensity over its mean, float32[frames or tilts, H, W], of an object real[h, w]."""
        with shielded():
            seen = self.seen.images(torch.as_tensor(np.array(brightness))[None])
            return self.exposed(seen)[0].to(torch.float32).cpu().numpy()

    def superposed(self, amplitudes: np.ndarray, step: float) -> np.ndarray:
        """Intensity of interfering beams over its mean, float32[H, W]; complex[h, w] amplitudes, ``step`` apart."""
        with shielded():
            waves = torch.as_tensor(np.asarray(amplitudes, np.complex128))[None]
            return self.seen.superposed(waves, step)[0, 0].to(torch.float32).cpu().numpy()

    def expected_contrast(self, brightness: np.ndarray) -> float:
        """Expected contrast of the images of an object real[h, w], noise aside."""
        with shielded():
            light = torch.as_tensor(np.array(brightness, np.float64))[None]
            return self.left * float(self.imaging.contrast(light))


def medium_of_recipe(recipe: "Recipe", seed: int, split: Split, number: int) -> Medium:
    """Prepare a medium of a recipe."""
    with shielded():
        ready = generator_of(recipe, seed_words(seed), split, recipe.device).media([number])
        imaging = ready.groups[0][1]
        parameters = {name: float(value[0]) for name, value in ready.parameters.items()}
        tilts = ready.drawn.tilts[0].cpu().numpy()
        left = recipe.light.halves**-0.5 * float(recipe.contrast_left(parameters))
    return Medium(ready, imaging.media(ready.streams), parameters, tilts, left, recipe.exposed)
