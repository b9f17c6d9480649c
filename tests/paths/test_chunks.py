"""Chunks of paths: even, fixed by the plan, summed in their order whatever the threads; and threads that help."""

import sys
import threading
import time

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import specklegen as sg
from specklegen.core.parallel import in_turn, map_blocks
from specklegen.paths.chunks import Chunks
from specklegen.samplers.path_sums import sampler


@given(st.integers(1, 10**8), st.floats(0, 1e3), st.integers(1, 2**20))
def test_chunks_are_the_paths_in_order_and_even(paths, per_path, at_once):
    chunks = Chunks(paths, per_path, at_once)
    assume(chunks.count <= 10_000)
    parts = chunks.slices
    assert len(parts) == chunks.count
    assert [parts[0].start, parts[-1].stop] == [0, paths]
    assert all(a.stop == b.start for a, b in zip(parts[:-1], parts[1:], strict=True))
    sizes = [part.stop - part.start for part in parts]
    assert 1 <= min(sizes) <= max(sizes) <= min(sizes) + 1
    assert min(sizes) == 1 or chunks.connections <= at_once * (1 + 1e-9)


@given(st.integers(1, 64), st.integers(1, 10**7), st.floats(0, 100), st.floats(1, 1e9), st.integers(1, 100))
def test_what_is_in_work_is_bounded_by_the_threads(threads, paths, per_path, fields, realizations):
    chunks = Chunks(paths, per_path)
    beside = chunks.side_by_side(threads, fields, realizations)
    assert 1 <= beside <= min(threads, chunks.count * realizations)
    assert beside == 1 or beside * (chunks.connections + fields / 8) <= threads * 2**17


# ---- In turn -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_jobs(workers):
    def slow_first(n: int, _threads) -> int:
        time.sleep(0.02 if n % 3 == 0 else 0.0)
        return n * n

    assert list(in_turn(slow_first, range(20), workers)) == [n * n for n in range(20)]
    assert list(in_turn(slow_first, [], workers)) == []


def test_few_jobs_are_begun_ahead_and_none_after_the_last_is_taken():
    begun, lock = [], threading.Lock()

    def job(n: int, _threads) -> int:
        with lock:
            begun.append(n)
        return n

    results = in_turn(job, range(1000), 2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert max(begun) <= 3 + 2 * 2
    results.close()
    after = len(begun)
    time.sleep(0.05)
    assert len(begun) == after


def test_an_error_comes_through_and_ends_the_work():
    begun = []

    def job(n: int, _threads) -> int:
        begun.append(n)
        if n == 3:
            raise ValueError("the third")
        return n

    results = in_turn(job, range(1000), 2)
    with pytest.raises(ValueError, match="the third"):
        list(results)
    assert max(begun) < 3 + 2 * 2 + 2


MEET = 20  # seconds within which threads that work side by side meet


def test_a_thread_without_a_job_helps_with_the_blocks_of_another():
    """Two blocks that wait for each other end only on two threads; nested blocks are helped with as well."""
    outer, inner = threading.Barrier(2, timeout=MEET), threading.Barrier(2, timeout=MEET)

    def job(n: int, crew) -> list[list[int]]:
        def block(m: int) -> list[int]:
            if m < 2:
                outer.wait()
                return [m]
            return map_blocks(lambda k: (inner.wait(), 10 * n + k)[1], range(2), crew)

        return map_blocks(block, range(3), crew)

    assert list(in_turn(job, [1], 2)) == [[[0], [1], [10, 11]]]


def test_one_job_at_a_time_where_more_would_not_fit():
    running, most, lock = 0, 0, threading.Lock()

    def job(n: int, crew) -> int:
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
        total = sum(map_blocks(lambda m: m * n, range(50), crew))
        with lock:
            running -= 1
        return total

    assert list(in_turn(job, range(20), 4, 1)) == [1225 * n for n in range(20)]
    assert most == 1


@pytest.mark.parametrize("beside", [1, 2])
def test_an_error_in_a_block_comes_through(beside):
    def job(n: int, crew) -> list[int]:
        return map_blocks(lambda m: m // (n - 3), range(10), crew)

    with pytest.raises(ZeroDivisionError):
        list(in_turn(job, range(1000), 2, beside))


def test_many_small_blocks_of_many_jobs():
    """Switching threads as often as it goes: every block is done once, results are those of one thread."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        done, lock = [], threading.Lock()

        def block(known: tuple[int, int]) -> int:
            with lock:
                done.append(known)
            return known[0] * known[1]

        def job(n: int, crew) -> int:
            return sum(map_blocks(block, [(n, m) for m in range(7)], crew))

        assert list(in_turn(job, range(300), 4)) == [21 * n for n in range(300)]
        assert sorted(done) == [(n, m) for n in range(300) for m in range(7)]
    finally:
        sys.setswitchinterval(before)


# ---- Renders -------------------------------------------------------------------------------------------
def slab_scene(**kwargs) -> sg.Scene:
    return sg.Scene(wavelength=1.0,
                    medium=sg.Slab(thickness=200.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.6)),
                    illumination=sg.CollimatedBeams.tilts([0.0, 1e-4, 2e-4], width=2e4),
                    sensor=sg.FarField.grid(shape=(24, 25), pitch=1e-5), **kwargs)  # fmt: skip


def box_scene() -> sg.Scene:
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=(-9.0, -9.0, 0.0), upper=(9.0, 9.0, 20.0), mean_free_path=9.0, scatterer=sg.Isotropic()),
        illumination=sg.PlaneWaves(directions=[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]),
        sensor=sg.FarField(directions=[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0]]),
    )


CASES = {
    "slab, NUFFT": (slab_scene(), {}),
    "slab, directly": (slab_scene().replace(sensor=sg.FarField(directions=[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])), {}),
    "slab, reversed": (slab_scene(), {"reverse": True}), "box": (box_scene(), {}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("count", [1, 4])
def test_bits_do_not_depend_on_threads(name, count, monkeypatch):
    """Chunks side by side, of one realization or of several, and threads within a chunk."""
    scene, options = CASES[name]
    monkeypatch.setattr(Chunks, "count", count)
    one = sg.render(scene, paths=2000, seed=4, sampler="paths", realizations=3, threads=1, **options)
    for threads in (2, 3, 16):
        more = sg.render(scene, paths=2000, seed=4, sampler="paths", realizations=3, threads=threads, **options)
        assert more.field.tobytes() == one.field.tobytes()
        assert more.report == one.report
    alone = sg.render(scene, paths=2000, seed=4, sampler="paths", threads=2, **options)
    assert alone.field.tobytes() == one.field[0].tobytes()


def test_a_chunk_that_is_lost_or_counted_twice_is_seen(monkeypatch):
    """Of the test above: a realization takes its own chunks and no other's."""
    monkeypatch.setattr(Chunks, "count", 4)
    scene = slab_scene()
    right = sg.render(scene, paths=2000, seed=4, sampler="paths", realizations=2, threads=2)
    taken = sampler.islice
    monkeypatch.setattr(sampler, "islice", lambda parts, n: taken(parts, n - 1))
    wrong = sg.render(scene, paths=2000, seed=4, sampler="paths", realizations=2, threads=2)
    for a, b in zip(right.field, wrong.field, strict=True):
        assert np.linalg.norm(a - b) > 0.1 * np.linalg.norm(a)
    assert wrong.report.connections < right.report.connections
