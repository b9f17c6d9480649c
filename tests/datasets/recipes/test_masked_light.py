"""Masked light in front of a slab: the mask's waves, the fields of path sums, fringes in the speckle, refusals."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_mean, refute_mean

from specklegen.coherence.transmission import transmission_matrix
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.masked_light import slit_loops
from specklegen.datasets.split import Purpose, substream

SMALL = {"material": {"kernel_paths": 2000}, "camera": {"shape": [48, 48]}}
DOUBLE = {"mask": {"count": 2, "width": 0.1, "gap": 0.2, "length": 0.5, "turn": 0.3}}


def recipe(**changes):
    return load_recipe("masked-light-slab", {**SMALL, **changes})


def light_on_window(waves, count):
    """Field complex[n, n] of the series on the window's pixels, rows y, and their positions in its sides."""
    x = (np.arange(count) + 0.5) / count - 0.5
    order = np.arange(len(waves)) - (len(waves) - 1) // 2
    wave = np.exp(2j * np.pi * np.outer(x, order))
    return wave @ waves @ wave.T, x


def test_waves_are_those_of_the_mask():
    """The series makes the mask's picture again, as finely as its beams go; and the picture is the mask's area."""
    made = recipe(beams=61, **DOUBLE)
    sample = made.sample(0, "train", 0)
    numbers = {name: sample["parameters"][f"slit_{name}"] for name in ("count", "width", "gap", "length", "turn")}
    loops = slit_loops({f"slit_{name}": value for name, value in numbers.items()})
    waves = made.amplitudes(loops)
    assert waves[30, 30] == pytest.approx(0.1)  # the open share
    assert sample["mask"].mean() == pytest.approx(0.1, abs=1e-6)
    field, x = light_on_window(waves, 64)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    coordinates = np.stack(np.meshgrid(x, x), axis=-1) @ turn
    across, along = np.abs(np.abs(coordinates[..., 0]) - 0.15), np.abs(coordinates[..., 1])
    inside, outside = (across < 0.02) & (along < 0.2), (across > 0.1) | (along > 0.3)
    assert np.abs(field[inside] - 1).max() < 0.2  # ringing of a series that ends
    assert np.abs(field[outside]).max() < 0.1
    assert (sample["mask"][inside] == 1).all()
    assert sample["mask"][outside].max() < 1e-12  # rounding of areas
    assert sample["parameters"]["carried_share"] == pytest.approx(np.square(np.abs(waves)).sum() / 0.1)
    assert 0.95 < sample["parameters"]["carried_share"] < 1


def test_distance_is_a_phase_of_each_wave():
    """One metre: the wave of sines (m, n) lambda / W lags behind the axis by k z s^2 / 2; powers stay."""
    loops = slit_loops({"slit_count": 1.0, "slit_width": 0.2, "slit_gap": 0.1, "slit_length": 0.3, "slit_turn": 0.0})
    near, far = (recipe(distance=z, **DOUBLE).amplitudes(loops) for z in (0.0, 1e8))
    sine = 1e-5
    turned = near[7, 8] * np.exp(-1j * 2 * np.pi / 0.5 * 1e8 * sine**2 / 2)
    assert far[7, 8] == pytest.approx(turned, rel=1e-6)
    assert np.abs(far) == pytest.approx(np.abs(near))


def test_a_gaussian_laser_on_the_mask():
    """The series makes the beam's amplitude again where the mask is open; its power is that which passes."""
    waist = 10_000.0  # a fifth of the window
    made = recipe(beams=41, waist=waist, **DOUBLE)
    sample = made.sample(0, "train", 0)
    loops = slit_loops({f"slit_{name}": value for name, value in DOUBLE["mask"].items()})
    amplitudes = made.amplitudes(loops)
    field, x = light_on_window(amplitudes, 64)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    coordinates = np.stack(np.meshgrid(x, x), axis=-1) @ turn
    inside = (np.abs(np.abs(coordinates[..., 0]) - 0.15) < 0.02) & (np.abs(coordinates[..., 1]) < 0.2)
    beam = np.exp(-np.square(coordinates).sum(axis=-1) * (5e4 / waist) ** 2)
    assert np.abs(field - beam)[inside].max() < 0.2 * beam[inside].max()
    assert np.abs(field - 1)[inside].max() > 0.4  # even light is caught
    fine = (np.arange(2000) + 0.5) / 2000 - 0.5
    across, along = 0.15 + 0.1 * fine, 0.5 * fine
    power = 0.2 * np.exp(-2 * (across**2) * 25).mean() * 0.5 * np.exp(-2 * (along**2) * 25).mean()
    carried = np.square(np.abs(amplitudes)).sum() / power
    assert sample["parameters"]["carried_share"] == pytest.approx(carried, rel=5e-3)
    wide = recipe(beams=15, waist=1e9, **DOUBLE).amplitudes(loops)
    assert wide == pytest.approx(recipe(beams=15, **DOUBLE).amplitudes(loops), abs=1e-6)
    for narrow in (0.0, 700.0):
        assert_refused(lambda waist=narrow: recipe(beams=61, waist=waist, **DOUBLE), "MaskedLight.waist")


