"""Ten names and the submodules are listed; the rest is by subject, and in its old place for one version."""

import subprocess
import sys
import warnings
from inspect import ismodule

import pytest

import specklegen as sg

TEN = ["GroundGlass", "Layers", "Scene", "Slab", "load_recipe", "materials", "memory_effect", "plan", "reconstruct",
       "render"]  # fmt: skip
BEFORE = "Box Mie CollimatedBeams FarField Budget SpeckleStack fit_camera covariance transmission_matrix".split()


def test_ten_names_and_submodules_are_listed():
    modules = {name for name in dir(sg) if ismodule(getattr(sg, name))}
    assert sorted(set(dir(sg)) - modules | {"materials"}) == TEN
    assert modules >= {"media", "light", "sensors", "results", "fit", "statistics", "datasets", "models"}


def test_a_name_has_one_subject():
    names = [name for subject in sg.SUBJECTS if subject != "coherence" for name in getattr(sg, subject).__all__]
    assert len(names) == len(set(names)) > 60
    assert not set(names) & set(TEN)


@pytest.mark.parametrize("name", BEFORE)
def test_an_old_place_names_the_new_one(name):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _ in range(2):  # the second time too
            found = getattr(sg, name)
    assert len(said) == 2
    assert said[0].filename == __file__
    place = str(said[0].message).removeprefix(f"specklegen.{name} is now specklegen.").removesuffix(f".{name}")
    assert getattr(getattr(sg, place), name) is found


def test_names_load_when_they_are_used():
    code = "import sys, specklegen, specklegen.media; print([m for m in ('numpy', 'torch') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
