"""What every family of hidden objects has in common: sources that are split, and pictures of one source.

Two ways to keep the splits apart, one for each kind of source:

- :class:`ListedFamily`: the sources can be listed; the list is dealt to the splits, and sample n shows
  the next source of its split's shuffled list.
- :class:`DrawnFamily`: the sources are too many to list; one is drawn at random again and again until
  its own hash puts it into the split that asks.

In both, the picture is made from a source that has already been proved to belong to the split.
"""

from functools import cached_property

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.split import (
    SPLITS,
    Purpose,
    Seed,
    Split,
    generator,
    keys_of_split,
    position_in_pass,
    split_number,
    split_of,
    substream,
)

Source = tuple[str | int, ...]

_ATTEMPTS = 1000


def source_key(source: Source) -> str:
    """Text by which a source is hashed, split and stored with its samples."""
    return "/".join(map(str, source))


class ObjectFamily(Value):
    """A family of hidden objects.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    """

    shape: tuple[PositiveInt, PositiveInt] = (28, 28)

    def image(self, seed: Seed, split: Split, index: int) -> np.ndarray:
        """Object of sample ``index``: float32[h, w], at least 0, largest value 1; a pure function.

        Raises
        ------
        RuleError
            If the split is unknown or holds no source, or the seed or index is no whole number >= 0.
        """
        source = self.source(seed, split, index)
        picture = self.picture(source, generator(substream(seed, split, Purpose.OBJECT, index)))
        peak = picture.max()
        if not peak > 0:
            reject(f"{type(self).__name__} picture", "brighter than 0 somewhere", source_key(source))
        return np.asarray(picture / peak, dtype=np.float32)

    def identity(self) -> dict:
        """Everything that the pixels depend on, for the fingerprint of a data set."""
        return self.model_dump(mode="json")

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """What sample ``index`` shows; it belongs to ``split`` and to no other."""
        raise NotImplementedError

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Draw one source at a random size and place: float[h, w], at least 0."""
        raise NotImplementedError

    def labels(self, source: Source) -> dict[str, float]:  # noqa: ARG002
        """What is told of a source with every sample, under the same names for all: "label", -1 where it has none."""
        return {"label": -1.0}


class ListedFamily(ObjectFamily):
    """A family whose sources can be listed."""

    def sources(self) -> tuple[Source, ...]:
        """Every source of the family."""
        raise NotImplementedError

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
            split: tuple(source for key in keys_of_split(groups, split) for source in groups[key])
            for split in SPLITS
        }

    def sources_of_split(self, split: Split) -> tuple[Source, ...]:
        """Sources of one split; no source is in two."""
        split_number(split)
        return self.by_split[split]

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """Take the next source of the split's list, which is shuffled anew for each pass through it."""
        sources = self.sources_of_split(split)
        if not sources:
            reject(
                f"{type(self).__name__} sources",
                f"enough to leave some for the split {split!r}",
                f"{len(self.sources())} in all",
                "Validation and test get sources of their own where there are at least 3 different ones.",
            )
        return sources[position_in_pass(seed, split, index, len(sources))]


class DrawnFamily(ObjectFamily):
    """A family whose sources are drawn at random, and belong to the split that their hash says."""

    def propose(self, rng: np.random.Generator) -> Source:
        """Draw one source, of any split."""
        raise NotImplementedError

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """Draw sources until one belongs to the split."""
        rng = generator(substream(seed, split, Purpose.OBJECT_ORDER, index))
        for _ in range(_ATTEMPTS):
            source = self.propose(rng)
            if split_of(f"{type(self).__name__}/{source_key(source)}") == split:
                return source
        reject(
            f"{type(self).__name__}.shape",
            f"large enough for patterns of the split {split!r}",
            self.shape,
            f"None of {_ATTEMPTS} random patterns belongs to it: enlarge the shape or allow more patterns.",
        )


def place_within(rng: np.random.Generator, room: float) -> float:
    """Offset drawn evenly from 0 to ``room``; 0 where there is no room."""
    return rng.uniform(0.0, room) if room > 0 else 0.0
