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
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import index
from threading import Lock
from typing import Any, cast

import numpy as np
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
from specklegen.synthesis.contrast import speckle_contrast
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
    at : int64[M, 2]
        Group of every medium, and place in it.
    parameters : dict of float64[M]
        What is stored of them, the sampler included.
    """

    drawn: DrawnMedia
    groups: list[tuple[list[int], Any]]
    at: np.ndarray
    parameters: dict[str, torch.Tensor]
    streams: Streams


@dataclass(frozen=True)
class Behind:
    """Samples that are seen through media of one batch.

    Attributes
    ----------
    samples : int64[n]
        Their places among the samples.
    made : ReadyMedia
        The media.
    media : int64[n]
        Place of the medium of each.
    """

    samples: np.ndarray
    made: ReadyMedia
    media: np.ndarray

    def groups(self) -> Iterator[tuple[Any, np.ndarray]]:
        """Yield samples whose media are rendered together: what images them, and which they are, int64[m]."""
        group = self.made.at[self.media, 0]
        order = np.argsort(group, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
            yield self.made.groups[group[rows[0]]][1], rows


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
        values: list[tuple[list[int], dict[str, torch.Tensor]]] = []
        for places, media in parts:
            for some, rendering in recipe.renderings(media):
                of = media if len(some) == len(media) else media.at(some)
                at = [places[n] for n in some]
                groups += [([at[n] for n in own], imaging) for own, imaging in self._prepared(of, rendering)]
                whole = partial(torch.full, (len(at),), dtype=torch.float64, device=self.device)
                sampler, error = float(number_of(rendering.chosen)), rendering.expected_error
                values.append((at, of.parameters | {"sampler": whole(sampler), "expected_error": whole(error)}))
        ordered = np.empty((len(numbers), 2), np.int64)
        for group, (places, _) in enumerate(groups):
            ordered[places, 0], ordered[places, 1] = group, np.arange(len(places))
        whole_drawn = _together(parts, len(numbers))
        parameters = _scattered(values, len(numbers))
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

    def _ready(self, numbers: list[int]) -> list[Behind]:
        """Media made ready, and which samples are behind which; those that come again are kept."""
        if not self.recipe.shares_media:
            every = np.arange(len(numbers))
            return [Behind(every, self.media(numbers), every)]
        different = [*dict.fromkeys(numbers)]
        with self._lock:
            ready = {number: self._media[number] for number in different if number in self._media}
        missing = [number for number in different if number not in ready]
        if missing:
            batch = self.media(missing)
            ready |= {number: (batch, n) for n, number in enumerate(missing)}
        with self._lock:  # others may have dropped by now what was there
            for number in reversed(dict.fromkeys(reversed(numbers))):
                self._media[number] = ready[number]
                self._media.move_to_end(number)
            most = KEPT if self.device.type == "cpu" else max(KEPT, self.recipe.media or 0)
            while len(self._media) > most:
                dropped, _ = self._media.popitem(last=False)
                self._spectra.pop(dropped, None)
                self._fields.pop(dropped, None)
        batches = {id(batch): batch for batch, _ in ready.values()}
        number_of_batch = {key: n for n, key in enumerate(batches)}
        at = {number: (number_of_batch[id(batch)], n) for number, (batch, n) in ready.items()}
        which, media = np.array([at[number] for number in numbers]).T
        samples = [np.flatnonzero(which == n) for n in range(len(batches))]
        return [Behind(own, batch, media[own]) for own, batch in zip(samples, batches.values(), strict=True)]

    def _batch(self, numbers: list[int]) -> dict[str, Any]:
        recipe = self.recipe
        media = recipe.medium_numbers(numbers)
        ready = self._ready(media)
        lit = recipe.lit(self.shown, numbers)
        images = self._images(media, ready, lit)
        tilts, parameters = self._of_samples(ready, len(numbers))
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

    def _of_samples(self, ready: list[Behind], count: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Tilts float64[B, T, 2] and parameters float64[B] of the media of samples."""
        rows = []
        for behind in ready:
            made = behind.made
            media, values = self.drawn.put(behind.media), {"": made.drawn.tilts} | made.parameters
            values = {name: value.index_select(0, media) for name, value in values.items()}
            rows.append((behind.samples.tolist(), values))
        parameters = _scattered(rows, count)
        return parameters.pop(""), parameters

    def _images(self, media: list[int], ready: list[Behind], lit: Lit) -> torch.Tensor:
        """Images over their expected value, float32[B, T or F, H, W]."""
        shape = (self.recipe.pictures, *self.recipe.camera_shape)
        images = torch.zeros((len(media), *shape), device=self.device)
        for behind in ready:
            for imaging, rows in behind.groups():
                chunks = _chunks(rows, self._chunk(imaging, behind.made.streams))
                samples, places = behind.samples[chunks], behind.media[chunks]
                if self.one_by_one or not isinstance(imaging, Imaging) or lit.step is not None:
                    for some, of in zip(samples, places, strict=True):
                        at = self._at(some)
                        images[at] = self._rendered(media[some[0]], imaging, behind.made, of, lit.at(at))
                else:
                    self._render(images, media, imaging, behind.made, samples, places, lit.light)
        return images

    def _at(self, places: np.ndarray) -> Places:
        """Return places as what picks them fastest: those that follow each other are a view."""
        first = int(places[0])
        if np.array_equal(places, np.arange(first, first + len(places))):
            return slice(first, first + len(places))
        return self.drawn.put(places)

    def _rendered(self, medium: int, imaging: Any, made: ReadyMedia, places: np.ndarray, lit: Lit) -> torch.Tensor:
        """Images of a chunk of samples, of one imaging; on the CPU of one, seen through a medium of this number."""
        some, at = imaging.at(self._at(made.at[places, 1])), self._at(places)
        if not isinstance(some, Imaging) or lit.step is not None:
            drawn = some.media(made.streams.at(at))
            if lit.step is None:
                seen = drawn.images(lit.light)
            elif lit.exit_radius is None:
                seen = drawn.superposed(lit.light, lit.step)
            elif isinstance(drawn, ImagedMedia):
                seen = drawn.superposed(lit.light, lit.step, lit.exit_radius)
            else:
                reject(f"{type(self.recipe).__name__}.exit_radius", "left out where path sums render", "an aperture",
                       'Take sampler = "stationary", where the planner finds it fit.')  # fmt: skip
            return self.recipe.exposed(seen).to(torch.float32)
        if self.recipe.shares_media and self._keeps(medium, imaging):
            spectra = self._of_medium(self._spectra, medium, lambda: some.media(made.streams.at(at)).shared().spectra)
            return self.recipe.exposed(ImagedMedia(some, None, spectra).images(lit.light))
        if self.recipe.shares_media and self._keeps_fields(medium, imaging, made.streams):
            fields = self._of_medium(self._fields, medium, lambda: some.media(made.streams.at(at)).drawn)
            return self.recipe.exposed(ImagedMedia(some, fields).images(lit.light))
        return self.recipe.exposed(some.media(made.streams.at(at)).images(lit.light))

    def _render(
        self, images: torch.Tensor, media: list[int], imaging: Imaging, made: ReadyMedia, samples: np.ndarray,
        places: np.ndarray, light: torch.Tensor,
    ) -> None:  # fmt: skip
        """Write the images of samples int64[chunks, n] behind media int64[chunks, n] of one imaging, on a device.

        Tensors of the batch go where a graph finds them once for all chunks, which pick their rows by themselves.
        """
        streams, within = made.streams, made.at[places, 1]
        tables: list[dict[str, torch.Tensor]] = [{"light": light}, {}, {}]
        if not self.recipe.media_alike:  # what stays is not copied
            tables[2] = imaging.tensors()
        if self.recipe.shares_media and self._keeps(media[samples[0, 0]], imaging):
            different, first, which = np.unique(places, return_index=True, return_inverse=True)
            numbers = [media[n] for n in samples.reshape(-1)[first]]
            held = [self._spectra_of(*each, imaging, made) for each in zip(numbers, different, strict=True)]
            tables[1] = {"spectra": torch.cat(held) if len(held) > 1 else held[0]}
            name, function, places = "kept", _seen_through, which.reshape(places.shape)
        else:
            tables[1] = {"keys": streams.keys, "still": streams.still}
            if streams.shares is not None:
                tables[1]["shares"] = streams.shares
            name, function = "drawn", _drawn_and_seen
        chosen = self.drawn.put(np.stack([samples, places, within], 1)).unbind(0)
        if self.run is each_time:
            for some, of in zip(chosen, within, strict=True):
                at, medium, _ = some.unbind(0)
                images[at] = self.recipe.exposed(function(imaging, tables, (at, medium, self._at(of))))
            return
        stage = self.run.stage if isinstance(self.run, Graphs) else _as_they_are
        key, tables = stage((name, *imaging.statics), tables)
        # A graph holds on to what it reads: not to the tensors of this batch, of which it picks none.
        bare = imaging.of(dict.fromkeys(tables[2], torch.empty(0)))
        seen = partial(function, bare, tables)
        for some in chosen:
            images[some[0]] = self.recipe.exposed(self.run(key, seen, {"places": some}))

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

    def _spectra_of(self, medium: int, place: int, imaging: Imaging, made: ReadyMedia) -> torch.Tensor:
        """Spectra of one medium, complex64[1, F, pairs, n, m], kept for all objects behind it."""
        some, own = imaging.at(self._at(made.at[[place], 1])), made.streams.at(slice(place, place + 1))
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

    def _contrasts(self, ready: list[Behind], lit: Lit) -> torch.Tensor:
        """Expected contrast float64[B] of the images under polarised light; 1 of beams that interfere."""
        contrasts = torch.ones(sum(len(behind.samples) for behind in ready), dtype=torch.float64, device=self.device)
        if lit.step is not None:
            return contrasts
        for behind in ready:
            variances, places = [], []
            for imaging, rows in behind.groups():
                at, within = behind.samples[rows], behind.made.at[behind.media[rows], 1]
                if self.one_by_one or not isinstance(imaging, Imaging):
                    contrasts[self._at(at)] = imaging.contrast(lit.light[self._at(at)], self._at(within))
                    continue
                own = np.minimum(within, len(imaging) - 1)  # one may be for all
                places.append(np.stack([at, own + sum(map(len, variances))]))
                variances.append(imaging.variance)
            if not variances:
                continue
            variance = torch.cat(variances) if len(variances) > 1 else variances[0]
            # In chunks of one size, since transforms are planned anew for every number of samples.
            each = 160 * lit.light[0].numel()  # bytes of the transforms of an object, on twice its rows and columns
            most = max(1, min(AT_ONCE // 4, CHUNK_BYTES // each))
            for some in self.drawn.put(_chunks(np.concatenate(places, 1), most)).unbind(1):
                at, own = some.unbind(0)
                contrasts[at] = speckle_contrast(lit.light[at], variance[own])
        return contrasts


def _few(each: int, medium: int) -> bool:
    """Return whether ``each`` bytes of a medium are kept on the CPU."""
    return each <= _KEPT_BYTES or each * (medium + 1) <= _FIRST_BYTES


def _as_they_are(name: Hashable, tables: list[dict[str, torch.Tensor]]) -> tuple[Hashable, Any]:
    return name, tables


def _picked(tables: list[dict[str, torch.Tensor]], places: Iterable[Any]) -> dict[str, torch.Tensor]:
    """Rows of the tensors of tables, by name: those of each table at places of its own."""
    return {name: value[at] for table, at in zip(tables, places, strict=True) for name, value in table.items()}


def _drawn_and_seen(imaging: Imaging, tables: list[dict[str, torch.Tensor]], places: Any) -> torch.Tensor:
    """Images of drawn media, over their expected value; of tensors alone, so that it can be replayed."""
    rows = _picked(tables, places)
    light, keys, still = (rows.pop(name) for name in ("light", "keys", "still"))
    shares, some = rows.pop("shares", None), imaging.of(rows)
    return ImagedMedia(some, some.fields(keys, still, shares=shares), None, False).images(light)


def _seen_through(imaging: Imaging, tables: list[dict[str, torch.Tensor]], places: Any) -> torch.Tensor:
    """Images through kept media."""
    rows = _picked(tables, places)
    light, spectra = rows.pop("light"), rows.pop("spectra")
    return ImagedMedia(imaging.of(rows), None, spectra, False).images(light)


def _together(parts: list[tuple[list[int], DrawnMedia]], count: int) -> DrawnMedia:
    """Part of media that does not depend on how they are known: tilts, and their rest."""
    _, first = parts[0]
    if len(parts) == 1:
        return first
    rows = [(places, {"tilts": part.tilts, "still": part.still}) for places, part in parts]
    return replace(first, **_scattered(rows, count))


def _scattered(parts: list[tuple[list[int], dict[str, torch.Tensor]]], count: int) -> dict[str, torch.Tensor]:
    """Rows of several parts in their places, by name; NaN where a part has none."""
    places, first = parts[0]
    if len(parts) == 1 and places == [*range(count)]:
        return first
    whole: dict[str, torch.Tensor] = {}
    for places, values in parts:
        for name, rows in values.items():
            if name not in whole:
                whole[name] = torch.full((count, *rows.shape[1:]), torch.nan, dtype=rows.dtype, device=rows.device)
            whole[name][places] = rows
    return whole


def _chunks(places: np.ndarray, size: int) -> np.ndarray:
    """Cut places int64[..., n] into int64[..., chunks, size]; the last is filled up with its first, to equal bits."""
    count = places.shape[-1]
    chunks = -(-count // size)
    filled = np.arange(chunks * size)
    filled[count:] = (chunks - 1) * size
    return places[..., filled].reshape(*places.shape[:-1], chunks, size)


_Key = tuple[RecipeMedia, tuple[int, ...], Split, str]
GENERATORS: MostRecent[_Key, SpeckleGenerator] = MostRecent(_MOST_BYTES, held=SpeckleGenerator.held)
"""Generators of this process that were asked for last: samples asked for one by one find the media before them."""


def generator_of(recipe: RecipeMedia, seed: tuple[int, ...], split: Split, device: str) -> SpeckleGenerator:
    """Return the generator of a recipe, ``seed_words``, split and device: the one that is cached, or a new one."""
    key = (recipe, seed, split, device)
    return GENERATORS.get(key, lambda: SpeckleGenerator(*key))
