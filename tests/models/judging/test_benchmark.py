"""The benchmark: frozen tasks, functions that see nothing but the image, tables that say whether they are complete."""

import itertools
import os
import re
import sys
import time

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import limit

from specklegen.core.errors import RuleError
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.models import benchmark
from specklegen.models.judging import baselines
from specklegen.models.judging.benchmark import BASELINES, TOLD, blinded
from specklegen.models.judging.chance import above_chance
from specklegen.models.judging.fitted import fitted
from specklegen.models.judging.isolation import Limits
from specklegen.models.judging.results import DIGITS, SHOWN
from specklegen.models.judging.tasks import GLASSES, SAMPLES, SEED, TASKS, VERSION, digest, task
from specklegen.models.learning.reconstructor import load_pretrained
from specklegen.models.metrics import align, pearson

RECORDED = {1: "ae9684f0b03428ea2f891e6cd8a2eb0abacaa862aacb298c111faa109fbcdcc3",
            2: "63a020c1503a09916f118fdaa1438569d7ddba69b028f53ac016193b9c8696a5",
            3: "197bde4b0334604294f0e7bb4fff736d45c27cb90d521397e13b42b7498374fc",
            4: "a9ad617f2eabfbb6beeba969accbfb7be3022bb4a719edfa211bf1837b940381",
            5: "7df0a7f04f36d08ddc2c66cb8e95a43909833f9085734a96cef3852021db1074",
            6: "4c879dc27b3f6f0890db0d5b456c152be641cb721aac4a0ded99c8365fbeea37",
            7: "cc71722424bff64007b1718b0c45350374b001f42159114f3c6af0b7f9234fbb",
            8: "6acbddf43914ad11b33a76a1448724364b6c4d44092e1190e04b4ca86a92dafa",
            9: "b37acf34a0e8878b5dd1508ce96e177d81374c28b5d91c70e077250e1214f334",
            10: "547db28b34e24fe3d7a66b4b1ce8eb346c0a0c4be533d88f06d22a43fcc70102"}  # fmt: skip
"""What each version stands for. Never change a line: raise VERSION, and add one."""


def test_a_version_is_one_set_of_images():
    """Every task renders what is written down beside it, and that is what its version was recorded with."""
    for each in TASKS:
        each.recipe()  # refuses any other fingerprint
    assert RECORDED[VERSION] == digest(), "raise VERSION, and record the new digest under it"


def test_a_task_that_changes_is_refused():
    """The tests above have power: one number of one recipe, or one seed, is enough."""
    other = TASKS[0]._replace(changes={"objects": {"disjoint": "font", "rotation": 29.9}})
    assert_refused(lambda: other.recipe(), f"must be that of version {VERSION}, {other.fingerprint[:12]}; got")
    assert digest((other._replace(fingerprint="0"), *TASKS[1:])) != digest()
    assert digest(seed=SEED + 1) != digest()


def test_what_is_held_out_is_in_no_training_split():
    """Ten characters, bars and silhouettes: of all tasks but two, no test object's kind is in training."""
    for each in (each for each in TASKS if not (each.fetched or each.name in ("unseen media", "seven families"))):
        objects = each.recipe().objects
        objects = getattr(objects, "of", objects)
        families = getattr(objects, "families", [objects])
        glyphs = families[0]
        test = {source[1] for source in glyphs.sources_of_split("test")}
        assert test == set("569BFMTVWt")
        assert not test & {source[1] for split in ("train", "validation") for source in glyphs.sources_of_split(split)}


@pytest.fixture(scope="module")
def thin():
    return task("thin").recipe()


@pytest.fixture(scope="module")
def batch(thin):
    return tensors(thin.batch(SEED, "test", range(3)))


def knowing(recipe):
    """A function that cheats: it counts images, looks up their objects, and turns, moves and dims them."""
    number = itertools.count()

    def function(batch):
        images = [recipe.objects.image(SEED, "test", next(number)) for _ in batch["object"]]
        return np.pad(np.stack(images)[:, ::-1, ::-1], ((0, 0), (3, 8), (5, 1))) * 0.1 + 5

    return function


