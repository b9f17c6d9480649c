"""Recipes: what a data set is made of, and its samples as pure functions of (seed, split, index).

What a recipe says is in :mod:`specification`; here is what is made of it. The physics of each kind is in a file of its
own: :mod:`tilt_stack`, :mod:`hidden_object`, :mod:`partially_coherent`, :mod:`masked_light`.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from specklegen.core.arguments import whole_number, whole_numbers
from specklegen.core.content import is_own
from specklegen.core.decision import Decision
from specklegen.core.lazy import LazyModule
from specklegen.core.random_streams import seed_words
from specklegen.core.registry import Registry
from specklegen.core.shielded import shielded
from specklegen.datasets.recipes.media import (
    DrawnMedia,
    MediumView,
    Planned,
    Rendering,
    by_one_sampler,
    media_requests,
    medium_plan,
    rendering_of,
)
from specklegen.datasets.recipes.parts.diffuser import KnownDiffuser
from specklegen.datasets.recipes.parts.material import CharacterizedMaterial
from specklegen.datasets.recipes.specification import Specification
from specklegen.datasets.sample_schema import named_file, require_finite
from specklegen.datasets.split import Purpose, Split, generator, split_number, substream
from specklegen.planning.plan import Plan
from specklegen.samplers.sampler import MediaRequest
from specklegen.scene.scene import Scene
from specklegen.scene.validity import idealisations
from specklegen.synthesis.sight import Sight

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes import kept_generators as _kept_generators
    from specklegen.datasets.recipes import materials as _materials
    from specklegen.datasets.recipes import medium as _medium
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.datasets.recipes.medium import Medium
    from specklegen.datasets.recipes.parts.light import Lit
else:
    torch = LazyModule("torch")
    _kept_generators = LazyModule("specklegen.datasets.recipes.kept_generators")
    _materials = LazyModule("specklegen.datasets.recipes.materials")
    _medium = LazyModule("specklegen.datasets.recipes.medium")


def _is_kind(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Recipe)


class Recipe(Specification):
    """What every kind of recipe has. Subclass it, or one of its kinds, for a kind of your own.

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
        What differs from bench to bench and nobody is told, in recipes with hidden objects: domain randomisation. None
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

    registry: ClassVar = Registry("kind of recipe", _is_kind)
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

    @cached_property
    def rendering(self) -> Rendering | None:
        """What renders all media of the recipe; None if that is for each of them to decide. Carried to the workers.

        Raises
        ------
        RuleError
            If no sampler serves, or, where ``strict``, the one that is asked for is unfit.
        """
        return rendering_of(self, self.plans())

    def idealisations(self, scene: Scene) -> list[Decision]:
        """What a real set-up has and one of the recipe's scenes leaves out."""
        index = self.light.refractive_index if self.lab is None else self.lab.refractive_index
        known = self.lab is not None or index != 1
        band = bool(self.light.bandwidth or (self.lab is not None and self.lab.bandwidth))
        return idealisations(scene, refractive_index=index if known else None, band=band, halves=self.light.halves)

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
    def path_sum_obstacle(self) -> str | None:
        """What the recipe asks for that path sums have no model of; None where they serve."""
        band = self.light.bandwidth or (self.lab is not None and self.lab.wavenumber_bandwidth)
        return "a bandwidth" if band else None

    @property
    def media_alike(self) -> bool:
        """Whether media differ in nothing but what is drawn of their fields: one imaging serves them all."""
        return not self.material.varies

    @property
    def frames(self) -> int:
        """Frames of a sample in which the medium is another one."""
        return 1

    @property
    def moving(self) -> bool:
        """Whether particles move from frame to frame, so that frames are asked of a sampler together."""
        return False

    @property
    def pictures(self) -> int:
        """Images of a sample: frames, or tilts."""
        return self.frames

    def later_frames(self, drawn: "Addresses", numbers: Sequence[int]) -> "torch.Tensor | None":  # noqa: ARG002
        """Keys int64[M, halves, F - 1, 2] of the fields of all frames but the first; None of media at rest."""
        return None

    def exposed(self, images: "torch.Tensor") -> "torch.Tensor":
        """Pictures real[B, pictures, H, W] of the images of all frames or tilts real[B, T or F, H, W]."""
        return images

    def contrast_left(self, parameters: Mapping[str, Any]) -> Any:  # noqa: ARG002
        """Share of the contrast of an instant that exposures leave, of numbers of media: float64[M], or 1."""
        return 1.0

    def polarisation_shares(self, parameters: Mapping[str, Any]) -> "torch.Tensor | None":  # noqa: ARG002
        """Shares float64[M, 2] of the light of media in either polarisation; None where they are alike."""
        return None

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files that objects are made from, by the number "file" of a sample; () where there are none."""
        return ()

    def host_work(self) -> list[str]:
        """What is made on the host, whatever the device, in words."""
        work = [] if _materials.in_atlas(self.material) else ["the memory effect of every material"]
        if self.rendering is None:
            work.append("sums over paths, where they are chosen")
        elif self.rendering.chosen.medium_by_medium:
            sampler = self.rendering.name
            work.append("sums over paths" if sampler == "paths" else f"media of the {sampler} sampler, one by one")
        own = self.exposure is not None and is_own(type(self.exposure))
        return [*work, "counts of a camera of a user's own"] if own else work

    def drawn_media(self, drawn: "Addresses", numbers: Sequence[int]) -> "list[tuple[list[int], DrawnMedia]]":
        """Draw media, those whose materials are known in the same way together, and which they are."""
        parts = _materials.drawn_materials(self.material, drawn, numbers, self.wavelength)
        return [
            (places, self.seen_media(drawn, [numbers[n] for n in places], materials)) for places, materials in parts
        ]

    def seen_media(self, drawn: "Addresses", numbers: Sequence[int], materials: "Materials") -> DrawnMedia:
        """Draw what is seen of media of known materials; every kind has its own."""
        raise NotImplementedError

    def requests(self, media: DrawnMedia) -> list[tuple[list[int], MediaRequest]]:
        """What is asked of the sampler for media, and for which."""
        return media_requests(self, media)

    def path_scene(self, media: DrawnMedia, place: int) -> Scene:
        """Scene of one medium with every beam, for path sums."""
        return media.view(place).full

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> "Lit":
        """Draw what shines through the media of samples; every kind has its own."""
        raise NotImplementedError

    def on_sensor(self, images: Any, parameters: Mapping[str, Any]) -> Any:  # noqa: ARG002
        """Light on the pixels, real[B, n, H, W], of images real[B, pictures, H, W]; what a mosaic makes of them."""
        return images

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Name what the camera saw, [B, T or F, H, W], under tilts float64[B, T, 2]; every kind has its own."""
        raise NotImplementedError

    def sight(
        self, drawn: "Addresses", shape: tuple[int, int], object_pitch: Any, base: Any, width: Any = None
    ) -> Sight:
        """How objects are seen through media.

        Parameters
        ----------
        drawn
            Where the numbers lie.
        shape
            Of the object.
        object_pitch, base
            Direction sines float64[M] between its pixels, and float64[M, T, 2] of the base tilts.
        width : float64[M] or None
            Of the windows, in the recipe's unit of length, where each medium has its own.
        """
        if width is None:
            seen = self.geometry
            width, pitch = (torch.full_like(object_pitch, number) for number in (seen.width, seen.grid.pitch))
        else:
            assert self.camera is not None
            pitch = self.wavelength / (width * self.camera.pixels_per_grain)
        bound = self._most_cells if drawn.device.type != "cpu" or self._on_one_grid else None
        return Sight(
            wavelength=self.wavelength, profile=self.profile, shape=shape, camera=self.camera_shape, center=(0.0, 0.0),
            integrated=self.lab is not None or self.exposure is not None, width=width, object_pitch=object_pitch,
            camera_pitch=pitch, base=base, bound=bound,
        )  # fmt: skip

    @property
    def _on_one_grid(self) -> bool:
        """Whether it pays to have all media on one grid: each is seen once, and they are of about one size."""
        return not (self.media_alike or self.shares_media or self.tilts_turn)

    @cached_property
    def _most_cells(self) -> tuple[int, int]:
        """No fewer cells along (y, x) than any medium has: those at the ends of the ranges, tilted either way."""
        views = [view for view in self.extremes() if isinstance(view, MediumView)]
        put = lambda rows: torch.tensor(np.array(rows), dtype=torch.float64)  # noqa: E731
        cells = []
        for turned in (False, True) if self.tilts_turn else (False,):
            base = [np.sin(view.tilts)[:, ::-1] if turned else np.sin(view.tilts) for view in views]
            sight = Sight(
                wavelength=self.wavelength, profile=self.profile, shape=views[0].shape, camera=self.camera_shape,
                center=(0.0, 0.0), integrated=False, width=put([view.seen.width for view in views]) * (1 + 1e-9),
                object_pitch=put([view.pitch for view in views]), base=put(base),
                camera_pitch=put([view.seen.grid.pitch for view in views]),
            )  # fmt: skip
            cells.append(sight.most_cells)
        rows, columns = np.max(cells, axis=0).tolist()
        return rows, columns

    @property
    def tilts_turn(self) -> bool:
        """Whether the direction of tilting differs between media."""
        return False

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
        return _medium.medium_of_recipe(self, seed, split, medium)

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

    def extremes(self) -> Sequence[Planned]:
        """Media at the ends of every range, looked at by the widest object and the most tilted beams."""
        raise NotImplementedError

    @shielded()
    def plans(self) -> list[Plan]:
        """Plans of the media at the ends of every range, which ``specklegen plan`` prints and samples run by."""
        return by_one_sampler([medium_plan(self, view) for view in self.extremes()])

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
        kept = _kept_generators.generator_of(self, seed_words(seed), cast(Split, split), self.device)
        batch = arrays(kept(numbers))
        require_finite(batch, self, seed, split)
        return batch


def arrays(batch: Any) -> Any:
    """Turn the tensors of a (nested) dict into arrays on the host."""
    if isinstance(batch, dict):
        return {key: arrays(value) for key, value in batch.items()}
    return batch.cpu().numpy()
