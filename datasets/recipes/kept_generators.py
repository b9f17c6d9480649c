"""Generators that stay between calls, so that samples asked for one by one find the media of those before them.

What they hold is bounded in bytes, not in number: a process may go through as many recipes, seeds and splits as it
likes.
"""

from typing import TYPE_CHECKING

from specklegen.core.most_recent import MostRecent
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.split import Split

if TYPE_CHECKING:
    from specklegen.datasets.recipes.recipe import Recipe

_MOST_BYTES = 2**31
_MOST = 64  # generators: a recipe, its plan and the small things about it take memory too
Key = tuple["Recipe", tuple[int, ...], Split, str]


class KeptGenerators:
    """The generators that were asked for last, up to a number of bytes; the last one stays, however large it is."""

    def __init__(self, most_bytes: int = _MOST_BYTES, most: int = _MOST) -> None:
        self._kept: MostRecent[Key, SpeckleGenerator] = MostRecent(most_bytes, most, SpeckleGenerator.held)

    def __len__(self) -> int:
        return len(self._kept)

    def found(self, key: Key) -> SpeckleGenerator:
        """Return the generator of (recipe, seed words, split, device), made now if it is not there."""
        return self._kept.found(key, lambda: SpeckleGenerator(*key))

    def forget(self) -> None:
        """Let all of them go."""
        self._kept.forget()


GENERATORS = KeptGenerators()
"""Those of this process."""


def generator_of(recipe: "Recipe", seed: tuple[int, ...], split: Split, device: str) -> SpeckleGenerator:
    """Return the generator that makes a recipe's samples one by one, or the one that is there; of ``seed_words``."""
    return GENERATORS.found((recipe, seed, split, device))
