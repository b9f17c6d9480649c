"""Recipes: what a data set is made of, and its samples as pure functions of (seed, split, index).

Fields are in :mod:`specification`, media in :mod:`media`, the making of batches in :mod:`generator`; here are samples,
and media one by one. The physics of each kind is in a file of its own: :mod:`tilt_stack`, :mod:`hidden_object`,
:mod:`partially_coherent`, :mod:`masked_light`, :mod:`coherent_object`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from specklegen.core.arguments import whole_number, whole_numbers
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.random_streams import seed_words
from specklegen.core.registry import Registry
from specklegen.core.shielded import shielded
from specklegen.datasets.recipes.media import RecipeMedia
from specklegen.datasets.recipes.parts.diffuser import KnownDiffuser
from specklegen.datasets.recipes.parts.material import CharacterizedMaterial
from specklegen.datasets.sample_schema import named_file, require_finite
from specklegen.datasets.split import Purpose, Split, generator, split_number, substream

if TYPE_CHECKING:
    import os

    from specklegen.datasets import SpeckleCache, SpeckleStream
    from specklegen.datasets.recipes import generator as _generators
    from specklegen.datasets.recipes.generator import ReadyMedia
else:
    _generators = LazyModule("specklegen.datasets.recipes.generator")


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

    ready: "ReadyMedia"
    seen: Any
    parameters: dict[str, float]
    tilts: np.ndarray
    left: float
    exposed: "Callable[[torch.Tensor], torch.Tensor]"

    @property
    def imaging(self) -> Any:
        """Sampler that draws such media and images objects through them."""
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


class Recipe(RecipeMedia):
    """Base class of every kind of recipe. Subclass it, or one of its kinds, for your own kind.

    A kind is known by its ``kind``: the name of the class, unless the field says another. It says its arrays in
    :meth:`layout`, and lists in :meth:`extremes` the media that a plan must serve.

    Parameters
    ----------
    name, description
        For people; not part of the fingerprint.
    samples
        Samples an epoch, of each split.
    media
        Media a split; sample n is seen through medium n mod ``media``. "new" (None, the default) never repeats one:
        take a number where few media are to be learned, or drawing them takes most of the time.
    media_group
        Neighbouring samples that share a medium, where media never repeat; 1 by default.
    material
        What scatters: a slab of drawn numbers, a preset by its name, layers, or ground glass, with its wavelength.
    window, camera
        The rest of the scene in the engine's terms: how wide the light's window is, and the camera's pixels a grain.
        Left out where there is a ``lab``.
    lab
        All of that in the terms of a laboratory, instead of wavelength, window, camera and field. None by default.
    light
        Bandwidth and polarisation; by default one wavelength, and one polarisation that reaches the camera.
    exposure
        Camera and its noises; where given, images are counts, and pixels average over their area. None: exact
        intensities.
    bench
        What differs from setup to setup and nobody is told, in recipes with hidden objects: domain randomisation. None
        by default.
    sampler
        "auto" renders with the sampler that the planner chooses: the stationary one where its error over all the
        recipe's media is within 0.02, path sums elsewhere, which are slower; that of thin screens behind such. Or the
        name of one: "stationary", "convolution", "paths" or "screens"; or one of your own, by its name, import path or
        class.
    strict
        Whether to refuse, instead of warning of it, a sampler that is asked for and that the planner finds unfit.
    kind
        Name by which a file asks for the class; every kind states its own as the default.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> recipe = load_recipe("through-slab", {"material": {"optical_depth": 5.0, "kernel_paths": 1000}})
    >>> recipe.camera_shape
    (128, 128)
    >>> recipe.sample(0, "train", 7)["image"].shape
    (128, 128)
    """

    registry: ClassVar = Registry("kind of recipe")
    name_key: ClassVar = "kind"

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw the scene of its first medium."""
        self.extremes()[0].probe.plot(axes, label)

    def material_of(self, seed: int, split: Split, medium: int) -> CharacterizedMaterial | KnownDiffuser:
        """Material of one medium, with its kernel.

        Parameters
        ----------
        seed
            Of the data set: a whole number, or a sequence of them.
        split
            "train", "validation" or "test": no medium and no object of one is in another.
        medium
            Number of the medium.
        """
        return self.material.realized(generator(substream(seed, split, Purpose.MATERIAL, medium)), split)

    @property
    def rendering_note(self) -> str:
        """Say what renders the samples, and the idealisations, in sentences."""
        decisions = self.idealisations(self.extremes()[0].probe)
        kept = [f"{each.part.capitalize()}: {each.reason}." for each in decisions if each.needed]
        left = [f"Left out: {each.part}, {each.reason}." for each in decisions if not each.needed]
        return " ".join([self._rendered_by, *kept, *left])

    @property
    def _rendered_by(self) -> str:
        chosen = self.rendering
        if chosen is None:
            return "Rendered by the sampler that the planner chooses for each medium; every sample says which."
        sampler = "path sums" if chosen.name == "paths" else f"the {chosen.name} sampler"
        return f"Rendered by {sampler}; relative error that the paths leave, as planned: {chosen.expected_error:.2g}."

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files that objects are made from, by the number "file" of a sample; () where there are none."""
        return ()

    def prepare(self, seed: int, split: Split, medium: int) -> "Medium":
        """Make one medium ready to be looked through, with all that is drawn for it.

        Parameters
        ----------
        seed
            Of the data set: a whole number, or a sequence of them.
        split
            "train", "validation" or "test": no medium and no object of one is in another.
        medium
            Number of the medium.
        """
        with shielded():
            made = _generators.generator_of(self, seed_words(seed), split, self.device)
            ready = made.media([medium])
            parameters = {name: float(value[0]) for name, value in ready.parameters.items()}
            tilts = ready.drawn.tilts[0].cpu().numpy()
            left = self.light.halves**-0.5 * float(self.contrast_left(parameters))
            return Medium(ready, ready.groups[0][1].media(ready.streams), parameters, tilts, left, self.exposed)

    @shielded()
    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One sample: arrays, "index" and "parameters" (a flat dict of float64). Pure.

        An object from a file of yours has its name too, "file", within the folder.

        Parameters
        ----------
        seed
            Of the data set: a whole number, or a sequence of them.
        split
            "train", "validation" or "test": no medium and no object of one is in another.
        index
            Which sample, from 0 on; there is no last one.

        Raises
        ------
        RuleError
            If the split is unknown, the seed or the index is not a whole number of at least 0, or the sample would
            hold a number that is not finite.
        """
        index = whole_number(f"{type(self).__name__}.sample index", index, 0, 2**63 - 1)
        batch = self.batch(seed, split, [index])
        parameters = {name: float(value[0]) for name, value in batch.pop("parameters").items()}
        sample = {name: value[0] for name, value in batch.items()} | {"parameters": parameters}
        return sample | named_file(self.file_names, parameters)

    def stream(self, seed: int = 0, split: Split = "train", batch_size: int = 32, **options: Any) -> "SpeckleStream":
        """Return batches of fresh samples, as a torch ``IterableDataset``.

        Parameters
        ----------
        seed, split, batch_size, **options
            As of :class:`~specklegen.datasets.SpeckleStream`, such as ``cache="data/cache.zarr"``.
        """
        from specklegen.datasets import SpeckleStream

        return SpeckleStream(self, seed, split, batch_size, **options)

    def store(
        self, folder: "str | os.PathLike", samples: int | None = None, seed: int = 0, split: Split = "train",
        **options: Any,
    ) -> "SpeckleCache":  # fmt: skip
        """Fill the store at ``folder`` with samples, where they are missing, and open it.

        Parameters
        ----------
        folder
            Of the store, by custom ending in ``.zarr``, or its address.
        samples
            Number of samples; by default an epoch of the split.
        seed, split, **options
            As of :func:`~specklegen.datasets.generate`, such as ``processes=4``.
        """
        from specklegen.datasets import SpeckleCache, generate

        count = self.length(split) if samples is None else samples
        generate(self, seed, split, samples=count, folder=folder, **options)
        return SpeckleCache(folder)

    @shielded()
    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        """Samples stacked along a new first axis, parameters as a dict of float64[B]; the same bits as alone.

        Parameters
        ----------
        seed
            Of the data set: a whole number, or a sequence of them.
        split
            "train", "validation" or "test": no medium and no object of one is in another.
        indices
            Which samples, from 0 on.
        """
        numbers = whole_numbers(f"{type(self).__name__}.batch indices", indices, 0, 2**63 - 1)
        words = seed_words(seed)
        seed = words if isinstance(seed, Sequence) else words[0]
        split_number(split)
        self.rendering  # noqa: B018 - a strict recipe is refused here, whatever is kept of others
        made = _generators.generator_of(self, seed_words(seed), cast(Split, split), self.device)
        batch = arrays(made(numbers))
        require_finite(batch, self, seed, split)
        return batch


def arrays(batch: Any) -> Any:
    """Turn the tensors of a (nested) dict into arrays on the host."""
    if isinstance(batch, dict):
        return {key: arrays(value) for key, value in batch.items()}
    return batch.cpu().numpy()
