"""A wide object, lit a spot at a time, is found in its place and the right way up; wrong places and a wrong C_I show.

The images are made here, by a literal sum over the pixels that a spot lights, each with its own correlated field.
"""

import numpy as np
import pytest
import torch
from scipy.stats import norm

from specklegen.datasets.objects.scan import spot_of
from specklegen.models import Optics
from specklegen.models.likelihood import wide_field
from specklegen.models.likelihood.wide_field import Seen, WideField, scanned_object
from tests.core.test_shielded import CONTEXTS
from tests.refusals import assert_refused

SPOT, STEP, CAMERA, GRAIN, GRID, MOVE = 8, 2, 192, 2.0, (2, 4), 3
OPTICS = Optics(step=float(STEP), grain=GRAIN)
FALSE_ALARM = 1e-6
STEPS = np.arange(1 - SPOT, SPOT)
C_I = 2.0 ** -((STEPS[:, None] ** 2 + STEPS**2) / 4.0**2)  # half at four pixels, of a spot of eight
PLACES = np.indices(GRID).reshape(2, -1).T * MOVE
WIDE = tuple((n - 1) * MOVE + SPOT for n in GRID)


def page(rng):
    """Strokes, three pixels long, down or across: nowhere symmetric."""
    found = np.zeros(WIDE)
    for y, x, down in zip(rng.integers(0, WIDE[0] - 2, 14), rng.integers(0, WIDE[1] - 2, 14), rng.random(14) < 0.5,
                          strict=True):  # fmt: skip
        found[y : y + (3 if down else 1), x : x + (1 if down else 3)] += rng.uniform(0.3, 1)
    return found


def exposures(light, rng):
    """Images float64[N, CAMERA, CAMERA], a new medium each: x(v) = sum_j o(j) |U_j(v + j)|^2, <U_i U_j*> = C_I^1/2."""
    side = CAMERA + STEP * SPOT
    pixels = np.indices((SPOT, SPOT)).reshape(2, -1).T
    apart = pixels[:, None] - pixels + SPOT - 1
    root = np.linalg.cholesky(np.sqrt(C_I[apart[..., 0], apart[..., 1]]) + 1e-9 * np.eye(len(pixels)))
    wide = round(side / GRAIN)
    images = np.zeros((len(PLACES), CAMERA, CAMERA))
    for image, (row, column) in zip(images, PLACES, strict=True):
        lit = (spot_of((SPOT, SPOT)) * light[row : row + SPOT, column : column + SPOT]).ravel()
        white = rng.normal(size=(len(pixels), wide * wide)) + 1j * rng.normal(size=(len(pixels), wide * wide))
        spectra = (root @ white).reshape(-1, wide, wide)
        for brightness, (y, x), spectrum in zip(lit, pixels, spectra, strict=True):
            if brightness:
                pattern = np.abs(np.fft.fft2(spectrum, (side, side))) ** 2 / wide**2
                image += brightness * pattern[STEP * y : STEP * y + CAMERA, STEP * x : STEP * x + CAMERA]
    return torch.from_numpy(images)


def given(images, **changes):
    return {"images": images, "spot": torch.from_numpy(spot_of((SPOT, SPOT))), "places": torch.from_numpy(PLACES),
            "optics": OPTICS, "memory_effect": torch.from_numpy(C_I)} | changes  # fmt: skip


@pytest.fixture(scope="module")
def seen():
    rng = np.random.default_rng(0)
    light = page(rng)
    return light, exposures(light, rng)


@pytest.fixture(scope="module")
def found(seen):
    return scanned_object(**given(seen[1], starts=2))


def correlation(image, other, covered):
    return np.corrcoef(image[covered].numpy(), torch.from_numpy(other)[covered].numpy())[0, 1]


def test_a_page_is_found_in_its_place(seen, found):
    """Beside its correlations with 200 other pages, which are chance: by more spreads of theirs than 1e-6 has."""
    covered = found.covered
    others = np.random.default_rng(1)
    chance = [correlation(found.image, page(others), covered) for _ in range(200)]
    r = correlation(found.image, seen[0], covered)
    assert r > max(chance)
    assert r > np.mean(chance) + norm.isf(FALSE_ALARM) * np.std(chance)
    turned = correlation(found.image, np.ascontiguousarray(seen[0][::-1, ::-1]), covered)
    assert turned < max(chance)
    assert isinstance(found, WideField)
    assert repr(found).startswith("WideField(image=float32[11, 17], covered=bool[11, 17], deviance=float32[8], looks=")


def test_the_true_page_has_the_expected_deviance(seen):
    """And neither a C_I of 1, nor a page one pixel off, nor noise that is not there leave it."""
    known = Seen.of(**given(seen[1]))
    light, count = torch.from_numpy(seen[0]).float(), len(PLACES)

    def z(wide, memory_effect):
        """Excess of all exposures in spreads of what it is for the true page."""
        excess = known.likelihood.excess(known.scan.parts(wide), memory_effect).sum()
        return float(excess / (count**0.5 * known.likelihood.spread.mean()))

    bound = norm.isf(FALSE_ALARM / 2)
    assert abs(z(light, known.memory_effect)) < bound
    assert z(light, torch.ones_like(known.memory_effect)) > bound
    assert z(light.roll(1, 1), known.memory_effect) > bound


def test_places_in_another_order_do_not_explain_the_exposures(seen, found):
    swapped = torch.from_numpy(PLACES[[3, 1, 2, 0, 7, 5, 6, 4]].copy())
    wrong = scanned_object(**given(seen[1], starts=1, places=swapped))
    assert float(wrong.deviance.mean()) > 1.1 * float(found.deviance.mean())


def test_it_is_a_function_of_its_seed_alone(seen, monkeypatch):
    monkeypatch.setattr(wide_field, "REFLECTIONS", 20)
    monkeypatch.setattr(wide_field, "STEPS", ((5, 0.03),))
    few = given(seen[1][:3], places=torch.from_numpy(PLACES[:3]), starts=1)
    first, again = scanned_object(**few), scanned_object(**few)
    other = scanned_object(**few, seed=1)
    assert torch.equal(first.image, again.image)
    assert not torch.equal(first.image, other.image)
    for name in ("autocast", "double", "inference", "meta device", "threads"):
        with CONTEXTS[name]():
            found = scanned_object(**few).image
        assert torch.equal(found.cpu(), first.image), name


@pytest.mark.parametrize(("change", "rule"), [
    ({"spot": torch.zeros(8, 8)}, r"scanned_object spot must be"),
    ({"places": torch.zeros(8, 2)}, r"scanned_object places must be int64\[8, 2\]"),
    ({"places": torch.full((8, 2), -1)}, r"scanned_object places must be"),
    ({"memory_effect": torch.ones(8, 8)}, r"scanned_object memory_effect must be of shape \(15, 15\)"),
    ({"light": torch.zeros(8)}, r"scanned_object light must be 8 numbers above 0"),
    ({"images": torch.rand(64, 64)}, r"scanned_object images must be of shape"),
    ({"starts": 0}, r"scanned_object starts must be"),
])  # fmt: skip
def test_bad_arguments_are_refused(seen, change, rule):
    assert_refused(lambda: scanned_object(**given(seen[1]) | change), rule)
