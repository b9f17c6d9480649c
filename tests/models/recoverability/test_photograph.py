"""Verdicts on photographs of benches that are not described: what is measured, what is refused, what is told."""

import json

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.instrument import Camera
from specklegen.measured import read_measurement
from specklegen.models import judge_photograph
from specklegen.models.recoverability import photograph
from specklegen.models.recoverability.autocorrelation_error import REACH
from specklegen.models.recoverability.band import fit_band
from specklegen.models.retrieval.autocorrelation import taper

SIDE = 144


def speckle(seed, grain=3.0, points=5, profile="square", side=SIDE, frames=1):
    """Light float64[n, side, side] of mean 1 of points behind a thin medium, by transforms of a random iris."""
    rng = np.random.default_rng(seed)
    f = np.fft.fftfreq(2 * side)
    away = np.maximum(abs(f[:, None]), abs(f)) if profile == "square" else np.hypot(f[:, None], f)
    object = np.zeros((2 * side, 2 * side))
    places = rng.integers(0, int(8 * grain), (points, 2))
    object[tuple(places.T)] += 1
    found = []
    for _ in range(frames):
        waves = rng.normal(size=(2, *object.shape))
        light = np.abs(np.fft.ifft2((away < 0.5 / grain) * (waves[0] + 1j * waves[1]))) ** 2
        found.append(np.fft.ifft2(np.fft.fft2(light) * np.fft.fft2(object)).real[:side, :side].clip(0))
    made = np.array(found)
    return made / made.mean((1, 2), keepdims=True)


