"""Odd values for every argument of every public name: an answer, or an error of the library's own.

A part of the table (:mod:`odd_arguments`) each time, all of it under ``slow``: 50 000 calls, a quarter of an hour.
"""

from fractions import Fraction
from inspect import ismodule

import numpy as np
import odd_arguments
import pytest
import torch
from refusals import assert_refused

import specklegen as sg

SLOW = ("twin", "render", "covariance", "memory", "finite_path", "trace", "coverage", "coherent_rays", "field_on_plane",
        "Recipe", "Stream", "recoverable", "likelihood", "materials", "stack_like", "mean_field", "joint",
        "transmission", "reflectance", "wedge", "aperture", "retrieve", "monte_carlo", "Optics", "evaluate", "sample_",
        "expose", "temporal", "film", "to_zarr", "generate", "fit_camera", "read_measurement")  # fmt: skip
"""Calls that take more than a moment, or compile kernels."""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """What odd paths make is left there."""
    monkeypatch.chdir(tmp_path)


def raw_errors(chosen, share):
    """Errors that are not the library's own, over calls of the table; of the odd values a share, others each time."""
    found, tried, turn = [], 0, 0
    for call in chosen:
        for argument in call.arguments:
            turn += 1
            for name, value in odd_arguments.odd_values()[turn % share :: share]:
                tried += 1
                error = odd_arguments.raw_error(call, argument, value)
                found += [f"{call.name}({argument}={name}): {error}"] if error else []
    return found, tried


def quick(call):
    return not any(word in call.name for word in SLOW)


@pytest.mark.filterwarnings("ignore")
def test_odd_values_are_answered_or_refused_in_the_houses_words():
    found, tried = raw_errors(filter(quick, odd_arguments.calls()), 17)
    assert tried > 700
    assert found == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_all_odd_values_of_all_calls():
    found, tried = raw_errors(odd_arguments.calls(), 1)
    assert tried > 30_000
    assert found == []


def test_the_table_has_what_is_public_and_its_calls_are_valid():
    """Otherwise the odd values were tried on something that is refused anyway."""
    names = " ".join(call.name for call in odd_arguments.calls())
    missing = {"CameraFit", "DoubtWarning", "Flow", "Motion", "RuleError", "Scatterer", "Sensor", "Stratified",
               "TemporalCorrelation", "materials", "reconstruct"}  # fmt: skip
    subjects = (getattr(sg, subject).__all__ for subject in sg.SUBJECTS if subject != "coherence")
    public = {name for name in sg.__all__ if not ismodule(getattr(sg, name))}
    for name in sorted(public.union(*subjects) - missing):
        result = name in ("Advice", "Covariance", "ExposureContrast", "JointCorrelation",
                              "MaterialFit", "MemoryEffect", "Plan", "SetupFit", "Twin",
                          "ReflectanceTransmittance", "Replacement", "SpeckleStack")  # fmt: skip
        assert result or name in names
    for call in odd_arguments.calls():
        if quick(call) and "(refused)" not in call.name:
            call()


def test_a_raw_error_is_noticed():
    """The test of the test: a function that indexes what it is given."""
    call = odd_arguments.Call("first", lambda several: several[0], {"several": [1]})
    assert "TypeError" in (odd_arguments.raw_error(call, "several", None) or "")
    assert odd_arguments.raw_error(call, "several", [2]) is None


@pytest.mark.parametrize(("call", "says"), [
    (lambda: sg.plan(odd_arguments.SCENE, mean=np.ones(2)), "mean must be True or False"),
    (lambda: sg.plan(odd_arguments.SCENE, sampler=["paths"]), "sampler must be the name of a sampler"),
    (lambda: sg.plan(odd_arguments.SCENE, threads=2**63), "threads must be at least 1 and at most 4096"),
    (lambda: sg.render(odd_arguments.SCENE, seconds=np.inf), "Budget.seconds must be between 0 and"),
    (lambda: sg.render(odd_arguments.SCENE, rel_error=1e-300), "Budget.rel_error must be between 1e-09 and 1"),
    (lambda: sg.PlaneWaves(directions=np.eye(3) * (1 + 0.5j)), "directions must be an array of real numbers"),
    (lambda: sg.FarField.angles(np.array([1j])), "FarField.angles must be an array of real numbers"),
    (lambda: sg.memory_effect(odd_arguments.SLAB, wavelength=np.complex64(1), tilts=[0.0]),
     "wavelength must be a number"),
    (lambda: sg.memory_effect(odd_arguments.STACK, wavelength=0.5, tilts=[0.0], view=[0.0, 0.0]), "view must be"),
    (lambda: sg.memory_effect(odd_arguments.STACK, wavelength=1e-300, tilts=[0.0]), "wavelength must be"),
    (lambda: sg.covariance(odd_arguments.SCENE, orders=np.ones(4)), "covariance orders must be"),
    (lambda: sg.render_tiles(odd_arguments.SCENE, sampler=np.ones(4)), "sampler must be"),
    (lambda: odd_arguments.coherence.sample_fields(torch.ones(3), 3, seed=0), "W0 must be"),
    (lambda: odd_arguments.coherence.sample_fields(odd_arguments.W0, 3, seed=np.asmatrix([1, 2])),
     "sample_fields seed must be a whole number"),
])  # fmt: skip
def test_what_was_silently_wrong_or_ended_the_process_is_refused(call, says):
    """Imaginary parts were thrown away, any text was True, a matrix as a seed ended Python with a fault of memory."""
    assert_refused(call, says)


def test_numbers_of_other_types_are_taken_as_they_are():
    """A fraction had no format, and a whole number of 8 bits overflowed in the planner's bytes."""
    stack = sg.render(odd_arguments.SCENE, paths=100, realizations=np.uint8(2))
    assert len(stack.field) == 2
    curve = sg.memory_effect(odd_arguments.SLAB, wavelength=0.5, tilts=[0.0], paths=100, tolerance=Fraction(1, 3))
    assert curve.intensity == pytest.approx(1.0)
