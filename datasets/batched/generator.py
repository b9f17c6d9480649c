"""Samples made on a device, batch by batch: a pure function from sample numbers to tensors that lie there.

    generator = SpeckleGenerator(recipe, seed=0, split="train", device="cuda")
    batch = generator(range(256))               # {"image": float32[256, H, W], "object": ..., "parameters": {...}}

A batch is prepared at once, then rendered in buckets of equal rank, in chunks of one shape: the companions of a sample
do not matter. The ranks are the one thing that the host waits for.
"""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch

from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Stream
from specklegen.datasets.batched import camera, kept, medium, plan, rendering, words
from specklegen.datasets.batched.glyphs import GlyphTables, glyph_places, glyph_tables, glyphs
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.recipe import NOISES, Recipe
from specklegen.datasets.recipes.tilt_stack import MaterialRegression, TiltStack
from specklegen.datasets.split import Purpose, Split, split_number, substream

BUCKETS = (1, 2, 3, 4, 6, 8, 11, 16, 22, 28)
CHUNK_BYTES = 2**30
"""Memory that the largest tensors of a chunk may take on a device; on the CPU a chunk is one sample."""
_PURPOSES = {"material": Purpose.MATERIAL, "field": Purpose.FIELD, "tilts": Purpose.TILTS}


