"""Samples made on a device, batch by batch: a pure function from sample numbers to tensors that lie there.

    generator = SpeckleGenerator(recipe, seed=0, split="train", device="cuda")
    batch = generator(range(256))               # {"image": float32[256, H, W], "object": ..., "parameters": {...}}

A batch is prepared at once, then rendered in buckets of equal rank, in chunks of one shape: the companions of a sample
do not matter. The ranks are the one thing that the host waits for.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Any, cast

import numpy as np
import torch

from specklegen.core.devices import checked_device
from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Stream
from specklegen.datasets.batched import camera, fresh, kept, medium, plan, rendering, samplers, words
from specklegen.datasets.batched.glyphs import GlyphTables, glyph_places, glyph_tables, glyphs
from specklegen.datasets.batched.graphs import Graphs, each_time
from specklegen.datasets.recipes.hidden_object import CENTRE, HiddenObject, centre_of
from specklegen.datasets.recipes.multi_image import DynamicSlab
from specklegen.datasets.recipes.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipes.parts.light import MEDIUM_PURPOSES
from specklegen.datasets.recipes.recipe import NOISES, Recipe
from specklegen.datasets.recipes.tilt_stack import MaterialRegression, TiltStack
from specklegen.datasets.split import Purpose, Split, split_number, substream

BUCKETS = (1, 2, 3, 4, 6, 8, 11, 16, 22, 28)
CHUNK, CHUNK_BYTES, KEPT_CHUNK = 64, 2**30, 64
"""Samples of a chunk, and the memory that its largest tensors may take on a device; on the CPU a chunk is a sample."""
AT_ONCE, AT_ONCE_BYTES = 1024, 2**28
"""Samples that are best asked for at once, so that few chunks are filled up, and the memory of their images."""
_WITH_AUTOCAST = ("cpu", "cuda", "xpu", "mps")
_PURPOSES = {"material": Purpose.MATERIAL, "field": Purpose.FIELD, "tilts": Purpose.TILTS}


class SpeckleGenerator:
    """Batches of one split of a recipe, made where they are used.

    Parameters
    ----------
    recipe, seed, split
        As for ``recipe.sample``.
    device
        Any device of torch. On "cuda" steps that want one kernel are compiled at first use.
    graphs
        Whether CUDA graphs replay the way from fields to images, on "cuda", where they can be captured.

    Raises
    ------
    RuleError
        If the split is unknown, there is no such device, or the recipe cannot say where it renders.
    """

    def __init__(
        self, recipe: Recipe, seed: int = 0, split: str = "train", device: str | torch.device = "cpu", *,
        graphs: bool = True,
    ) -> None:  # fmt: skip
        self.number = split_number(split)
        if not isinstance(recipe, Recipe):
            reject("SpeckleGenerator.recipe", "a recipe of this library", type(recipe).__name__)
        self.recipe, self.seed, self.split = recipe.on("cpu"), seed, cast(Split, split)
        counted = str(device) == "meta"  # holds no numbers: there, batches are counted
        self.device = torch.device(device) if counted else checked_device("SpeckleGenerator.device", device)
        self.way, self.why = plan.way_of(recipe)
        self.run = Graphs(self.device) if graphs and self.device.type == "cuda" else each_time
        self.tail = substream(seed, self.split, Purpose.MATERIAL, 0)[4:]
        self.outlines: GlyphTables | None = None
        self.library: kept.Library | None = None
        if self.way == plan.KEPT:
            self.library = kept.library(cast(HiddenObject, self.recipe), seed, self.split, self.device)
            if self.library is None:
                self.way, self.why = plan.STEPS, [f"its media take more than {kept.MOST_BYTES >> 20} MB"]
        if self.way == plan.FRESH:
            self.media = fresh.fresh_media(self.recipe, seed, self.split, self.device)
            if isinstance(recipe, PartiallyCoherent):
                self.source = fresh.source_of(recipe, self.device)
        if self.way != plan.STEPS and plan.draws_objects(recipe):
            assert isinstance(recipe, HiddenObject)
            self.outlines = glyph_tables(recipe.objects, self.device)  # type: ignore[arg-type]
        if self.way == plan.DRAWN:
            self.sizes = plan.sizes_of(recipe)
            self.tables = plan.tables_of(recipe, self.sizes, self.device)

    def __call__(self, indices: Sequence[int] | np.ndarray | torch.Tensor) -> dict[str, Any]:
        """Make samples: the keys of ``recipe.batch``, tensors on the device; parameters float64[B].

        Parameters
        ----------
        indices
            Numbers of the samples, on the host.
        """
        numbers = [int(n) for n in indices]
        if not numbers or min(numbers) < 0:
            reject("SpeckleGenerator indices", "at least one index, each a whole number of at least 0", numbers)
        # Complex products of a user who allows TF32 would be wrong by 3e-4, and half precision is no place for this.
        with torch.no_grad(), _ieee(self.device.type), one_torch_thread():
            ways = {plan.DRAWN: self._drawn, plan.KEPT: self._through_kept, plan.FRESH: self._of_one_material}
            return ways.get(self.way, self._by_steps)(numbers)

    @property
    def at_once(self) -> int:
        """Samples that are best asked for at once."""
        picture = next(iter(self.recipe.layout().values()))
        return max(1, min(AT_ONCE, AT_ONCE_BYTES // (4 * math.prod(picture.shape))))

    def report(self) -> dict[str, Any]:
        """Say how batches are made: the way, what keeps the recipe from a faster one, and what the host still does."""
        host = [] if self.way != plan.STEPS else ["everything: samples one by one on the CPU, then copied"]
        if self.way == plan.KEPT:
            host.append("all media, once, when the generator is made")
        if self.way == plan.FRESH:
            host.append("the sampler that all media share, once, when the generator is made")
        if self.way != plan.STEPS and isinstance(self.recipe, HiddenObject) and self.outlines is None:
            host.append(f"pictures of {self.recipe.objects.type}")
        said = {"way": self.way, "device": str(self.device), "why": list(self.why), "host": host}
        return said | {"graphs": self.run.report() if isinstance(self.run, Graphs) else "none"}

    def _by_steps(self, numbers: list[int]) -> dict[str, Any]:
        return _tensors(self.recipe.batch(self.seed, self.split, numbers), self.device)

    def _words(self, numbers: Sequence[int], purposes: Sequence[int]) -> torch.Tensor:
        return words.substreams(self.number, [int(p) for p in purposes], torch.tensor(numbers), self.tail)

    def _uniforms(self, numbers: Sequence[int], purposes: Sequence[int]) -> torch.Tensor:
        """Uniform numbers float64[B, purposes, 4]."""
        return words.uniforms(self._words(numbers, purposes)).to(self.device, non_blocking=True)

    def _keys(self, numbers: Sequence[int], purposes: Sequence[int], stream: Stream) -> torch.Tensor:
        """Keys int64[B, purposes, 2]."""
        return words.stream_keys(words.keyed(stream, self._words(numbers, purposes))).to(self.device, non_blocking=True)

    def _put(self, numbers: Sequence[int]) -> torch.Tensor:
        return torch.tensor(numbers, dtype=torch.int64).to(self.device, non_blocking=True)

    def _objects(self, numbers: list[int]) -> torch.Tensor:
        """Objects float32[B, h, w]."""
        recipe = self.recipe
        if isinstance(recipe, TiltStack):
            return torch.ones((len(numbers), 1, 1), device=self.device)
        assert isinstance(recipe, HiddenObject)
        if self.outlines is None:
            made = np.stack([recipe.objects.image(self.seed, self.split, n) for n in numbers])
            return torch.from_numpy(made).to(self.device)
        places = self._put(glyph_places(self.outlines.family, self.seed, self.split, numbers))
        drawn = self._uniforms(numbers, [Purpose.OBJECT])[:, 0]
        return glyphs(self.outlines, places, drawn)

    def _told(self, numbers: list[int], light: torch.Tensor) -> dict[str, torch.Tensor]:
        """What is told of objects float32[B, h, w]: labels, and where they lie."""
        assert isinstance(self.recipe, HiddenObject)
        objects = self.recipe.objects
        labels = [objects.labels(objects.source(self.seed, self.split, n)) for n in numbers]
        told = {name: torch.tensor([each[name] for each in labels], dtype=torch.float64) for name in labels[0]}
        device = light.device
        if device.type == "cpu":  # one by one: sums over several have other last bits
            centre = torch.tensor([centre_of(each) for each in light.numpy()], dtype=torch.float64).unbind(-1)
        else:
            bright = light.double()
            along = [torch.arange(n, dtype=torch.float64, device=device) for n in bright.shape[1:]]
            centre = [bright.sum(axis) @ place / bright.sum((1, 2)) for axis, place in zip((2, 1), along, strict=True)]
        labelled = {name: each.to(device, non_blocking=True) for name, each in told.items()}
        return labelled | dict(zip(CENTRE, centre, strict=True))

    def prepare(self, media: list[int]) -> tuple[medium.MediumBatch, torch.Tensor]:
        """Media of drawn materials made ready, and the keys int64[B, 2] of their fields."""
        drawn = self._uniforms(media, list(_PURPOSES.values()))
        draws = {name: drawn[:, n] for n, name in enumerate(_PURPOSES)}
        keys = self._keys(media, [Purpose.MEDIUM], Stream.STATIONARY)[:, 0]
        return medium.prepare(self.recipe, self.split, self.tables, self.sizes, draws), keys

    def ranks(self, made: medium.MediumBatch) -> list[int]:
        """Bring the ranks to the host, for which it waits. On "meta" each is 3, for there are no numbers."""
        return [3] * len(made.rank) if made.rank.device.type == "meta" else made.rank.tolist()

    def _drawn(self, numbers: list[int]) -> dict[str, Any]:
        media = [self.recipe.medium_number(n) for n in numbers]
        made, keys = self.prepare(media)
        light = self._objects(numbers)
        ranks = self.ranks(made)
        order, slices = self.buckets(ranks, made.columns.shape[-1], made.base.shape[1])
        images = self._dark(len(numbers), plan.beams_of(self.recipe)[1])
        at = self._put(order)
        inputs = rendering.inputs(self.recipe, self.sizes, made.at(at), keys[at], light[at]) if order else {}
        for bucket, part in slices:
            render = partial(rendering.render, self.sizes, self.tables, bucket)
            images[at[part]] = self.run(bucket, render, {name: each[part] for name, each in inputs.items()})
        parameters = dict(made.parameters)
        contrasts = [
            rendering.expected_contrast(self.recipe, self.sizes, self.tables, made.at(part), light[part])
            for part in self._alone(len(numbers))
        ]
        parameters["expected_contrast"] = torch.cat(contrasts)
        parameters["medium"] = self._put(media).to(torch.float64)
        batch = self._named(numbers, images, light, parameters, made.tilts)
        left = [place for place, rank in enumerate(ranks) if not rank]
        return self._mended(batch, numbers, left) if left else batch

    def _alone(self, count: int) -> list[slice]:
        """Samples one by one on the CPU, where a transform or sum of several has other last bits than that of one."""
        return [slice(n, n + 1) for n in range(count)] if self.device.type == "cpu" else [slice(None)]

    def buckets(self, ranks: list[int], most: int, tilts: int) -> tuple[list[int], list[tuple[int, slice]]]:
        """Order in which to render, and the slices of it that are rendered together, each with its rank.

        The last chunk of a bucket is filled up with its first sample, so that every chunk has one shape.
        """
        members: dict[int, list[int]] = {}
        for place, rank in enumerate(ranks):
            if rank:
                bucket = next((bucket for bucket in BUCKETS if bucket >= rank), most)
                members.setdefault(min(bucket, most), []).append(place)
        order: list[int] = []
        slices = []
        for bucket, places in sorted(members.items()):
            for some in _chunks(places, self.chunk(bucket, tilts)):
                slices.append((bucket, slice(len(order), len(order) + len(some))))
                order += some
        return order, slices

    def chunk(self, rank: int, tilts: int) -> int:
        """Samples rendered at once, the same for every batch: companions do not matter. On the CPU one."""
        if self.device.type == "cpu":
            return 1
        pairs = rank * (rank + 1) // 2
        bytes_each = self.sizes.lags[0] * self.sizes.lags[1] * (8 * rank + 12 * pairs + 8 * tilts * pairs)
        return 2 ** int(np.log2(max(1, min(CHUNK if rank <= 3 else CHUNK // 4, CHUNK_BYTES // bytes_each))))

    def _dark(self, count: int, pictures: int) -> torch.Tensor:
        """Images float32[B, T or F, H, W] to be filled in; what fills up a chunk comes again, with the same bits."""
        return torch.zeros((count, pictures, *self.recipe.camera_shape), device=self.device)

    def _mended(self, batch: dict[str, Any], numbers: list[int], left: list[int]) -> dict[str, Any]:
        """Samples that the device could not prepare, made step by step."""
        own = self._by_steps([numbers[place] for place in left])
        where = self._put(left)
        for key, value in own.items():
            if isinstance(value, dict):
                for name, numbers_ in value.items():
                    batch[key][name].index_copy_(0, where, numbers_)
            else:
                batch[key].view(torch.uint8).index_copy_(0, where, value.view(torch.uint8)) if value.dtype in (
                    torch.uint16,
                ) else batch[key].index_copy_(0, where, value)
        return batch

    def _through_kept(self, numbers: list[int]) -> dict[str, Any]:
        assert self.library is not None
        light = self._objects(numbers)
        media = [self.recipe.medium_number(n) for n in numbers]
        shape = self.library.groups[0].samplers.tilts.shape[1:]
        images = self._dark(len(numbers), shape[0])
        zeros = partial(torch.zeros, dtype=torch.float64, device=self.device)
        contrast, rows = zeros(len(numbers)), zeros((len(numbers), len(self.library.names)))
        tilts = zeros((len(numbers), *shape))
        for number, group in enumerate(self.library.groups):
            places = [place for place, m in enumerate(media) if self.library.places[m][0] == number]
            for some in _chunks(places, 1 if self.device.type == "cpu" else KEPT_CHUNK):
                at = self._put(some)
                which = self._put([self.library.places[media[place]][1] for place in some])
                images[at] = self.run(number, group.images, {"which": which, "light": light[at]})
                contrast[at] = samplers.expected_contrast(group.samplers, which, light[at])
                rows[at], tilts[at] = group.samplers.parameters[which], group.samplers.tilts[which]
        parameters = dict(zip(self.library.names, rows.unbind(1), strict=True))
        parameters |= {"expected_contrast": contrast, "medium": self._put(media).to(torch.float64)}
        return self._named(numbers, images, light, parameters, tilts)

    def _of_one_material(self, numbers: list[int]) -> dict[str, Any]:
        recipe, shared = self.recipe, self.media.samplers
        media = [recipe.medium_number(n) for n in numbers]
        count, keys = len(numbers), self._film_keys(media)
        parameters = dict(zip(self.media.names, shared.parameters.expand(count, -1).unbind(1), strict=True))
        still = torch.ones(count, dtype=torch.float64, device=self.device)
        if isinstance(recipe, DynamicSlab):
            drawn = self._uniforms(media, [Purpose.DYNAMICS])[:, 0, 0]
            parameters["correlation_time"] = medium.value_of(recipe.dynamics.correlation_time, drawn)  # type: ignore[arg-type]
            still = torch.exp(-1 / parameters["correlation_time"])
        light, told = self._light(numbers)
        size = 1 if self.device.type == "cpu" else fresh.chunk(self.media, keys.shape[2], CHUNK, CHUNK_BYTES)
        images = self._dark(count, max(keys.shape[2], shared.tilts.shape[1]))
        for some in _chunks([*range(count)], size):
            at = self._put(some)
            inputs = {"keys": keys[at], "kept": still[at], "light": light[at].to(torch.float32)}
            images[at] = self.run("films", self.media.images, inputs)
        first = torch.zeros(count, dtype=torch.int64, device=self.device)
        contrasts = [samplers.expected_contrast(shared, first[part], light[part]) for part in self._alone(count)]
        parameters |= told | {"expected_contrast": torch.cat(contrasts), "medium": self._put(media).to(torch.float64)}
        return self._named(numbers, images, light, parameters, shared.tilts.expand(count, -1, -1))

    def _film_keys(self, media: list[int]) -> torch.Tensor:
        """Keys int64[B, halves, F, 2] of the fields of media, frame by frame."""
        halves = MEDIUM_PURPOSES[: self.recipe.light.halves]
        keys = self._keys(media, halves, Stream.STATIONARY)[:, :, None]
        frames = fresh.frames_of(self.recipe)
        if frames == 1:
            return keys
        moved = self._words(media, [Purpose.DYNAMICS])[:, :, None].expand(-1, len(halves), frames - 1, -1)
        number = torch.stack(torch.meshgrid(torch.arange(len(halves)), torch.arange(1, frames), indexing="ij"), -1)
        moved = torch.cat([moved, number.expand(len(media), -1, -1, -1)], -1)
        later = words.stream_keys(words.keyed(Stream.STATIONARY, moved)).to(self.device, non_blocking=True)
        return torch.cat([keys, later], 2)

    def _light(self, numbers: list[int]) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Brightness real[B, h, w] of objects or of the beams of a source, and what was drawn for it."""
        recipe = self.recipe
        if not isinstance(recipe, PartiallyCoherent):
            return self._objects(numbers), {}
        drawn = self._uniforms(numbers, [Purpose.OBJECT])[:, 0, 0]
        length = medium.value_of(recipe.coherence_length, drawn)  # type: ignore[arg-type]
        parts = self._alone(len(numbers))
        light = torch.cat([fresh.beams(self.source, length[part]) for part in parts])
        modes = torch.cat([fresh.effective_modes(self.source, light[part]) for part in parts])
        return light, {"coherence_length": length, "effective_modes": modes}

    def _named(
        self, numbers: list[int], images: torch.Tensor, light: torch.Tensor, parameters: dict[str, torch.Tensor],
        tilts: torch.Tensor,
    ) -> dict[str, Any]:  # fmt: skip
        """Batch in the names of the recipe, exposed where it has a camera."""
        recipe = self.recipe
        if recipe.exposure is not None:
            keys = self._keys(numbers, NOISES, Stream.CAMERA)
            images = camera.expose(recipe.exposure, images, keys)
        index = {"index": self._put(numbers)}
        picture, *others = recipe.layout()
        named = {picture: images[:, 0] if picture == "image" else images}
        named |= {"tilts": tilts} if "tilts" in others else {}
        if isinstance(recipe, HiddenObject):
            parameters |= self._told(numbers, light)
            return {**named, "object": light, **index, "parameters": parameters}
        batch: dict[str, Any] = {**named, **index, "parameters": parameters}
        if isinstance(recipe, MaterialRegression):
            target = [parameters["g"], torch.log10(parameters["optical_depth"]), torch.log10(parameters["thickness"])]
            batch["target"] = torch.stack(target, -1).to(torch.float32)
        return batch


def _chunks(places: list[int], size: int) -> Iterator[list[int]]:
    """Cut places into chunks of one size, the last filled up with its first place."""
    for first in range(0, len(places), size):
        some = places[first : first + size]
        yield some + some[:1] * (size - len(some))


@contextmanager
def _ieee(kind: str) -> Iterator[None]:
    """Full single precision in products on a kind of device, whatever the program around allows."""
    # One switch a backend: torch refuses to read the switch of all, where a program has set it and allow_tf32, too.
    switches = torch.backends.cuda.matmul, torch.backends.mkldnn.matmul
    before = [switch.fp32_precision for switch in switches]
    plain = torch.autocast(kind, enabled=False) if kind in _WITH_AUTOCAST else nullcontext()
    try:
        for switch in switches:
            switch.fp32_precision = "ieee"
        with plain:
            yield
    finally:
        for switch, precision in zip(switches, before, strict=True):
            switch.fp32_precision = precision


def _tensors(batch: Any, device: torch.device) -> Any:
    if isinstance(batch, dict):
        return {key: _tensors(value, device) for key, value in batch.items()}
    return torch.from_numpy(np.require(batch, requirements=["C", "W"])).to(device)