@pytest.fixture(scope="module")
def found(thin):
    """One that knows, one that knows nothing, and the mean of the training objects."""
    told = []
    functions = {"knows": knowing(thin), "even": lambda batch: torch.ones(len(batch["object"]), 9, 9)}
    results = benchmark(functions, baselines=["mean image"], tasks=["thin"], samples=18,
                        progress=lambda *done: told.append(done))  # fmt: skip
    return results, told


def test_functions_get_what_they_deserve(found):
    results, told = found
    values = results.evaluations["thin"].values
    assert results.functions == ["knows", "even", "mean image"]
    np.testing.assert_allclose(values["knows"]["sharp"]["pearson"], 1, rtol=1e-5)  # float32 sums
    assert results.interval("even", "thin") == (0, 0, 0)
    assert results.interval("mean image", "thin").high < 0.7 < results.interval("knows", "thin").low
    assert results.score("knows") == results.interval("knows", "thin").mean
    assert told == [(16, 18), (18, 18)]


def test_a_function_sees_nothing_of_the_object_but_its_image(thin, batch):
    """Other objects and labels under the same image: what a function is handed stays the same."""
    drawn = batch["parameters"]
    changed = {name: drawn[name] + 1 for name in TOLD if name in drawn}
    assert {"label", "object_row", "expected_contrast"} <= changed.keys()
    other = {**batch, "object": batch["object"].flip(0), "parameters": {**drawn, **changed}}
    one, two = blinded(batch, thin), blinded(other, thin)
    assert one.keys() == two.keys() == {"image", "object", "parameters", "memory_effect"}
    assert one["parameters"].keys() == drawn.keys() - set(TOLD)
    for name in ("image", "object", "memory_effect"):
        assert torch.equal(one[name], two[name])
    assert not one["object"].any()
    assert one["object"].shape == (3, 28, 28)
    assert all(torch.equal(one["parameters"][name], two["parameters"][name]) for name in one["parameters"])


def test_the_memory_effect_is_over_object_pixels(thin, batch):
    """C_I is 1 at zero and a half at the memory-effect range, which is 28 pixels over the object's share of it."""
    curves = blinded(batch, thin)["memory_effect"].numpy()
    np.testing.assert_allclose(curves[:, 0], 1, rtol=1e-12)
    place = 28 / batch["parameters"]["extent_over_range"].numpy()
    # Linear between pixels: off by an eighth of the curvature, 1e-4 of a curve as wide as 56 pixels.
    np.testing.assert_allclose([np.interp(p, np.arange(64), c) for p, c in zip(place, curves, strict=True)], 0.5,
                               atol=1e-3)  # fmt: skip


@pytest.mark.parametrize(("answer", "said"), [
    (lambda b: b["image"][:, :65, :65], r"real\[2, n, n\], n at most 64; got 'torch.float32\[2, 65, 65\]'"),
    (lambda b: b["image"][:1, :28, :28], r"\[1, 28, 28\]"), (lambda b: b["object"][0], r"\[28, 28\]"),
    (lambda b: b["object"] * 1j, r"complex64"), (lambda b: b["object"] / 0, "finite"),
])  # fmt: skip
def test_what_is_no_answer_is_a_failure_that_is_named_and_scored(answer, said):
    results = benchmark({"mine": answer}, tasks=["thin"], samples=2)
    (failure,) = results.failures
    assert failure[:4] == ("thin", "mine", 0, 2)
    assert re.search(said, failure.reason)
    assert results.interval("mine", "thin") == (0, 0, 0)
    assert f"- mine on thin, images 0 to 1: {failure.reason}" in results.markdown()


def spoil(batch):
    """A function that works in place, on all that it is handed."""
    for name in ("image", "memory_effect", "object"):
        batch[name].mul_(0.5).add_(torch.rand(batch[name].shape))
    batch["parameters"].clear()
    return batch["image"][:, 50:78, 50:78]


