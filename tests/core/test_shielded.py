"""The shield: what a program sets of NumPy and torch reaches no sample, and stands again afterwards."""

import contextlib
import threading

import numpy as np
import pytest
import torch
from fake_recipe import assert_same
from forgotten import forget
from quick_recipes import quick_recipe

import specklegen as sg
from specklegen.core.parallel import one_blas_thread
from specklegen.core.shielded import shielded, shielded_steps
from specklegen.datasets import SpeckleStream, recipe_names
from specklegen.datasets.recipes.generator import SpeckleGenerator


@contextlib.contextmanager
def restored(read, write, value):
    before = read()
    write(value)
    try:
        yield
    finally:
        write(before)


def precision(backend):
    return restored(lambda: backend.fp32_precision, lambda value: setattr(backend, "fp32_precision", value), "tf32")


def flushing():
    return restored(lambda: TINY / 2 == 0, torch.set_flush_denormal, True)


TINY = float(np.finfo(float).tiny)
CONTEXTS = {
    "autocast": lambda: torch.autocast("cpu", dtype=torch.bfloat16),
    "half autocast": lambda: torch.autocast("cpu", dtype=torch.float16), "meta device": lambda: torch.device("meta"),
    "inference": torch.inference_mode, "floating-point errors": lambda: np.errstate(all="raise"),
    "double": lambda: restored(torch.get_default_dtype, torch.set_default_dtype, torch.float64),
    "bfloat16": lambda: restored(torch.get_default_dtype, torch.set_default_dtype, torch.bfloat16),
    "deterministic": lambda: restored(torch.are_deterministic_algorithms_enabled, torch.use_deterministic_algorithms,
                                      True),
    "tf32": lambda: precision(torch.backends.cuda.matmul),
    "low precision": lambda: precision(torch.backends.mkldnn.matmul),
    "threads": lambda: restored(torch.get_num_threads, torch.set_num_threads, 2), "denormals": flushing,
}  # fmt: skip


def state():
    """All that the contexts change, as it is now."""
    return (torch.is_autocast_enabled("cpu"), torch.get_default_device(), torch.is_inference_mode_enabled(),
            np.geterr(), torch.get_default_dtype(), torch.are_deterministic_algorithms_enabled(),
            torch.get_num_threads(), torch.backends.cuda.matmul.fp32_precision,
            torch.backends.mkldnn.matmul.fp32_precision, torch.is_grad_enabled(), TINY / 2 == 0)  # fmt: skip


@pytest.mark.parametrize("name", CONTEXTS)
def test_inside_all_is_the_same_and_outside_all_as_before(name):
    with shielded():
        plain = state()
    with CONTEXTS[name]():
        before = state()
        with shielded():
            assert state() == plain
            with shielded():
                assert state() == plain
            assert state() == plain
        assert state() == before


def test_what_fails_inside_leaves_all_as_it_was():
    with CONTEXTS["double"](), CONTEXTS["autocast"]():
        before = state()
        with pytest.raises(ZeroDivisionError), shielded():
            raise ZeroDivisionError
        assert state() == before


def test_one_thread_does_not_take_the_state_from_another():
    """The first thread leaves while the second is inside: settings of the process must stay until the last is out."""
    inside, leave = threading.Event(), threading.Event()
    seen = []

    def second():
        with shielded():
            inside.set()
            leave.wait(10)
            seen.append(torch.get_default_dtype())

    with CONTEXTS["double"]():
        thread = threading.Thread(target=second)
        with shielded():
            thread.start()
            assert inside.wait(10)
        assert torch.get_default_dtype() == torch.float32  # the second is still inside
        leave.set()
        thread.join()
        assert seen == [torch.float32]
        assert torch.get_default_dtype() == torch.float64


def test_what_the_program_sets_meanwhile_stays():
    with shielded():
        torch.set_default_dtype(torch.float64)
    try:
        assert torch.get_default_dtype() == torch.float64
    finally:
        torch.set_default_dtype(torch.float32)


def test_linear_algebra_stays_on_one_thread_until_the_last_is_out():
    from threadpoolctl import threadpool_info

    def threads():
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    from threadpoolctl import threadpool_limits

    with threadpool_limits(2, user_api="blas"):
        first, second = one_blas_thread(), one_blas_thread()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}


