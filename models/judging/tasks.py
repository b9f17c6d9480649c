"""The tasks of the benchmark: recipes with a seed, frozen under a version.

A task is the ``test`` split of a packaged recipe with changes, images that come with the package
(:mod:`specklegen.models.judging.waves`), pages of many exposures (:mod:`specklegen.models.judging.pages`), or images
that a user fetches (:mod:`specklegen.models.judging.frames`). The fingerprint of all that decides its pixels stands
beside it, and a build that renders anything else refuses the task: scores of one :data:`VERSION` are of one set of
images. A change of a task, a packaged recipe under it, or pixels (``DATA_VERSION``) raises :data:`VERSION` and
writes down the new fingerprints; a test keeps those of every version.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

from specklegen.core.errors import reject
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.coherent_object import CoherentObjects
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.hidden_object import CENTRE, HiddenObject
from specklegen.models.judging import frames, pages, waves
from specklegen.models.learning.examples import batches_of

VERSION = 10
"""Raised whenever an image of a task changes, or what a score is of."""
SEED = 20
"""Of every task."""
SAMPLES = 64
"""Images of most tasks in a complete run: the first of its test split."""

_CHARACTERS = {
    "type": "Glyphs", "shape": [28, 28], "disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq",
}  # fmt: skip
"""Ten characters held out, none of them another one upside down."""
_OTHERS = {
    "type": "Families", "shape": [28, 28], "families": [_CHARACTERS, {"type": "Bars"}, {"type": "Silhouettes"}],
}  # fmt: skip
_UNSEEN = {"objects": _CHARACTERS}
_SEVERAL = {
    "media_group": 4, "camera": {"pixels_per_grain": 2.0}, "field": {"pixels": {"log_uniform": [24.0, 32.0]}},
    "objects": {
        "type": "Families", "shape": [28, 28], "families": [_CHARACTERS, {"type": "Strokes"}, {"type": "Polygons"}],
    },
}  # fmt: skip
"""Four objects through each medium, grains and objects small enough that the four images say what the medium is."""
FAMILIES = ("Glyphs", "Blobs", "Polygons", "Points", "Bars", "Digits", "Photographs")
"""Of the task of seven families: characters, islands and rings, shapes, points, gratings, digits, photographs."""
_SEVEN = {
    "objects": {
        "type": "Families", "shape": [28, 28],
        "families": [{"type": name} | ({"disjoint": "font"} if name == "Glyphs" else {}) for name in FAMILIES],
    },
}  # fmt: skip
_NATURAL = {
    "sampler": "stationary", "mode_tolerance": 0.001, "objects": _CHARACTERS,
    "material": {
        "wavelength": 1.0, "thickness": {"log_uniform": [15.0, 150.0]}, "optical_depth": {"uniform": [4.0, 6.0]},
        "g": None, "scatterer": {"type": "VonMisesFisher", "concentration": {"log_uniform": [160.0, 400.0]}},
    },
    "media": "new", "window": {"width": 256.0}, "camera": {"shape": [128, 128], "pixels_per_grain": 2.0},
    "field": {"pitch": 1 / 512, "extent_over_range": None},
}  # fmt: skip
"""A camera of 14 degrees behind slabs that scatter into 7 to 12: the light falls off as it does behind such slabs."""
_BENCH = {
    "camera": {"shape": [800, 800], "pixels_per_grain": 2.0}, "objects": _CHARACTERS,
    "bench": {
        "stray": {"uniform": [0.6, 0.9]}, "brightness": {"log_uniform": [0.15, 0.4]},
        "cameras": [
            {"photons": 1000.0, "bit_depth": 8, "full_well": 10000.0, "gain": 40.0, "read_noise": 5.0, "offset": 2.0},
        ],
    },
}  # fmt: skip
"""Contrast of 0.05 to 0.3, 400 grains a side, 8 bits: what a frame of an optical bench has."""


class Task(NamedTuple):
    """One set of images.

    Attributes
    ----------
    asks : str
        What is new or hard in it.
    base : str
        Packaged recipe that it starts from.
    changes : Mapping
        Table merged over that.
    fingerprint : str
        SHA-256 of all that decides a pixel.
    samples : int
        Images of a complete run.
    families : tuple of str
        Names of the families of its objects, where scores are told by family.
    kind : str
        Where its images are from: "drawn" by the package's samplers, a sample an image; "pages", drawn too, a page of
        many exposures a question; "waves", which come with the package; "frames", which a user fetches; "glasses", of
        coherent objects, of which a complete run has none.
    """

    name: str
    asks: str
    base: str
    changes: Mapping[str, Any]
    fingerprint: str
    samples: int = SAMPLES
    families: tuple[str, ...] = ()
    kind: Literal["drawn", "pages", "waves", "frames", "glasses"] = "drawn"

    @property
    def fetched(self) -> bool:
        """True if a user has to fetch its images: no part of a complete run, nor of a mean over tasks."""
        return self.kind == "frames"

    def recipe(self) -> HiddenObject:
        """Recipe of the task; its ``train`` and ``validation`` splits are there to learn from.

        Of the kind "glasses" it is one of :class:`~specklegen.datasets.recipes.coherent_object.CoherentObjects`.
        Raise a `RuleError` if this build renders other images than those of :data:`VERSION`.
        """
        recipe = _recipe(self.base, json.dumps(self.changes))
        found = {"waves": waves.digest, "frames": frames.digest, "pages": lambda: pages.digest(recipe)}.get(
            self.kind, recipe.fingerprint
        )()
        if found != self.fingerprint:
            reject(
                f"benchmark task {self.name!r}", f"that of version {VERSION}, {self.fingerprint[:12]}", found[:12],
                "This build renders other images: use a release of that version, or raise VERSION with the change.",
            )  # fmt: skip
        return recipe

    def count(self, samples: int | None) -> int:
        """Images of a run of so many a task: all where None, no more than there are, and enough for two media."""
        if samples is None:
            return self.samples
        return min(max(samples, self.changes.get("media_group", 1) + 1), self.samples)

    def batches(self, numbers: Sequence[int], measured: Path | str | None = None) -> Iterator[dict[str, Any]]:
        """Samples of some numbers, in batches of tensors; ``measured`` is where files lie that have to be fetched.

        Raise a `RuleError` as :meth:`recipe`; if the files are not there.
        """
        recipe = self.recipe()
        if self.kind == "frames":
            if measured is None or frames.missing(measured):
                reject(f"benchmark task {self.name!r}", "run with its files", str(measured),
                       f"`specklegen check measured get {frames.SET}` fetches them; give the folder by --measured.",
                       )  # fmt: skip
            yield frames.batch(numbers, measured, _setup(self.base, json.dumps(self.changes)))
        elif self.kind == "waves":
            yield waves.batch(numbers)
        elif self.kind == "pages":
            yield from (pages.page(recipe, number, SEED) for number in numbers)
        elif self.kind == "glasses":  # digits of test, behind the glasses of training or others
            split = "train" if self.name == SEEN else "test"
            yield SpeckleGenerator(recipe, SEED, split, objects="test")(numbers)
        else:
            yield from batches_of(recipe, numbers, SEED, "test")


@cache
def _recipe(base: str, changes: str) -> Any:
    recipe = load_recipe(base, json.loads(changes))
    assert isinstance(recipe, HiddenObject | CoherentObjects)
    return recipe


@cache
def _setup(base: str, changes: str) -> Mapping[str, Any]:
    """Parameters of a sample that say nothing of its object."""
    drawn = _recipe(base, changes).batch(SEED, "test", range(1))["parameters"]
    told = ("label", "family", "medium", "expected_contrast", *CENTRE)
    return {name: values for name, values in drawn.items() if name not in told}


def _noisy(photons: float) -> dict[str, Any]:
    return _UNSEEN | {"exposure": {"photons": photons, "read_noise": 2.0}}


TASKS = (
    Task(
        "unseen media", "unseen slabs of drawn material; characters of the training set in other fonts",
        "unknown-slab", {"objects": {"disjoint": "font"}},
        "ee49f0a69d31bcdf71095e74b336884519ae91aa7917240d9f84a7983b02c073",
    ),
    Task(
        "unseen media and objects", "the same slabs; ten characters held out, bars, and silhouettes of photographs",
        "unknown-slab", {"objects": _OTHERS},
        "50a83a794e155213bdbefd4956d5ea8ca23f3c9e6d5132716b1bb6ce110fbcb9",
    ),
    Task(
        "beyond the memory effect", "held-out characters one to four memory-effect ranges wide",
        "points-beyond-range", _UNSEEN,
        "1bfed593fbe1f976ea99202eb0d1c6921456441eae32cad5d851c86d510db610",
    ),
    Task(
        "thin", "held-out characters behind two separate ground glasses",
        "double-diffuser", _UNSEEN,
        "80f6612bc5ea631789578cfbcce3accc2319979f89bc1a7bda2d0cc2a45f72f0",
    ),
    Task(
        "index step", "a slab of refractive index 1.4 in air, with reflection at its faces",
        "through-slab", _UNSEEN | {"material": {"faces": {"inside": 1.4, "outside": 1.0}, "kernel_paths": 30_000}},
        "9b8bf31628a2fc1ce30ec7d07043aca49840169ebf5b4c4a75568aff984b2d83",
    ),
    Task(
        "noise, 1000 photons", "read noise 2, 1000 photons a pixel", "unknown-slab", _noisy(1000.0),
        "b93acb7952f4aabb78287b283f4b39fa3be5e20bab80edead65ccb3c2b87bd9c",
    ),
    Task(
        "noise, 100 photons", "read noise 2, 100 photons a pixel", "unknown-slab", _noisy(100.0),
        "17258db5cb189354c9669779d175d2d5b0dc0b18e03becbb23c93cbb5e143929",
    ),
    Task(
        "noise, 10 photons", "read noise 2, 10 photons a pixel", "unknown-slab", _noisy(10.0),
        "43e625eb9f43e0d6ac71a28fdf1d808d34dafb4a3f778a154b6bbba2ed1394e8",
    ),
    Task(
        "in motion", "films of eight frames; the field decorrelates within two to twenty frames",
        "dynamic-slab", _UNSEEN,
        "4cc0668e9cc4a6d92cf9e1104efdb97f451fe96c1ea15b48dd9e6b18fb8cdb21",
    ),
    Task(
        "Brownian",
        "films of eight frames of particles in Brownian motion: g1 falls to 1/e within two to twenty frames",
        "brownian-slab", _UNSEEN,
        "fef3518181d41d9cfa0c2e0cd142a3a9f397e85566b2199482a87d2c9cca79e9",
    ),
    Task(
        "waves", "images of an independent multi-slice wave solver; objects of 0.25 to 3 memory-effect ranges, two "
        "behind each slab",
        "through-slab", waves.CHANGES,
        "06ca7c3bedd8aaa3014acd7a5c4ec0323dde166cbe1c0c9c6200c600ca8ab4e1",
        waves.SAMPLES, ("Glyphs", "Polygons"), "waves",
    ),
    Task(
        "several objects", "four objects in sequence through each medium at rest; the grouping is given",
        "unknown-slab", _SEVERAL,
        "a0a8c8df3c1a352806938e0b679b55008c709c00c415101387b7f6f0695ce50f",
    ),
    Task(
        "seven families", "one family of media; all 45 characters in other fonts and six other families of objects",
        "unknown-slab", _SEVEN,
        "1ad32519b856d1d28ba0b6d29c47f95efe4ebbfbd41eb826c2b8130a5c2bc77e", 112, FAMILIES,
    ),
    Task(
        "wide fields", "pages of held-out characters 10, 16, 25 and 40 memory-effect ranges wide, lit a spot at a "
        "time; a new medium at each of 42 to 186 exposures",
        "wide-field", pages.CHANGES,
        "b06d6dd5da696172b33d898520e347f9981a4bc424ba69b6e06a27b404158448", pages.SAMPLES, kind="pages",
    ),
    Task(
        "natural light", "held-out characters behind slabs whose light falls off across the camera; nothing is "
        "divided out", "through-slab", _NATURAL, "e8d1951c7d951d42036981255890ee62fb7ad4674aba24d6b4c143cef0f5e6b8",
    ),
    Task(
        "low contrast", "held-out characters behind ground glass on a camera of 400 grains a side: 8 bits, stray "
        "light, contrast 0.05 to 0.3", "ground-glass-bench", _BENCH,
        "622e28ef1cc8b54908fe7297bd002e9d5c892650c21629eeff79f91d00b628bd", 32,
    ),
    Task(
        "measured frames", "eight shapes behind four ground glasses, measured by another laboratory; "
        "fetched by `specklegen check measured get hidden-shapes`, not in the mean",
        "ground-glass", frames.CHANGES,
        "a0030391d3bbfad4eec990d9052bbec3110344eebe2455c5c74cee910ec6f8ae", frames.SAMPLES, kind="frames",
    ),
)  # fmt: skip
"""The benchmark."""

SEEN, UNSEEN = "seen glasses", "unseen glasses"
GLASSES = (
    Task(
        SEEN, "new digits on a modulator in laser light, behind the 64 glasses of training",
        "coherent-digits", {},
        "144abf282d7fd7dd683e66863523f55b198563ba607bed127d73577c26a09941", kind="glasses",
    ),
    Task(
        UNSEEN, "new digits on a modulator in laser light, behind 64 glasses that no training sample has",
        "coherent-digits", {},
        "144abf282d7fd7dd683e66863523f55b198563ba607bed127d73577c26a09941", kind="glasses",
    ),
)  # fmt: skip
"""Tasks of coherent objects, which are asked by name: methods of the others do not apply to them."""


def task(name: str) -> Task:
    """Task of a name."""
    for each in (*TASKS, *GLASSES):
        if each.name == name:
            return each
    reject("benchmark task", f"one of {', '.join(each.name for each in (*TASKS, *GLASSES))}", name)


def counted_tasks(names: Iterable[str]) -> list[str]:
    """Tasks whose mean is ranked by: those of a complete run, or all where there are no others."""
    asked, counted = list(names), [each.name for each in complete_run()]
    return [name for name in asked if name in counted] or asked


def complete_run() -> list[Task]:
    """Tasks of a complete run: all but those that have to be fetched."""
    return [each for each in TASKS if not each.fetched]


def digest(tasks: tuple[Task, ...] = TASKS, seed: int = SEED) -> str:
    """SHA-256 of names, fingerprints and seed: what a version stands for."""
    return hashlib.sha256(json.dumps([seed, [[each.name, each.fingerprint] for each in tasks]]).encode()).hexdigest()