@pytest.mark.parametrize("limits", [Limits(), None])
def test_a_function_that_works_in_place_spoils_no_other(limits):
    functions = {"spoils": spoil, "honest": lambda batch: batch["image"][:, 50:78, 50:78]}
    results = benchmark(functions, tasks=["thin"], samples=3, limits=limits)
    alone = benchmark({"honest": functions["honest"]}, tasks=["thin"], samples=3, limits=limits)
    assert not results.failures
    np.testing.assert_array_equal(results.answers["thin", "honest"][0], alone.answers["thin", "honest"][0])
    assert results.interval("honest", "thin") == alone.interval("honest", "thin")


def hungry(batch):
    return torch.ones(2**30, dtype=torch.float64)[: len(batch["object"])]


@pytest.mark.parametrize(("function", "said"), [
    (lambda batch: time.sleep(60), "took longer than 2 s"), (hungry, "memory|allocate"),
    (lambda batch: os._exit(3), "its process died, exit code 3"),
    (lambda batch: 1 / 0, "ZeroDivisionError: division by zero"), (lambda batch: sys.exit(), "SystemExit"),
])  # fmt: skip
def test_a_function_fails_alone(function, said):
    """For the batch that it does not answer; the others go on, and so does the next batch."""
    calls = itertools.count()

    def sometimes(batch):
        return function(batch) if len(batch["object"]) == 2 else torch.ones(len(batch["object"]), 5, 5)

    functions = {"fails": sometimes, "even": lambda batch: torch.ones(len(batch["object"]), 5, 5) * next(calls)}
    results = benchmark(functions, tasks=["thin"], samples=18, limits=Limits(seconds=2.0, gibibytes=4.0))
    (failure,) = results.failures
    assert failure[:4] == ("thin", "fails", 16, 2)
    assert re.search(said, failure.reason)
    assert [made.shape[0] for made in results.answers["thin", "even"]] == [16, 2]


def test_a_function_that_reaches_the_images_of_others_stops_the_run(monkeypatch, thin):
    """In this process a function could find them by other ways than what it is handed."""
    seen = []
    blind = blinded
    monkeypatch.setattr("specklegen.models.judging.benchmark.blinded", lambda *a: seen.append(blind(*a)) or seen[-1])

    def reaches(batch):
        seen[-1]["image"].zero_()
        return batch["object"]

    with pytest.raises(RuleError, match="'reaches' must be a function that does not change its input"):
        benchmark({"reaches": reaches}, tasks=["thin"], samples=2, limits=None)


def test_answers_are_a_file(found, tmp_path):
    results, _ = found
    results.write(tmp_path)
    with np.load(tmp_path / "answers.npz") as answers:
        assert {key.rpartition("/")[0] for key in answers} == {f"thin/{name}" for name in results.functions}
        np.testing.assert_array_equal(answers["thin/even/1"], results.answers["thin", "even"][1])


@pytest.mark.parametrize(("wrong", "said"), [
    ({"baselines": ["Kats"]}, "benchmark baselines must be one of mean image, Katz"),
    ({"tasks": ["thick"]}, "benchmark task must be one of unseen media"),
    ({"tasks": ["thin", "thin"]}, "at least one, each once"),
    ({"samples": 1}, "at least 2 and at most 112; got 1"),
    ({"samples": 113}, "at most 112; got 113"),
    ({"samples": SAMPLES + 1, "tasks": ["thin"]}, f"at most {SAMPLES}; got {SAMPLES + 1}"),
    ({"functions": {}, "baselines": ["multiframe"], "tasks": ["thin"]}, "at least one that serves the task 'thin'"),
    ({"functions": {}}, "at least one function, or a baseline"),
])  # fmt: skip
def test_what_cannot_be_run_is_refused(wrong, said):
    assert_refused(lambda: benchmark(**{"functions": lambda batch: batch["object"], **wrong}), said)


