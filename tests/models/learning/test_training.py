"""Training: repeatable, resumable to the bit, and able to learn."""

import time

import numpy as np
import pytest
import torch
from refusals import assert_refused
from small_runs import DATA, HELD_OUT, SETTINGS, TINY, assert_same_run, checkpoint

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.store.generate import generate
from specklegen.models.judging.unseen import seen_by
from specklegen.models.learning import run
from specklegen.models.learning.examples import examples, sharing_media, streamed
from specklegen.models.learning.reconstructor import Reconstructor, centred
from specklegen.models.learning.training import Training, train
from specklegen.models.metrics import align, pearson


def weights(model):
    return torch.cat([p.flatten() for p in model.network.parameters()])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    train(SETTINGS, DATA, HELD_OUT, folder)
    return folder


def test_a_seed_repeats_a_run(whole, tmp_path):
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))
    train(SETTINGS.replace(seed=1), DATA, HELD_OUT, tmp_path / "other")
    with pytest.raises(AssertionError):
        assert_same_run(checkpoint(whole), checkpoint(tmp_path / "other"))


@pytest.mark.parametrize("stop", [1, 5, 7])
def test_a_stopped_run_goes_on_to_the_same_bits(whole, tmp_path, stop):
    """Five steps an epoch: stopped inside the first, at its end, and inside the second."""
    train(SETTINGS, DATA, HELD_OUT, tmp_path, stop_after=stop)
    assert not checkpoint(tmp_path)["finished"]
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


def test_a_finished_run_stays_as_it_is(whole):
    before = (whole / "checkpoint.pt").read_bytes()
    model = train(SETTINGS, DATA, HELD_OUT, whole)
    assert (whole / "checkpoint.pt").read_bytes() == before
    assert torch.equal(weights(model), weights(Reconstructor.load(whole / "best.pt")))


@pytest.mark.parametrize("device", ["gpu", "meta", *([] if torch.cuda.is_available() else ["cuda"])])
def test_a_device_that_is_not_there_is_named_before_anything_is_written(tmp_path, device):
    with pytest.raises(ValueError, match=f"train device must be a device that torch has here; got '{device}'"):
        train(SETTINGS, DATA, HELD_OUT, tmp_path / "run", device=device)
    assert not (tmp_path / "run").exists()


def test_it_learns(tmp_path):
    model = train(SETTINGS.replace(epochs=20, mirror=False), DATA, HELD_OUT, tmp_path)
    made = model(HELD_OUT.inputs.float())
    found = pearson(align(made, HELD_OUT.targets), HELD_OUT.targets).mean()
    mean = DATA.targets.mean(0).expand_as(HELD_OUT.targets)
    assert found > pearson(align(mean, HELD_OUT.targets), HELD_OUT.targets).mean() + 0.1


def test_it_stops_when_nothing_improves(tmp_path):
    settings = SETTINGS.replace(epochs=50, patience=2, learning_rate=1e-12)
    train(settings, DATA, HELD_OUT, tmp_path)
    rows = checkpoint(tmp_path)["rows"]
    best = int(np.argmax([row["validation_pearson"] for row in rows]))
    assert len(rows) == best + 3


@pytest.fixture
def clock(monkeypatch):
    """Time that passes when a test says so: by the returned function, in seconds by the clock and of CPU time."""
    now, used = [0.0], [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "process_time", lambda: used[0])

    def passes(seconds, cpu=0.0):
        now[0], used[0] = now[0] + seconds, used[0] + cpu

    return passes


