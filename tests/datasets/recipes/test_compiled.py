"""The compiler takes each operator's torch form as one graph, without a break; Inductor's code finds the same."""

from itertools import product

import pytest
import torch

from specklegen.datasets.objects import glyph_batches
from specklegen.datasets.recipes import generator, materials
from specklegen.datasets.recipes.parts import source
from specklegen.datasets.recipes.parts.atlas_batches import atlas_tables
from specklegen.instrument.camera import Camera
from specklegen.synthesis import fused
from specklegen.synthesis.fused import FORMS
from specklegen.synthesis.imaging import BUCKETS

CPU = torch.device("cpu")


def double(*shape):
    return torch.rand(shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def arguments():
    """Small arguments of every operator."""
    tables = atlas_tables(CPU)
    outlines = glyph_batches.glyph_edges(CPU)
    words = torch.randint(0, 2**32, (3, 2, 7), generator=torch.Generator().manual_seed(0))
    slabs = torch.tensor([[1000.0, 10.0, 0.9, 1.0], [500.0, 5.0, 0.8, 1.0]], dtype=torch.float64)
    edges = glyph_batches.turned(outlines, torch.tensor([3, 500]), double(2)) * 0.2 + 4
    cells = torch.tensor([5, 6])
    camera = Camera(photons=1.0, background=5.0, dark_current=1.5, full_well=1500.0, read_noise=2.0, gain=1.7,
                    offset=50.0, bit_depth=12)  # fmt: skip
    return {"mixture": (9 * double(2, 5), double(2, 6), double(2, 6)),
            "half_range": (double(2, 6), double(2, 6), 0.1 * double(2)),
            "slab_correlations": (slabs, [*tables.axes], tables.shares, tables.table, tables.bounds, 0.02),
            "waves": (double(2, 5), 9 * double(2, 4), double(2, 4), False),
            "fields": (words[:2, :, :2], 0, double(2), cells, cells, torch.rand(2, 6, 6), 3, [9, 8]),
            "pair_products": (torch.rand(2, 2, 3, 4, 5, 2),),
            "mode_maps": (torch.rand(2, 2, 3, 6), torch.rand(2, 2, 3)),
            "lag_sum": (torch.rand(2, 6, 1, 5, 4, 2), torch.rand(2, 3, 5, 6, 4, 2)),
            "map_lags": (torch.rand(2, 3, 1, 5, 4), torch.rand(2, 6, 3, dtype=torch.complex64),
                         torch.rand(2, 4, 4, dtype=torch.complex64), torch.rand(2, 3, 5, 6, 4, 2)),
            "half_seen": (torch.rand(2, 3, 6, 4, 2), torch.rand(2, 2, 3, 3), torch.rand(2, 2, 2, 4),
                          torch.rand(2, 3, 10, 2), [5, 4]),
            "gaussian_beams": (9 * double(5), double(2) + 1),
            "window_power": (double(2), cells, 0.1 * double(2), 8, False),
            "lag_transform": (double(2, 5), double(2), double(2), double(2), 4),
            "speckle_contrast": (torch.rand(2, 3, 4), double(2, 3, 4)),
            "turned": (outlines, torch.tensor([3, 500]), double(2)), "coverage": (edges, 20, 20),
            "exposed": (90 * double(2, 30), words[:2, :, :2].repeat(1, 2, 1), camera.electronics)}  # fmt: skip


def test_every_operator_is_tested():
    assert all((generator, materials, source))  # which import all of them
    assert set(arguments()) == set(FORMS)


def counted(compiled):
    """A backend that compiles nothing and notes each graph."""

    def backend(graph, _inputs):
        compiled.append(graph)
        return graph.forward

    return backend


@pytest.mark.parametrize("name", sorted(FORMS))
def test_one_graph(name):
    """Dynamo with fullgraph refuses what would break; its graph, run as it is, gives the bits of the function."""
    graphs = []
    torch._dynamo.reset()
    inputs = arguments()[name]
    found = torch.compile(FORMS[name], fullgraph=True, dynamic=False, backend=counted(graphs))(*inputs)
    assert len(graphs) == 1
    torch.testing.assert_close(found, FORMS[name](*inputs), rtol=0, atol=0, equal_nan=True)


@pytest.mark.parametrize(("name", "of_rank"), [
    ("pair_products", lambda rank, count: (torch.rand(count, 1, rank, 3, 2, 2),)),
    ("mode_maps", lambda rank, count: (torch.rand(count, 1, rank, 6), torch.rand(count, 2, 3))),
])  # fmt: skip
def test_few_graphs_serve_all_ranks(name, of_rank):
    """Twelve shapes, as of chunks of two sizes: rank 1, what comes first, and all others take a graph each."""
    compiled, plain = [], []
    torch._dynamo.reset()
    run = fused._compiled(FORMS[name], backend=counted(compiled))
    for rank, count in product(BUCKETS[:6], (2, 3)):
        inputs = of_rank(rank, count)
        assert torch.equal(run(*inputs), FORMS[name](*inputs))
    assert len(compiled) <= 4
    torch._dynamo.reset()
    static = torch.compile(FORMS[name], fullgraph=True, dynamic=False, backend=counted(plain), recompile_limit=99)
    for rank in BUCKETS[:6]:  # power
        static(*of_rank(rank, 2))
    assert len(plain) == 6


def test_more_graphs_than_torch_allows_by_itself():
    """Of inputs with another number of axes each, which no graph serves together; where it was met, limits stay."""
    compiled, limit = [], 2
    torch._dynamo.reset()
    run = fused._compiled(lambda x: 2 * x, backend=counted(compiled))
    plain = torch.compile(lambda x: 3 * x, fullgraph=True, backend=counted([]))
    with torch._dynamo.config.patch(recompile_limit=limit):
        for axes in (1, 2, 3, 4, 1, 2, 3, 4):
            assert torch.equal(run(torch.ones((2,) * axes)), torch.full((2,) * axes, 2.0))
        assert len(compiled) == 4
        assert torch._dynamo.config.recompile_limit == limit
        with pytest.raises(torch._dynamo.exc.FailOnRecompileLimitHit):  # power
            [plain(torch.ones((2,) * axes)) for axes in (1, 2, 3, 4)]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FORMS))
def test_inductor_finds_the_same(name):
    """To rounding, which for noise means that the compiler has the words right. Needs a C++ compiler."""
    torch._dynamo.reset()
    inputs = arguments()[name]
    found = torch.compile(FORMS[name], fullgraph=True, dynamic=False)(*inputs)
    torch.testing.assert_close(found, FORMS[name](*inputs), rtol=1e-5, atol=1e-6)
