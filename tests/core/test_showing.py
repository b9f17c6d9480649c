"""Short texts of results."""

import importlib
import re
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe

import specklegen as sg
from specklegen.core.display.repr import summary
from specklegen.core.errors import counted
from specklegen.datasets import SpeckleCache, SpeckleStream
from specklegen.datasets.store.generate import generate
from specklegen.models import Periodogram, PhotographVerdict, load_pretrained, load_solver


def test_results_show_what_they_hold_on_one_line():
    slab = sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.5))
    scene = sg.Scene(
        wavelength=0.5,
        medium=slab,
        illumination=sg.CollimatedBeams.tilts([0.0, 1e-5], width=1000.0),
        sensor=sg.FarField.grid((12, 13), 1e-4),
    )
    shown = [
        (sg.render(scene, paths=64), "SpeckleStack(field=complex64[2, 12, 13], sampler="),
        (sg.covariance(scene, paths=64), "Covariance(value=complex128[2, 156, 2, 156], paths=64, "),
        (sg.plan(scene, paths=64), "Plan(sampler="),
        (sg.memory_effect(slab, wavelength=0.5, tilts=np.zeros(1000), paths=64), "MemoryEffect(tilts=float64[1000], "),
    ]
    for result, start in shown:
        assert repr(result).startswith(start)
        assert len(repr(result)) < 200
        assert "\n" not in repr(result)


ROOMS = ("datasets", "models", "fdtd", "coherence", "instrument", "wavetracing")
PACKAGES = ("specklegen", *(f"specklegen.{name}" for name in ROOMS))
PUBLIC = [
    kind
    for package in PACKAGES
    for kind in (getattr(importlib.import_module(package), name) for name in importlib.import_module(package).__all__)
    if isinstance(kind, type)
]


RESULTS = [kind for kind in PUBLIC if is_dataclass(kind) or hasattr(kind, "_fields")]


IN_WORDS = (sg.Plan, sg.Advice, PhotographVerdict)
"""Results that hold no arrays of their own and say themselves in a sentence."""


@pytest.mark.parametrize("kind", [kind for kind in RESULTS if kind not in IN_WORDS])
def test_a_result_of_many_numbers_shows_none_of_them(kind):
    """Whatever a result is made of, here a million numbers in each array field."""
    many = np.zeros((1000, 1000), np.float32)
    names = kind._fields if hasattr(kind, "_fields") else [field.name for field in fields(kind)]
    said = {name: str(kind.__annotations__.get(name)) for name in names}
    held = {
        name: many if re.search("ndarray|Tensor", of) else () if of.startswith("tuple[") else 1.0
        for name, of in said.items()
    }
    if hasattr(kind, "_fields"):
        shown = kind(**held)
    else:
        shown = object.__new__(kind)
        for name, value in held.items():
            object.__setattr__(shown, name, value)
    told = repr(shown)
    assert told.startswith(kind.__name__ + "(")
    assert len(told) < 500
    assert told.count("float32[1000, 1000]") <= sum(value is many for value in held.values())
    assert "..." not in told  # no array has been cut short


@pytest.mark.parametrize("kind", [kind for kind in PUBLIC if not getattr(kind, "_is_protocol", False)])
def test_nothing_public_shows_an_address(kind):
    assert kind.__repr__ is not object.__repr__


def test_tensors_are_shown_as_arrays_are():
    assert repr(Periodogram(torch.zeros(2, 4, 3), torch.zeros(2), 1.0, (4, 4))) == (
        "Periodogram(power=float32[2, 4, 3], noise=float32[2], looks=1, shape=(4, 4), lowest=0)"
    )


def test_data_sets_say_what_they_are(tmp_path):
    recipe = FakeRecipe()
    generate(recipe, samples=3, folder=tmp_path / "a.zarr", processes=1)
    stream = SpeckleStream(recipe, batch_size=4)
    length = len(stream)
    assert repr(stream) == (
        f"SpeckleStream(recipe='fake', seed=0, split='train', batches={length}, batch_size=4, epoch=0, "
        "device='cpu')"
    )
    cache = SpeckleCache(tmp_path / "a.zarr")
    assert repr(cache) == (
        f"SpeckleCache(folder={str(tmp_path / 'a.zarr')!r}, samples=3, split='train', keys={cache.keys!r})"
    )
    assert repr(cache.shuffled(2)) == f"ShuffledCache(cache={cache!r}, batches=2, batch_size=2, epoch=0)"
    assert repr(stream.loader()) == f"EpochLoader(batches={stream!r}, num_workers=0)"


def test_a_network_says_what_it_is():
    told = repr(load_pretrained())
    assert re.match(r"Reconstructor\(name='\w+', input='autocorrelation', target='object', side=", told)
    assert len(told) < 200
    assert repr(load_solver()).startswith("Solver(frame=")


def test_a_summary_keeps_numbers_short():
    assert summary(1, a=1 / 3, b="x", c=7) == "int(a=0.3333, b='x', c=7)"


def test_things_are_counted():
    assert [counted(n, "shard") for n in (0, 1, 2)] == ["0 shards", "1 shard", "2 shards"]
