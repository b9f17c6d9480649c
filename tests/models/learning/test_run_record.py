"""A run knows what it was made with: settings, data, validation; and is saved often enough."""

import contextlib
import json
import shutil
import signal

import pytest
import torch
from refusals import assert_refused
from small_runs import DATA, HELD_OUT, SETTINGS, TINY, assert_same_run, checkpoint, squares
from small_stores import claiming
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.core.interrupts import Terminated
from specklegen.core.whole_files import write_whole
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.recipes.recipe_files import merged
from specklegen.datasets.store.generate import generate
from specklegen.models.learning import model_file, run, run_record
from specklegen.models.learning.examples import examples, streamed
from specklegen.models.learning.training import train


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    train(SETTINGS, DATA, HELD_OUT, folder)
    return folder


def test_a_run_does_not_go_on_with_other_data(whole, tmp_path):
    before = (whole / "checkpoint.pt").read_bytes()
    others = ((squares(70, 2), HELD_OUT, "data.sha256"), (DATA, squares(16, 3), "validation.sha256"))
    for data, held_out, words in others:
        with pytest.raises(RuleError, match=words):
            train(SETTINGS, data, held_out, whole)
    assert (whole / "checkpoint.pt").read_bytes() == before


def test_a_difference_is_named_with_both_values(tmp_path):
    about = {"data": {"recipe": {"material": {"g": 0.9}}, "seed": 0}}
    train(SETTINGS, DATA, HELD_OUT, tmp_path, about=about, stop_after=1)
    assert json.loads((tmp_path / "run.json").read_text())["data"]["recipe"] == {"material": {"g": 0.9}}
    other = {"data": {"recipe": {"material": {"g": 0.8}}, "seed": 1}}
    with pytest.raises(RuleError, match=r"material\.g \(0\.9 there, 0\.8 here\).*seed \(0 there, 1 here\)"):
        train(SETTINGS, DATA, HELD_OUT, tmp_path, about=other)
    with pytest.raises(RuleError, match=r"training\.width \(4 there, 8 here\)"):
        train(SETTINGS.replace(width=8), DATA, HELD_OUT, tmp_path, about=about)


def test_more_epochs_go_on_and_fewer_are_refused_by_name(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "a")
    with pytest.raises(RuleError, match=r"training\.epochs \(3 there, 2 here\)"):
        train(SETTINGS.replace(epochs=2), DATA, HELD_OUT, tmp_path / "a")
    train(SETTINGS.replace(epochs=5), DATA, HELD_OUT, tmp_path / "a")
    state = checkpoint(tmp_path / "a")
    assert state["epoch"] == 5
    assert [row["epoch"] for row in state["rows"]] == [0, 1, 2, 3, 4]
    assert state["rows"][:3] == checkpoint(whole)["rows"]


def test_a_larger_budget_goes_on(tmp_path):
    settings = SETTINGS.replace(epochs=10_000)
    train(settings, DATA, HELD_OUT, tmp_path, seconds=0.02)
    first = checkpoint(tmp_path)
    train(settings, DATA, HELD_OUT, tmp_path, seconds=first["spent"] + 0.02)
    assert checkpoint(tmp_path)["epoch"] > first["epoch"]


def test_another_stream_does_not_go_on_with_a_run(tmp_path):
    """Streams are known by recipe, seed and split, named one by one."""

    def data(changes=None, **options):
        recipe = load_recipe("through-slab", merged(TINY, changes or {}))
        return streamed(SpeckleStream(recipe, batch_size=16, **options), "camera")

    settings = SETTINGS.replace(input="camera", mirror=False)
    held_out = examples(load_recipe("through-slab", TINY), "camera", split="validation")
    train(settings, data(), held_out, tmp_path, stop_after=1)
    for other, words in ((data({"material": {"g": 0.5}}), r"recipe\.material\.g"), (data(seed=1), r"data\.seed")):
        with pytest.raises(RuleError, match=words):
            train(settings, other, held_out, tmp_path)


