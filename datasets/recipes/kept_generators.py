"""Generators that stay between calls, so that samples asked for one by one find the media of those before them.

What they hold is bounded in bytes, not in number: a process may go through as many recipes, seeds and splits as it
likes.
"""

from collections import OrderedDict
from threading import Lock
from typing import TYPE_CHECKING

from specklegen.core.memory import array_bytes
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
        self._most_bytes, self._most, self._lock = most_bytes, most, Lock()
        self._kept: OrderedDict[Key, SpeckleGenerator] = OrderedDict()

    def __len__(self) -> int:
        return len(self._kept)

    def found(self, key: Key) -> SpeckleGenerator:
        """Return the generator of (recipe, seed words, split, device), made now if it is not there."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = SpeckleGenerator(*key)
        with self._lock:
            made = self._kept.setdefault(key, made)  # another thread may have been as quick
            self._kept.move_to_end(key)
            # Those that are kept have grown since they came: they are weighed when another wants a place.
            held = {each: array_bytes(generator.held()) for each, generator in self._kept.items()}
            while len(held) > 1 and (len(held) > self._most or sum(held.values()) > self._most_bytes):
                oldest, _ = self._kept.popitem(last=False)
                del held[oldest]
        return made

    def forget(self) -> None:
        """Let all of them go."""
        with self._lock:
            self._kept.clear()


GENERATORS = KeptGenerators()
"""Those of this process."""


def generator_of(recipe: "Recipe", seed: tuple[int, ...], split: Split, device: str) -> SpeckleGenerator:
    """Return the generator that makes a recipe's samples one by one, or the one that is there; of ``seed_words``."""
    return GENERATORS.found((recipe, seed, split, device))