def test_path_sums_are_the_transmission_matrix():
    """A narrow window, which the planner gives to path sums: |T a|^2 of the same beams, paths and seed."""
    made = recipe(**DOUBLE, beams=3, window={"width": 4000.0}, camera={"shape": [12, 12]})
    ready = made.prepare(0, "train", 0)
    waves = made.amplitudes(slit_loops(made.mask.drawn(np.random.default_rng(0))))
    mean = ready.imaging.unit * np.square(np.abs(waves)).sum()
    image = ready.superposed(waves, made.step) * mean
    scene = made.view(made.material_of(0, "train", 0).slab).full
    (seed,) = ready.seen.seeds
    assert seed == substream(0, "train", Purpose.MEDIUM, 0)
    sines = scene.beams.directions[:, :2] * 4000.0 / 0.5
    order = np.rint(sines).astype(int) + 1
    matrix = transmission_matrix(scene, waves[order[:, 1], order[:, 0]][:, None], paths=2000, seed=seed, threads=1)
    expected = np.abs(matrix.value[:, 0].reshape(12, 12)) ** 2
    assert image == pytest.approx(expected, rel=1e-5, abs=1e-5 * expected.max())
    assert image.mean() == pytest.approx(mean, rel=0.6)  # 16 grains


def autocovariance(images):
    """Mean over positions of (I - 1)(I' - 1) at lags in pixels, float64[n, 9, 9] of images [n, H, W]."""
    away, side = images - 1.0, images.shape[1]
    return np.array([[
        (away[:, 4 : side - 4, 4 : side - 4] * away[:, 4 + r : side - 4 + r, 4 + c : side - 4 + c]).mean(axis=(1, 2))
        for c in range(-4, 5)] for r in range(-4, 5)]).transpose(2, 0, 1)  # fmt: skip


def test_speckle_has_the_fringes_of_the_slits():
    """Covariance |int |u|^2 e^{-ik dv x} dx / int |u|^2|^2 of a Gaussian field, u the light that the beams carry.
    Behind a slab of so wide a range every mode carries all of it, nearly: 2 % of slack for what it does not. Slits
    further apart have other fringes, and fail."""
    made = recipe(**DOUBLE)
    images = np.array([made.sample(0, "train", n)["image"] for n in range(96)], float)
    found = autocovariance(images)[:, 4, 1:]
    lag = np.arange(-3, 5) / 3  # in grains, wavelength / width
    expected = []
    for gap in (0.2, 0.35):
        mask = {**DOUBLE["mask"], "gap": gap}
        loops = slit_loops({f"slit_{name}": value for name, value in mask.items()})
        field, x = light_on_window(made.amplitudes(loops), 256)
        power = np.square(np.abs(field))
        wave = np.exp(-2j * np.pi * np.outer(lag, x))
        expected.append(np.abs(wave @ power.sum(axis=0) / power.sum()) ** 2)
    assert_mean(found, expected[0], slack=0.02)
    refute_mean(found, expected[1], slack=0.02)


def test_waves_of_a_star():
    """Inside the star the series is 1, outside 0; its picture has its area; the wave along the axis is that area."""
    numbers = {"points": 5, "radius": 0.4, "inner": 0.5, "turn": 0.3}
    made = load_recipe("star-behind-slab", {**SMALL, "beams": 61, "mask": numbers})
    sample = made.sample(0, "train", 0)
    area = 5 * 0.4**2 * 0.5 * np.sin(np.pi / 5)
    assert sample["parameters"]["open_share"] == pytest.approx(area)
    assert sample["mask"].mean() == pytest.approx(area, abs=1e-6)
    waves = made.amplitudes(made.mask.loops({f"star_{name}": value for name, value in numbers.items()}))
    assert waves[30, 30] == pytest.approx(area)
    field, x = light_on_window(waves, 64)
    radius, angle = np.hypot(*np.meshgrid(x, x)), np.arctan2(*np.meshgrid(x, x)[::-1]) - 0.3
    assert np.abs(field[radius < 0.15] - 1).max() < 0.2
    between = np.abs(np.mod(angle, 2 * np.pi / 5) - np.pi / 5) < 0.1
    assert np.abs(field[between & (radius > 0.27) & (radius < 0.45)]).max() < 0.2
    assert np.abs(field[~between & (radius > 0.25) & (np.abs(np.mod(angle + 0.05, 2 * np.pi / 5)) < 0.1)
                        & (radius < 0.33)]).min() > 0.7  # fmt: skip


