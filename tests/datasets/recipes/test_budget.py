"""What a batch costs a device, counted on "meta": operators, bytes, waits. No device is needed, and no time measured.

An operator counts as one kernel, a fused one as many as it says; what it reads and writes counts whole, so that an
operand that stays in the cache is counted all the same. Compiled graphs can only be cheaper.
"""

import pytest
import torch
from device_counting import Counting
from plain_forms import as_on_devices

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.synthesis import imaging
from specklegen.synthesis.fused import FORMS, KERNELS

BATCH = 256
# Launches an image, and megabytes an image, at most: a tenth above what was counted.
BUDGETS = {"unknown-slab": (2.72, 16.3), "unseen-material": (3.13, 24.0), "tilt-stack": (2.05, 4.5),
           "material-regression": (2.63, 11.8), "through-slab": (3.72, 14.5), "through-slab-lab": (6.9, 160.0),
           "dynamic-slab": (2.87, 109.0), "brownian-slab": (4.12, 184.0),
           "partially-coherent-slab": (2.74, 90.2)}  # fmt: skip


ESTIMATED = {"through-slab", "through-slab-lab", "dynamic-slab", "brownian-slab", "partially-coherent-slab"}


def generator(name, device):
    changes = {"material": {"kernel_paths": 20_000}} if name in ESTIMATED else {}
    return SpeckleGenerator(load_recipe(name, changes), 0, device=device)


def with_ranks(monkeypatch, name):
    """Let "meta", which has no numbers, know the ranks that the CPU finds; what its media share is of one rank."""
    media = generator(name, "cpu").media(range(BATCH))
    ranks = [media.groups[group][1].rank for group, _ in media.at]
    monkeypatch.setattr(imaging, "_ranks", lambda modes: (ranks * len(modes.rank))[: len(modes.rank)])


@pytest.mark.parametrize("name", BUDGETS)
def test_a_batch_keeps_to_its_budget(name, monkeypatch):
    """With the ranks that the CPU finds; everything runs where there are no numbers, so no step hides on the host."""
    with_ranks(monkeypatch, name)
    made = generator(name, "meta")
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


def test_batches_made_at_once_and_graphs_need_fewer_launches(monkeypatch):
    """What a stream of small batches asks for: few chunks are filled up; a replay is one launch, its inputs copied."""
    with_ranks(monkeypatch, "unknown-slab")
    made = generator("unknown-slab", "meta")
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
    assert alone.bytes / 32 > 3 * together.bytes / 1024
    assert together.launches / 1024 <= 2.05
    assert graphed / 1024 <= 1.85


def test_the_host_waits_a_few_times_a_batch(monkeypatch):
    """On the CPU, where there are numbers, in what devices run: whether atlas and first degree serve, and the ranks."""
    recipe = load_recipe("unknown-slab")
    recipe.rendering  # noqa: B018 - planned
    made, asked = SpeckleGenerator(recipe, 0), []
    with as_on_devices(monkeypatch):
        made.media(range(2))  # tables are made
        for name in ("item", "tolist", "__bool__", "__int__", "__float__", "nonzero"):
            plain = getattr(torch.Tensor, name)

            def counted(self, *arguments, _plain=plain, _name=name, **options):
                asked.append((_name, tuple(self.shape)))
                return _plain(self, *arguments, **options)

            monkeypatch.setattr(torch.Tensor, name, counted)
        for count in (8, 16):
            asked.clear()
            made.media(range(count))
            # Whole numbers are those that the host made itself, of shapes.
            waited = [each for each in asked if each != ("__int__", ())]
            assert waited == [("__bool__", ())] * 2 + [("tolist", (count,))] * 2


def test_counting_has_power():
    with Counting("cpu") as count:
        x = torch.ones(1000)
        (x + x).sum().item()
    assert (count.launches, count.waits) == (3, 1)
    assert count.bytes == 4 * (1000 + 3000 + 1001)
    assert set(KERNELS) == set(FORMS)
