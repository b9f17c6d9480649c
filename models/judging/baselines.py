"""Baselines of a network: the mean image, which ignores its input, and methods that learn nothing.

A method is a function of a batch (of a hidden-object recipe, as tensors) to brightness float32[B, n, n] on the pitch of
the object, up to shift and flip; n is at most :data:`FRAME`.
"""

import copy
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.measured.envelope import fit_envelope
from specklegen.models.learning.inputs import LAGS, network_input, resampled_lags, steps_of, without_background
from specklegen.models.learning.measurement import measured
from specklegen.models.learning.reconstructor import Reconstructor, centred
from specklegen.models.learning.solver import Solver
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.multiframe import multiframe_deconvolution
from specklegen.models.metrics import align
from specklegen.models.retrieval.apodisation import transfer_function
from specklegen.models.retrieval.autocorrelation import lag_means, memory_effect_at_lags
from specklegen.models.retrieval.camera_noise import Stated, camera_noise
from specklegen.models.retrieval.edges import taper_of
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve
from specklegen.models.retrieval.wiener import Division, choice, lag_variance, weights
from specklegen.scene.window import Profile

Batch = Mapping[str, Any]
Method = Callable[[Batch], Tensor]

FRAME = LAGS
"""Side of the frame that everything is scored on: an object, and a margin as wide."""


def grain_pixels(batch: Batch) -> Tensor:
    """Object pixels in a speckle grain, float64[B]."""
    drawn = batch["parameters"]
    return drawn["wavelength"] / drawn["width"] / drawn["object_pitch"]


def mean_image(objects: Tensor) -> Method:
    """Answer every question with the mean of the training objects [N, h, w], moved onto the first, then onto that."""
    reference = objects[0]
    for _ in range(2):
        reference = align(objects, reference.expand_as(objects)).mean(0)
    return lambda batch: reference.expand(len(batch["object"]), -1, -1)


def network(model: Reconstructor) -> Method:
    """A network; of a film it sees the mean of what it would see of the frames."""

    def method(batch: Batch) -> Tensor:
        if "frames" not in batch:
            return model.reconstruct(batch)
        return model(network_input(batch, model.input).mean(1))

    return method


def untrained(model: Reconstructor, seed: int = 0) -> Reconstructor:
    """Return the architecture with its initial weights: the result of its shape alone."""
    fresh = copy.deepcopy(model)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for part in fresh.network.modules():
            if callable(reset := getattr(part, "reset_parameters", None)):
                reset()
    return fresh


def together(recipe: HiddenObject, seed: int = 0, starts: int = 4) -> Method:
    """Multiframe deconvolution of the images that share a medium; by itself an image has a dark answer.

    ``seed`` and ``starts`` are of its search.
    """

    def method(batch: Batch) -> Tensor:
        step, grain = steps_of(batch).float(), (grain_pixels(batch) * steps_of(batch)).float()
        rows = min(batch["image"].shape[-2:])
        made = batch["image"].new_zeros(len(batch["image"]), FRAME, FRAME)
        for number in batch["medium"].unique():
            own = (batch["medium"] == number).nonzero()[:, 0]
            if len(own) < 2:
                continue
            size = min(FRAME, int(rows / float(step[own[0]])))
            optics = Optics(step[own], grain[own], recipe.profile)
            found = multiframe_deconvolution(batch["image"][own], optics, size, starts=starts, seed=seed)
            made[own, :size, :size] = found.image.to(made)
        return made

    return method


