"""Recipes of polarised light: modes of every analyser, shares, contrast without one, what is refused."""

import numpy as np
import pytest
from quick_recipes import quick_recipe
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.analysed_object import known_behind
from specklegen.models import recoverable
from specklegen.scene.illumination import object_sines

PATHS = 20_000
SMALL = {"camera": {"shape": [40, 40], "pixels_per_grain": 3.0}, "material": {"kernel_paths": PATHS},
         "field": {"extent_over_range": 0.4}, "objects": {"type": "Glyphs", "shape": [12, 12]}}  # fmt: skip


def recipe(**light):
    return quick_recipe("polarised-tissue", light={"polarisation": "projector"} | light, **SMALL)


@pytest.fixture(scope="module")
def pair():
    return recipe(analyser=["parallel", "crossed"])


@pytest.fixture(scope="module")
def tissue(pair):
    return pair.material.extremes()[0].replace(polarisation="projector")


def test_modes_are_those_of_both_analysers(pair, tissue):
    """The matrix of both over all pixels: K of each on the diagonal, and nothing between."""
    imaging = pair.replace(mode_tolerance=1e-4).prepare(0, "train", 1).imaging
    modes = imaging.modes[0].double().numpy()
    step = 2 * np.pi / pair.wavelength
    pitch = pair.sample(0, "train", 1)["parameters"]["object_pitch"]
    sines = object_sines("object", pair.objects.shape, pitch)[::7]
    apart = step * (sines[:, None] - sines).transpose(2, 0, 1)
    for n, analyser in enumerate(("parallel", "crossed")):
        known = known_behind(tissue, analyser, PATHS)
        some = modes[n][:, ::7]
        np.testing.assert_allclose(some.T @ some, known.planar(*apart), atol=5e-3)
    np.testing.assert_allclose(modes[0].T @ modes[1], 0, atol=5e-3)
    across = known_behind(tissue, "parallel", PATHS).planar(apart[1], apart[0])
    assert np.abs(modes[0][:, ::7].T @ modes[0][:, ::7] - across).max() > 0.01  # not round


def test_shares_are_those_of_the_mueller_matrix(pair, tissue):
    told = pair.sample(0, "train", 0)["parameters"]
    light = sg.mueller_matrix(tissue, wavelength=0.5, paths=PATHS, seed=8)
    assert_z(told["polarisation_degree"], light.linear, 2 * light.linear_error, degrees=63)
    assert told["analyser_share_0"] + told["analyser_share_1"] == pytest.approx(1)
    assert told["analyser_share_0"] == pytest.approx((1 + told["polarisation_degree"]) / 2)
    turned = recipe(analyser=np.pi / 3).sample(0, "train", 0)["parameters"]
    assert turned["analyser_share_0"] == pytest.approx((1 - told["polarisation_degree"] / 2) / 2)


def test_images_are_of_one_object_and_of_two_speckles(pair):
    """Repeated: a sample is a pure function of its number; the two images of a point have nothing in common."""
    one, again = pair.sample(0, "train", 2), pair.batch(0, "train", [5, 2])
    np.testing.assert_array_equal(one["stack"], again["stack"][1])
    assert one["stack"].shape == (2, 40, 40)
    point = np.zeros((12, 12))
    point[6, 6] = 1
    common = []
    for medium in range(12):
        co, crossed = pair.prepare(0, "train", medium).images(point)
        common.append(np.corrcoef(co.ravel(), crossed.ravel())[0, 1])
    assert_z(np.mean(common), 0, np.std(common) / np.sqrt(12), degrees=11)


def test_without_an_analyser_both_components_add_up():
    """A point has contrast sqrt((1 + P^2) / 2), as is stated, and both are drawn by their shares."""
    whole = recipe(analyser="none")
    point = np.zeros((12, 12))
    point[6, 6] = 1
    ready = [whole.prepare(0, "train", medium) for medium in range(30)]
    degree = ready[0].parameters["polarisation_degree"]
    assert ready[0].expected_contrast(point) == pytest.approx(np.sqrt((1 + degree**2) / 2), abs=0.004)
    images = np.array([each.images(point)[0] for each in ready], np.float64)
    squares = np.square(images - 1).mean(axis=(1, 2))
    assert_z(squares.mean(), (1 + degree**2) / 2, squares.std() / np.sqrt(len(squares)), degrees=29)
    refute_z(images.mean(axis=(1, 2)).mean(), 1.5, images.mean(axis=(1, 2)).std() / np.sqrt(len(images)))


