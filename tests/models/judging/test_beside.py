"""What a run is judged beside: the same images for all, answers asked for once, the clock obeyed."""

import numpy as np
import pytest
import torch
from small_runs import HELD_OUT, SETTINGS, TINY

from specklegen.datasets import load_recipe
from specklegen.models.judging.beside import TRAINED, UNTRAINED, Beside, methods_beside
from specklegen.models.judging.evaluation import evaluate
from specklegen.models.learning.examples import batches_of, examples
from specklegen.models.learning.run import untrained
from specklegen.models.learning.training import train


@pytest.fixture(scope="module")
def recipe():
    return load_recipe("through-slab", TINY)


@pytest.fixture(scope="module")
def network(recipe):
    return untrained(SETTINGS, examples(recipe, "autocorrelation", 2, split="validation"))


def batches(recipe):
    return batches_of(recipe, 6, 0, "validation", 2)


def test_rows_are_what_everybody_scores_on_the_same_images(recipe, network):
    asked = []

    def guess(batch):
        asked.append(batch["index"].tolist())
        return batch["image"][:, 10:22, 10:22]

    beside = Beside(batches(recipe), {"guess": guess}, network)
    assert beside.judged
    first, last = beside.table(), beside.table(network)
    assert asked == [[0, 1], [2, 3], [4, 5]]  # once each, whatever is shown
    found, _ = evaluate({"guess": guess, "network": network.reconstruct}, batches(recipe), recipe.profile)
    for name, shown in (("guess", "guess"), ("network", UNTRAINED), ("network", TRAINED)):
        assert f"| {shown} | {found.interval(name).mean:.3f} [" in last
    assert f"| {UNTRAINED} | {found.interval('network').mean:.3f} [" in first
    assert f"| {TRAINED} |" not in first
    assert f" {found.gain('network', 'guess').mean:+.3f} [" in last


def test_no_batch_is_begun_after_the_clock_but_two(recipe, network):
    beside = Beside(batches(recipe), {"nothing": lambda batch: batch["object"]}, network, until=0.0)
    assert len(beside.batches) == 2


def test_phase_retrieval_and_the_solver_answer_where_they_can(recipe):
    methods = methods_beside(recipe, 0, lambda: None)
    assert [*methods] == ["phase retrieval", "packaged solver"]
    assert [*methods_beside(None, 0, None)] == ["phase retrieval"]
    large = recipe.replace(objects=recipe.objects.replace(shape=(40, 40)))
    assert [*methods_beside(large, 0, lambda: None)] == ["phase retrieval"]
    (batch,) = batches_of(recipe, 2, 0, "validation")
    made = methods["phase retrieval"](batch)
    assert made.shape[0] == 2
    assert made.isfinite().all()


def test_numbers_of_a_medium_stand_beside_what_others_tell():
    settings = SETTINGS.replace(target="material", input="registered", network="perceptron", mirror=False)
    recipe = load_recipe("registered-tilts", {"material": {"kernel_paths": 1000, "kernel": "estimate"}})
    held_out = examples(recipe, "registered", 8, split="validation", target="material")
    network = untrained(settings, held_out)
    beside = Beside(batches_of(recipe, 8, 0, "validation", 4), {"zero": lambda batch: np.zeros((4, 4))}, network)
    table = beside.table(network)
    assert table.count("| zero |") == table.count(f"| {UNTRAINED} |") == table.count("| network |") == 4


def test_seconds_that_the_caller_needs_afterwards_are_kept_back(tmp_path):
    from small_runs import DATA, checkpoint

    settings = SETTINGS.replace(epochs=10_000)
    train(settings, DATA, HELD_OUT, tmp_path, seconds=1000, reserve=1000)
    state = checkpoint(tmp_path)
    assert state["finished"]
    assert len(state["rows"]) == 1
    assert state["spent"] < 500
    train(settings, DATA, HELD_OUT, tmp_path, seconds=1000)  # as many seconds, however few were needed: no more
    assert len(checkpoint(tmp_path)["rows"]) == 1
    train(settings, DATA, HELD_OUT, tmp_path, seconds=2000, reserve=2000)
    assert len(checkpoint(tmp_path)["rows"]) == 2
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["ended"] == 2000
