"""CUDA graphs where there is no GPU: a stand-in replays the operators that were captured, on the memory they had."""

from functools import partial
from itertools import chain, count

import numpy as np
import pytest
import torch
from stand_in_cuda import StandIn

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes import generator
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.synthesis.graphs import Graphs

CPU = torch.device("cpu")
QUICK = {"kernel_paths": 20_000}
LATER = chain([0.0] * 3, count(1.0))
CALLS = count()
SMALL = {"camera": {"shape": [12, 16]}}
RECIPES = {
    "tilt-stack": SMALL,
    "unknown-slab": {"field": {"pixels": 10.0}, "sampler": "stationary", **SMALL},  # else the planner's, at its margin
    "through-slab": {"material": QUICK, "media": 3, **SMALL},
    "dynamic-slab": {"material": QUICK, "dynamics": {"frames": 2}, **SMALL},
    "brownian-slab": {"material": QUICK, "dynamics": {"frames": 2}, **SMALL},
}


@pytest.mark.parametrize("name", RECIPES)
def test_replays_give_the_bits_of_the_functions(name, monkeypatch):
    recipe = load_recipe(name, RECIPES[name])
    monkeypatch.setattr(generator, "CHUNK", 1)
    plain, graphed = SpeckleGenerator(recipe, 3), SpeckleGenerator(recipe, 3)
    graphed.run = Graphs(CPU, StandIn())
    plain.one_by_one = graphed.one_by_one = False  # as on CUDA
    key = next(iter(recipe.layout()))
    rng = np.random.default_rng(0)
    for _ in range(3):
        indices = rng.integers(0, 2**40, 12)
        assert torch.equal(graphed(indices)[key], plain(indices)[key])
    replays = [found.graph.replays for found in graphed.run.kept.values()]
    assert sum(replays) == 36 + len(replays), "one for each sample, and one to compare"
    assert graphed.report()["graphs"] == f"{len(replays)} captured"
    assert plain.report()["graphs"] == "none"


def doubled(x):
    return torch.arange(len(x)) + 2 * x


def test_shapes_and_names_have_graphs_of_their_own():
    cuda = StandIn()
    run = Graphs(CPU, cuda)
    for length in (3, 5, 3, 3, 5):
        x = torch.rand(length)
        assert torch.equal(run("doubled", doubled, {"x": x}), doubled(x))
    assert torch.equal(run("halved", lambda x: x / 2, {"x": x}), x / 2)
    assert [found.graph.replays for found in run.kept.values()] == [4, 3, 2]
    assert len(cuda.pools) == 1
    expanded = torch.ones(1).expand(3)
    assert torch.equal(run("doubled", doubled, {"x": expanded}), doubled(expanded)), "inputs need not be contiguous"


@pytest.mark.parametrize(("function", "words"), [
    (lambda x: x * x.sum().item(), "wanting: operation not permitted when stream is capturing"),
    (lambda x: x + next(CALLS), "wanting: its own runs differ: 1 of its numbers, by up to 0.33 of the largest"),
    (lambda x: torch.cat([x[:2], x[:1] + next(LATER)]),
     "wanting: the first replay differs from what it replays: 0.33 of its numbers, by up to 1 of the largest"),
])  # fmt: skip
def test_what_cannot_be_captured_is_named_and_runs_as_it_is(function, words, caplog):
    run = Graphs(CPU, StandIn())
    x = torch.ones(3)
    with caplog.at_level("WARNING"):
        found = run("wanting", function, {"x": x})
    assert found.shape == (3,)
    assert torch.equal(run("doubled", doubled, {"x": x}), doubled(x))
    assert run.report() == f"refused: {words}"
    assert words in caplog.text
    assert not run.kept


def test_staged_tables_serve_batches_of_every_length():
    """Rooms of 64, 128 and 256 rows: lengths between them meet graphs that are there, and no row of a batch before."""
    cuda = StandIn()
    run, other = Graphs(CPU, cuda), cuda.Stream(None)
    picked = lambda tables, places: tables[0]["x"][places[0]] + tables[1]["y"][places[1]]  # noqa: E731
    for length in (3, 64, 65, 256, 5, 130, 1):
        tables = [{"x": torch.rand(length, 2)}, {"y": torch.rand(64, 1)}]
        places = torch.tensor([[0, length // 2, length - 1], [63, 0, 5]])
        key, staged = run.stage("picked", tables)
        assert torch.equal(run(key, partial(picked, staged), {"places": places}), picked(tables, places))
    assert [found.graph.replays for found in run.kept.values()] == [5, 2, 3]
    tick = cuda.current.work()  # which uses the result
    with cuda.stream(other):
        run.stage("picked", tables)
    assert other.has_waited(cuda.made[0], tick)
    run("wanting", lambda x: x * x.sum().item(), {"x": torch.ones(3)})
    assert run.refused
    assert run.stage("picked", tables) == ("picked", tables)
    assert not run._staged, "memory is free again"


def test_another_stream_waits_for_the_one_before():
    cuda = StandIn()
    run, other = Graphs(CPU, cuda), cuda.Stream(None)
    run("doubled", doubled, {"x": torch.ones(2)})
    tick = cuda.current.work()  # which uses the result
    assert not other.has_waited(cuda.current, tick)
    with cuda.stream(other):
        run("doubled", doubled, {"x": torch.ones(2)})
    assert other.has_waited(cuda.made[0], tick)


def test_the_stand_in_finds_what_a_graph_cannot_carry():
    """A number from the host stays what it was at the capture; what lies in the inputs does not."""
    cuda = StandIn()
    graph, x, factor = cuda.CUDAGraph(), torch.ones(2), [1.0]
    pool, side = cuda.graph_pool_handle(), cuda.Stream(None)
    with cuda.graph(graph, pool=pool, stream=side, capture_error_mode="thread_local"):
        out = factor[0] * x
    factor[0], x[0] = 5.0, 7.0
    graph.replay()
    assert out.tolist() == [7.0, 1.0]
