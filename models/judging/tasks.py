"""The tasks of the benchmark: recipes with a seed, frozen under a version.

A task is the ``test`` split of a packaged recipe with changes. The fingerprint of all that decides its pixels stands
beside it, and a build that renders anything else refuses the task: scores of one :data:`VERSION` are of one set of
images. Whoever changes a task, a packaged recipe under it, or pixels (``DATA_VERSION``) raises :data:`VERSION` and
writes down the new fingerprints; a test keeps those of every version.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from specklegen.core.errors import reject
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject

VERSION = 1
"""Raised whenever an image of a task changes."""
SEED = 20
"""Of every task."""
SAMPLES = 64
"""Images of a task in a complete run: the first of its test split."""

_CHARACTERS = {
    "type": "Glyphs", "shape": [28, 28], "disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq",
}  # fmt: skip
"""Ten characters held out, none of them another one upside down."""
_OTHERS = {
    "type": "Families", "shape": [28, 28], "families": [_CHARACTERS, {"type": "Bars"}, {"type": "Silhouettes"}],
}  # fmt: skip
_UNSEEN = {"objects": _CHARACTERS}


class Task(NamedTuple):
    """One set of images.

    Attributes
    ----------
    name : str
    asks : str
        What is new or hard in it.
    base : str
        Packaged recipe that it starts from.
    changes : Mapping
        Table merged over that.
    fingerprint : str
        SHA-256 of all that decides a pixel.
    """

    name: str
    asks: str
    base: str
    changes: Mapping[str, Any]
    fingerprint: str

    def recipe(self) -> HiddenObject:
        """Recipe of the task; its ``train`` and ``validation`` splits are there to learn from.

        Raises
        ------
        RuleError
            If this build renders other images than those of :data:`VERSION`.
        """
        recipe = _recipe(self.base, json.dumps(self.changes))
        if recipe.fingerprint() != self.fingerprint:
            reject(
                f"benchmark task {self.name!r}", f"that of version {VERSION}, {self.fingerprint[:12]}",
                recipe.fingerprint()[:12],
                "This build renders other images: use a release of that version, or raise VERSION with the change.",
            )  # fmt: skip
        return recipe


@cache
def _recipe(base: str, changes: str) -> HiddenObject:
    recipe = load_recipe(base, json.loads(changes))
    assert isinstance(recipe, HiddenObject)
    return recipe


def _noisy(photons: float) -> dict[str, Any]:
    return _UNSEEN | {"exposure": {"photons": photons, "read_noise": 2.0}}


TASKS = (
    Task(
        "unseen media", "slabs of drawn material that nobody has seen; characters as in training, in other fonts",
        "unknown-slab", {"objects": {"disjoint": "font"}},
        "8d3229c9ad65b9983acc9b23422af736657e7efaa482bb71c85c45a1c23300a5",
    ),
    Task(
        "unseen media and objects", "the same slabs; ten characters held out, bars, and silhouettes of photographs",
        "unknown-slab", {"objects": _OTHERS},
        "d2a845a6e7e496853928aab203d8fe9ed923e11b3519f093347932d190f8f039",
    ),
    Task(
        "beyond the memory effect", "held-out characters one to four memory-effect ranges wide",
        "points-beyond-range", _UNSEEN,
        "fe82b126d8e6f4f9829ca6ece9ebb0b1282169244a465a74d536c280c772939a",
    ),
    Task(
        "thin", "held-out characters behind two ground glasses some way apart",
        "double-diffuser", _UNSEEN,
        "29a06ada39403f3a06dba095660f73f333cdfe412fd12cc559d22c744dddab5c",
    ),
    Task(
        "index step", "a slab of refractive index 1.4 in air: its faces reflect light back into it",
        "through-slab", _UNSEEN | {"material": {"faces": {"inside": 1.4, "outside": 1.0}, "kernel_paths": 30_000}},
        "8ce205e1b30d1066f5c8028307a4fb8b8ff75421aa8ae5bb1b9c5fc1938a9be4",
    ),
    Task(
        "noise, 1000 photons", "read noise 2, 1000 photons a pixel", "unknown-slab", _noisy(1000.0),
        "80d36cb723ee2130443f0a41c19a812ffe181d8147bbbe996e17df37dbc0fe22",
    ),
    Task(
        "noise, 100 photons", "read noise 2, 100 photons a pixel", "unknown-slab", _noisy(100.0),
        "b7966f1aba6667192cc409472db496ae5749b8b9b48ad77120c7dac5a7596361",
    ),
    Task(
        "noise, 10 photons", "read noise 2, 10 photons a pixel", "unknown-slab", _noisy(10.0),
        "d4252867e38e8cd72a8e7ff9c1d8205b3de985f972c493b5c369517a12667d06",
    ),
    Task(
        "in motion", "films of eight frames while the slab's field decorrelates in two to twenty",
        "dynamic-slab", _UNSEEN,
        "e35f3b061aafbd91fed2ea317468f648f89ceeed3bceb067bde1192ae03fe93c",
    ),
)  # fmt: skip
"""The benchmark."""


def task(name: str) -> Task:
    """Task of a name.

    Raises
    ------
    RuleError
        If there is none.
    """
    for each in TASKS:
        if each.name == name:
            return each
    reject("benchmark task", f"one of {', '.join(each.name for each in TASKS)}", name)


def digest(tasks: tuple[Task, ...] = TASKS, seed: int = SEED) -> str:
    """SHA-256 of names, fingerprints and seed: what a version stands for."""
    return hashlib.sha256(json.dumps([seed, [[each.name, each.fingerprint] for each in tasks]]).encode()).hexdigest()
