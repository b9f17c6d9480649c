"""Twins: photographs of the setup itself pass, others are told and named; fits do not flatter; what is refused."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

import specklegen as sg
from specklegen.models.calibration.image_statistics import movements, statistics
from specklegen.models.calibration.point_speckle import PointSpeckle, _shares
from specklegen.models.calibration.setup_fit import influence
from specklegen.models.calibration.twin import _freed, _judged, _slopes_of
from tests.refusals import assert_refused
from tests.zscore import FALSE_ALARM

SURE = norm.isf(FALSE_ALARM / 2)
SETUP = PointSpeckle("disc", 3.4, 1.0, 0.0, False)


@cache
def stacks(medium_scale=1.0, step=0.01, count=12, moved=0.0):
    """Stacks float64[n, 3, 64, 64] whose frames' fields correlate by a law of the step over a range, and move."""
    rng = np.random.default_rng(int(1000 * medium_scale + 10 * moved) + count)
    y, x = np.meshgrid(np.fft.fftfreq(64), np.fft.fftfreq(64), indexing="ij")
    iris = np.hypot(y, x) < 0.5 / 3.5
    frames = np.arange(3)
    law = np.exp(-np.abs(np.subtract.outer(frames, frames)) * step / (0.03 * medium_scale))
    root = np.linalg.cholesky(law)
    waves = rng.normal(size=(count, 3, 64, 64)) + 1j * rng.normal(size=(count, 3, 64, 64))
    waves = np.einsum("ts,nsyx->ntyx", root, waves) * iris
    waves = waves * np.exp(-2j * np.pi * x * moved * frames[:, None, None])
    return np.abs(np.fft.ifft2(waves)) ** 2


def judged(one, other, seed=0):
    return _judged(statistics(one, 3.5), statistics(other, 3.5), seed)


@pytest.mark.parametrize("profile", ["disc", "square", "gaussian"])
def test_drawn_setups_are_found_by_the_fit(profile):
    """The fit's model of the spectrum is a closed form, which shares nothing with the drawing."""
    drawn = PointSpeckle(profile, 3.3, 0.7, 0.01, pixel := profile != "disc")
    light = drawn.draw((128, 128), 1, 5)
    found = sg.fit_setup(light, envelope=None, pixel_integration=pixel, profile=profile)
    assert abs(found.grain - 3.3) < SURE * found.grain_error
    assert abs(found.contrast - 0.7**0.5) < SURE * found.contrast_error
    assert abs(found.noise - 0.1) < SURE * found.noise_error
    assert abs(found.grain - 3.3 * 1.15) > SURE * found.grain_error


@pytest.mark.parametrize("lit", [1.0, 0.8, 0.5, 0.34, 0.11, 0.01])
def test_shares_have_the_contrast(lit):
    shares = _shares(lit)
    assert shares.sum() == pytest.approx(1)
    assert np.square(shares).sum() == pytest.approx(lit)
    assert (shares >= -1e-12).all()
    assert len(shares) == int(np.ceil(1 / lit - 1e-9))


def test_photographs_of_one_seed_move_smoothly_with_the_numbers():
    one, other, far = (SETUP._replace(grain=grain).draw((64, 64), 1, 3).ravel() for grain in (3.4, 3.45, 4.2))
    assert np.corrcoef(one, other)[0, 1] > 0.97 > np.corrcoef(one, far)[0, 1]


def test_p_values_are_even_where_nothing_differs():
    """Of 60 draws of the judge on equal laws: Kolmogorov's distance, false alarm 1e-4; a shifted law fails it."""
    rng = np.random.default_rng(0)

    def chance(moved):
        numbers = [{"contrast": rng.normal(size=(n, 1)), "C_I": rng.exponential(size=(n, 3))} for n in (8, 24)]
        numbers[0]["C_I"] += moved
        return _judged(numbers[0], numbers[1], 0)[0]

    def distance(found):
        found = np.sort(found)
        steps = np.arange(1, len(found) + 1) / len(found)
        return max((steps - found).max(), (found - steps + 1 / len(found)).max())

    bound = np.sqrt(np.log(2 / 1e-4) / 2 / 60)
    assert distance([chance(0.0) for _ in range(60)]) < bound
    assert distance([chance(0.8) for _ in range(60)]) > bound


def test_patterns_that_tilts_move_are_followed():
    """The peak of each step is where frames were moved to, whole pixels and beyond a grain."""
    light = stacks(count=4, moved=9.0)
    assert movements(light) == {1: (0, 9), 2: (0, 18)}
    followed, not_followed = (statistics(light, 3.5, moves=moves)["C_I"].mean(0) for moves in (movements(light), None))
    assert np.abs(followed - statistics(stacks(count=48), 3.5)["C_I"].mean(0)).max() < 0.1
    assert not_followed.max() < 0.1


