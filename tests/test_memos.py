"""What is kept for the next call is what would be worked out again, whatever has happened, and nobody can change it.

The watch of :mod:`memo_hunt` over renders, samples and streams, in a process of its own: it begins before the package
is imported. Over any tests: ``python tests/memo_hunt.py tests/scene ...``.
"""

import os
import subprocess
import sys
from pathlib import Path

import memo_hunt
import numpy as np
import pytest

import specklegen as sg

BEGIN = """
import memo_hunt
memo_hunt.begin()
"""
PROGRAM = BEGIN + """
import numpy as np, torch
import specklegen as sg
from specklegen.datasets.recipes.generator import SpeckleGenerator
from quick_recipes import quick_recipe

def work():
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    light = sg.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))
    hidden = sg.IncoherentObject(brightness=np.ones((6, 6)), pitch=1e-4, width=5000.0)
    for each in (scene, scene.replace(illumination=hidden)):
        sg.render(each, paths=2000)
    sg.render(scene, paths=200, sampler="paths")
    sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-3], paths=1000)
    screen = sg.PhaseScreen(correlation_length=5.0, rms_phase=3.0)
    sg.render(scene.replace(medium=screen))
    return scene.views

def samples(names):
    for name in names:
        recipe = quick_recipe(name, 300)
        recipe.sample(0, "test", 0)
        SpeckleGenerator(recipe, 0, "test")([0, 1])
"""
CONTEXTS = """
work()
samples({names})
with torch.autocast("cpu", dtype=torch.bfloat16), np.errstate(all="ignore"):
    work()
    samples({names})
with torch.device("meta"), torch.inference_mode():
    work()
    samples({names})
"""
SPOILED = """
from specklegen.core import quadrature
nodes, _ = quadrature.gauss_legendre(5)
nodes.flags.writeable = True
nodes[0] = 7.0
quadrature.gauss_legendre(5)
"""
IMPURE = """
import specklegen.core.memory as memory
memory.memory_limit()
memory._slurm_limits = lambda: [1]
memory.memory_limit()
"""


def watched(program):
    """What the watch says of a program."""
    here = Path(__file__).parent
    paths = os.pathsep.join([str(here), str(here.parent)])
    code = program + "\nprint(memo_hunt.WATCH.report())\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=1200,
                          env=os.environ | {"PYTHONPATH": paths})  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def findings(lines):
    return [line for line in lines if line.startswith("FINDING")]


ALL = "[name for name in __import__('specklegen.datasets', fromlist=['x']).recipe_names()]"


@pytest.mark.slow
@pytest.mark.parametrize("names", ["['through-slab']", pytest.param(ALL, marks=pytest.mark.slow)],
                         ids=["one recipe", "all recipes"])  # fmt: skip
def test_what_is_kept_is_what_would_be_worked_out_again(names):
    lines = watched(PROGRAM + CONTEXTS.format(names=names))
    assert findings(lines) == []
    memos, _, hits, _, compared, *_ = lines[-1].split()
    assert int(memos) > 15
    assert int(hits) > 300
    assert int(compared) > 60


def test_changed_and_impure_memos_are_noticed():
    lines = watched(BEGIN + SPOILED + IMPURE)
    assert [line.split(":")[0] for line in findings(lines)] == [
        "FINDING specklegen.core.memory.memory_limit", "FINDING specklegen.core.quadrature.gauss_legendre",
    ]  # fmt: skip
    assert "changed" in findings(lines)[1]


def test_what_may_be_written_into_is_listed():
    table = {"a": (np.ones(2), [np.zeros((2, 3))]), "b": 1}
    assert [place for place, _ in memo_hunt.writable(table)] == ["['a'][0]", "['a'][1][0]"]


def test_views_of_a_grid_are_read_only():
    """They were kept and handed out: who wrote into them changed every render of an equal scene."""
    grid = sg.FarField.grid((3, 4), 1e-3)
    for kept in (grid.directions, grid.vectors):
        with pytest.raises(ValueError, match="read-only"):
            kept[...] = 0.0