@pytest.mark.parametrize(("grain", "profile"), [(2.6, "square"), (4.0, "disc")])
def test_what_a_photograph_holds(grain, profile):
    light = speckle(1, grain, profile=profile)
    counts = np.random.default_rng(2).poisson(100 * light[0])
    found = judge_photograph(counts)
    assert np.abs(np.log(np.array(found.grain) / grain)).max() < 0.05
    assert abs(found.contrast - light.std()) < 0.03
    assert found.electrons == pytest.approx(100, rel=0.15)
    assert found.answer == "works"
    assert found.interval[0] < found.probability < found.interval[1]
    assert found.grains == pytest.approx(SIDE / grain, rel=0.06)
    assert found.photons is None
    assert "assumed: that it is speckle" in found.explain()
    told = judge_photograph(counts // 2 + 10, dark=10.0, camera=Camera(photons=1.0, gain=2.0))
    assert told.photons == pytest.approx(counts.mean(), rel=0.02)


@pytest.mark.slow
def test_a_measurement_without_envelope_is_said_to_be_taken_for_even():
    line = np.linspace(-1.5, 1.5, SIDE)
    light = speckle(1)[0] * np.exp(-np.add.outer(line**2, line**2))
    plain, fitted = (judge_photograph(read_measurement(light, envelope=how)) for how in (None, "fit"))
    assert plain.answer == "no speckle"
    assert "assumed: even light" in plain.explain()
    assert fitted.answer == "works"
    assert "even light" not in fitted.explain() + judge_photograph(light).explain()


def test_grains_are_those_of_all_the_camera(monkeypatch):
    """Of a large one the middle alone is looked at."""
    counts = np.random.default_rng(2).poisson(100 * speckle(1)[0])
    whole = judge_photograph(counts)
    monkeypatch.setattr(photograph, "_SEEN", 112)
    middle = judge_photograph(counts)
    assert middle.contrast != whole.contrast
    assert middle.grains == pytest.approx(SIDE / 3.0, rel=0.06)


def test_fewer_grains_and_photons_are_worse():
    light = speckle(3)
    rng = np.random.default_rng(4)
    good, dim = (judge_photograph(rng.poisson(n * light[0])) for n in (200, 2))
    small = judge_photograph(rng.poisson(200 * light[0, :48, :48]))
    assert good.probability > dim.probability
    assert good.probability > small.probability
    assert good.frames_needed is not None
    assert small.frames_needed is None or small.frames_needed >= good.frames_needed
    several = judge_photograph(rng.poisson(200 * speckle(3, frames=4, side=48)))
    assert several.probability > small.probability
    for each in (dim, small):
        assert each.answer == "works" or each.reasons


def test_frames_of_one_pattern_tell_noise_and_vibration():
    wide = speckle(5, 4.0, side=SIDE + 8)[0]
    rng = np.random.default_rng(6)
    still = judge_photograph(rng.poisson(50 * wide[None, 4:-4, 4:-4].repeat(4, 0)))
    assert still.vibration < 0.1
    assert still.electrons == pytest.approx(4 * 50, rel=0.15)  # of the mean of four
    moved = [wide[4 + d : 4 + d + SIDE, 4 : 4 + SIDE] for d in (0, 2, 0, 2)]
    shaken = judge_photograph(rng.poisson(50 * np.array(moved)))
    assert shaken.vibration == pytest.approx(1.0, abs=0.1)


def scenes():
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:112, :120]
    yield "a blank wall", rng.poisson(500 + 50 * x / 120.0)
    yield "a chequerboard", 100 + 400 * ((x // 11 + y // 11) % 2) + rng.normal(0, 3, x.shape)
    yield "noise", rng.normal(1000, 100, x.shape)
    face = np.full(x.shape, 60.0)
    for _ in range(40):
        r, at = rng.uniform(4, 35), rng.uniform(0, 112, 2)
        face = np.where(((x - at[0]) / r) ** 2 + ((y - at[1]) / (0.8 * r)) ** 2 < 1, rng.uniform(20, 230), face)
    yield "a picture", gaussian_filter(face, 1.0) + rng.normal(0, 2, x.shape)


@pytest.mark.parametrize(("name", "image"), [*scenes()], ids=[name for name, _ in scenes()])
def test_what_is_no_speckle_is_refused(name, image):
    found = judge_photograph(np.rint(np.clip(image, 0, None)))
    assert found.answer == "no speckle", name
    assert found.probability == 0
    assert found.reasons
    assert found.headline.startswith("no speckle: ")
    assert "that it is speckle" not in found.explain()


def test_few_patches_of_bright_light_are_not_called_noise():
    """A large smooth object on a small camera: refused, since a picture may look like it, and not for want of light."""
    rng = np.random.default_rng(13)
    few = judge_photograph(rng.poisson(2000 * speckle(13, 4.0, points=900, side=96)[0]))
    assert few.answer == "no speckle"
    assert few.reasons[0].name == "too few patches"
    assert judge_photograph(rng.poisson(500, (96, 96))).reasons[0].name == "nothing but noise"


@pytest.mark.parametrize("image", [np.zeros((64, 64)), np.full((64, 64), 7), np.full((64, 64), np.nan), np.ones((3, 3)),
                                   np.zeros((0, 5)), np.ones((64, 64, 3), complex), "nothing.tif"])  # fmt: skip
def test_odd_images_are_told_and_not_fallen_over(image):
    try:
        found = judge_photograph(image)
    except RuleError:  # whose words name the field and the rule
        return
    assert found.answer == "no speckle"


def test_a_wrong_grain_would_be_seen():
    light = speckle(8, 3.0)
    right, wrong = fit_band(light).grain[0], fit_band(speckle(8, 3.3)).grain[0]
    assert wrong / right == pytest.approx(1.1, rel=0.03)


def test_the_command_tells_photographs_from_recipes(tmp_path):
    counts = np.random.default_rng(9).poisson(100 * speckle(9)[0]).astype(np.uint16)
    tifffile.imwrite(tmp_path / "photo.tif", counts)
    (tmp_path / "camera.toml").write_text("[exposure]\ngain = 2.0\nbit_depth = 12\n")
    run = CliRunner().invoke
    told = run(app, ["check", "recoverable", str(tmp_path / "photo.tif"), "--camera", str(tmp_path / "camera.toml")])
    assert told.exit_code == 0, told.output
    assert told.output.startswith("works: success probability")
    assert "photons" in told.output
    answer = run(app, ["check", "recoverable", str(tmp_path), "--json"])
    assert json.loads(answer.output)["answer"] == "works"
    for words, said in ((["through-slab", "--dark", "3"], "--dark must be left out"),
                        ([str(tmp_path / "photo.tif"), "--beam", "0.5"], "--beam must be left out")):  # fmt: skip
        refused = run(app, ["check", "recoverable", *words])
        assert isinstance(refused.exception, RuleError)
        assert said in str(refused.exception)


def test_full_pixels_bend_the_modulus_by_what_they_do():
    """Directly, of thirty frames, cut or not; of the intensities, in place of their modulus, it is far more."""
    light = speckle(11, frames=30)
    cut = np.minimum(light, np.quantile(light, 0.8))
    whole, bent = (photograph._lags(each / each.mean(), 0.0) for each in (light, cut))
    reach, extent = 40, 8 * 3.0
    at = np.r_[:reach, -reach:0]
    kept = taper(2 * reach, 0.85 * REACH * extent, 1.2 * REACH * extent).numpy()
    one, other = (np.fft.fft2(each[np.ix_(at, at)] * kept).real.clip(0).ravel()[1:] for each in (whole, bent))
    direct = np.sqrt(1 - np.square(np.sqrt(one * other).sum()) / one.sum() / other.sum())
    found = photograph._bent(bent, float(bent[0, 0]), extent, 0.2)
    assert found == pytest.approx(direct, rel=0.25)
    assert photograph._bent(bent, float(bent[0, 0]), extent, 0.1) < 0.75 * direct
    assert np.sqrt(1 - np.corrcoef(light.ravel(), cut.ravel())[0, 1] ** 2) > 2 * direct
    assert photograph._bent(bent, float(bent[0, 0]), extent, 0.0) == 0
