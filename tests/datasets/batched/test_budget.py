"""What a batch costs a device, counted on "meta": operators, bytes, waits. No device is needed, and no time measured.

An operator counts as one kernel, a fused one as many as it says; what it reads and writes counts whole, so that an
operand that stays in the cache is counted all the same. Compiled graphs can only be cheaper.
"""

import pytest
import torch
from device_counting import Counting

from specklegen.datasets import load_recipe
from specklegen.datasets.batched.fused import FORMS, KERNELS
from specklegen.datasets.batched.generator import SpeckleGenerator

BATCH = 256
# Launches an image, and megabytes an image, at most: a tenth above what was counted.
BUDGETS = {
    "unknown-slab": (1.95, 15.0), "unseen-material": (2.25, 23.2), "tilt-stack": (1.4, 3.5),
    "material-regression": (1.75, 9.5), "through-slab": (0.94, 9.2), "through-slab-lab": (0.96, 14.4),
    "dynamic-slab": (2.15, 84.0), "partially-coherent-slab": (2.05, 95.0),
}  # fmt: skip


ESTIMATED = {"through-slab", "through-slab-lab", "dynamic-slab", "partially-coherent-slab"}


def generator(name, device):
    changes = {"material": {"kernel_paths": 20_000}} if name in ESTIMATED else {}
    return SpeckleGenerator(load_recipe(name, changes), 0, device=device)


@pytest.mark.parametrize("name", BUDGETS)
def test_a_batch_keeps_to_its_budget(name):
    """With the ranks that the CPU finds; everything runs where there are no numbers, so no step hides on the host."""
    made = generator(name, "meta")
    if hasattr(made, "sizes"):
        here = generator(name, "cpu")
        ranks = here.ranks(here.prepare(list(range(BATCH)))[0])
        made.ranks = lambda _: ranks
    with Counting("meta") as count:
        batch = made(range(BATCH))
    launches, megabytes = BUDGETS[name]
    assert count.launches / BATCH <= launches
    assert count.bytes / BATCH / 1e6 <= megabytes
    assert count.launches / BATCH > launches / 2, "the budget says something"
    assert count.bytes / BATCH / 1e6 > megabytes / 2
    assert count.waits == 0, "and the ranks make one"
    shapes = {key: value.shape for key, value in batch.items() if key != "parameters"}
    assert {shape[0] for shape in shapes.values()} == {BATCH}
    tensors = [value for key, value in batch.items() if key != "parameters"] + list(batch["parameters"].values())
    assert {value.device.type for value in tensors} == {"meta"}


def test_the_budget_of_the_issue():
    """unknown-slab: 15 MB and 2.4 launches an image, two waits a batch."""
    launches, megabytes = BUDGETS["unknown-slab"]
    assert launches <= 2.4
    assert megabytes <= 15


def test_batches_made_at_once_and_graphs_need_fewer_launches():
    """What a stream of small batches asks for: few chunks are filled up; a replay is one launch, its inputs copied."""
    made, here = generator("unknown-slab", "meta"), generator("unknown-slab", "cpu")
    ranks = here.ranks(here.prepare(list(range(BATCH)))[0]) * 4
    made.ranks = lambda medium: ranks[: len(medium.rank)]
    spared = []

    def replayed(_, function, inputs):
        with Counting("meta") as inside:
            result = function(**inputs)
        spared.append(inside.launches - 1 - len(inputs))
        return result

    with Counting("meta") as alone:
        made(range(32))
    made.run = replayed
    with Counting("meta") as together:
        made(range(made.at_once))
    graphed = together.launches - sum(spared)
    assert made.at_once == 1024
    assert alone.launches / 32 > 10
    assert alone.bytes / 32 > 4 * together.bytes / 1024
    assert together.launches / 1024 <= 1.0
    assert graphed / 1024 <= 0.7


def test_the_host_waits_once_a_batch(monkeypatch):
    """On the CPU, where there are numbers: nothing but the ranks is asked for."""
    made = generator("unknown-slab", "cpu")
    asked = []
    for name in ("item", "tolist", "__bool__", "__int__", "__float__", "nonzero"):
        plain = getattr(torch.Tensor, name)

        def counted(self, *arguments, _plain=plain, _name=name, **options):
            asked.append((_name, tuple(self.shape)))
            return _plain(self, *arguments, **options)

        monkeypatch.setattr(torch.Tensor, name, counted)
    medium, _ = made.prepare(list(range(8)))
    assert asked == []
    made.ranks(medium)
    assert asked == [("tolist", (8,))]


def test_counting_has_power():
    with Counting("cpu") as count:
        x = torch.ones(1000)
        (x + x).sum().item()
    assert (count.launches, count.waits) == (3, 1)
    assert count.bytes == 4 * (1000 + 3000 + 1001)
    assert set(KERNELS) == set(FORMS)
