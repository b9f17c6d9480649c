"""Short texts of results."""

import numpy as np

import specklegen as sg
from specklegen.core.errors import counted
from specklegen.core.showing import summary


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


def test_a_summary_keeps_numbers_short():
    assert summary(1, a=1 / 3, b="x", c=7) == "int(a=0.3333, b='x', c=7)"


def test_things_are_counted():
    assert [counted(n, "shard") for n in (0, 1, 2)] == ["0 shards", "1 shard", "2 shards"]
