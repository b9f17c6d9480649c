"""The loader: epochs that go on by themselves, one iteration at a time, positions that are checked, frameworks."""

import gc
import inspect
import itertools
import weakref

import pytest
import torch
from fake_recipe import FakeRecipe
from small_stores import make
from torch.utils.data import DataLoader

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream

TIMEOUT = 120


def indices(batches):
    return [n for batch in batches for n in batch["index"].tolist()]


def stream(samples=12, **options):
    return SpeckleStream(FakeRecipe(samples=samples), batch_size=4, **options)


@pytest.mark.parametrize("workers", [0, 2])
def test_every_iteration_is_the_next_epoch(workers):
    loader = stream().loader(num_workers=workers, timeout=TIMEOUT)
    assert [indices(loader) for _ in range(3)] == [list(range(12 * e, 12 * e + 12)) for e in range(3)]
    next(iter(loader))  # given up in the middle: the next one is new all the same
    assert indices(loader) == list(range(48, 60))
    assert loader.state_dict()["epoch"] == 4


def test_workers_end_with_their_loader():
    """By counting references, not when the garbage collector comes by: no reference goes round in a circle."""
    gc.disable()
    try:
        loader = stream().loader(num_workers=1, timeout=TIMEOUT)
        next(iter(loader))
        loader.sampler.set_epoch(1)
        seen = weakref.ref(loader)
        del loader
        assert seen() is None
    finally:
        gc.enable()


def test_two_loaders_of_one_stream_count_for_themselves():
    shared = stream()
    one, two = shared.loader(), shared.loader()
    assert indices(one) + indices(one) == list(range(24))
    assert indices(two) == list(range(12))


def test_who_sets_the_epoch_keeps_it():
    loader = stream().loader()
    indices(loader)
    loader.set_epoch(7)
    assert indices(loader) == indices(loader) == list(range(84, 96))
    with pytest.raises(RuleError, match="epoch must be a whole number"):
        loader.set_epoch(1.5)
    with pytest.raises(RuleError, match="epoch must be at least 0 and at most"):
        loader.set_epoch(2**62)


def test_set_epoch_on_the_stream_ends_a_position_in_another_epoch():
    """Batch 2 of epoch 3 was saved; who then asks the stream for epoch 5 gets all of it."""
    loader = stream().loader()
    loader.load_state_dict(loader.state_dict() | {"epoch": 3, "next_batch": 2})
    loader.batches.set_epoch(5)
    assert loader.state_dict()["next_batch"] == 0
    assert indices(loader) == list(range(60, 72))


def test_validation_is_on_the_same_samples_each_time():
    loader = stream(split="validation").loader()
    assert indices(loader) == indices(loader) == list(range(12))
    loader.sampler.set_epoch(3)
    assert indices(loader) == list(range(12))
    loader.set_epoch(3)
    assert indices(loader) == list(range(36, 48))
    fresh = stream(split="validation").loader(repeat=False)
    assert indices(fresh) + indices(fresh) == list(range(24))


def test_a_shuffled_cache_is_in_another_order_each_time(tmp_path):
    make(tmp_path / "a.zarr")
    cache = SpeckleCache(tmp_path / "a.zarr")
    loader, shuffled = cache.shuffled(4).loader(), cache.shuffled(4)
    orders = [indices(loader) for _ in range(3)]
    assert orders == [shuffled.order(epoch).tolist() for epoch in range(3)]
    assert orders[0] != orders[1]


def test_resume_goes_on_into_the_next_epoch():
    first, whole = stream().loader(), stream().loader()
    head = indices(itertools.islice(first, 2))
    second = stream().loader()
    second.load_state_dict(first.state_dict())
    assert head + indices(second) + indices(second) == indices(whole) + indices(whole)


@pytest.mark.parametrize("workers", [0, 2])
def test_an_older_iteration_does_not_go_on(workers):
    loader = stream(40).loader(num_workers=workers, timeout=TIMEOUT)
    older = iter(loader)
    assert indices([next(older)]) == [0, 1, 2, 3]
    newer = iter(loader)
    assert indices([next(newer)]) == [40, 41, 42, 43]
    with pytest.raises(RuleError, match=r"one?.* at a time; .*Make one loader for each"):
        next(older)
    assert indices(newer) == list(range(44, 80)), "the newer one is whole"
    assert loader.state_dict()["next_batch"] == 10


