"""Class of an object from one camera image, by the law of images, without training or rendering.

A recipe says which objects and materials there may be. Of many of them, drawn from its training split, the mean
periodogram S follows in closed form (:mod:`specklegen.models.likelihood.spectrum`); that takes a fraction of the time
that an image takes, and each explains an image so well (Whittle 1953)

    log L = -looks * [ n log(mean of I / S) + sum log S ],     n frequencies, the brightness that fits best put in.

The evidence for a class is the mean of L over its examples, whatever their font, size, turn and material: Bayes' rule
by Monte Carlo (Robert and Casella, *Monte Carlo Statistical Methods*, 2004, section 3.2). Nothing is learned; objects
unlike every example that was drawn are what it does not know.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import instance, real_tensor, whole_number
from specklegen.core.errors import reject
from specklegen.core.shielded import shielded
from specklegen.datasets.addresses import Addresses
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.learning.measurement import seen_by_camera
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, memory_effect_between
from specklegen.models.likelihood.spectrum import autocorrelation_of

SAMPLES = 200_000
MATERIALS = 64
"""Whose memory effects examples share."""
_CHUNK = 500
_NOISES = 0.1  # of the power of a weak frequency, by which images' noises may differ: their mean stands for all


@dataclass(frozen=True, eq=False)
class ClassEvidence:
    """Probabilities of the classes of objects, given their images.

    Attributes
    ----------
    classes : int64[K]
        Labels of the classes, as samples of the recipe have them.
    log_evidence : float64[N, K]
        Logarithm of the mean likelihood of every class's examples; of an image, up to a constant. Examples are few
        beside what a likelihood tells apart, so the best one decides, and differences are no calibrated odds.
    """

    classes: Tensor
    log_evidence: Tensor

    @property
    def ranked(self) -> Tensor:
        """Labels int64[N, K] of every image, the most probable first."""
        return self.classes[self.log_evidence.argsort(dim=1, descending=True)]


@shielded()
def classes_by_law(images: Tensor, recipe: HiddenObject, *, samples: int = SAMPLES, seed: int = 0) -> ClassEvidence:
    """Tell which class the object in each image is of.

    Parameters
    ----------
    images
        real[N, H, W], one camera image each, of the setup that the recipe describes. The mean of their noises stands
        for all, so that of counts an image's evidence depends a little on its companions.
    recipe
        What may be hidden, with ``label``, and behind what. Objects have one pitch and images one window.
    samples
        Examples drawn from the training split; 300 microseconds each on one core for cameras of 128 x 128 pixels, for
        however many images.
    seed
        Of the examples.

    Raises
    ------
    RuleError
        If images are not of the recipe's camera, or differ in noise; objects have no classes; or pitch, window and
        camera differ between samples.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models.learning.classes import classes_by_law
    >>> recipe = load_recipe("characters-of-new-fonts", {"camera": {"shape": [48, 48]}})
    >>> images = recipe.batch(0, "test", range(2))["image"]
    >>> classes_by_law(images, recipe, samples=1000).ranked.shape
    torch.Size([2, 45])
    """
    instance("classes_by_law recipe", recipe, HiddenObject)
    samples, seed = (
        whole_number(f"classes_by_law {name}", value, least)
        for name, value, least in (("samples", samples, 1), ("seed", seed, 0))
    )
    images = real_tensor("classes_by_law images", torch.as_tensor(np.asarray(images)))
    if images.ndim != 3 or tuple(images.shape[1:]) != tuple(recipe.camera_shape) or not len(images):
        reject("classes_by_law images", f"[N, H, W] of {tuple(recipe.camera_shape)} pixels", tuple(images.shape))
    drawn = recipe.batch(seed, "train", (0, recipe.samples.train // 2, recipe.samples.train - 1))["parameters"]
    settings = {name: np.unique(drawn[name]) for name in ("wavelength", "width", "camera_pitch", "object_pitch")}
    if any(len(values) > 1 for values in settings.values()):
        reject("classes_by_law recipe", "a recipe of one object pitch and one illuminated area",
               {name: values.tolist() for name, values in settings.items() if len(values) > 1})  # fmt: skip
    wavelength, width, camera, pitch = (float(values[0]) for values in settings.values())
    grain = wavelength / width / camera
    one = Optics(pitch / camera, grain, recipe.profile, recipe.pixel_integration)
    grains = torch.full((len(images),), grain)
    seen = seen_by_camera(images[:, None].float(), grains, None, recipe.exposure or "none", taper=0.0)
    law = SpeckleLikelihood(seen, recipe.objects.shape, one)
    power = law.power[:, law.used[0]]
    if seen.noise.max() - seen.noise.min() > _NOISES * power.median(1).values.min():
        reject("classes_by_law images", "images of equal noise", (float(seen.noise.min()), float(seen.noise.max())),
               "Call it once for each brightness.")  # fmt: skip
    materials = (recipe.material.realized(np.random.default_rng([seed, 46, n]), "train") for n in range(MATERIALS))
    shape = recipe.objects.shape
    table = [memory_effect_between(each.correlation, wavelength, pitch, shape).float() for each in materials]
    return _pooled(law, float(seen.noise.mean()), recipe, torch.stack(table), samples, seed)


def _pooled(
    law: SpeckleLikelihood, noise: float, recipe: HiddenObject, memory: Tensor, samples: int, seed: int
) -> ClassEvidence:
    """Evidence of examples, a few at a time."""
    family, rng = recipe.objects, np.random.default_rng([seed, 45])
    used, one = law.used[0], law.select(slice(0, 1))
    power = law.power[:, used]
    sources = [family.source(seed, "train", n) for n in range(samples)]
    labels = np.array([family.labels(source).get("label", -1.0) for source in sources])
    if (labels < 0).any():
        reject("classes_by_law recipe.objects", "a family with labelled classes", family.type)
    classes, which = np.unique(labels, return_inverse=True)
    places = torch.from_numpy(which)
    best = torch.full((len(power), len(classes)), -1e30)
    total = torch.zeros(best.shape, dtype=torch.float64)
    drawn = Addresses(seed, "train", torch.device("cpu"))
    for first in range(0, samples, _CHUNK):
        numbers = range(first, min(first + _CHUNK, samples))
        lags = autocorrelation_of(family.images(drawn, numbers))
        lags *= memory[torch.from_numpy(rng.integers(0, len(memory), len(numbers)))]
        expected = one.of_lags(lags[None])[0][:, used] + noise
        fit = (power @ (1 / expected).T) / power.shape[1]
        nats = -law.looks * (power.shape[1] * fit.log() + expected.log().sum(1))
        own = places[first : first + len(numbers)].expand(len(power), -1)
        top = best.scatter_reduce(1, own, nats, "amax")
        total *= (best - top).double().exp()
        total.scatter_add_(1, own, (nats - top.gather(1, own)).double().exp())
        best = top
    count = torch.from_numpy(np.bincount(which))
    return ClassEvidence(torch.from_numpy(classes).long(), best.double() + (total / count).log())