class SpeckleGenerator:
    """Batches of one split of a recipe, made where they are used.

    Parameters
    ----------
    recipe, seed, split
        As for ``recipe.sample``.
    device
        Any device of torch. On "cuda" steps that want one kernel are compiled at first use.

    Raises
    ------
    RuleError
        If the split is unknown, or the recipe cannot say where it renders.
    """

    def __init__(self, recipe: Recipe, seed: int = 0, split: str = "train", device: str | torch.device = "cpu") -> None:
        self.number = split_number(split)
        if not isinstance(recipe, Recipe):
            reject("SpeckleGenerator.recipe", "a recipe of this library", type(recipe).__name__)
        self.recipe, self.seed, self.split = recipe.on("cpu"), seed, cast(Split, split)
        self.device = torch.device(device)
        self.way, self.why = plan.way_of(recipe)
        self.tail = substream(seed, self.split, Purpose.MATERIAL, 0)[4:]
        self.outlines: GlyphTables | None = None
        self._kept: dict[int, kept.KeptMedium] = {}
        self._kept_bytes = 0
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
        if not numbers:
            reject("SpeckleGenerator indices", "at least one index", numbers)
        # Complex products of a user who allows TF32 would be wrong by 3e-4, and half precision is no place for this.
        with torch.no_grad(), torch.autocast(self.device.type, enabled=False), _ieee(), one_torch_thread():
            if self.way == plan.STEPS:
                return self._by_steps(numbers)
            return self._drawn(numbers) if self.way == plan.DRAWN else self._through_kept(numbers)

    def report(self) -> dict[str, Any]:
        """Say how batches are made: the way, what keeps the recipe from a faster one, and what the host still does."""
        host = [] if self.way != plan.STEPS else ["everything: samples one by one on the CPU, then copied"]
        if self.way == plan.KEPT:
            host.append("each medium once, at its first sample")
        if self.way != plan.STEPS and isinstance(self.recipe, HiddenObject) and self.outlines is None:
            host.append(f"pictures of {self.recipe.objects.type}")
        return {"way": self.way, "device": str(self.device), "why": list(self.why), "host": host}

    def _by_steps(self, numbers: list[int]) -> dict[str, Any]:
        return _tensors(self.recipe.batch(self.seed, self.split, numbers), self.device)

    def _words(self, numbers: Sequence[int], purposes: Sequence[int]) -> torch.Tensor:
        return words.substreams(self.number, [int(p) for p in purposes], self._put(numbers), self.tail)

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
        drawn = words.uniforms(self._words(numbers, [Purpose.OBJECT]))[:, 0]
        return glyphs(self.outlines, places, drawn)

    def prepare(self, media: list[int]) -> tuple[medium.MediumBatch, torch.Tensor]:
        """Media of drawn materials made ready, and the keys int64[B, 2] of their fields."""
        drawn = words.uniforms(self._words(media, list(_PURPOSES.values())))
        draws = {name: drawn[:, n] for n, name in enumerate(_PURPOSES)}
        keys = words.stream_keys(words.keyed(Stream.STATIONARY, self._words(media, [Purpose.MEDIUM])))[:, 0]
        return medium.prepare(self.recipe, self.split, self.tables, self.sizes, draws), keys

    def ranks(self, made: medium.MediumBatch) -> list[int]:
        """Ranks on the host: the one wait of a batch. On "meta" there are no numbers: the median's."""
        return [3] * len(made.rank) if made.rank.device.type == "meta" else made.rank.tolist()

    def _drawn(self, numbers: list[int]) -> dict[str, Any]:
        media = [self.recipe.medium_number(n) for n in numbers]
        made, keys = self.prepare(media)
        light = self._objects(numbers)
        ranks = self.ranks(made)
        tilts = made.base.shape[1]
        images = torch.empty((len(numbers), tilts, *self.recipe.camera_shape), device=self.device)
        buckets: dict[int, list[int]] = {}
        for place, rank in enumerate(ranks):
            if rank:
                bucket = next((bucket for bucket in BUCKETS if bucket >= rank), rank)
                buckets.setdefault(min(bucket, made.columns.shape[-1]), []).append(place)
        for bucket, places in sorted(buckets.items()):
            size = self.chunk(bucket, tilts)
            for first in range(0, len(places), size):
                some = places[first : first + size]
                whole = self._put(some + some[:1] * (size - len(some)))  # every chunk of one shape
                part = rendering.render(
                    self.recipe, self.sizes, self.tables, _chosen(made, whole), keys[whole], light[whole], bucket
                )
                images.index_copy_(0, whole[: len(some)], part[: len(some)])
        parameters = dict(made.parameters)
        parameters["expected_contrast"] = rendering.expected_contrast(
            self.recipe, self.sizes, self.tables, made, light
        )
        parameters["medium"] = self._put(media).to(torch.float64)
        batch = self._named(numbers, images, light, parameters, made.tilts)
        left = [place for place, rank in enumerate(ranks) if not rank]
        return self._mended(batch, numbers, left) if left else batch

    def chunk(self, rank: int, tilts: int) -> int:
        """Samples rendered at once."""
        if self.device.type == "cpu":
            return 1
        pairs = rank * (rank + 1) // 2
        bytes_each = self.sizes.lags[0] * self.sizes.lags[1] * (8 * rank + 12 * pairs + 8 * tilts * pairs)
        return 2 ** int(np.log2(max(1, min(256, CHUNK_BYTES // bytes_each))))

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
        recipe = cast(HiddenObject, self.recipe)
        light = self._objects(numbers)
        media = [recipe.medium_number(n) for n in numbers]
        groups: dict[int, list[int]] = {}
        for place, number in enumerate(media):
            groups.setdefault(number, []).append(place)
        ready = {number: self._medium(number) for number in groups}
        some = next(iter(ready.values()))
        images = torch.empty((len(numbers), len(some.tilts), *recipe.camera_shape), device=self.device)
        contrast = torch.empty(len(numbers), dtype=torch.float64, device=self.device)
        tilts = torch.empty((len(numbers), *some.tilts.shape), dtype=torch.float64, device=self.device)
        for number, places in groups.items():
            size = 1 if self.device.type == "cpu" else 4
            for first in range(0, len(places), size):
                part = places[first : first + size]
                whole = self._put(part + part[:1] * (size - len(part)))
                seen, objects = whole[: len(part)], light[whole]
                images.index_copy_(0, seen, kept.render(ready[number], objects)[: len(part)])
                contrast.index_copy_(0, seen, kept.expected_contrast(ready[number], objects)[: len(part)])
                tilts.index_copy_(0, seen, ready[number].tilts.expand(len(part), -1, -1))
        names = some.parameters
        rows = [[ready[number].parameters[name] for name in names] for number in media]
        table = torch.tensor(rows, dtype=torch.float64)
        columns = dict(zip(names, table.to(self.device).unbind(1), strict=True))
        parameters = columns | {"expected_contrast": contrast, "medium": self._put(media).to(torch.float64)}
        return self._named(numbers, images, light, parameters, tilts)

    def _medium(self, number: int) -> kept.KeptMedium:
        if number not in self._kept:
            made = kept.keep(cast(HiddenObject, self.recipe), self.seed, self.split, number, self.device)
            self._kept_bytes += made.spectra.numel() * made.spectra.element_size()
            if self._kept_bytes > kept.MOST_BYTES:
                return made
            self._kept[number] = made
        return self._kept[number]

    def _named(
        self, numbers: list[int], images: torch.Tensor, light: torch.Tensor, parameters: dict[str, torch.Tensor],
        tilts: torch.Tensor,
    ) -> dict[str, Any]:  # fmt: skip
        """Batch in the names of the recipe, exposed where it has a camera."""
        recipe = self.recipe
        if recipe.exposure is not None:
            keys = words.stream_keys(words.keyed(Stream.CAMERA, self._words(numbers, NOISES)))
            images = camera.expose(recipe.exposure, images, keys)
        index = {"index": self._put(numbers)}
        stack = {"stack": images, "tilts": tilts}
        if isinstance(recipe, HiddenObject):
            named = stack if images.shape[1] > 1 or "stack" in recipe.layout() else {"image": images[:, 0]}
            return {**named, "object": light, **index, "parameters": parameters}
        batch: dict[str, Any] = {**stack, **index, "parameters": parameters}
        if isinstance(recipe, MaterialRegression):
            target = [parameters["g"], torch.log10(parameters["optical_depth"]), torch.log10(parameters["thickness"])]
            batch["target"] = torch.stack(target, -1).to(torch.float32)
        return batch


def _chosen(made: medium.MediumBatch, places: torch.Tensor) -> medium.MediumBatch:
    """Some media of a batch, with all that rendering asks of them."""
    pick = lambda value: value[places]  # noqa: E731
    return medium.MediumBatch(
        {}, pick(made.columns), pick(made.rank), pick(made.cells), pick(made.size), pick(made.envelope),
        pick(made.tilts), pick(made.base), pick(made.object_pitch), pick(made.camera_pitch), made.kernels,
    )  # fmt: skip


class _ieee:  # noqa: N801
    """Full single precision in matrix products, whatever the program allows."""

    def __enter__(self) -> None:
        self._before = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("highest")

    def __exit__(self, *_: object) -> None:
        torch.set_float32_matmul_precision(self._before)


def _tensors(batch: Any, device: torch.device) -> Any:
    if isinstance(batch, dict):
        return {key: _tensors(value, device) for key, value in batch.items()}
    return torch.from_numpy(np.require(batch, requirements=["C", "W"])).to(device)