def test_checkpoints_inside_an_epoch_lose_no_step(whole, tmp_path, monkeypatch):
    """Saved after every step, dead without a last word in step 8: the rest is what it would have been."""
    seen, left = [], []

    def failing(done, total):
        seen.append((done, total))
        if done == 8:
            left.append((tmp_path / "checkpoint.pt").read_bytes())
            raise OSError("power")

    with pytest.raises(OSError, match="power"):
        train(SETTINGS, DATA, HELD_OUT, tmp_path, save_every=-1.0, steps=failing)
    assert seen == [(n, 15) for n in range(1, 9)]
    (tmp_path / "checkpoint.pt").write_bytes(left[0])
    assert (checkpoint(tmp_path)["epoch"], checkpoint(tmp_path)["step"]) == (1, 2)
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


@pytest.mark.parametrize(("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_ctrl_c_and_sigterm_save_after_the_step(whole, tmp_path, number, error):
    before = signal.getsignal(number)

    def interrupting(done, total):
        if done == 7:
            signal.raise_signal(number)

    with pytest.raises(error):
        train(SETTINGS, DATA, HELD_OUT, tmp_path, steps=interrupting)
    assert (checkpoint(tmp_path)["epoch"], checkpoint(tmp_path)["step"]) == (1, 2)
    assert signal.getsignal(number) is before
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


def test_a_handler_of_sigterm_that_the_program_has_is_left_alone(tmp_path):
    heard = []
    before = signal.signal(signal.SIGTERM, lambda *_: heard.append(1))
    try:
        train(SETTINGS, DATA, HELD_OUT, tmp_path,
              steps=lambda done, _: signal.raise_signal(signal.SIGTERM) if done == 7 else None)  # fmt: skip
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [1]
    assert checkpoint(tmp_path)["epoch"] == 3


@pytest.mark.parametrize("moment", ["in a step", "between steps"])
def test_data_that_fail_lose_no_step(whole, tmp_path, monkeypatch, moment):
    """Slurm ends workers at the same time: torch tells of it by an error that it raises wherever the program is."""
    step, count = torch.optim.AdamW.step, iter(range(100))

    def die(*_):
        raise RuntimeError("worker is killed by signal: Terminated")

    def interrupted(self, *arguments, **options):
        if next(count) == 6 and moment == "in a step":
            signal.raise_signal(signal.SIGCHLD)
        step(self, *arguments, **options)

    monkeypatch.setattr(torch.optim.AdamW, "step", interrupted)
    before = signal.signal(signal.SIGCHLD, die)
    try:
        with pytest.raises(RuntimeError, match="killed by signal"):
            train(SETTINGS, DATA, HELD_OUT, tmp_path,
                  steps=lambda done, _: signal.raise_signal(signal.SIGCHLD) if done == 7 else None)  # fmt: skip
    finally:
        signal.signal(signal.SIGCHLD, before)
    monkeypatch.undo()
    assert (checkpoint(tmp_path)["epoch"], checkpoint(tmp_path)["step"]) == (1, 2)
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


def test_a_second_ctrl_c_stops_inside_a_step_and_saves_nothing_of_it(whole, tmp_path, monkeypatch):
    """Weights half updated must not become a checkpoint: the one after epoch 0 stays."""
    step, count = torch.optim.AdamW.step, iter(range(100))

    def impatient(self, *arguments, **options):
        step(self, *arguments, **options)
        if next(count) == 6:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(torch.optim.AdamW, "step", impatient)
    with pytest.raises(KeyboardInterrupt):
        train(SETTINGS, DATA, HELD_OUT, tmp_path)
    monkeypatch.undo()
    assert (checkpoint(tmp_path)["epoch"], checkpoint(tmp_path)["step"]) == (1, 0)
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


@pytest.mark.parametrize("deaths", range(1, 13))
def test_a_run_that_dies_between_two_files_goes_on_to_the_same_bits(whole, tmp_path, monkeypatch, deaths):
    """Three files an epoch, or four with a better model, the owner and the record: a kill before each of them."""
    left = iter(range(deaths))

    def dying(file, data):
        if next(left, None) is None:
            raise KeyboardInterrupt
        write_whole(file, data)

    for module in (run_record, model_file, run):
        monkeypatch.setattr(module, "write_whole", dying)
    with contextlib.suppress(KeyboardInterrupt):
        train(SETTINGS, DATA, HELD_OUT, tmp_path)
    monkeypatch.undo()
    train(SETTINGS, DATA, HELD_OUT, tmp_path)
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))
    torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    lines = [(folder / "log.csv").read_text().splitlines() for folder in (whole, tmp_path)]
    assert len(lines[0]) == len(lines[1])
    assert (tmp_path / "best.pt").read_bytes() == (whole / "best.pt").read_bytes()