def test_seconds_count_everything(tmp_path, clock):
    """Batches that come slowly, and what was prepared before, use the budget up; a run that goes on counts on."""

    def slow(epoch, first):
        for n in range(first, 5):
            clock(0.05)
            yield DATA.inputs[8 * n : 8 * n + 8].float(), DATA.targets[8 * n : 8 * n + 8]

    settings = SETTINGS.replace(epochs=100)
    train(settings, (slow, 5), HELD_OUT, tmp_path, seconds=0.2)
    spent = checkpoint(tmp_path)["spent"]
    assert 0.15 <= spent <= 0.2 + 1e-9  # another batch would come too late
    train(settings, (slow, 5), HELD_OUT, tmp_path, seconds=spent + 0.1, begun=-50.0)
    assert checkpoint(tmp_path)["spent"] >= spent + 50
    assert checkpoint(tmp_path)["epoch"] == 2  # one step, and its epoch ends


@pytest.mark.parametrize("busier", [1.0, 7.0])
def test_a_budget_holds_on_a_machine_that_becomes_busy(tmp_path, clock, monkeypatch, busier):
    """Steps of 1 s of CPU time, ends of 2 s and a reserve of 3 s, all ``busier`` times as long from the first step on:
    what is left of 60 s is less than a step and a tenth of the end."""
    load = [1.0]
    monkeypatch.setattr(run, "validated", lambda *_: clock(2.0 * load[0], 2.0) or 0.5)
    monkeypatch.setattr(run.Run, "save", lambda self: self.count_time())

    def step(self, *args):
        load[0] = busier
        self.step += 1
        clock(load[0], 1.0)

    monkeypatch.setattr(run.Run, "take_step", step)
    train(SETTINGS.replace(epochs=1000, patience=1000), DATA, HELD_OUT, tmp_path, seconds=60.0, reserve=3.0)
    clock(3.0 * load[0])  # the caller's table
    assert 60.0 - 2.0 * busier <= time.perf_counter() <= 60.0


def test_training_streams_share_media_where_none_is_shared():
    recipe = load_recipe("unknown-slab")
    assert sharing_media(recipe) == recipe.replace(media_group=8)
    assert sharing_media(recipe, 1) == recipe
    stated = recipe.replace(media_group=3)
    assert sharing_media(stated) == stated
    numbered = load_recipe("through-slab")
    assert sharing_media(numbered) == numbered


@pytest.mark.parametrize("kind", ["camera", "autocorrelation"])
def test_from_a_stream_and_from_a_store_alike(tmp_path, kind):
    recipe = load_recipe("through-slab", TINY)
    generate(recipe, 0, "train", samples=24, folder=tmp_path / "store.zarr", processes=1)
    stored = examples(SpeckleCache(tmp_path / "store.zarr"), kind)
    rendered = examples(recipe, kind)
    assert all(torch.equal(a, b) for a, b in zip(stored, rendered, strict=True))
    batches, count = streamed(SpeckleStream(recipe, batch_size=16), kind)
    assert count == 2
    made = torch.cat([inputs for inputs, _ in batches(0, 0)])
    assert torch.equal(made.half(), stored.inputs)
    assert torch.equal(torch.cat([inputs for inputs, _ in batches(0, 1)]).half(), stored.inputs[16:])


def test_a_run_from_a_stream_resumes_to_the_bit(tmp_path):
    recipe = load_recipe("through-slab", TINY)
    held_out = examples(recipe, "autocorrelation", split="validation")
    settings = Training(width=4, batch_size=16, epochs=2)

    def data():
        return streamed(SpeckleStream(recipe, batch_size=16), "autocorrelation")

    train(settings, data(), held_out, tmp_path / "whole")
    train(settings, data(), held_out, tmp_path / "parts", stop_after=3)
    train(settings, data(), held_out, tmp_path / "parts")
    assert_same_run(checkpoint(tmp_path / "whole"), checkpoint(tmp_path / "parts"))


