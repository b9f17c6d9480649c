"""Wide fields: pages in their place, functions of images alone beside functions of a page."""

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.models import benchmark
from specklegen.models.judging import pages, tasks
from specklegen.models.judging.tasks import SEED, task

NAME = "wide fields"


@pytest.fixture
def small(monkeypatch):
    """The task with two pages of three and four columns, on a small camera."""
    changes = {"objects": {"grid": [3, 4]}, "camera": {"shape": [128, 128]}}
    monkeypatch.setattr(pages, "COLUMNS", (3, 4))
    one = task(NAME)._replace(changes=changes, samples=2)
    drawn = tasks._recipe(one.base, tasks.json.dumps(changes))
    one = one._replace(fingerprint=pages.digest(drawn))
    monkeypatch.setattr(tasks, "TASKS", (*(each for each in tasks.TASKS if each.name != NAME), one))
    return one


def knowing(recipe, moved=0):
    """A function that cheats: it knows the page of so many exposures."""

    def function(batch):
        number = [12 - 3, 12].index(len(batch["object"]))
        return pages.page(recipe, number, SEED, images=False)["page"].roll(moved, 1)[None] * 3 + 1

    return function


def test_pages_are_as_wide_as_said():
    recipe = task(NAME).recipe()
    spot = recipe.objects.shape[1]
    wide = [shape[1] / spot * 2 for shape in pages.shapes(recipe).values()]  # a spot is two ranges wide
    np.testing.assert_allclose(wide, [10, 16, 25, 40], atol=0.3)
    assert recipe.field.extent_over_range == 2.0


def test_a_page_is_its_exposures(small):
    recipe = small.recipe()
    (one,) = small.batches([0])
    assert one["image"].shape == (9, 128, 128)
    assert pages.shape_of(one["places"], one["spot"]) == tuple(one["page"].shape) == (26, 26)
    for (row, column), lit, light in zip(one["places"], one["object"], one["parameters"]["light"], strict=True):
        part = one["page"][row : row + 16, column : column + 16] * one["spot"]
        torch.testing.assert_close(lit * (part.max() / lit.max().clamp_min(1e-9)), part, rtol=0, atol=1e-5)
        assert float(part.sum()) == pytest.approx(float(light), rel=1e-5)
    assert pages.shapes(recipe) == {9: (26, 26), 12: (26, 31)}


def test_a_page_is_scored_in_its_place(small):
    """One that knows it is right, even in other units; moved by two pixels it is not; all zeros is nothing."""
    recipe = small.recipe()
    functions = {"knows": knowing(recipe), "moved": knowing(recipe, 2), "dark": lambda batch: batch["object"]}
    results = benchmark(functions, tasks=[NAME], samples=2)
    assert not results.failures
    values = {name: results.evaluations[NAME].values[name]["sharp"]["pearson"] for name in functions}
    np.testing.assert_allclose(values["knows"], 1, rtol=1e-5)
    assert (values["moved"] < 0.8).all()
    assert (values["dark"] == 0).all()
    assert results.evaluations[NAME].identified["knows"].all()
    assert results.chance("knows", NAME) < 0.8
    assert results.evaluations[NAME].extents.tolist() == [26 / 8, 31 / 8]


def test_objects_of_exposures_are_put_where_their_spots_were(small):
    """What each spot lights, anywhere on a frame of its own: put together they are the page but for its dark edges."""
    recipe = small.recipe()

    def parts(batch):
        page = pages.page(recipe, [9, 12].index(len(batch["object"])), SEED, images=False)
        lit = [page["page"][r : r + 16, c : c + 16] * page["spot"] for r, c in page["places"].tolist()]
        return torch.stack([torch.nn.functional.pad(each, (7, 3, 2, 5)) for each in lit])

    results = benchmark({"parts": parts}, baselines=["mean image"], tasks=[NAME], samples=2)
    assert not results.failures
    # the centre of brightness of a part is not the middle of its spot, which is all that is off
    assert results.interval("parts", NAME).low > results.interval("mean image", NAME).high


def test_what_is_neither_is_a_failure(small):
    results = benchmark({"wide": lambda batch: torch.ones(1, 26, 30)}, tasks=[NAME], samples=2)
    assert [each[:4] for each in results.failures] == [(NAME, "wide", 0, 1), (NAME, "wide", 1, 1)]
    assert results.interval("wide", NAME) == (0, 0, 0)


@pytest.mark.slow
def test_all_exposures_together_say_what_none_says_alone(small):
    results = benchmark({}, baselines=["untrained network", "spots together"], tasks=[NAME], samples=2)
    assert not results.failures
    assert results.interval("spots together", NAME).low > results.interval("untrained network", NAME).high + 0.2
    with pytest.raises(RuleError, match="at least one that serves the task 'thin'"):
        benchmark({}, baselines=["spots together"], tasks=["thin"], samples=2)


def test_a_function_of_images_is_asked_in_parts():
    seen = []

    def function(batch):
        seen.append(len(batch["object"]))
        assert len(batch["parameters"]["light"]) == len(batch["image"]) == len(batch["memory_effect"])
        return batch["object"]

    batch = {"image": torch.rand(35, 8, 8), "object": torch.rand(35, 4, 4), "memory_effect": torch.rand(35, 64),
             "parameters": {"light": torch.rand(35)}, "places": torch.zeros(35, 2)}  # fmt: skip
    assert torch.equal(pages.in_parts(function)(batch), batch["object"])
    assert seen == [16, 16, 3]


def test_only_what_the_spots_light_is_scored():
    """Rows that the middle of a spot passes, and none of the outermost, where it is dark."""
    spot = torch.from_numpy(np.outer(np.hanning(18)[1:-1], np.hanning(18)[1:-1])).float()
    places = torch.tensor([[row, column] for row in (0, 5, 10) for column in (0, 5, 10)])
    rows, columns = pages.told(places, spot)
    assert rows == columns
    assert 0 < rows.start < 8
    assert rows.start + rows.stop == 26  # symmetric