def test_a_film_is_more_of_the_same_image(batch):
    """Two equal frames: the lags and the network's answer of one image, and half the variance."""
    film = {name: value for name, value in batch.items() if name != "image"}
    film["frames"] = batch["image"][:, None].expand(-1, 2, -1, -1)
    one, two = baselines.seen_lags(batch), baselines.seen_lags(film)
    assert torch.equal(one.lags, two.lags)
    torch.testing.assert_close(two.variance, one.variance / 2, rtol=1e-12, atol=0)
    method = baselines.network(load_pretrained())
    # convolutions of other batch sizes round otherwise
    torch.testing.assert_close(method(film), method(batch), rtol=0, atol=1e-4)


@pytest.mark.parametrize(("name", "beside"), [("in motion", ["Katz, C_I", "packaged network", "solver"]),
                                              ("Brownian", ["packaged network"])])  # fmt: skip
def test_films_are_scored(name, beside):
    results = benchmark(knowing(task(name).recipe()), baselines=beside, tasks=[name], samples=2)
    assert results.interval("yours", name).mean == pytest.approx(1, rel=1e-5)
    assert all(results.interval(each, name).mean > 0.3 for each in results.functions)


def test_scores_stand_beside_their_chance(found, tmp_path):
    """One that knows has the objects of others as its chance; what answers the same to all has its score."""
    results, _ = found
    assert results.chance("mean image", "thin") == pytest.approx(results.interval("mean image", "thin").mean, abs=1e-6)
    for score in ("pearson", "psnr", "ssim"):
        assert results.interval("knows", "thin", score).low > results.chance("knows", "thin", score)
    told = " | ".join(DIGITS[score].format(results.interval("knows", "thin", score).mean,
                                           results.chance("knows", "thin", score)) for score in SHOWN)  # fmt: skip
    assert f"| knows | {told} | 1.000 |" in results.markdown()
    assert above_chance(0.8, 0.5) == pytest.approx(0.6)  # by hand
    assert re.search(r"\| mean image \|.*\| -?0.000 \|\n", results.markdown())
    rows = [row for row in results.rows() if row["method"] == "knows"]
    told = {(row["target"], row["score"]): row["chance"] for row in rows}
    assert told["sharp", "ssim"] == results.chance("knows", "thin", "ssim")
    assert told["diffraction-limited", "ssim"] is None


def test_which_samples_share_a_medium_is_told_and_no_more():
    one = task("several objects")
    numbers = [blinded(batch, one.recipe())["medium"].tolist() for first in (0, 8)
               for batch in one.batches(range(first, first + 8))]  # fmt: skip
    assert numbers == [[0, 0, 0, 0, 1, 1, 1, 1]] * 2


def test_several_families_are_scored_by_family():
    """A function that knows blobs alone is right there, and at chance elsewhere."""
    one = task("seven families")
    objects, number = one.recipe().objects, itertools.count()

    def blobs(batch):
        asked = [next(number) for _ in batch["object"]]
        some = [n if objects.member(SEED, "test", n) == 1 else n + 1 for n in asked]
        return np.stack([objects.image(SEED, "test", n) for n in some])

    results = benchmark(blobs, tasks=[one.name], samples=16)
    parts = results.by_family()
    assert set(parts) <= {(one.name, family) for family in one.families}
    assert parts[one.name, "Blobs"].interval("yours").mean == pytest.approx(1, rel=1e-5)
    others = [part.interval("yours").mean for (_, family), part in parts.items() if family != "Blobs"]
    assert len(others) > 2
    assert max(others) < 0.95
    rows = {row["family"]: row["images"] for row in results.rows()}
    assert rows[""] == 16
    assert rows["Blobs"] == (results.evaluations[one.name].families == 1).sum()
    assert "| seven families, Blobs (" in results.markdown()


def test_a_baseline_of_some_tasks_has_no_score_elsewhere(monkeypatch):
    monkeypatch.setitem(BASELINES, "multiframe", lambda recipe: lambda batch: batch["object"])  # which takes seconds
    results = benchmark({}, baselines=["mean image", "multiframe"], tasks=["several objects", "thin"], samples=2)
    assert [len(each.media) for each in results.evaluations.values()] == [5, 2]  # of two media
    assert np.isnan(results.score("multiframe"))
    assert results.asked("multiframe", "several objects")
    assert not results.asked("multiframe", "thin")
    lines = results.markdown().splitlines()
    assert next(line for line in lines if line.startswith("| thin |")).endswith("| – |")
    assert next(line for line in lines if line.startswith("| **mean** |")).endswith("| – |")


