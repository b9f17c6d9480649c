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
        "c9a4272cb0ecfd188d3488e6c691a2390fe920cf2e26187e708d14ec5bc17984",
    ),
    Task(
        "unseen media and objects", "the same slabs; ten characters held out, bars, and silhouettes of photographs",
        "unknown-slab", {"objects": _OTHERS},
        "4e46637dd99261f3c7501945929c619626278719f83c63124e4b1cbdac738544",
    ),
    Task(
        "beyond the memory effect", "held-out characters one to four memory-effect ranges wide",
        "points-beyond-range", _UNSEEN,
        "7acbe94e107792076c3f33c911bd118f777fcfaa37d4a5a02e0c10c4820f34bc",
    ),
    Task(
        "thin", "held-out characters behind two ground glasses some way apart",
        "double-diffuser", _UNSEEN,
        "0b029cfa4cfb92fa7b9a9ce3bc171d17c1759ff83fa73e7da143625007b3bfbe",
    ),
    Task(
        "index step", "a slab of refractive index 1.4 in air: its faces reflect light back into it",
        "through-slab", _UNSEEN | {"material": {"faces": {"inside": 1.4, "outside": 1.0}, "kernel_paths": 30_000}},
        "b64b77d60bc977e391d385ceb53311e03488c9fcc5cb3bc57418973464652be9",
    ),
    Task(
        "noise, 1000 photons", "read noise 2, 1000 photons a pixel", "unknown-slab", _noisy(1000.0),
        "ebde08dfad77815c1bda00d6a51eef6c19c9e9f3483b370a8812d46c558ba463",
    ),
    Task(
        "noise, 100 photons", "read noise 2, 100 photons a pixel", "unknown-slab", _noisy(100.0),
        "e760e5d11d1354a1b50711f5f63af4e637f14dad13785ad9638e1b37ef8003bb",
    ),
    Task(
        "noise, 10 photons", "read noise 2, 10 photons a pixel", "unknown-slab", _noisy(10.0),
        "ee8c513dcbe9d18ed489e4788381b903d72dc6480769df75a4fc38e9adcac7f1",
    ),
    Task(
        "in motion", "films of eight frames while the slab's field decorrelates in two to twenty",
        "dynamic-slab", _UNSEEN,
        "86b22fe2c55b82bfb18aac8d464aa72614c6d770e197912e1684ab3e869ad6fd",
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
