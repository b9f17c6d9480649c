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

VERSION = 3
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
        "ba7b1a64d0deb1d914eb2dd2a94869f40088ed12a5c2c9403a2df577aac4b8fa",
    ),
    Task(
        "unseen media and objects", "the same slabs; ten characters held out, bars, and silhouettes of photographs",
        "unknown-slab", {"objects": _OTHERS},
        "18658b06ac0de965df22320732bd61bbfc19d6cc87596b6d7507d2400590f554",
    ),
    Task(
        "beyond the memory effect", "held-out characters one to four memory-effect ranges wide",
        "points-beyond-range", _UNSEEN,
        "58efe4434cfc2b65d7a7fba6772e03909189d2131492560d5ea95e438ef248d3",
    ),
    Task(
        "thin", "held-out characters behind two ground glasses some way apart",
        "double-diffuser", _UNSEEN,
        "3e294167bf5665be2060724cdf2bfc84a37a4c91b589e598edcf9e585d99d596",
    ),
    Task(
        "index step", "a slab of refractive index 1.4 in air: its faces reflect light back into it",
        "through-slab", _UNSEEN | {"material": {"faces": {"inside": 1.4, "outside": 1.0}, "kernel_paths": 30_000}},
        "0b11d8dfac96a809c5f8451897970f2bf7cd1113a5583c348fc85f21524ab84c",
    ),
    Task(
        "noise, 1000 photons", "read noise 2, 1000 photons a pixel", "unknown-slab", _noisy(1000.0),
        "5a5374888c6a73ec548a05a5ba66241a1d7d8544c7ef1c05fdf8c1a9299795b4",
    ),
    Task(
        "noise, 100 photons", "read noise 2, 100 photons a pixel", "unknown-slab", _noisy(100.0),
        "7ee1b2c1071216dded659e1f57d151ed9c094d61cc73dd1892065b86707d8bf1",
    ),
    Task(
        "noise, 10 photons", "read noise 2, 10 photons a pixel", "unknown-slab", _noisy(10.0),
        "9fa3e7c2dcac12bc834881a6a35136519801e569098219146c50e81bc612839e",
    ),
    Task(
        "in motion", "films of eight frames while the slab's field decorrelates in two to twenty",
        "dynamic-slab", _UNSEEN,
        "43a5eb951c85a29cddbe1eb2ead28eaf9b04b64e7e6b05b75ca8d808fe53d284",
    ),
    Task(
        "Brownian", "films of eight frames of particles in Brownian motion: g1 falls to 1/e in two to twenty",
        "brownian-slab", _UNSEEN,
        "d910f1ac2364acbcd8502a45db72b530a999ea8254e5685c9ac69804cbef0dfc",
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
