"""Files of integrating spheres, and their correction against light that is followed from wall to wall."""

import re

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z

from specklegen.core.errors import RuleError
from specklegen.measured import Sphere, SphereReadings, read_sphere

SMALL = Sphere(diameter=100.0, sample_port=40.0, third_port=30.0, detector_port=10.0, wall=0.95)
HEAD = ["1.33 # index", "1.507", "1.0", "1.0", "2.0", "0.99", "", "1 # spheres", *["100", "40", "30", "10", "0.95"] * 2]


def write(folder, *lines, head=HEAD, first="IAD1"):
    path = folder / "a.rxt"
    path.write_text("\n".join(["", first, "# Royston", *head, *lines]))
    return path


def detected(sphere, reflectance, open_port, number, rng):
    """Share of the light of a sample that ends on the detector, landing by landing."""
    a_s, a_e, a_d = np.square(np.array(sphere[1:4]) / sphere.diameter) / 4
    from_sample, alive, found = np.ones(number, bool), np.ones(number, bool), np.zeros(number, bool)
    while alive.any():
        place = rng.random(number)
        place = np.where(from_sample, a_d + place * (1 - a_d), place)  # the baffle
        on_detector, in_port = place < a_d, (place >= a_d) & (place < a_d + a_s)
        out = open_port & (place >= a_d + a_s) & (place < a_d + a_s + a_e)
        found |= alive & on_detector
        kept = rng.random(number) < np.where(in_port, reflectance, sphere.wall)
        alive &= ~on_detector & ~out & kept
        from_sample = in_port
    return found.mean()


@pytest.mark.parametrize(("reflectance", "open_port"), [(0.0, False), (0.7, True)])
def test_landings_are_those_of_light_that_is_followed(reflectance, open_port):
    number = 60_000
    found = detected(SMALL, reflectance, open_port, number, np.random.default_rng(3))
    a_d = (SMALL.detector_port / SMALL.diameter) ** 2 / 4
    expected = a_d * SMALL.wall * SMALL.landings(reflectance, open_port=open_port)
    error = np.sqrt(expected / number)
    assert_z(found, expected, error)
    assert abs(found - a_d * SMALL.wall * SMALL.landings(reflectance, open_port=not open_port)) > 5 * error
    assert abs(found - a_d * SMALL.wall * SMALL.landings(0.7 - reflectance, open_port=open_port)) > 5 * error


@pytest.mark.parametrize("open_port", [False, True])
def test_landings_obey_their_equations_at_a_large_detector(open_port):
    """W and S by the module's two equations, a detector's port that hides a tenth of the sphere from the sample."""
    wide = Sphere(diameter=100.0, sample_port=40.0, third_port=30.0, detector_port=63.0, wall=0.95)
    a_s, a_e, a_d = np.square(np.array(wide[1:4]) / wide.diameter) / 4
    a_w, b, r = 1 - a_s - a_d - open_port * a_e, 1 / (1 - a_d), 0.7
    equations = np.array([[1 - wide.wall * a_w, -r * a_w * b], [-wide.wall * a_s, 1 - r * a_s * b]])
    wall, _ = np.linalg.solve(equations, [a_w * b, a_s * b])
    assert wide.landings(r, open_port=open_port) == pytest.approx(wall, rel=1e-12)


def test_what_a_sphere_would_read_comes_back(tmp_path):
    share, through = np.array([0.05, 0.3, 0.8]), np.array([0.6, 0.5, 0.1])
    standard = SMALL.landings(0.99, open_port=True)
    raw = share * SMALL.landings(share, open_port=True) / standard
    behind = through * SMALL.landings(share, open_port=False) / SMALL.landings(0.0, open_port=False)
    rows = [" ".join(map(repr, map(float, row))) for row in np.stack([raw, behind], axis=1)]
    read = read_sphere(write(tmp_path, "r\tt", *rows))
    found = read.corrected()
    assert np.allclose(found.reflectance, share, rtol=1e-12)
    assert np.allclose(found.transmittance, through, rtol=1e-12)
    assert found.collimated is None
    assert np.abs(raw / share - 1).max() > 0.1  # it is no small thing
    assert "correction" in read.explain()
    twice = read_sphere(tmp_path / "a.rxt", dual_beam=True).corrected()
    assert np.array_equal(twice.reflectance, raw)


def test_columns_by_letters_by_number_and_without(tmp_path):
    named = read_sphere(write(tmp_path, "L r t n", "500, .3, .4, 1.41", "510, .3, .8, 1.41"))
    assert list(named.columns) == ["wavelength", "reflection", "transmission", "sample_index"]
    assert named.columns["wavelength"].tolist() == [500.0, 510.0]
    assert "sample 2 reflects and transmits 1.1" in named.doubts[0]
    counted = read_sphere(write(tmp_path, "3", ".3 .4 .1"))
    assert list(counted.columns) == ["reflection", "transmission", "collimated"]
    assert (counted.sample_index, counted.standard, counted.transmission_sphere) == (1.33, 0.99, SMALL)
    corrected_before = read_sphere(write(tmp_path, "1", ".3", ".4", head=[*HEAD[:7], "0"]))
    assert corrected_before.reflection_sphere is None
    assert corrected_before.corrected().reflectance.tolist() == [0.3, 0.4]
    assert repr(corrected_before) == "SphereReadings(reflection=float64[2])"
    assert corrected_before.plot().lines


