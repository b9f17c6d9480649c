"""Families: objects of several families in one data set, the family of each sample drawn at random."""

from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.values import IDENTITY, Positive
from specklegen.datasets.objects.family import AnyFamily, ObjectFamily, Source
from specklegen.datasets.split import Purpose, Seed, Split, generator, substream


class Families(ObjectFamily):
    """A mixture of families; each keeps its own splits apart.

    Parameters
    ----------
    shape
        (rows, columns) of an object, of every family.
    families
        At least one; a family that states no shape takes that of the mixture.
    weights
        How often each is shown, relative to the others; by default equally.
    """

    type: Literal["Families"] = "Families"
    families: tuple[AnyFamily, ...]
    weights: tuple[Positive, ...] | None = None

    @model_validator(mode="before")
    @classmethod
    def _share_shape(cls, table: Any) -> Any:
        if not isinstance(table, dict) or "shape" not in table or not isinstance(table.get("families"), list | tuple):
            return table
        families = [{"shape": table["shape"]} | each if isinstance(each, dict) else each for each in table["families"]]
        return table | {"families": families}

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.families:
            reject("Families.families", "at least one family", self.families)
        if any(isinstance(family, Families) for family in self.families):
            reject("Families.families", "families of one kind of object each, and no mixture", self.families)
        shapes = {family.shape for family in self.families}
        if shapes != {self.shape}:
            reject("Families.families", f"of the mixture's shape {self.shape}", sorted(shapes))
        if self.weights is not None and len(self.weights) != len(self.families):
            reject("Families.weights", f"one for each of {len(self.families)} families", self.weights)
        return self

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Fields, and the identity of every family."""
        return super().identity(context) | {"families": [family.identity(context) for family in self.families]}

    def member(self, seed: Seed, split: Split, index: int) -> int:
        """Number of the family of sample ``index``."""
        weights = np.array(self.weights or np.ones(len(self.families)))
        rng = generator(substream(seed, split, Purpose.FAMILY, index))
        return int(rng.choice(len(weights), p=weights / weights.sum()))

    def source(self, seed: Seed, split: Split, index: int) -> Source:
        """(number of the family, what it shows)."""
        number = self.member(seed, split, index)
        return number, *self.families[number].source(seed, split, index)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Picture of the family's source."""
        return self.families[int(source[0])].picture(source[1:], rng)

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files of all families, one family after another."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(name for family in self.families for name in family.file_names)

    @cached_property
    def _others(self) -> dict[str, float]:
        """Default label and centroid of a source whose family has none."""
        return dict.fromkeys((name for family in self.families for name in family.label_names), -1.0)

    def labels(self, source: Source) -> dict[str, float]:
        """Number of the family, and its own words; -1 for those that only others have. Files are numbered through."""
        number = int(source[0])
        labels = self.families[number].labels(source[1:])
        if "file" in labels:
            labels["file"] += sum(len(family.file_names) for family in self.families[:number])
        return {"family": float(number)} | self._others | labels