def test_a_correlation_between_pixels_is_that_of_its_peak():
    """Moved by .4 of a pixel, frames correlate as they do unmoved: what the nearest pixel falls short is put back."""
    rng = np.random.default_rng(3)
    y, x = np.meshgrid(np.fft.fftfreq(96), np.fft.fftfreq(96), indexing="ij")
    one, other = (rng.normal(size=(2, 8, 96, 96, 2)) @ [1, 1j]) * (np.hypot(y, x) < 0.5 / 7)
    later = 0.95 * one + np.sqrt(1 - 0.95**2) * other
    short = []
    for moved in (0.0, 0.4):
        waves = np.stack([one, later * np.exp(-2j * np.pi * x * moved)], axis=1)
        short.append(np.exp(statistics(np.abs(np.fft.ifft2(waves)) ** 2, 7.0)["C_I"]).mean())
    assert short[1] == pytest.approx(short[0], rel=0.02)


def test_range_and_displacement_are_named():
    light = stacks(count=48)
    alike, _ = judged(stacks(count=16), light)
    assert alike > 1e-3
    chance, found = judged(stacks(0.85, count=16), light)
    assert chance < 0.01
    assert found[0].name == "C_I"
    assert found[0].measured < found[0].simulated
    assert "shorter memory-effect range" in found[0].cause
    chance, found = judged(stacks(count=16, moved=0.7), light)
    assert chance < 0.01
    assert "displacement" in {each.name for each in found if each.p_value < 0.01}
    assert "out of focus" in next(each.cause for each in found if each.name == "displacement")


@pytest.mark.parametrize(("change", "name", "cause"), [
    ({"lit": 0.5}, "contrast", "missing analyser"), ({"profile": "square"}, "spectrum", "shape of the aperture"),
    ({"grain": 3.7}, "grain", "narrower aperture"),
])  # fmt: skip
def test_other_setups_are_told_and_named(change, name, cause):
    theirs = SETUP._replace(**change).draw((64, 64), 16, 11)[:, None]
    chance, found = judged(theirs, SETUP.draw((64, 64), 48, 12)[:, None])
    assert chance < 0.01
    told = {each.name: each for each in found if each.p_value < 0.01}
    assert name in told
    assert cause in told[name].cause


def test_a_fit_does_not_flatter():
    """Photographs lie nearer to what was fitted to them than chance; numbers less each image's share do not. The setup
    is moved by less than its error on purpose: the shares take it back, as if it had not been moved."""
    light = SETUP.draw((64, 64), 12, 21)
    moved = SETUP._replace(grain=SETUP.grain * 1.02, lit=0.95)
    slopes = _slopes_of(moved, (64, 64), 0, 5)
    theirs = moved.draw((64, 64), 48, 22)

    def freed(images):
        return _freed(statistics(images[:, None], moved.grain), influence(images, moved), slopes)

    ours, made = freed(light), freed(theirs)
    plain = statistics(light[:, None], moved.grain), statistics(theirs[:, None], moved.grain)
    for name in ("contrast", "grain"):
        before, after = (
            np.abs(a.mean(axis=0) - b.mean(axis=0)).max()
            for a, b in ((plain[0][name], plain[1][name]), (ours[name], made[name]))
        )
        assert after < 0.6 * before
    assert _judged(ours, made, 0)[0] > 1e-3


@cache
def point_twin():
    return sg.twin(SETUP.draw((96, 96), 3, 2), images=8, pixel_integration=False, profile="disc")


def test_it_is_told_and_seen():
    found = point_twin()
    assert found.setup is not None
    assert found.images == 3
    assert not found.differs
    assert "indistinguishable in 3 images" in found.verdict
    assert found.pictures.shape == (9, 96, 96)
    assert "yours" in [label.get_text() for label in found.plot().get_xticklabels()]
    assert "grain = " in found.recipe
    assert "p = " in str(found._facts()["contrast"])


def test_the_written_recipe_renders():
    from specklegen.core.tables import toml_table
    from specklegen.datasets import load_recipe

    found = point_twin()
    table = toml_table(found.recipe, "recipe")
    recipe = load_recipe(table.pop("inherits"), {key: value for key, value in table.items() if key != "name"})
    assert recipe.sample(0, "train", 0)["image"].shape == (96, 96)


@pytest.mark.parametrize(("changes", "rule"), [
    ({"images": 4}, "twin images must be"), ({"seed": -1}, "twin seed must be"),
    ({"recipe": "tilt-stack"}, "whole stacks of 5 frames"), ({"recipe": "through-slab"}, "at least 128 x 128 pixels"),
    ({"recipe": "no-such-recipe"}, "no-such-recipe"),
])  # fmt: skip
def test_what_is_refused(changes, rule):
    assert_refused(lambda: sg.twin(**{"photographs": SETUP.draw((96, 96), 1, 0)} | changes), rule)