def test_a_mosaic_sees_two_components_of_one_field(tissue):
    """Modes of all four angles are those of cos a f_x + sin a f_y, and pixels have the light of their polarisers."""
    leak = 1 / 50
    mosaic = recipe(analyser="none").replace(mosaic={"extinction": 1 / leak}, mode_tolerance=1e-4)
    modes = mosaic.prepare(0, "train", 1).imaging.modes[0].double().numpy()[:, :, ::7]
    told = mosaic.sample(0, "train", 1)
    shares = np.array([told["parameters"][f"analyser_share_{n}"] for n in range(4)])
    fields = modes * np.sqrt(shares)[:, None, None]
    np.testing.assert_allclose(fields[1], (fields[0] + fields[2]) / np.sqrt(2), atol=0.02 * np.abs(fields).max())
    np.testing.assert_allclose(fields[3], (fields[2] - fields[0]) / np.sqrt(2), atol=0.02 * np.abs(fields).max())
    degree = told["parameters"]["polarisation_degree"]
    np.testing.assert_allclose(shares, [(1 + degree) / 2, 0.5, (1 - degree) / 2, 0.5], atol=0.02)
    assert told["stack"].shape == (1, 40, 40)
    images = np.concatenate([mosaic.sample(0, "train", n)["stack"] for n in range(12)]).astype(np.float64)
    cells = images.reshape(12, 20, 2, 20, 2).mean(axis=(1, 3)).reshape(12, 4)
    lit = {90: shares[2], 45: shares[1], 135: shares[3], 0: shares[0]}
    expected = np.array([lit[a] + leak * lit[(a + 90) % 180] for a in mosaic.mosaic.pattern]) * 2 / (1 + leak)
    assert_z(cells.mean(axis=0), expected, cells.std(axis=0, ddof=1) / np.sqrt(12), degrees=11)
    refute_z(cells.mean(axis=0), expected[::-1], cells.std(axis=0, ddof=1) / np.sqrt(12), degrees=11)
    counted = mosaic.replace(exposure={"photons": 100.0})
    assert counted.sample(0, "train", 1)["stack"].dtype == np.uint16
    assert "mosaic" not in recipe(analyser="none").to_toml()
    assert load_recipe("polarised-tissue").fingerprint() != mosaic.fingerprint()


REFUSED = {
    "scalar light": ({"light": {"polarisation": "scalar", "analyser": "none"}}, "Light.polarisation"),
    "angles together": ({"light": {"analyser": [0.1, 0.2]}},
                        "Light.analyser must be one analyser, or parallel and crossed"),
    "one twice": ({"light": {"analyser": ["crossed", "crossed"]}}, "Light.analyser must be one"),
    "no analyser in a list": ({"light": {"analyser": []}}, "Light.analyser must be at least one"),
    "an unknown one": ({"light": {"analyser": "diagonal"}}, "analyser"),
    "an angle beyond": ({"light": {"analyser": 7.0}}, "analyser"),
    "a band": ({"light": {"bandwidth": 1e-4}}, "Recipe.light must be of one wavelength"),
    "halves": ({"light": {"polarised": False}}, "Recipe.light must be of one wavelength"),
    "the atlas": ({"material": {"kernel": "atlas"}}, "Recipe.material must be a slab given by its numbers"),
    "walls": ({"material": {"faces": {"inside": 1.33, "wall": 1.52}}}, "faces must be without a wall"),
    "a mosaic behind an analyser": ({"mosaic": {}}, 'Light.analyser must be "none"'),
    "a mosaic of odd sides": ({"mosaic": {}, "light": {"analyser": "none"}, "camera": {"shape": [41, 40]}},
                              "CameraGrid.shape must be a shape of ev"),
    "a mosaic before spheres": ({"mosaic": {}, "light": {"analyser": "none", "polarisation": "vector"}},
                                "Light.polarisation must be"),
    "no amplitudes": ({"light": {"polarisation": "vector"}}, "Slab.polarisation"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_known_is_refused(name):
    changes, told = REFUSED[name]
    assert_refused(lambda: load_recipe("polarised-tissue", changes), told)


def test_other_kinds_and_samplers_refuse_polarised_light():
    with pytest.raises(RuleError, match='Light.polarisation must be "scalar"'):
        load_recipe("through-slab", {"light": {"polarisation": "projector"}})
    with pytest.raises(RuleError, match="Light.analyser must be left out"):
        load_recipe("through-slab", {"light": {"analyser": "crossed"}})
    with pytest.raises(RuleError, match="without analysers, since media are rendered by path sums"):
        quick_recipe("polarised-tissue", sampler="paths").plans()
    assert_refused(lambda: recoverable("polarised-tissue"), "recoverable recipe must be a recipe of scalar light")