@pytest.mark.parametrize("name", ["test-time fit", "untrained network",
                                  pytest.param("multiframe", marks=pytest.mark.slow)])  # fmt: skip
def test_what_fits_sees_more_than_chance_and_what_is_untrained_does_not(name):
    """Student's t of the paired gain over chance, 16 images: what sees nothing is beyond the limit once in 1e6 runs."""
    one = "several objects"
    results = benchmark({}, baselines=[name], tasks=[one], samples=16)
    assert not results.failures
    gain = results.evaluations[one].values[name]["sharp"]["pearson"] - results.chances[one, name]["pearson"]
    z, most = gain.mean() / (gain.std(ddof=1) / np.sqrt(len(gain))), limit(degrees=15)
    assert abs(z) < most if name == "untrained network" else z > most


def test_a_fit_is_of_one_image_alone(batch, thin):
    """Companions change nothing but the last bits, which 20 steps do not magnify."""
    method = fitted(thin, seed=3, steps=20)
    alone = {name: value[1:2] for name, value in batch.items() if torch.is_tensor(value)}
    alone["parameters"] = {name: value[1:2] for name, value in batch["parameters"].items()}
    torch.testing.assert_close(method(alone)[0], method(batch)[1], rtol=0, atol=1e-3)


@pytest.mark.slow
def test_several_objects_are_seen_together_and_one_image_of_a_medium_says_nothing():
    """Four through one medium are more like themselves than like one another; the fifth is alone behind its own."""
    one = task("several objects")
    (batch,) = one.batches(range(5))
    answer = BASELINES["multiframe"](one.recipe())(blinded(batch, one.recipe()))
    assert not answer[4].any()
    objects = torch.nn.functional.pad(batch["object"][:4].float(), (18, 18, 18, 18))  # to the answers' 64 pixels
    scores = np.array([[float(pearson(align(made, light), light)) for light in objects] for made in answer[:4]])
    assert np.diag(scores).min() > 0.8
    assert np.diag(scores).min() > (scores - np.eye(4)).max()


def test_seen_and_unseen_glasses_are_asked_by_name_and_scored_in_place():
    """Digits are the same, glasses are not; a turned answer counts as another one; chance stands beside."""
    seen, unseen = (next(each.batches(range(12))) for each in GLASSES)
    assert torch.equal(seen["object"], unseen["object"])
    assert not torch.equal(seen["image"], unseen["image"])
    glasses = SpeckleGenerator(GLASSES[0].recipe(), SEED, "train", objects="test")
    glasses.shown = glasses.drawn  # the objects of training behind them are its samples
    assert np.array_equal(glasses([3])["image"], GLASSES[0].recipe().batch(SEED, "train", [3])["image"])
    known = {each["image"].sum().item(): obj for one in (seen, unseen) for each, obj in
             (({"image": image}, obj) for image, obj in zip(one["image"], one["object"], strict=True))}  # fmt: skip

    def right(batch):
        assert "memory_effect" not in batch
        assert not batch["object"].any()
        return torch.stack([known[image.sum().item()] for image in batch["image"]])

    found = benchmark({"right": right, "turned": lambda batch: right(batch).flip((-2, -1))},
                      baselines=["mean image", "Katz"], tasks=[each.name for each in GLASSES], samples=12,
                      limits=None)  # fmt: skip
    for each in GLASSES:
        assert found.interval("right", each.name).mean == pytest.approx(1, abs=1e-5)
        assert found.interval("turned", each.name).mean < 0.9
        assert found.chance("right", each.name) < 0.9
        assert found.chance("mean image", each.name) == pytest.approx(found.interval("mean image", each.name).mean)
    assert not {each.name for each in GLASSES} & {each.name for each in TASKS}
