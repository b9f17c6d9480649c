"""Curves from text, in the dialects that programs write, and errors that name the line."""

import csv

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.measured import read_curve

TABLE = np.array([[0.0, 1.0, 0.01], [0.25, 0.7071, 0.02], [1e3, -3e-4, 0.02]])


def write(path, **dialect):
    with path.open("w", newline="") as file:
        writer = csv.writer(file, **dialect)
        writer.writerow(["lag (us)", "g2 - 1", "error"])
        writer.writerows(TABLE.tolist())


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("quoting", [csv.QUOTE_MINIMAL, csv.QUOTE_NONNUMERIC])
def test_what_csv_writes(delimiter, quoting, tmp_path):
    write(tmp_path / "a.csv", delimiter=delimiter, quoting=quoting)
    found = read_curve(tmp_path / "a.csv")
    assert np.array_equal(np.stack([found.at, found.values, found.errors], axis=1), TABLE)
    assert found.names == ("lag (us)", "g2 - 1", "error")
    assert found.facts()["columns"] == "lag (us); g2 - 1; error"


def test_what_numpy_writes(tmp_path):
    np.savetxt(tmp_path / "a.txt", TABLE, header="measured on Tuesday, by hand")
    found = read_curve(tmp_path / "a.txt")
    assert np.array_equal(found.errors, TABLE[:, 2])
    assert found.names == ()
    two = read_curve(tmp_path / "a.txt", columns=(0, 2))
    assert np.array_equal(two.values, TABLE[:, 2])
    assert two.errors is None


@pytest.mark.parametrize(("lines", "told"), [
    ("tilt,C\n0,1\n1,abc\n", r"line 3, must be of finite numbers; got 'abc'"),
    ("0,1\n1,nan\n", "line 2, must be of finite numbers"),
    ("# head\n\n0;1\n1;0,5\n", "line 4, .* Write a decimal point"),
    ("0,1\n2,.5\n1,.4\n", r"line 3, must be of increasing places: the line before has 2; got 1\.0\. Sort"),
    ("0,1\n0,.5\n", "line 2, .*average repeated"),
    ("0,1,.1\n1,.5,0\n", "line 2, must be of a standard error greater than 0"),
    ("0,1,.1\n1,.5\n", "line 2, must be of at least 3 columns"), ("0\n1\n", "line 1, must be of at least 2 columns"),
    ("tilt,C\n0,1\n", "at least two lines"), ("", "at least two lines"),
    ("lag,a,b,c\n0,2,2,2\n", r"line 2, must be of two or three columns, .*columns=\(0, 2\)"),
    ("lag,a\n0,2\n1,1\n\nlag,b\n0,2\n", "line 5, .*second measurement begins here, put it into its own file"),
    ("0,2\n1,1\n\n0,2\n", "line 4, .*second measurement begins here, put it into its own file"),
    ("a,b\nc,d\n", "line 2, must be of finite numbers"),
])  # fmt: skip
def test_the_line_is_named(lines, told, tmp_path):
    (tmp_path / "a.csv").write_text(lines)
    assert_refused(lambda: read_curve(tmp_path / "a.csv"), told)


def test_files_that_are_no_text(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe0,1\n")
    for path in (tmp_path / "a.csv", tmp_path, "a\0b", 7):
        with pytest.raises(RuleError, match="read_curve path must be a text file that can be read"):
            read_curve(path)
    assert_refused(lambda: read_curve(tmp_path / "none.csv"), "read_curve path must be an existing file")
    for columns in (0, (0,), (0, -1), ("a", "b"), (0, 1.5)):
        with pytest.raises(RuleError, match="read_curve columns"):
            read_curve(tmp_path / "a.csv", columns)
    monkeypatch.setattr("specklegen.measured.curve.MOST_BYTES", 4)
    (tmp_path / "long.csv").write_text("0,1\n1,2\n")
    assert_refused(lambda: read_curve(tmp_path / "long.csv"), "longer than 4 bytes")


def test_damaged_curves(tmp_path):
    write(tmp_path / "a.csv")
    whole = (tmp_path / "a.csv").read_bytes()
    refused = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), rng.integers(1, 6)):
            damaged[at] = rng.integers(256)
        (tmp_path / "a.csv").write_bytes(damaged)
        try:
            found = read_curve(tmp_path / "a.csv")
            assert np.isfinite(found.values).all()
            assert (np.diff(found.at) > 0).all()
        except RuleError:
            refused += 1
    assert 0 < refused < 100