def another_object(objects: Tensor) -> Method:
    """Answer with some training object [N, h, w], which has nothing to do with the image: the level of chance.

    Not with that of the image's own number, which is the answer where training images are judged.
    """
    return lambda batch: objects[(batch["index"].long() + len(objects) // 2) % len(objects)]


def katz(
    retrieval: Retrieval | None = None, recipe: HiddenObject | None = None, seed: int = 0, *,
    division: Division | Literal["expected"] = "expected", apodise: bool = False, camera: Stated | None = None,
    profile: Profile | None = None,
) -> Method:  # fmt: skip
    """Return phase retrieval (Katz et al. 2014) as a method: a function of a batch to images float32[B, n, n].

    It sees the autocorrelation that a network sees, without the variance of the camera's noise.

    Parameters
    ----------
    retrieval
        Restarts and iterations; the extent is by default that of the object.
    recipe
        If given: divide by each material's C_I, which a simulator knows; and where camera noise cannot be read off the
        image, it is that of the recipe's camera.
    seed
        Of the random starts.
    division
        How, where a recipe is given: one of :data:`~specklegen.models.retrieval.wiener.DIVISIONS`, or "expected": what
        each image's own lags promise most of, which may be not to divide.
    apodise
        Apodise by the window's transfer function, which a laboratory knows: aims at the diffraction-limited object.
    camera
        What is known of its noise; by default the recipe's camera, or nothing where none is given.
    profile
        Of the window, which says where noise is read; by default that of the recipe, or nothing.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.datasets.loading.stream import tensors
    >>> from specklegen.models import Retrieval, katz
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> katz(Retrieval(restarts=2, steps=2))(tensors(recipe.batch(0, "test", [0]))).shape[0]
    1
    """
    shape = profile if recipe is None else recipe.profile
    stated = camera or ("unknown" if recipe is None else recipe.exposure or "none")

    def method(batch: Batch) -> Tensor:
        settings = retrieval or Retrieval()
        if settings.extent is None:
            settings = settings.replace(extent=max(batch["object"].shape[-2:]))
        seen = seen_lags(batch, stated, shape)
        images = []
        for n, grains in enumerate(seen.grain.tolist()):
            lags = seen.lags[n : n + 1]
            if recipe is not None and division != "none":
                drawn = {name: float(values[n]) for name, values in batch["parameters"].items()}
                correlation = recipe.material.known(recipe.material.slab_of(drawn)).correlation
                c_i = memory_effect_at_lags(correlation, drawn["wavelength"], drawn["object_pitch"], FRAME)
                about = dict(side=float(settings.extent or FRAME), grain=seen.grain[n : n + 1])
                chosen = choice(lags, c_i, seen.variance[n : n + 1], **about)[0] if division == "expected" else division
                lags = lags * weights(lags, c_i, seen.variance[n : n + 1], guess=chosen, **about)
            transfer = None
            if apodise:
                transfer = transfer_function(FRAME, grains, "square" if recipe is None else recipe.profile)
            images.append(retrieve(lags, settings, transfer=transfer, seed=seed).image)
        return torch.cat(images)

    return method


def on_even_light(method: Method) -> Method:
    """Let a method see images over the envelope that is fitted to each, as ``specklegen reconstruct`` does.

    Light that falls off over a camera, by 5 to 34 % (rms) in the task "waves", is no part of the likelihood: its
    leakage passes for signal at all frequencies. Where the evidence is for even light nothing is changed;
    but wide objects pass for an envelope now and then (docs/notes/benchmark.md).
    """

    def seen(batch: Batch) -> Tensor:
        name = "image" if "image" in batch else "frames"
        images = torch.as_tensor(batch[name])
        over = images.mean(1) if name == "frames" else images
        good = np.ones(tuple(over.shape[1:]), bool)
        fits = [fit_envelope(one.double().numpy(), good, "benchmark").values for one in over]
        envelope = torch.from_numpy(np.stack(fits)).to(images.device, torch.float32)  # counts may be integers
        return method({**batch, name: images / (envelope[:, None] if name == "frames" else envelope)})

    return seen


def any_object(solver: Solver, recipe: HiddenObject, seed: int = 0) -> Method:
    """The solver for any object, which knows each material's C_I and reads camera noise off the image.

    ``seed`` is that of phase retrieval's starts.
    """
    return lambda batch: solver.solve(*measured(batch, recipe), seed=seed).image


def drawn(solver: Solver, recipe: HiddenObject, retrieval: Retrieval | None = None, seed: int = 0) -> Method:
    """Mean of pictures that the solver draws (:meth:`Solver.posterior`), some from phase retrieval's image.

    Pictures that explain an image are many, and where the likelihood cannot choose one, their mean errs least. One that
    begins at an image of many restarts visits what the solver's own short ones miss.

    Parameters
    ----------
    solver
        The solver.
    recipe
        Of the images.
    retrieval
        Restarts and iterations of phase retrieval; the extent is by default that of the object.
    seed
        Of its starts, and of the draws.
    """
    first, frame = katz(retrieval, recipe=recipe, seed=seed), solver.network.frame

    def method(batch: Batch) -> Tensor:
        image = centred(first(batch).clamp_min(0))
        cut = (FRAME - frame) // 2
        image = image[:, None, cut : cut + frame, cut : cut + frame].contiguous()
        return solver.posterior(*measured(batch, recipe), seed=seed, first=image).mean

    return method


class SeenLags(NamedTuple):
    """Autocorrelations of a batch on the pitch of the object.

    Attributes
    ----------
    lags : float64[B, FRAME, FRAME]
        The zero lag first, without camera noise and background; over the zero lag before the pitch was changed.
    variance : float64[B]
        Of a lag.
    grain : float64[B]
        Object pixels in a grain.
    """

    lags: Tensor
    variance: Tensor
    grain: Tensor


def seen_lags(batch: Batch, camera: Stated = "unknown", profile: Profile | None = None) -> SeenLags:
    """Lags of the images of a batch; of films the mean over frames, taken as independent for the variance."""
    images = (batch["image"][:, None] if "image" in batch else batch["frames"]).double()
    flat = images / images.mean((-2, -1), keepdim=True)
    step, grain = steps_of(batch).double(), grain_pixels(batch).double()
    rows, columns = flat.shape[-2:]
    taper = taper_of(images)
    every = lag_means(flat - 1, (rows - 1, columns - 1), taper)
    every[..., 0, 0] -= camera_noise(images, (grain * step)[:, None], camera, profile)
    every, variance = every.mean(1), lag_variance(images, taper).mean(1) / images.shape[1]
    peak = every[..., 0, 0].clamp_min(torch.finfo(every.dtype).tiny)
    lags = resampled_lags(torch.fft.fftshift(every / peak[:, None, None], dim=(-2, -1)), step, FRAME)
    return SeenLags(torch.fft.ifftshift(without_background(lags), dim=(-2, -1)), variance / peak.square(), grain)
