"""Common part of every family of hidden objects: sources that are split, and pictures of one source.

Two ways to keep the splits apart, one for each kind of source:

- :class:`ListedFamily`: the sources can be listed; the list is dealt to the splits, and sample n shows
  the next source of its split's shuffled list.
- :class:`DrawnFamily`: the sources are too many to list; one is drawn at random again and again until
  its own hash puts it into the split that asks.

In both, the picture is made from a source that has already been proved to belong to the split.

A family of a user's own is a class that inherits one of the two, with fields of its own; from then on it is known by
its name, in recipes too:

    class Rings(DrawnFamily):
        def propose(self, rng):
            return (int(rng.integers(3, 12)),)

        def picture(self, source, rng):
            row, column = np.indices(self.shape) - np.array(self.shape)[:, None, None] / 2
            return np.abs(np.hypot(row, column) - source[0]) < 1
"""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.memory import memory_limit
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry
from specklegen.core.shielded import shielded
from specklegen.core.values import IDENTITY, PositiveInt
from specklegen.datasets.split import (
    SPLITS,
    Purpose,
    Seed,
    Split,
    generator,
    keys_of_split,
    position_in_pass,
    positions_in_passes,
    split_number,
    split_of,
    substream,
)

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.addresses import Addresses

Source = tuple[str | int, ...]

_ATTEMPTS = 1000
_AT_ONCE = 32  # objects that one batch holds


def source_key(source: Source) -> str:
    """Text by which a source is hashed, split and stored with its samples."""
    return "/".join(map(str, source))


