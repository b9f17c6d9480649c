"""Training samples drawn from the law of images, without rendering: what a network sees is drawn itself.

The periodogram of an image of one hidden object has nearly independent values, exponentially distributed about a mean S
that follows in closed form from object, memory effect and window (:mod:`specklegen.models.likelihood.spectrum`). So

    I(f) = S(f) e(f),     e(f) independent, exponential with mean 1,

is drawn, and the input "periodogram" of networks made of it as it is made of an image's. The same number has the same
object and the same slab as the recipe's own sample; only the speckle is another one.

Means are exact. What the law leaves out is of second order: neighbouring frequencies of a camera have a covariance of
0.06 where an object fills a third of it, and few points widen the scatter of the lags within a grain by their fourth
cumulant (docs/notes/networks.md).
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import whole_number, whole_numbers
from specklegen.core.errors import reject
from specklegen.core.random_streams import seed_words
from specklegen.core.shielded import shielded
from specklegen.datasets.addresses import Addresses
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.media import DrawnMedia
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, split_number, substream
from specklegen.models.learning.inputs import LAGS, band, banded_lags
from specklegen.models.likelihood.likelihood import LEAST
from specklegen.models.likelihood.spectrum import Transforms, autocorrelation_of, transforms
from specklegen.scene.window import Profile, Window

_RULES: tuple[tuple[str, str, Callable[[Any], Any], Any, str], ...] = (
    ("recipe", 'of kind "hidden-object", one image of an object', lambda r: getattr(r, "kind", type(r).__name__),
     "hidden-object", "Render other kinds: this saves no time there."),
    ("recipe", "of a kind of the package's own", type, HiddenObject, "Render recipes of your own classes."),
    ("recipe.light.bandwidth", "0, for light of one wavelength",
     lambda r: r.light.bandwidth or (0.0 if r.lab is None else r.lab.bandwidth), 0.0,
     "Render recipes with a bandwidth."),
    ("recipe.window.profile", "square or disc",
     lambda r: "square or disc" if Window(r.profile, 1.0).sharp else r.profile, "square or disc",
     "Render recipes with a Gaussian window: this method was not tested for them."),
    ("recipe.exposure", "left out, for images without noise", lambda r: r.exposure, None,
     "The network's input has the noise subtracted, so train without noise."),
    ("recipe.bench", "left out", lambda r: r.bench, None, "Render recipes with a table bench."),
    ("recipe.sampler", "stationary for all media",
     lambda r: "chosen for each medium" if r.rendering is None else r.rendering.name, "stationary",
     "Render path sums and thin screens."),
)  # fmt: skip
"""Field, rule, what a recipe has, what it must have, remedy; in the order in which they are asked."""


@dataclass(frozen=True)
class ByLaw:
    """A recipe whose samples are drawn from the law of images.

    It takes the recipe's place in :class:`specklegen.datasets.SpeckleStream`, and so in training. Samples: ``lags``
    float32[64, 64], the autocorrelation of the image that was not rendered as the input "periodogram" has it, and
    ``object`` and parameters as the recipe's own.

    Parameters
    ----------
    recipe
        Of kind "hidden-object", behind a square or disc window, without exposure, setup or bandwidth, its media
        stationary.

    Raises
    ------
    RuleError
        If no law of the recipe's images is known: the rule is named.

    Examples
    --------
    >>> from specklegen.datasets import SpeckleStream, load_recipe
    >>> from specklegen.models.learning.examples import streamed
    >>> from specklegen.models.learning.law import ByLaw
    >>> recipe = load_recipe("unknown-slab")
    >>> ByLaw(recipe).sample(0, "train", 7)["lags"].shape
    (64, 64)
    >>> batches, length = streamed(SpeckleStream(ByLaw(recipe), batch_size=8), "periodogram")  # data for `train`
    """

    recipe: HiddenObject

    def __post_init__(self) -> None:
        for field, rule, has, must, remedy in _RULES:
            if (found := has(self.recipe)) != must:
                reject(f"ByLaw.{field}", rule, found, remedy)

    @property
    def name(self) -> str:
        """Name of the recipe."""
        return self.recipe.name

    @property
    def data_version(self) -> int:
        """Version of the recipe's pixels."""
        return self.recipe.data_version

    @cached_property
    def _canonical_json(self) -> str:
        decided = json.loads(self.recipe.canonical_json()) | {"drawn_by": "law"}
        return json.dumps(decided, sort_keys=True, separators=(",", ":"))

    def canonical_json(self) -> str:
        """Write everything that decides the samples."""
        return self._canonical_json

    def fingerprint(self) -> str:
        """SHA-256 of that, in hexadecimal."""
        return hashlib.sha256(self._canonical_json.encode()).hexdigest()

    def length(self, split: str) -> int:
        """Samples in an epoch of a split."""
        return self.recipe.length(split)

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        lags = ArraySpec(
            shape=(LAGS, LAGS), dims=("lag_y", "lag_x"),
            description="autocorrelation of the image at lags of the object's pixels, 1 at the zero lag, the middle",
        )  # fmt: skip
        whole = self.recipe.layout()
        return {"lags": lags, "object": whole["object"], "parameters": whole["parameters"]}

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One sample; a pure function of its arguments.

        Parameters
        ----------
        seed, split, index
            As of the recipe's own.
        """
        batch = self.batch(seed, split, [whole_number("ByLaw.sample index", index, 0)])
        parameters = {name: float(value[0]) for name, value in batch.pop("parameters").items()}
        return {name: value[0] for name, value in batch.items()} | {"parameters": parameters}

    @shielded()
    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        """Samples stacked along a new first axis, the same bits as alone.

        Parameters
        ----------
        seed, split, indices
            As of the recipe's own.
        """
        numbers = whole_numbers("ByLaw.batch indices", indices, 0, 2**63 - 1)
        split_number(split)
        recipe, drawn = self.recipe, Addresses(seed_words(seed), cast(Split, split), torch.device("cpu"))
        lit = recipe.lit(drawn, numbers)
        of_samples = [recipe.medium_number(n) for n in numbers]
        media = [*dict.fromkeys(of_samples)]
        seen: dict[int, tuple[DrawnMedia, int, Tensor]] = {}
        for places, some in recipe.drawn_media(drawn, media):
            memory = _memory_effects(some)
            seen |= {media[place]: (some, n, memory[n]) for n, place in enumerate(places)}
        lags = []
        for place, number in enumerate(numbers):
            rng = generator(substream(drawn.seed, drawn.split, Purpose.PERIODOGRAM, number))
            lags.append(_drawn_lags(lit.light[place].float(), *seen[of_samples[place]], rng))
        of_media = [(some.parameters, n) for some, n, _ in (seen[medium] for medium in of_samples)]
        parameters = {name: np.array([float(rows[name][n]) for rows, n in of_media]) for name in of_media[0][0]}
        parameters |= {name: value.numpy() for name, value in lit.parameters.items()}
        parameters["medium"] = np.array(of_samples, np.float64)
        arrays = {name: value.numpy() for name, value in lit.arrays.items()}
        return {"lags": torch.stack(lags).numpy(), **arrays, "index": np.array(numbers), "parameters": parameters}


def _memory_effects(media: DrawnMedia) -> Tensor:
    """C_I of media at every lag between the pixels of an object, float32[M, 2 h - 1, 2 w - 1]."""
    sight, correlations = media.sight, media.materials.correlations
    rows, columns = (torch.arange(1 - n, n, dtype=torch.float64) for n in sight.shape)
    turns = sight.wavenumber * sight.object_pitch[:, None, None]
    if not correlations.isotropic:
        along, across = torch.broadcast_tensors(turns * columns, turns * rows[:, None])
        return correlations.planar(along.contiguous(), across.contiguous()).square().float()
    distances, places = torch.hypot(rows[:, None], columns).unique(return_inverse=True)  # of eight lags one is asked
    return correlations(turns[:, 0] * distances).square()[:, places].float()


def _drawn_lags(light: Tensor, media: DrawnMedia, place: int, memory: Tensor, rng: np.random.Generator) -> Tensor:
    """Lags float32[LAGS, LAGS] of one object float[h, w] behind one of some media."""
    sight = media.sight
    pitch, width, step = (float(each[place]) for each in (sight.camera_pitch, sight.width, sight.object_pitch))
    grain, step = sight.wavelength / width / pitch, step / pitch
    waves = _transforms(sight.camera, sight.shape, step, grain, sight.profile, sight.integrated)
    expected = waves(autocorrelation_of(light)[None] * memory)[0]
    expected = torch.maximum(expected, LEAST * expected.amax())
    power = expected * torch.from_numpy(rng.standard_exponential(expected.shape, dtype=np.float32))
    return banded_lags(power, sight.camera, grain, step)


@lru_cache(maxsize=64)
def _transforms(
    camera: tuple[int, int], objects: tuple[int, int], step: float, grain: float, profile: Profile, pixel: bool
) -> Transforms:
    """Transforms float32[1, ...] of one layout; media that are seen alike share them."""
    rows, columns = band(camera, grain)
    down, across = rows.double().numpy() / camera[0], columns.double().numpy() / camera[1]
    one = transforms(down, across, camera, objects, torch.tensor([step], dtype=torch.float64),
                     torch.tensor([grain], dtype=torch.float64), profile, pixel)  # fmt: skip
    return Transforms(*(each.float() for each in one))
