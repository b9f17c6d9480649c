"""How many processes render: as many as save more time than they take to start."""

from dataclasses import dataclass

import pytest
from fake_recipe import FakeRecipe

from specklegen.datasets.store import timing
from specklegen.datasets.store.timing import START, processes_for


@dataclass(frozen=True)
class SharedMedia(FakeRecipe):
    """Every medium is looked through by ten samples, the first of which takes its time."""

    def media_of(self, samples: int) -> int:
        return samples // 10


@pytest.fixture(autouse=True)
def _two_cores(monkeypatch):
    monkeypatch.setattr(timing, "thread_count", lambda _: 2)


def test_a_pool_starts_where_it_saves_more_than_its_start():
    enough = 2 * START / 0.02  # samples, half of which the second process takes over
    assert processes_for(FakeRecipe(seconds=0.02), 0, "train", int(1.2 * enough)) == 2
    assert processes_for(FakeRecipe(seconds=0.02), 0, "train", int(0.3 * enough)) == 1


def test_media_that_samples_share_count_once(monkeypatch):
    monkeypatch.setattr(timing, "_timed", lambda recipe, *_: next(times))
    times = iter([1.0, 0.001])  # a sample of a new medium, and one more of the same
    assert processes_for(SharedMedia(), 0, "train", 60) == 1  # six seconds and little beside
    times = iter([1.0, 0.001])
    assert processes_for(SharedMedia(), 0, "train", 80) == 2


def test_one_core_renders_nothing_to_know(monkeypatch):
    monkeypatch.setattr(timing, "thread_count", lambda _: 1)
    assert processes_for(FakeRecipe(fails_at=0), 0, "train", 10**6) == 1


def test_a_sample_that_fails_is_left_to_who_renders_it():
    assert processes_for(FakeRecipe(fails_at=1), 0, "train", 10**6) == 2
