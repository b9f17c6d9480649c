"""What was measured of a slab: values that no measurement gives are refused, by name and by line of the file."""

import pytest
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.measured import BallisticFraction, ContrastVersusBandwidth, MemoryCurve, TemporalCurve, Transmittance

TILTS = [1e-4, 2e-4, 3e-4]


def test_values_are_arrays_of_one_shape():
    curve = MemoryCurve(TILTS, [0.9, 0.7, 0.4], 0.01)
    assert curve.at.tolist() == TILTS
    assert curve.values.tolist() == [0.9, 0.7, 0.4]
    assert curve.errors.tolist() == [0.01] * 3
    assert not curve.planned
    assert MemoryCurve(TILTS, None, 0.01).planned
    assert Transmittance(None, 0.01).planned
    assert curve.facts()["tilts"] == "3 values, 0.0001 to 0.0003"


@pytest.mark.parametrize(("make", "field", "rule"), [
    (lambda: MemoryCurve(TILTS, [0.9, 0.7, 0.4], 0.0), "MemoryCurve error, number 1,", "greater than 0"),
    (lambda: MemoryCurve(TILTS[::-1], [0.9, 0.7, 0.4], 0.1), "MemoryCurve tilts, number 2,", "above the value before"),
    (lambda: MemoryCurve([-1e-4, 0.0], [0.9, 0.7], 0.1), "MemoryCurve tilts, number 1,", "at least 0"),
    (lambda: MemoryCurve(TILTS, [1.2, 0.7, 0.4], 0.01), "MemoryCurve c_i, number 1,", "from 0 to 1"),
    (lambda: MemoryCurve(TILTS, [0.1, 0.05, 0.0], 0.01), "MemoryCurve c_i, number 1,", "at least 0.2"),
    (lambda: MemoryCurve([1.0, 2.0], [0.9, 0.7], 0.01), "MemoryCurve tilts, number 2,", "below pi/2 radians"),
    (lambda: MemoryCurve(TILTS, [0.9, 0.7], 0.01), "MemoryCurve c_i", "one number for each of 3 tilts"),
    (lambda: TemporalCurve([0.1, 0.2], [0.9, 0.5], 0.01), "TemporalCurve g2, number 1,", "from 1 to 2"),
    (lambda: TemporalCurve([0.1], [1.9], 0.01, beta=1.5), "TemporalCurve beta", "at most 1"),
    (lambda: ContrastVersusBandwidth([0.1], [1.3], 0.01), "ContrastVersusBandwidth contrast, number 1,", "0 to 1"),
    (lambda: ContrastVersusBandwidth([0.1], [0.3], 0.01, spectrum="lamp"), "ContrastVersusBandwidth", "flat"),
    (lambda: Transmittance(31.0, 1.0), "Transmittance value", "from 0 to 1"),
    (lambda: BallisticFraction("x", 0.1), "BallisticFraction value", "a number"),
])  # fmt: skip
def test_what_no_measurement_gives_is_refused(make, field, rule):
    with pytest.raises(RuleError) as error:
        make()
    assert field in str(error.value)
    assert rule in str(error.value)


@pytest.mark.parametrize(("text", "line", "rule"), [
    ("tilt,C_I,error\n1e-4,.9,.01\n2e-4,1.3,.01\n", 3, "from 0 to 1"),
    ("1e-4,.9,.01\n# a word\n2e-4,.7,0\n", 3, "standard error greater than 0"),
    ("1e-4,.9,.01\n1e-4,.7,.01\n", 2, "of increasing places"),
    ("1e-4,.9,.01\n\n2,.7,.01\n", 3, "below pi/2 radians"),
    ("0.5,.1,.01\n0.6,.05,.01\n", 1, "at least 0.2 at the first tilt"),
])  # fmt: skip
def test_files_are_refused_with_the_line(tmp_path, text, line, rule):
    (tmp_path / "tilts.csv").write_text(text)
    with pytest.raises(RuleError) as error:
        MemoryCurve.read(tmp_path / "tilts.csv")
    assert f"tilts.csv, line {line}," in str(error.value)
    assert rule in str(error.value)


def test_a_file_without_errors_is_given_one(tmp_path):
    (tmp_path / "tilts.csv").write_text("1e-4 .9\n2e-4 .7\n")
    assert_refused(lambda: MemoryCurve.read(tmp_path / "tilts.csv"), "of three columns")
    assert MemoryCurve.read(tmp_path / "tilts.csv", error=0.02).errors.tolist() == [0.02, 0.02]
    (tmp_path / "g2.csv").write_text("1e-4 1.4 .01\n2e-4 1.2 .01\n")
    assert TemporalCurve.read(tmp_path / "g2.csv", beta=0.5).beta == 0.5