def test_capitals_name_walls_and_standards_of_each_sample(tmp_path):
    """As one file a sample, whose head has its walls and its standard."""
    rows = [(0.3, 0.4, 0.93, 0.90, 0.97, 0.5), (0.2, 0.5, 0.94, 0.96, 0.8, 0.5)]
    lines = [" ".join(map(str, row)) for row in rows]
    together = read_sphere(write(tmp_path, "r t w W R T", *lines))
    assert list(together.columns)[2:] == ["wall", "transmission_wall", "standard", "transmission_standard"]
    for n, (r, t, wall, behind, standard, _) in enumerate(rows):
        sizes = ["100", "40", "30", "10"]
        head = [*HEAD[:5], str(standard), "1", *sizes, str(wall), *sizes, str(behind)]
        alone = read_sphere(write(tmp_path, "r t", f"{r} {t}", head=head)).corrected()
        for one, both in zip(alone[:2], together.corrected()[:2], strict=True):
            assert both[n] == pytest.approx(one[0], rel=1e-12)
    by_number = read_sphere(write(tmp_path, "7", *[f"{500 + n} {r} {t} .1 {rest}" for n, (r, t, rest) in enumerate(
        (r, t, " ".join(map(str, rest))) for r, t, *rest in rows)]))  # fmt: skip
    assert by_number.columns["wavelength"].tolist() == [500.0, 501.0]
    for share, expected in zip(by_number.corrected()[:2], together.corrected()[:2], strict=True):
        assert np.array_equal(share, expected)
    only = read_sphere(write(tmp_path, "r t w", *[" ".join(line.split()[:3]) for line in lines]))
    assert np.abs(only.corrected().reflectance / together.corrected().reflectance - 1).max() > 1e-3


def with_head(number, text):
    return [text if n == number else line for n, line in enumerate(HEAD)]


@pytest.mark.parametrize(("lines", "head", "told"), [
    (["r t", ".3 .4 .5"], HEAD, "line 23, must be 2 numbers"),
    (["r t", ".3 1.4"], HEAD, "line 23, transmission must be a share"),
    (["r q", ".3 .4"], HEAD, "line 22, must be names of columns among r, t"),
    (["t u", ".3 .4"], HEAD, "line 22, must be names of different columns, r among"),
    (["r t", ".3 nan"], HEAD, "line 23, must be a finite number"),
    (["r t", ".3 .4", "IAD1"], HEAD, "If a second measurement begins here, put it into its own file."),
    (["r t", ".3 .4", "r t", ".3 .4"], HEAD, "If a second measurement begins here, put it into its own file."),
    (["r"], HEAD, "readings must be at least one"),
    ([], HEAD, "followed by readings"),
    (["8", ".3 .4 .5 .6"], HEAD, "1 to 7 numbers"),
    (["R T", ".3 .4"], HEAD, "line 22, must be names of different columns, r among"),
    (["r", ".3"], HEAD[:12], "line 16, must be a number of the header"),
    (["r", ".3"], with_head(0, "13.3"), "line 4, sample index must be from 0.1 to 10"),
    (["r", ".3"], with_head(2, "0"), "line 6, thickness must be greater than 0"),
    (["r", ".3"], with_head(7, "1.5"), "line 11, spheres must be from 0 to 2"),
    (["r", ".3"], with_head(8, "20"), "line 12, diameter must be of a sphere larger than its ports"),
])  # fmt: skip
def test_refusals_name_the_line(lines, head, told, tmp_path):
    assert_refused(lambda: read_sphere(write(tmp_path, *lines, head=head)), re.escape(told))


def test_other_files_and_two_spheres(tmp_path):
    assert_refused(lambda: read_sphere(write(tmp_path, first="wavelength r t")), 'line 2, must be "IAD1"')
    assert_refused(lambda: read_sphere(tmp_path / "none.rxt"), "read_sphere path must be an existing file")
    two = read_sphere(write(tmp_path, "r", ".3", head=with_head(7, "2")))
    assert isinstance(two, SphereReadings)
    assert_refused(lambda: two.corrected(), r"SphereReadings.spheres must be 0 or 1")


def test_damaged_files_are_refused_or_read(tmp_path):
    path = write(tmp_path, "r t", ".3 .4", ".2 .5")
    whole = path.read_bytes()
    refused = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), 6):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read_sphere(path).explain()
        except RuleError:
            refused += 1
    assert refused >= 10
