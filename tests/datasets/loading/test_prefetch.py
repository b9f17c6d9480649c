"""Pieces made ahead: with streams that know what they waited for, no order of a real device has to be met by luck."""

import pytest
import torch
from stand_in_cuda import StandIn, Stream

from specklegen.datasets.loading.prefetch import ahead

CUDA = torch.device("cuda")


def followed(cuda, pieces=6):
    """What was waited for when each piece was begun, made and used."""
    begun, made, used = [], [], []

    def make():
        for number in range(pieces):
            here = cuda.current
            begun.append((here, here.record_event()))
            made.append(here.work())
            yield number

    for number in ahead(make(), CUDA, cuda):
        program = cuda.current
        assert program.has_waited(begun[number][0], made[number]), "used before it was made"
        used.append(program.work())
    return begun, made, used


def test_a_piece_is_made_while_the_one_before_is_used():
    cuda = StandIn()
    begun, _, used = followed(cuda)
    assert len(used) == 6
    program = cuda.made[0]
    for number, (side, clock) in enumerate(begun):
        assert side is not program
        waited = clock.get(program.name, 0)
        assert waited >= (used[number - 2] if number > 1 else 0), "memory of the last but one is still read"
        assert number == 0 or waited < used[number - 1], "no overlap"


@pytest.mark.parametrize(("method", "words"), [("wait_event", "used before"), ("wait_stream", "memory of the last")])
def test_without_either_wait_there_is_a_race(monkeypatch, method, words):
    monkeypatch.setattr(Stream, method, lambda *_: None)
    with pytest.raises(AssertionError, match=words):
        test_a_piece_is_made_while_the_one_before_is_used()


def test_an_iteration_that_is_left_waits_for_what_it_began():
    cuda, made = StandIn(), []

    def make():
        for number in range(6):
            made.append((cuda.current, cuda.current.work()))
            yield number

    pieces = ahead(make(), CUDA, cuda)
    assert [next(pieces), next(pieces)] == [0, 1]
    assert len(made) == 3
    pieces.close()
    assert cuda.current.has_waited(*made[-1])


def test_elsewhere_pieces_are_made_when_they_are_asked_for():
    made = []

    def make():
        for number in range(3):
            made.append(number)
            yield number

    pieces = ahead(make(), torch.device("cpu"), cuda=None)
    assert (next(pieces), made) == (0, [0])
    assert [*pieces] == [1, 2]


def test_a_failure_is_the_programs():
    def make():
        yield 0
        raise MemoryError("no room for a batch")

    with pytest.raises(MemoryError, match="no room"):
        [*ahead(make(), CUDA, StandIn())]