def test_a_run_starts_from_a_model(whole, tmp_path):
    """Its weights are the first; where nothing better is found, they stay the best."""
    first = Reconstructor.load(whole / "best.pt")
    worse = train(SETTINGS.replace(learning_rate=10.0, epochs=1), DATA, HELD_OUT, tmp_path / "worse", start=first)
    assert torch.equal(weights(worse), weights(first))
    small = SETTINGS.replace(learning_rate=1e-9, epochs=1)
    train(small, DATA, HELD_OUT, tmp_path / "near", start=first)
    near = checkpoint(tmp_path / "near")["network"]
    for name, weight in first.network.state_dict().items():
        if name.endswith(("weight", "bias")):
            assert torch.allclose(near[name], weight, atol=1e-6)
    with pytest.raises(AssertionError):
        torch.testing.assert_close(near, train(small, DATA, HELD_OUT, tmp_path / "drawn").network.state_dict())


def test_a_started_run_stops_and_goes_on_to_the_same_bits(whole, tmp_path):
    first = Reconstructor.load(whole / "best.pt")
    train(SETTINGS, DATA, HELD_OUT, tmp_path / "at once", start=first)
    train(SETTINGS, DATA, HELD_OUT, tmp_path / "twice", start=first, stop_after=7)
    train(SETTINGS, DATA, HELD_OUT, tmp_path / "twice", start=first)
    assert_same_run(checkpoint(tmp_path / "at once"), checkpoint(tmp_path / "twice"))
    assert_refused(lambda: train(SETTINGS, DATA, HELD_OUT, tmp_path / "twice"), r"start\.sha256")


@pytest.mark.parametrize(("field", "value"), [("width", 8), ("network", "residual")])
def test_a_start_of_another_kind_is_refused(whole, tmp_path, field, value):
    with pytest.raises(RuleError, match=rf"train start must be a model of {field} {value}"):
        train(SETTINGS.replace(**{field: value}), DATA, HELD_OUT, tmp_path, start=Reconstructor.load(whole / "best.pt"))


def test_a_started_network_has_seen_what_both_have(whole, tmp_path):
    first = Reconstructor.load(whole / "best.pt")
    table = {"type": "Glyphs", "shape": [12, 12], "disjoint": "character", "test": "5F"}
    first.trained_on, mine = table | {"validation": "TV"}, table | {"validation": "AE"}
    about = {"data": {"recipe": {"objects": mine}}}
    found = train(SETTINGS.replace(epochs=1), DATA, HELD_OUT, tmp_path, start=first, about=about)
    assert seen_by([found.trained_on]) == seen_by([mine]) | set("AE")
    alone = train(SETTINGS.replace(epochs=1), DATA, HELD_OUT, tmp_path / "alone", about=about)
    assert seen_by([alone.trained_on]) == seen_by([mine])
    assert set("TV") <= seen_by([mine])
    assert not set("AE") & seen_by([mine])


def test_saved_model_is_the_model(tmp_path, whole):
    model = Reconstructor.load(whole / "best.pt")
    model.save(tmp_path / "compact.pt", compact=True)
    again = Reconstructor.load(tmp_path / "compact.pt")
    inputs = HELD_OUT.inputs.float()
    # float16 rounds each weight to 2**-11
    torch.testing.assert_close(again(inputs), model(inputs), rtol=0, atol=0.02)
    assert (tmp_path / "compact.pt").stat().st_size < (whole / "best.pt").stat().st_size
    assert_refused(lambda: Reconstructor.load(tmp_path / "none.pt"), "model must be an existing file")
    torch.save({"a": 1}, tmp_path / "other.pt")
    assert_refused(lambda: Reconstructor.load(tmp_path / "other.pt"), r"Reconstructor\.save")


def test_an_object_across_the_edge_is_put_together():
    whole = torch.zeros(2, 12, 14)
    whole[0, 4:9, 5:10] = 1
    whole[1, 5:8, 2:11] = 1  # odd sides: their centroid is a pixel
    expected = centred(whole)
    for shift in ((3, 4), (6, -7), (-5, 1)):
        assert torch.equal(centred(torch.roll(whole, shift, (-2, -1))), expected)
    ends = expected[0].nonzero()
    assert (ends.amax(0) - ends.amin(0)).tolist() == [4, 4]
    assert torch.equal(expected.sum((-2, -1)), whole.sum((-2, -1)))
