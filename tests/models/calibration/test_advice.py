"""Expected errors: those of an independent program, and which instrument to add."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.measured import MemoryCurve, TemporalCurve


def slab(depth, g, **fields):
    return sg.Slab(thickness=1.0, mean_free_path=1 / depth, scatterer=sg.HenyeyGreenstein(g=g), **fields)


@pytest.mark.parametrize(("depth", "g", "expected"), [
    (10.0, 0.9, {"thickness": 0.133, "optical_depth": 0.084, "g": 0.055, "transport_depth": 0.052}),
    (30.0, 0.8, {"optical_depth": 3.16, "g": 3.26}), (20.0, 0.0, {"optical_depth": 2.26}),
])  # fmt: skip
def test_errors_are_those_of_an_independent_program(depth, g, expected):
    found = sg.advise(slab(depth, g), wavelength=1e-3).rows[0]
    for name, error in expected.items():
        assert found.errors[name] == pytest.approx(error, rel=0.03)


def test_errors_fall_with_every_instrument_and_thick_slabs_are_vague():
    advice = sg.advise(slab(20.0, 0.0), wavelength=1e-3)
    worst = [row.worst for row in advice.rows]
    assert worst == sorted(worst, reverse=True)
    assert "1 - g (ln ± 1.5" in advice.rows[0].degenerate[0]
    assert advice.additions == ()
    assert advice.plot().get_xlabel()
    assert "not determined" in advice._facts()


def test_the_most_useful_instrument_is_told_first():
    tilts = np.linspace(1e-5, 3e-4, 25)
    given = MemoryCurve(tilts, None, 0.01)
    advice = sg.advise(slab(20.0, 0.8), wavelength=1e-3, instruments=[given])
    assert [row.worst for row in advice.additions] == sorted(row.worst for row in advice.additions)
    assert len(advice.rows) == 1
    added = {type(row.instruments[1]).__name__ for row in advice.additions}
    assert added == {"Transmittance", "ContrastVersusBandwidth"}


def test_of_a_known_thickness_nothing_is_asked():
    some = sg.advise(slab(10.0, 0.9), wavelength=1e-3, free=("mean_free_path", "g")).rows[0].errors
    every = sg.advise(slab(10.0, 0.9), wavelength=1e-3).rows[0].errors
    assert "thickness" not in some
    assert some["optical_depth"] < every["optical_depth"]


@pytest.mark.parametrize(("medium", "changes", "rule"), [
    (slab(10.0, 0.9, faces=sg.Faces(inside=1.33)), {}, "matched faces"),
    (slab(10.0, 0.9).replace(scatterer=sg.VonMisesFisher(concentration=9.0)), {}, "Henyey-Greenstein"),
    (slab(100.0, 0.9), {}, "within the lookup table"), (slab(10.0, 0.9), {"wavelength": -1.0}, "above 0"),
    (slab(10.0, 0.9), {"free": ("depth",)}, "made of"),
    (slab(10.0, 0.9), {"instruments": [TemporalCurve([0.1], None, 0.1)]}, "of moving particles"),
])  # fmt: skip
def test_bad_input_is_refused(medium, changes, rule):
    with pytest.raises(RuleError) as error:
        sg.advise(medium, **{"wavelength": 1e-3} | changes)
    assert str(error.value).startswith("advise")
    assert rule in str(error.value)
