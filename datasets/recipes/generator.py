"""Samples in batches: the one program behind every door, a pure function from sample numbers to tensors on a device.

    numbers -> media (drawn, planned, made ready) -> fields -> images of objects -> camera -> batch

    generator = SpeckleGenerator(recipe, seed=0, split="train", device="cuda")
    batch = generator(range(256))               # {"image": float32[256, H, W], "object": ..., "parameters": {...}}

Samples are rendered in groups of equal rank, in chunks of one shape: the companions of a sample do not matter. On the
CPU a chunk is a sample, where a transform of several has other last bits than that of one. Of a device the host asks
which slabs the lookup table has, whether the first polynomials are enough, and the ranks.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import index
from threading import Lock
from typing import Any, cast

import torch

from specklegen.core.devices import checked_device
from specklegen.core.errors import reject
from specklegen.core.most_recent import MostRecent
from specklegen.core.random_streams import Stream, seed_words
from specklegen.core.shielded import shielded
from specklegen.datasets.addresses import Addresses
from specklegen.datasets.recipes.media import DrawnMedia, RecipeMedia, Rendering, planned_whole
from specklegen.datasets.recipes.parts import exposure
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.parts.sampler import number_of
from specklegen.datasets.split import Split, split_number
from specklegen.synthesis.correlations import Places
from specklegen.synthesis.graphs import Graphs, each_time
from specklegen.synthesis.imaging import ImagedMedia, Imaging
from specklegen.synthesis.modes import one_by_one
from specklegen.synthesis.streams import Streams

CHUNK, CHUNK_BYTES = 64, 2**30
"""Samples of a chunk, and the memory that its largest tensors may take on a device; on the CPU a chunk is a sample."""
AT_ONCE, AT_ONCE_BYTES = 1024, 2**28
"""Samples that are best asked for at once, so that few chunks are filled up, and the memory of their images."""
KEPT = 64
"""Media kept in a process on the CPU, ..."""
_KEPT_BYTES, _FIRST_BYTES = 2**22, 2**29
"""... with their spectra, where those of one take at most the former, or those of all up to its number the latter,
else with their fields, where those do."""
_SLOW_BYTES = 2**24
"""Spectra of more than these bytes are not kept on the CPU: an image takes less from fields."""
_MOST_BYTES = 2**31  # of spectra on a device, and of all that is kept of the generators of a process


@dataclass(frozen=True)
class ReadyMedia:
    """Media made ready: what was drawn, who renders each, and where.

    Attributes
    ----------
    groups : list of (places, imaging)
        Media that are rendered together; where they share one imaging, it is the same object.
    at : list of (group, place)
        Of every medium.
    parameters : dict of float64[M]
        What is stored of them, the sampler included.
    """

    drawn: DrawnMedia
    groups: list[tuple[list[int], Any]]
    at: list[tuple[int, int]]
    parameters: dict[str, torch.Tensor]
    streams: Streams


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
    objects
        Split whose objects are shown, if another one: those of "test" behind media of "train" are unseen objects behind
        seen media.

    Raises
    ------
    RuleError
        If the split is unknown, there is no such device, or the recipe cannot say where it renders.
    """

    @shielded()
    def __init__(
        self, recipe: RecipeMedia, seed: Any = 0, split: str = "train", device: str | torch.device = "cpu", *,
        graphs: bool = True, objects: str | None = None,
    ) -> None:  # fmt: skip
        split_number(split)
        split_number(objects or split)
        if not isinstance(recipe, RecipeMedia):
            reject("SpeckleGenerator.recipe", "a recipe of this library", type(recipe).__name__)
        counted = str(device) == "meta"  # holds no numbers: there, batches are counted
        self.device = torch.device(device) if counted else checked_device("SpeckleGenerator.device", device)
        self.recipe, self.seed, self.split = recipe.on("cpu"), seed_words(seed), cast(Split, split)
        self.drawn = Addresses(self.seed, self.split, self.device)
        self.shown = Addresses(self.seed, cast(Split, objects or split), self.device)
        self.run = Graphs(self.device) if graphs and self.device.type == "cuda" else each_time
        self.one_by_one = one_by_one(self.device)  # whether objects may be looked at before they are transformed
        self.recipe.rendering  # noqa: B018 - a strict recipe is refused here, whatever is kept of others
        self._lock = Lock()
        self._media: OrderedDict[int, tuple[ReadyMedia, int]] = OrderedDict()
        self._spectra: dict[int, Any] = {}
        self._fields: dict[int, Any] = {}
        self._shared: Any = None

    def __call__(self, indices: Sequence[int] | torch.Tensor) -> dict[str, Any]:
        """Make samples: the keys of ``recipe.batch``, tensors on the device; parameters float64[B].

        Parameters
        ----------
        indices
            Numbers of the samples, on the host.
        """
        try:
            numbers = [index(n) for n in indices]
        except TypeError:
            reject("SpeckleGenerator indices", "whole numbers", indices)
        if not numbers or min(numbers) < 0 or max(numbers) >= 2**63:  # samples hold them as int64
            reject("SpeckleGenerator indices", "at least one index, each from 0 to 2**63 - 1", numbers)
        with shielded():
            return self._batch(numbers)

    @property
    def at_once(self) -> int:
        """Samples that are best asked for at once."""
        picture = next(iter(self.recipe.layout().values()))
        return max(1, min(AT_ONCE, AT_ONCE_BYTES // (4 * math.prod(picture.shape))))

    def report(self) -> dict[str, Any]:
        """Say how batches are made: by which sampler, and what the host does."""
        rendering = self.recipe.rendering
        host = [*self.recipe.host_work()]
        report = {"sampler": "chosen for each medium" if rendering is None else rendering.name,
                  "device": str(self.device), "host": host}  # fmt: skip
        return report | {"graphs": self.run.report() if isinstance(self.run, Graphs) else "none"}

    def held(self) -> list[Any]:
        """All that is kept for samples to come: media, their spectra, what media share."""
        with self._lock:
            return [*self._media.values(), *self._spectra.values(), *self._fields.values(), self._shared]

    def media(self, numbers: Sequence[int]) -> ReadyMedia:
        """Draw media and make them ready, all at once."""
        recipe, drawn = self.recipe, self.drawn
        parts = recipe.drawn_media(drawn, numbers)
        groups: list[tuple[list[int], Any]] = []
        values: dict[str, list[tuple[list[int], torch.Tensor]]] = {}
        for places, media in parts:
            for some, rendering in recipe.renderings(media):
                of = media if len(some) == len(media) else media.at(some)
                at = [places[n] for n in some]
                groups += [([at[n] for n in own], imaging) for own, imaging in self._prepared(of, rendering)]
                whole = partial(torch.full, (len(at),), dtype=torch.float64, device=self.device)
                sampler, error = float(number_of(rendering.chosen)), rendering.expected_error
                own = of.parameters | {"sampler": whole(sampler), "expected_error": whole(error)}
                for name, value in own.items():
                    values.setdefault(name, []).append((at, value))
        at_place: dict[int, tuple[int, int]] = {}
        for group, (places, _) in enumerate(groups):
            at_place |= {place: (group, n) for n, place in enumerate(places)}
        whole_drawn = _together(parts, len(numbers))
        parameters = {name: _scattered(rows, len(numbers)) for name, rows in values.items()}
        ordered = [at_place[n] for n in range(len(numbers))]
        streams = self._streams(numbers, whole_drawn)._replace(shares=recipe.polarisation_shares(parameters))
        return ReadyMedia(whole_drawn, groups, ordered, parameters, streams)

    def _prepared(self, media: DrawnMedia, rendering: Rendering) -> list[tuple[list[int], Any]]:
        """Media made ready by the sampler that was planned for them; all that are alike share what is made."""
        recipe = self.recipe
        if rendering.chosen.abilities.medium_by_medium:  # planned for the scene of each
            groups: list[tuple[list[int], Any]] = []
            for n in range(len(media)):
                ((_, request),) = recipe.requests(media.at([n]))
                scene, paths = recipe.path_scene(media, n), recipe.material.kernel_paths
                chosen = planned_whole(scene, paths, type(rendering.chosen)).chosen
                groups += [([n], imaging) for _, imaging in chosen.prepare_media(request)]
            return groups
        if recipe.media_alike:
            with self._lock:
                if self._shared is None:
                    ((_, request),) = recipe.requests(media.at([0]))
                    ((_, self._shared),) = rendering.chosen.prepare_media(request)
            return [([*range(len(media))], self._shared)]
        return [
            ([places[n] for n in own], imaging)
            for places, request in recipe.requests(media)
            for own, imaging in rendering.chosen.prepare_media(request)
        ]

    def _streams(self, numbers: Sequence[int], media: DrawnMedia) -> Streams:
        words = self.drawn.words(numbers, self.recipe.medium_purposes)
        keys = self.drawn.keys(Stream.STATIONARY, words)[:, :, None]
        later = self.recipe.later_frames(self.drawn, numbers)
        return Streams(keys if later is None else torch.cat([keys, later], 2), media.still, words)

    def _ready(self, numbers: list[int]) -> list[tuple[ReadyMedia, int]]:
        """Media made ready, and where each is; those that come again are kept."""
        if not self.recipe.shares_media:
            batch = self.media(numbers)
            return [(batch, n) for n in range(len(numbers))]
        with self._lock:
            ready = {number: self._media[number] for number in numbers if number in self._media}
        missing = [number for number in dict.fromkeys(numbers) if number not in ready]
        if missing:
            batch = self.media(missing)
            ready |= {number: (batch, n) for n, number in enumerate(missing)}
        with self._lock:  # others may have dropped by now what was there
            for number in numbers:
                self._media[number] = ready[number]
                self._media.move_to_end(number)
            most = KEPT if self.device.type == "cpu" else max(KEPT, self.recipe.media or 0)
            while len(self._media) > most:
                dropped, _ = self._media.popitem(last=False)
                self._spectra.pop(dropped, None)
                self._fields.pop(dropped, None)
        return [ready[number] for number in numbers]

    def _batch(self, numbers: list[int]) -> dict[str, Any]:
        recipe = self.recipe
        media = [recipe.medium_number(n) for n in numbers]
        ready = self._ready(media)
        lit = recipe.lit(self.shown, numbers)
        images = self._images(media, ready, lit)
        whole = ready[0][0]
        if all(batch is whole for batch, _ in ready):
            places = [n for _, n in ready]
            parameters = {name: value[places] for name, value in whole.parameters.items()}
            tilts = whole.drawn.tilts[places]
        else:
            parameters = {
                name: torch.stack([batch.parameters[name][n] for batch, n in ready]) for name in whole.parameters
            }
            tilts = torch.stack([batch.drawn.tilts[n] for batch, n in ready])
        parameters |= lit.parameters
        left = recipe.light.halves**-0.5 * recipe.contrast_left(parameters)
        parameters["expected_contrast"] = self._contrasts(ready, lit) * left
        parameters["medium"] = self.drawn.put(media).to(torch.float64)
        images = recipe.on_sensor(images, parameters)
        bench, settings = recipe.bench, {}
        if bench is not None:
            settings = bench.found(parameters)
            images = bench.seen(images, settings, bench.keys(self.drawn, numbers))
        if recipe.exposure is not None:
            keys = self.drawn.keys(Stream.CAMERA, self.drawn.words(numbers, exposure.NOISES))
            if bench is None:
                images = exposure.expose(recipe.exposure, images, keys)
            else:
                images = bench.exposed(images, settings, keys, recipe.exposure)
        named = recipe.named(images, tilts, parameters) | lit.arrays
        return named | {"index": self.drawn.put(numbers), "parameters": parameters}

    def _images(self, media: list[int], ready: list[tuple[ReadyMedia, int]], lit: Lit) -> torch.Tensor:
        """Images over their expected value, float32[B, T or F, H, W]."""
        shape = (self.recipe.pictures, *self.recipe.camera_shape)
        images = torch.zeros((len(media), *shape), device=self.device)
        for places, batch, imaging in _grouped(ready):
            for some in _chunks(places, self._chunk(imaging, batch.streams)):
                at = self._at(some)
                images[at] = self._rendered([media[p] for p in some], imaging, batch, [ready[p][1] for p in some],
                                            lit.at(at))  # fmt: skip
        return images

    def _at(self, places: list[int]) -> Places:
        """Return places as what picks them fastest: one is a view."""
        return slice(places[0], places[0] + 1) if len(places) == 1 else self.drawn.put(places)

    def _rendered(
        self, media: list[int], imaging: Any, made: ReadyMedia, places: list[int], lit: Lit
    ) -> torch.Tensor:
        """Images of a chunk of samples, of one imaging."""
        within = [made.at[n][1] for n in places]
        first, last = within[0], within[-1] + 1
        # Media that follow each other are a view of their batch, others are copied.
        some = imaging.at(slice(first, last) if within == [*range(first, last)] else self.drawn.put(within))
        if not isinstance(some, Imaging) or lit.step is not None:
            drawn = some.media(made.streams.at(self._at(places)))
            seen = drawn.images(lit.light) if lit.step is None else drawn.superposed(lit.light, lit.step)
            return self.recipe.exposed(seen).to(torch.float32)
        own = {} if self.one_by_one or self.recipe.media_alike else some.tensors()  # what stays is not copied
        shared = self.recipe.shares_media
        if shared and self._keeps(media[0], imaging):  # on the CPU a chunk is one sample
            held = [self._spectra_of(m, imaging, made, place) for m, place in zip(media, places, strict=True)]
            inputs = {"spectra": torch.cat(held) if len(held) > 1 else held[0], "light": lit.light} | own
            seen = self.run(("kept", *some.statics), partial(_seen_through, some, self.one_by_one), inputs)
            return self.recipe.exposed(seen)
        streams = made.streams.at(self._at(places))
        if shared and self._keeps_fields(media[0], imaging, streams):
            fields = self._of_medium(self._fields, media[0], lambda: some.media(streams).drawn)
            return self.recipe.exposed(ImagedMedia(some, fields).images(lit.light))
        inputs = {"keys": streams.keys, "still": streams.still, "light": lit.light} | own
        if streams.shares is not None:
            inputs["shares"] = streams.shares
        return self.recipe.exposed(self.run(
            ("drawn", streams.shares is None, *some.statics), partial(_drawn_and_seen, some, self.one_by_one), inputs
        ))  # fmt: skip

    def _keeps(self, medium: int, imaging: Imaging) -> bool:
        """True if spectra of shared media are kept: by recipe and medium alone; last bits of samples depend on it."""
        each = imaging.spectra_bytes * self.recipe.frames
        if self.device.type == "cpu":
            return imaging.spectra_bytes <= _SLOW_BYTES and _few(each, medium)
        return each <= _MOST_BYTES // max(KEPT, self.recipe.media or KEPT)

    def _keeps_fields(self, medium: int, imaging: Imaging, streams: Streams) -> bool:
        """Return whether fields of shared media are kept, where spectra are not: on the CPU."""
        each = imaging.field_bytes * streams.keys[0].numel() // 2
        return self.device.type == "cpu" and _few(each, medium)

    def _spectra_of(self, medium: int, imaging: Imaging, made: ReadyMedia, place: int) -> torch.Tensor:
        """Spectra of one medium, complex64[1, F, pairs, n, m], kept for all objects behind it."""
        some, own = imaging.at(self._at([made.at[place][1]])), made.streams.at(self._at([place]))
        return self._of_medium(self._spectra, medium, lambda: some.media(own).shared().spectra)

    def _of_medium(
        self, held: dict[int, Any], medium: int, make: Callable[[], torch.Tensor | None]
    ) -> torch.Tensor:
        """Return the cached part of a medium for all objects behind it; make it if there is none."""
        with self._lock:
            own = held.get(medium)
        if own is None:
            own = make()
            with self._lock:
                if medium in self._media:  # else nobody would drop it
                    held[medium] = own
        return cast(torch.Tensor, own)

    def _chunk(self, imaging: Any, streams: Streams) -> int:
        """Samples rendered at once, the same for every batch: companions do not matter. On the CPU one."""
        if self.one_by_one or not isinstance(imaging, Imaging):
            return 1
        frames = streams.keys.shape[2]
        (rows, columns), pairs = imaging.lags, imaging.rank * (imaging.rank + 1) // 2
        h, w = imaging.shape
        tilts, draws = imaging.modes.shape[1], imaging.draws * streams.keys.shape[1]
        bytes_each = rows * columns * (8 * imaging.rank * draws * frames + 12 * pairs * frames + 4 * tilts * pairs)
        bytes_each += 4 * pairs * h * (w + columns)
        most = CHUNK if imaging.rank <= 3 or self.recipe.media_alike else CHUNK // 4
        return 2 ** int(math.log2(max(1, min(most, CHUNK_BYTES // bytes_each))))

    def _contrasts(self, ready: list[tuple[ReadyMedia, int]], lit: Lit) -> torch.Tensor:
        """Expected contrast float64[B] of the images under polarised light; 1 of beams that interfere."""
        contrasts = torch.ones(len(ready), dtype=torch.float64, device=self.device)
        if lit.step is not None:
            return contrasts
        for places, batch, imaging in _grouped(ready):
            # In chunks of one size on a device, where an operator is compiled anew for every number of samples.
            for some in [places] if self.one_by_one else _chunks(places, CHUNK):
                within = self._at([batch.at[ready[place][1]][1] for place in some])
                at = self._at(some)
                contrasts[at] = imaging.contrast(lit.light[at], within)
        return contrasts


def _few(each: int, medium: int) -> bool:
    """Return whether ``each`` bytes of a medium are kept on the CPU."""
    return each <= _KEPT_BYTES or each * (medium + 1) <= _FIRST_BYTES


def _grouped(ready: list[tuple[ReadyMedia, int]]) -> Iterator[tuple[list[int], ReadyMedia, Any]]:
    """Samples whose media are rendered together: their places, the media, and what images them."""
    members: dict[tuple[int, int], list[int]] = {}
    for place, (batch, n) in enumerate(ready):
        members.setdefault((id(batch), batch.at[n][0]), []).append(place)
    for places in members.values():
        batch, n = ready[places[0]]
        yield places, batch, batch.groups[batch.at[n][0]][1]


def _drawn_and_seen(
    imaging: Imaging, one_by_one: bool, keys: Any, still: Any, light: Any, shares: Any = None, **tensors: torch.Tensor
) -> torch.Tensor:
    """Images of drawn media, over their expected value; not one by one of tensors alone, so that it can be replayed."""
    some = imaging.of(tensors)
    return ImagedMedia(some, some.fields(keys, still, shares=shares), None, one_by_one).images(light)


def _seen_through(
    imaging: Imaging, one_by_one: bool, spectra: Any, light: Any, **tensors: torch.Tensor
) -> torch.Tensor:
    """Images through kept media."""
    return ImagedMedia(imaging.of(tensors), None, spectra, one_by_one).images(light)


def _together(parts: list[tuple[list[int], DrawnMedia]], count: int) -> DrawnMedia:
    """Part of media that does not depend on how they are known: tilts, and their rest."""
    _, first = parts[0]
    if len(parts) == 1:
        return first
    tilts, still = ([(places, getattr(part, name)) for places, part in parts] for name in ("tilts", "still"))
    return replace(first, tilts=_scattered(tilts, count), still=_scattered(still, count))


def _scattered(parts: list[tuple[list[int], torch.Tensor]], count: int) -> torch.Tensor:
    """Rows of several parts in their places; NaN where a part has none."""
    places, first = parts[0]
    if len(parts) == 1 and places == [*range(count)]:
        return first
    whole = torch.full((count, *first.shape[1:]), torch.nan, dtype=first.dtype, device=first.device)
    for places, rows in parts:
        whole[places] = rows
    return whole


def _chunks(places: list[int], size: int) -> Iterator[list[int]]:
    """Cut places into chunks of one size, the last filled up with its first place once more, with the same bits."""
    for first in range(0, len(places), size):
        some = places[first : first + size]
        yield some + some[:1] * (size - len(some))


_Key = tuple[RecipeMedia, tuple[int, ...], Split, str]
GENERATORS: MostRecent[_Key, SpeckleGenerator] = MostRecent(_MOST_BYTES, held=SpeckleGenerator.held)
"""Generators of this process that were asked for last: samples asked for one by one find the media before them."""


def generator_of(recipe: RecipeMedia, seed: tuple[int, ...], split: Split, device: str) -> SpeckleGenerator:
    """Return the generator of a recipe, ``seed_words``, split and device: the one that is cached, or a new one."""
    key = (recipe, seed, split, device)
    return GENERATORS.get(key, lambda: SpeckleGenerator(*key))