def test_an_iteration_does_not_go_on_over_a_loaded_position():
    loader = stream(40).loader()
    older = iter(loader)
    next(older)
    loader.load_state_dict(loader.state_dict())
    with pytest.raises(RuleError, match="at a time"):
        next(older)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"world": -1}, "'world'.* at least 1; got -1"), ({"world": 0}, "'world'"), ({"next_batch": -1}, "'next_batch'"),
     ({"next_batch": 4}, r"'next_batch'\] must be at most 3; got 4"), ({"next_batch": 1.0}, "'next_batch'"),
     ({"epoch": -1}, "'epoch'"), ({"epoch": "two"}, "'epoch'"), ({"epoch": 2**63}, "epoch must be"),
     ({"batch_size": 0}, "'batch_size'"), ({"batch_size": True}, "'batch_size'"), ({"drop_last": None}, "'drop_last'"),
     ({"seed": "0"}, "seed")],
)  # fmt: skip
def test_positions_that_cannot_be_are_refused_by_name(change, words):
    loader = stream().loader()
    before = loader.state_dict()
    with pytest.raises(RuleError, match=words):
        loader.load_state_dict(before | change)
    assert loader.state_dict() == before


@pytest.mark.parametrize("missing", stream().loader().state_dict())
def test_a_position_that_lacks_something_is_refused_by_name(missing):
    loader = stream().loader()
    state = loader.state_dict()
    del state[missing]
    with pytest.raises(RuleError, match=missing):
        loader.load_state_dict(state)
    with pytest.raises(RuleError, match="must be a dict"):
        loader.load_state_dict(list(state))


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize("options", [{"batch_size": 8}, {}], ids=["8", "default"])
def test_batches_are_not_batched_again(workers, options):
    loader = DataLoader(stream(), num_workers=workers, timeout=TIMEOUT if workers else 0, **options)
    with pytest.raises(RuleError, match=r"batch_size must be None.*stream\.loader"):
        next(iter(loader))


def test_samples_of_a_cache_are_batched_as_ever(tmp_path):
    make(tmp_path / "a.zarr")
    assert indices(DataLoader(SpeckleCache(tmp_path / "a.zarr"), batch_size=8)) == list(range(22))


def test_lightning_sees_new_samples_each_epoch_and_resumes(tmp_path):
    """The example of docs/streaming.md: two epochs, stopped inside the second, and resumed."""
    lightning = pytest.importorskip("lightning", reason="the extra lightning is not installed")

    class Seeing(lightning.LightningModule):
        def __init__(self, stop_after=None):
            super().__init__()
            self.layer = torch.nn.Conv2d(1, 1, 3)
            self.trained, self.validated, self.stop_after = [], [], stop_after

        def training_step(self, batch, number):
            self.trained += batch["index"].tolist()
            if len(self.trained) == self.stop_after:
                self.trainer.should_stop = True
                self.trainer.save_checkpoint(tmp_path / "stopped.ckpt")
            return self.layer(batch["image"][:, None].float()).square().mean()

        def validation_step(self, batch, number):
            self.validated += batch["index"].tolist()

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), 1e-9)

    def fit(model, path=None):
        trainer = lightning.Trainer(
            max_epochs=3, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
            enable_model_summary=False, num_sanity_val_steps=0,
        )  # fmt: skip
        trainer.fit(model, stream().loader(), stream(split="validation").loader(), ckpt_path=path)
        return model

    whole = fit(Seeing())
    assert whole.trained == list(range(36))
    assert whole.validated == 3 * list(range(12))
    stopped = Seeing(stop_after=20)
    fit(stopped)
    resumed = fit(Seeing(), tmp_path / "stopped.ckpt")
    assert resumed.trained == list(range(20, 36))


REFUSED = {
    "batch_size": 3, "drop_last": True, "shuffle": True, "sampler": [1], "batch_sampler": [[1]], "collate_fn": list,
    "in_order": False, "dataset": [1],
}  # fmt: skip
TAKEN = {
    "num_workers": 0, "pin_memory": False, "timeout": 0, "prefetch_factor": 2, "worker_init_fn": print,
    "multiprocessing_context": "spawn", "persistent_workers": True, "generator": torch.Generator(),
    "pin_memory_device": "", "repeat": True,
}  # fmt: skip


def test_every_argument_of_a_dataloader_is_taken_or_refused_with_a_reason():
    arguments = [*inspect.signature(DataLoader.__init__).parameters][1:]
    assert set(arguments) <= REFUSED.keys() | TAKEN.keys()
    for name, value in REFUSED.items():
        with pytest.raises(RuleError, match=rf"loader\.{name} must be left out; got .*\. \w+"):
            stream().loader(**{name: value})
    for name, value in TAKEN.items():
        assert len([*stream().loader(**{name: value})]) == len(stream())
    list(stream().loader(batch_size=None, drop_last=False, shuffle=False, sampler=None, in_order=True, collate_fn=None))
    with pytest.raises(RuleError, match=r"loader\.workers must be one of repeat, .*persistent_workers"):
        stream().loader(workers=2)
    with pytest.raises(RuleError, match="fork.*may deadlock"):
        stream().loader(multiprocessing_context="fork")


def test_workers_that_are_started_anew_each_epoch_give_the_same_batches():
    with_workers = stream().loader(2, persistent_workers=False, timeout=TIMEOUT, generator=torch.Generator())
    without = stream().loader()
    for _ in range(2):
        assert indices(with_workers) == indices(without)