def test_only_the_steps_of_a_generator_are_inside():
    def steps():
        for _ in range(3):
            yield torch.get_default_dtype()

    with CONTEXTS["double"]():
        for found in shielded_steps(steps()):
            assert found == torch.float32
            assert torch.get_default_dtype() == torch.float64


def sampled(name, index=3):
    forget()
    return quick_recipe(name).sample(0, "train", index)


QUICK = ("unknown-slab", "tilt-stack", "ground-glass", "refocus-stack", "lsci-slab", "polarised-tissue")
"""One of each way of drawing."""


@pytest.mark.parametrize("name", [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in recipe_names()
])  # fmt: skip
def test_samples_of_all_recipes_are_the_same_under_all_contexts(name):
    expected = sampled(name)
    with contextlib.ExitStack() as stack:
        for context in CONTEXTS.values():
            stack.enter_context(context())
        found = sampled(name)
    assert_same(found, expected)


@pytest.mark.parametrize("name", ["unknown-slab", "through-slab", "ground-glass"])
def test_batches_of_tensors_are_the_same_under_all_contexts(name):
    """Of the generator, which draws, keeps, and shares media; made and called under the contexts."""
    expected = SpeckleGenerator(quick_recipe(name), 0, "train")([2, 5])
    forget()
    with contextlib.ExitStack() as stack:
        for context in CONTEXTS.values():
            stack.enter_context(context())
        found = SpeckleGenerator(quick_recipe(name), 0, "train")([2, 5])
    assert_same(found, expected)
    assert not found["image"].is_inference()


def test_a_stream_runs_under_a_default_device_without_numbers():
    """With and without workers, which know nothing of the contexts of the program."""
    recipe = quick_recipe("through-slab", samples={"train": 4})
    expected = next(iter(SpeckleStream(recipe, batch_size=2).loader()))
    with torch.device("meta"), torch.autocast("cpu", dtype=torch.bfloat16), np.errstate(all="raise"):
        assert_same(next(iter(SpeckleStream(recipe, batch_size=2).loader())), expected)
        assert_same(next(iter(SpeckleStream(recipe, batch_size=2).loader(num_workers=1))), expected)


SLAB = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
SCENE = sg.Scene(wavelength=0.5, medium=SLAB, illumination=sg.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0),
                 sensor=sg.FarField.grid((8, 8), 2e-5))  # fmt: skip
VERBS = {
    "render": lambda: sg.render(SCENE, paths=500).field,
    "render by paths": lambda: sg.render(SCENE, paths=500, sampler="paths").field,
    "render_tiles": lambda: np.concatenate([piece.ravel() for _, piece in sg.render_tiles(SCENE, paths=500)]),
    "memory_effect": lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts=[0.0, 1e-3], paths=2000).intensity,
    "covariance": lambda: sg.covariance(SCENE, pairs=[[0, 0, 1, 1]], paths=2000).value,
    "joint_correlation": lambda: sg.joint_correlation(SLAB, wavelength=0.5, tilts=[0.0, 1e-3], shifts=[0.0, 1.0],
                                                      paths=2000).magnitude,
    "mean_field": lambda: sg.mean_field(SCENE),
    "partially coherent": lambda: sg.render_partially_coherent(
        SCENE.replace(illumination=sg.CollimatedBeams.tilts([0.0], width=5000.0)), 2500.0, paths=500
    ).intensity,
}  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_verbs_give_the_same_under_all_contexts(verb):
    expected = VERBS[verb]()
    forget()
    with contextlib.ExitStack() as stack:
        for context in CONTEXTS.values():
            stack.enter_context(context())
        found = VERBS[verb]()
    np.testing.assert_array_equal(found, expected)


def test_products_are_on_one_thread_where_only_openmp_was_told():
    """threadpoolctl sets the threads of OpenMP alone: torch then counts 1, and its products run on two. A whole run of
    the tests failed by it: what ran before in the process had left that state."""
    from threadpoolctl import threadpool_limits

    rng = torch.Generator().manual_seed(1)
    left, right = torch.randn(1, 5, 3, generator=rng), torch.randn(1, 3, 896, generator=rng)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        expected = torch.bmm(left, right)
        torch.set_num_threads(2)
        on_two = torch.bmm(left, right)
        with threadpool_limits(1, user_api="openmp"):
            with shielded():
                inside = torch.bmm(left, right)
            restored = torch.bmm(left, right)
    finally:
        torch.set_num_threads(before)
    assert torch.equal(inside, expected)
    assert torch.equal(restored, on_two)  # the program's own products are as they were