@pytest.mark.parametrize(("change", "message"), [({"points": 2}, "at least 3"), ({"points": 4.5}, "whole number"),
                                                 ({"radius": 0.6}, "below 0.5"), ({"inner": 1.2}, "below 1"),
                                                 ({"inner": 0.0}, "greater than 0")])  # fmt: skip
def test_stars_refused(change, message):
    assert_refused(lambda: load_recipe("star-behind-slab", {"mask": change}), message)


@pytest.mark.parametrize(("changes", "message"), [
    ({"beams": 4}, "odd"), ({"window": {"profile": "disc"}}, "Fourier series"),
    ({"light": {"bandwidth": 0.001}}, "one wavelength"), ({"mask": {"count": 3, "width": 0.3}}, "diagonal below 1"),
    ({"mask": {"count": 1.5}}, "whole number"), ({"mask": {"count": {"uniform": [1, 3]}}}, "whole number"),
    ({"mask": {"gap": 0.0}}, "greater than 0"),
    ({"window": {"width": 4.0}, "camera": {"shape": [4, 4]}}, "their sines are below 1"),
])  # fmt: skip
def test_refused(changes, message):
    assert_refused(lambda: recipe(**changes).sample(0, "train", 0), message)


def test_exit_aperture_sets_the_grain():
    """Covariance |sum of A |u|^2 e^{-ik dv x}|^2 over its own at 0, u the light that the beams carry, A a round
    aperture on the exit face. A wider one, and none, are caught."""
    radius = 12_000.0
    numbers = {"count": 1, "width": 0.7, "gap": 0.1, "length": 0.7, "turn": 0.0}
    made = recipe(mask=numbers, exit_radius=radius)
    samples = [made.sample(0, "train", n) for n in range(96)]
    assert samples[0]["parameters"]["exit_radius"] == radius
    images = np.array([sample["image"] for sample in samples], float)
    assert_mean(images.mean(axis=(1, 2)), 1.0)
    found = autocovariance(images)[:, 4, 1:]
    field, x = light_on_window(made.amplitudes(made.mask.loops(made.mask.drawn(np.random.default_rng(0)))), 256)
    wave = np.exp(-2j * np.pi * np.outer(np.arange(-3, 5) / 3, x))
    expected = []
    for inside in (radius, 1.3 * radius, 1e9):
        power = (np.square(np.abs(field)) * (np.hypot(x, x[:, None]) <= inside / 5e4)).sum(axis=0)
        expected.append(np.abs(wave @ power / power.sum()) ** 2)
    assert_mean(found, expected[0], slack=0.02)
    refute_mean(found, expected[1], slack=0.02)
    refute_mean(found, expected[2], slack=0.02)


def test_exit_aperture_keeps_masks_and_is_refused():
    """Masks, and images without an aperture, stay as they were; path sums and tiny apertures are refused."""
    plain, behind = recipe(), recipe(exit_radius={"uniform": [1e4, 2e4]})
    assert "exit_radius" not in plain.sample(0, "train", 0)["parameters"]
    one, two = (made.sample(0, "train", 0) for made in (plain, behind))
    assert np.array_equal(one["mask"], two["mask"])
    assert np.abs(one["image"] - two["image"]).max() > 0.1
    wide = recipe(exit_radius=1e6).sample(0, "train", 0)["image"]
    assert wide == pytest.approx(one["image"], rel=1e-5, abs=1e-5)
    assert_refused(lambda: recipe(exit_radius=100.0), "MaskedLight.exit_radius")
    narrow = recipe(**DOUBLE, beams=3, window={"width": 4000.0}, camera={"shape": [12, 12]}, exit_radius=1500.0)
    assert_refused(lambda: narrow.sample(0, "train", 0), "where path sums render")