class ObjectFamily(Registered):
    """A family of hidden objects, by its ``type``, the name of the class. Subclass it for one of your own.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    """

    registry: ClassVar = Registry("family of objects")
    label_names: ClassVar[tuple[str, ...]] = ("label",)
    """Names of what :meth:`labels` tells."""
    type: Any = None
    shape: tuple[PositiveInt, PositiveInt] = (28, 28)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if 4 * _AT_ONCE * prod(self.shape) > 0.1 * memory_limit():
            reject(f"{type(self).__name__}.shape", f"of at most {0.1 * memory_limit() / 4 / _AT_ONCE:.1e} pixels here",
                   self.shape, "A batch of objects must fit in a tenth of the memory: use fewer pixels.")  # fmt: skip
        return self

    @shielded()
    def image(self, seed: Seed, split: Split, index: int) -> np.ndarray:
        """Object of sample ``index``: float32[h, w], at least 0, largest value 1; a pure function."""
        source = self.source(seed, split, index)
        picture = self.picture(source, generator(substream(seed, split, Purpose.OBJECT, index)))
        peak = picture.max()
        if not peak > 0:
            reject(f"{type(self).__name__} picture", "brighter than 0 somewhere", source_key(source))
        return np.asarray(picture / peak, dtype=np.float32)

    @property
    def drawn_together(self) -> bool:
        """True if pictures of many samples are drawn where the samples are made; else one by one, on the host."""
        return type(self).images is not ObjectFamily.images

    def images(self, drawn: "Addresses", numbers: Sequence[int]) -> "torch.Tensor":
        """Objects of samples, float32[B, h, w], on the device of their draws; :meth:`image` for each."""
        import torch

        images = np.stack([self.image(drawn.seed, drawn.split, n) for n in numbers])
        return torch.from_numpy(images).to(drawn.device)

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Everything that the pixels depend on, for the fingerprint of a data set; see ``Recipe.physics``."""
        return self.model_dump(mode="json", context=context)

    @abstractmethod
    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """Return the source of sample ``index``; it belongs to ``split`` and to no other."""

    @abstractmethod
    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Draw one source at a random size and place: float[h, w], at least 0."""

    def labels(self, source: Source) -> dict[str, float]:  # noqa: ARG002
        """Labels of a source, stored with every sample, by ``label_names``: "label", -1 where it has none."""
        return {"label": -1.0}

    def labels_of(self, drawn: "Addresses", numbers: Sequence[int]) -> dict[str, np.ndarray]:
        """Labels float64[B] of the objects of samples, by name; :meth:`labels` of each."""
        rows = [self.labels(self.source(drawn.seed, drawn.split, number)) for number in numbers]
        return {name: np.array([row[name] for row in rows], np.float64) for name in rows[0]}

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files that objects are made from, by the number "file" of a sample; none of other families."""
        return ()


AnyFamily = Annotated[ObjectFamily, *member_of(ObjectFamily)]
"""Objects of any family, written with its type."""


class ListedFamily(ObjectFamily):
    """A family whose sources can be listed."""

    @abstractmethod
    def sources(self) -> tuple[Source, ...]:
        """Every source of the family."""

    def split_key(self, source: Source) -> str:
        """Key by which a source is dealt to a split; sources that share it stay together."""
        return source_key(source)

    @cached_property
    def by_split(self) -> dict[Split, tuple[Source, ...]]:
        """Sources of each split, in an order that depends on their keys alone; made once a process."""
        groups: dict[str, list[Source]] = {}
        for source in self.sources():
            groups.setdefault(self.split_key(source), []).append(source)
        return {
            split: tuple(source for key in keys_of_split(groups, split) for source in groups[key]) for split in SPLITS
        }

    def sources_of_split(self, split: Split) -> tuple[Source, ...]:
        """Sources of one split; no source is in two."""
        split_number(split)
        return self.by_split[split]

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """Take the next source of the split's list, which is shuffled anew for each pass through it."""
        sources = self._enough(split)
        return sources[position_in_pass(seed, split, index, len(sources))]

    @property
    def dealt(self) -> bool:
        """True if sources are taken from the shuffled list: not if a class of one's own takes them in another way."""
        return type(self).source is ListedFamily.source

    def positions(self, drawn: "Addresses", numbers: Sequence[int]) -> np.ndarray:
        """Places int64[B] of the sources of samples in the list of their split, where they are :attr:`dealt`."""
        return positions_in_passes(drawn.seed, drawn.split, numbers, len(self._enough(drawn.split)))

    def labels_of(self, drawn: "Addresses", numbers: Sequence[int]) -> dict[str, np.ndarray]:
        """Labels float64[B] of the objects of samples, by name, from a table of all sources of the split."""
        if not self.dealt:
            return super().labels_of(drawn, numbers)
        positions = self.positions(drawn, numbers)
        return {name: column[positions] for name, column in self._table_of(drawn.split).items()}

    def _table_of(self, split: Split) -> dict[str, np.ndarray]:
        """Labels of all sources of a split, by name; made when the split is first read, which may open files."""
        if split not in self._label_tables:
            rows = [self.labels(source) for source in self.sources_of_split(split)]
            self._label_tables[split] = {n: np.array([row[n] for row in rows], np.float64) for n in (rows or [{}])[0]}
        return self._label_tables[split]

    @cached_property
    def _label_tables(self) -> dict[Split, dict[str, np.ndarray]]:
        return {}

    def _enough(self, split: Split) -> tuple[Source, ...]:
        """Sources of a split, of which there is at least one."""
        sources = self.sources_of_split(split)
        if not sources:
            reject(
                f"{type(self).__name__} sources",
                f"enough for the split {split!r}",
                f"{len(self.sources())} in all",
                "Add files or characters: each split needs its own, so at least 3.",
            )
        return sources


class DrawnFamily(ObjectFamily):
    """A family whose sources are drawn at random, and belong to the split that their hash says."""

    @abstractmethod
    def propose(self, rng: np.random.Generator) -> Source:
        """Draw one source, of any split."""

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """Draw sources until one belongs to the split."""
        rng = generator(substream(seed, split, Purpose.OBJECT_ORDER, index))
        for _ in range(_ATTEMPTS):
            source = self.propose(rng)
            if split_of(f"{type(self).__name__}/{source_key(source)}") == split:
                return source
        reject(
            f"{type(self).__name__}.shape", f"large enough for patterns of the split {split!r}", self.shape,
            f"None of {_ATTEMPTS} random patterns belongs to that split: enlarge the shape or allow more patterns.",
        )  # fmt: skip


def place_within(rng: np.random.Generator, room: float) -> float:
    """Offset drawn evenly from 0 to ``room``; 0 where there is no room."""
    return rng.uniform(0.0, room) if room > 0 else 0.0
