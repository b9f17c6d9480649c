"""Objects that a network has seen: characters that it was trained on, in any font, upright or upside down."""

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any

from specklegen.core.errors import warn_user
from specklegen.datasets.objects import Families, Glyphs, ObjectFamily
from specklegen.datasets.objects.family import Source
from specklegen.datasets.split import Split

HALF_TURNS = {"6": "9", "M": "W", "b": "q", "n": "U"}
"""Characters that are another, or nearly, when turned by 180 degrees, which an autocorrelation cannot tell."""
_MOST = 10  # times as many samples looked through as are wanted


def character_of(objects: ObjectFamily, source: Source) -> str | None:
    """Character that a source shows; None where it shows something else."""
    if isinstance(objects, Families):
        return character_of(objects.families[int(source[0])], source[1:])
    return str(source[1]) if isinstance(objects, Glyphs) else None


def characters_of(table: Mapping[str, Any]) -> set[str]:
    """Characters that the objects of a recipe's table show in training, and those that they are upside down."""
    if table.get("type") == "Families":
        return seen_by(table["families"])
    if table.get("type") != "Glyphs":
        return set()
    shown = {str(source[1]) for source in Glyphs(**table).sources_of_split("train")}
    pairs = HALF_TURNS | {turned: upright for upright, turned in HALF_TURNS.items()}
    return shown | {pairs[character] for character in shown & pairs.keys()}


def seen_by(trained_on: Iterable[Mapping[str, Any]]) -> set[str]:
    """Characters that any network was trained on, from the tables of objects that their files state."""
    return set().union(*map(characters_of, trained_on))


def unseen(objects: ObjectFamily, seed: int, split: Split, samples: int, seen: set[str]) -> list[int]:
    """Numbers of the first ``samples`` samples of a split that show no character of ``seen``.

    Where there are not as many among ten times as many, a :class:`~specklegen.core.errors.DoubtWarning` says so, and
    the first samples are returned, whatever they show.
    """
    numbers = range(_MOST * samples)
    fresh = (n for n in numbers if character_of(objects, objects.source(seed, split, n)) not in seen)
    chosen = list(islice(fresh, samples))
    if len(chosen) == samples:
        return chosen
    warn_user(
        "the networks were trained on the test characters, in other fonts. For unseen characters, hold some out: "
        'objects.disjoint = "character"',
    )  # fmt: skip
    return list(range(samples))