@pytest.mark.parametrize("moment", [2, 7])
def test_where_locks_exclude_nobody_the_earlier_process_ends_before_it_writes(whole, tmp_path, monkeypatch, moment):
    """Its checkpoint, log and best model took the place of the later one's, which had been further on."""

    @contextlib.contextmanager
    def excluding_nobody(*_):
        yield "held"

    monkeypatch.setattr(run_record, "claim", excluding_nobody)
    left = {}

    def meanwhile(done, _total):
        if done == moment:
            train(SETTINGS, DATA, HELD_OUT, tmp_path)
            left.update({file.name: file.read_bytes() for file in tmp_path.iterdir()})

    with pytest.raises(RuleError, match="Another process trains there now"):
        train(SETTINGS, DATA, HELD_OUT, tmp_path, steps=meanwhile)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == left
    assert_same_run(checkpoint(whole), checkpoint(tmp_path))


def test_two_processes_do_not_train_in_one_folder(tmp_path):
    (tmp_path / "lock").touch()
    other = claiming(tmp_path / "lock", 0)
    try:
        assert_refused(lambda: train(SETTINGS, DATA, HELD_OUT, tmp_path), "no other running training")
    finally:
        other.kill()
        other.wait(120)
    train(SETTINGS, DATA, HELD_OUT, tmp_path, stop_after=1)


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stores")
    recipe = load_recipe("through-slab", TINY)
    for name, split, seed in (("a", "train", 0), ("b", "train", 1), ("c", "validation", 0), ("d", "test", 0)):
        generate(recipe, seed, split, samples=8, folder=folder / f"{name}.zarr", processes=1)
    return folder


@pytest.mark.parametrize(("data", "held_out"), [("a", "a"), ("a", "b"), ("c", "c"), ("c", "a")])
def test_validation_on_training_media_is_refused(stores, tmp_path, data, held_out):
    one, other = str(stores / f"{data}.zarr"), str(stores / f"{held_out}.zarr")
    error = CliRunner().invoke(app, ["train", one, "--validation", other, "--out", str(tmp_path)]).exception
    assert isinstance(error, RuleError)
    assert "of another split than the training data" in str(error)
    assert not list(tmp_path.iterdir())


def test_the_command_records_the_data_and_says_when_a_run_is_finished(stores, tmp_path):
    def run(*words, data="a", held_out="c"):
        place = [str(stores / f"{data}.zarr"), "--validation", str(stores / f"{held_out}.zarr"), "--out", str(tmp_path)]
        return CliRunner().invoke(app, ["train", *place, "--width", "4", "--epochs", "1", *words])

    assert run().exit_code == 0
    noted = json.loads((tmp_path / "run.json").read_text())
    assert noted["data"]["split"] == "train"
    assert noted["data"]["recipe"]["material"]["kernel_paths"] == 1000
    assert "already finished" in run().output
    assert "data.seed (0 there, 1 here)" in str(run(data="b").exception)
    assert "validation.split ('validation' there, 'test' here)" in str(run(held_out="d").exception)
    assert "epoch 1:" in run("--epochs", "2").output
    assert "left out with a store" in str(run("--set", "material.g=0.5").exception)
    error = CliRunner().invoke(app, ["train", "through-slab", "--out", str(tmp_path), "--validation", "x"]).exception
    assert "left out with a recipe" in str(error)
