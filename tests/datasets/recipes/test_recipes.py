"""Recipes: pure samples that their layout describes, in either kind of terms; kinds, presets, fingerprints."""

import json
import pickle

import numpy as np
import pytest
import torch
from fake_recipe import assert_same
from quick_recipes import few_paths, packaged, quick_recipe
from refusals import assert_refused
from typer.testing import CliRunner
from zscore import assert_mean, refute_mean

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.recipes.generator import GENERATORS
from specklegen.datasets.recipes.registry import KINDS, recipe_schema
from specklegen.datasets.recipes.specification import DATA_VERSION
from specklegen.datasets.sample_schema import Renderable, stored_arrays
from specklegen.datasets.split import Purpose, substream
from specklegen.instrument.camera import NoiseStreams, expose
from specklegen.scene.faces import Faces

NOISE = {"photons": 200.0, "background": 10.0, "dark_current": 2.0, "read_noise": 3.0, "gain": 0.5, "offset": 20.0}


@pytest.mark.parametrize("name", packaged())
def test_samples_are_pure(name):
    """Alone, in a batch, in another order, after pickling and with other threads: the same bits."""
    recipe = quick_recipe(name)
    first = [recipe.sample(3, "train", index) for index in (0, 1, 70)]
    batch = recipe.batch(3, "train", [70, 0, 1])
    for place, index in enumerate((2, 0, 1)):
        alone = first[index]
        for key, column in batch.items():
            if key == "parameters":
                assert {n: v[place] for n, v in column.items()} == alone["parameters"]
            else:
                assert column[place].tobytes() == np.asarray(alone[key]).tobytes()
    GENERATORS.forget()
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        assert_same(pickle.loads(pickle.dumps(recipe)).sample(3, "train", 70), first[2])
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(threads)
    for other in (recipe.sample(4, "train", 0), recipe.sample(3, "test", 0), first[1]):
        key = next(iter(stored_arrays(recipe)))
        assert other[key].tobytes() != first[0][key].tobytes()


@pytest.mark.parametrize("name", packaged())
def test_layout_describes_the_sample(name):
    assert_described(quick_recipe(name), noisy=False)


@pytest.mark.parametrize("name", {load_recipe(name).kind: name for name in reversed(recipe_names())}.values())
def test_layout_describes_counts(name):
    """Of one recipe of each kind, which has the noise of a camera in one place."""
    if load_recipe(name).kind == "lens-stack":
        assert_refused(lambda: quick_recipe(name, exposure=NOISE), r"Recipe\.exposure")
    else:
        assert_described(quick_recipe(name, exposure=NOISE), noisy=True)


def assert_described(recipe, *, noisy):
    assert isinstance(recipe, Renderable)
    sample = recipe.sample(0, "validation", 5)
    arrays = stored_arrays(recipe)
    assert set(sample) == {*arrays, "index", "parameters"}
    for key, spec in arrays.items():
        assert sample[key].shape == spec.shape
        assert sample[key].dtype == spec.dtype
        assert np.isfinite(sample[key]).all()
        assert spec.counts == (spec.dtype == "uint16")
    assert sample["index"] == 5
    values = sample["parameters"]
    assert all(type(value) is float for value in values.values())
    assert list(values) == list(recipe.sample(0, "test", 9)["parameters"])
    thick = {"optical_depth", "g", "memory_effect_range"} if "screens" not in values else set()
    thick -= {"memory_effect_range"} if recipe.kind == "contrast-map" else set()  # light that comes straight back
    named = {"optical_depth", "mean_error"} if "focus" in sample else {"ballistic_fraction", "estimator"} | thick
    for key in {"expected_contrast"} | named:
        assert np.isfinite(values[key])
    assert "estimator: 1 kernel from paths" in recipe.layout()["parameters"].description
    if "object" in sample:
        assert values["extent_over_range"] > 0 or values["memory_effect_range"] == np.inf  # of one screen
        assert sample["object"].max() == 1
    observed = next(sample[key] for key in ("image", "stack", "frames") if key in sample)
    if not noisy and recipe.exposure is None and "focus" not in sample:  # a lens sees light beside the window, too
        assert observed.mean() == pytest.approx(1, abs=0.3)


def test_fingerprint_rules():
    """Any physics changes it; names, descriptions and sample counts do not, nor what equals the default."""
    base = load_recipe("through-slab")
    same = [{"name": "other"}, {"description": "other"}, {"samples": {"train": 7}}, {"light": {"polarised": True}},
            {"light": {"bandwidth": 0.0}}, {"media_group": 1}]  # fmt: skip
    for changes in same:
        assert load_recipe("through-slab", changes).fingerprint() == base.fingerprint(), changes
    other = [{"media": 63}, {"media": "new"}, {"media": "new", "media_group": 2}, {"material": {"g": 0.91}},
             {"material": {"wavelength": 0.51}}, {"material": {"kernel_paths": 99_999}},
             {"window": {"profile": "disc"}}, {"camera": {"shape": [128, 127]}}, {"camera": {"pixels_per_grain": 2.9}},
             {"light": {"polarised": False}}, {"light": {"bandwidth": 1e-5}}, {"light": {"spectrum": "flat"}},
             {"light": {"refractive_index": 1.3}}, {"exposure": NOISE}, {"exposure": NOISE | {"offset": 21.0}},
             {"objects": {"rotation": 29.0}}, {"field": {"extent_over_range": 0.51}},
             {"mode_tolerance": 0.011}]  # fmt: skip
    prints = [load_recipe("through-slab", changes).fingerprint() for changes in other]
    assert len({base.fingerprint(), *prints}) == len(other) + 1
    assert json.loads(base.canonical_json())["data_version"] == DATA_VERSION


def test_media_and_groups():
    assert [load_recipe("through-slab", {"media": 3}).medium_number(n) for n in range(5)] == [0, 1, 2, 0, 1]
    grouped = load_recipe("unknown-slab", {"media_group": 3})
    assert [grouped.medium_number(n) for n in range(7)] == [0, 0, 0, 1, 1, 1, 2]
    assert [grouped.media_of(n) for n in (1, 3, 4)] == [1, 1, 2]
    assert load_recipe("unknown-slab").media_of(5) == 5
    assert load_recipe("through-slab").media_of(500) == 64
    recipe = quick_recipe("unknown-slab", media_group=2)
    drawn = [recipe.sample(0, "train", n)["parameters"]["g"] for n in range(4)]
    assert drawn[0] == drawn[1] != drawn[2] == drawn[3]
    # Shared spectra and fields of its own give one image but for rounding.
    alone = quick_recipe("unknown-slab").sample(0, "train", 0)["image"]
    np.testing.assert_allclose(recipe.sample(0, "train", 0)["image"], alone, rtol=2e-4, atol=2e-5)


def test_windows_are_fitted_to_the_object():
    """An object of so many pixels, half a range wide, whatever the slab; otherwise the recipe of a fixed window."""
    recipe = quick_recipe("unknown-slab")
    widths = []
    for n in range(4):
        drawn = recipe.sample(0, "train", n)["parameters"]
        pixels = drawn["object_pitch"] * max(recipe.objects.shape) / drawn["camera_pitch"]
        assert 24 <= pixels <= 64
        assert drawn["extent_over_range"] == pytest.approx(0.5)
        assert drawn["width"] * drawn["camera_pitch"] * 3.0 == pytest.approx(recipe.wavelength)
        widths.append(drawn["width"])
    assert len(set(widths)) == 4
    through = load_recipe("through-slab")
    pitch = through.sample(0, "train", 0)["parameters"]["object_pitch"]
    pixels = pitch * 28 / through.geometry.grid.pitch
    fitted = load_recipe("through-slab", {"window": {"width": "fitted"}, "field": {"pixels": pixels}})
    there, here = (r.sample(0, "train", 0) for r in (through, fitted))
    errors = [each["parameters"].pop("expected_error") for each in (here, there)]
    assert errors[0] == pytest.approx(errors[1], rel=0.2)  # a last bit of the pitch asks for another pilot
    assert here["parameters"] == pytest.approx(there["parameters"], rel=1e-12)
    np.testing.assert_allclose(here["image"], there["image"], rtol=1e-3, atol=1e-4)
    with pytest.raises(ValueError,
                       match="Recipe.geometry must be read from a medium, since the illuminated area is fitted"):
        fitted.geometry  # noqa: B018
    assert len(fitted.plans()) == len(through.plans())
    assert len(recipe.plans()) == 2 * len(recipe.material.extremes())


@pytest.mark.parametrize(("name", "changes", "message"), [
    ("unknown-slab", {"window": {"width": 5e4}}, "a length without it; got 50000.0. Give one of window.width and"),
    ("through-slab", {"window": {"width": "fitted"}}, "Give one of window.width and field.pixels"),
    ("unknown-slab", {"field": {"pixels": 129.0}}, "ObjectField.pixels must be at most the camera's 128"),
    ("through-slab", {"lab": {}}, "Lab.wavelength must be given"),
    ("through-slab-lab", {"window": {"width": 5.0}},
     "Recipe.lab must be left out if the setup is given by other tables"),
    ("through-slab-lab", {"material": {"wavelength": 0.5}}, "Recipe.lab must be left out"),
    ("through-slab-lab", {"light": {"bandwidth": 1e-6}}, "Recipe.light must be without bandwidth"),
    ("through-slab-lab", {"lab": {"pixel_pitch": 0.006}}, "LabSetup.pixel_pitch must be at most"),
    ("through-slab-lab", {"lab": {"object_extent": 1.5}}, "LabSetup.object_extent must be at most"),
    ("through-slab-lab", {"lab": {"aperture": 40.0, "oversampling": 8}}, "LabSetup.aperture must be at most"),
    ("through-slab-lab", {"lab": {"bandwidth": 1e-3}}, "LabSetup.bandwidth must be at most"),
    ("through-slab-lab", {"lab": {"focal_length": 10.0}}, "LabSetup.pixel_pitch must be at most"),  # no camera_distance
    ("through-slab", {"light": {"bandwidth": 0.02}}, "Light.bandwidth must be at most 0.01172, which shifts"),
    ("through-slab", {"media_group": 2}, "Recipe.media_group must be 1 if the number of media is given"),
    ("through-slab", {"media": "old"}, "media must be a whole number"),
    ("through-slab", {"exposure": {**NOISE, "oversampling": 2}}, "Recipe.exposure.oversampling must be 1"),
    ("through-slab", {"exposure": {}}, "Camera.photons must be given"),
    ("through-slab", {"field": {"pitch": 1e-6}}, "given by one of pitch and extent_over_range"),
    ("through-slab", {"field": {"extent_over_range": {"uniform": [0.0, 1.0]}}}, "greater than 0"),
    ("dynamic-slab", {"dynamics": {"correlation_time": {"uniform": [0.0, 1.0]}}}, "greater than 0"),
    ("through-slab", {"camera": {"pixels_per_grain": 1.59}}, "CameraGrid.pixels_per_grain must be at least 1.6"),
    ("tilt-stack", {"camera": {"pixels_per_grain": 1.9}}, "must be at least 2 in recipes of this kind"),
    ("through-slab", {"kind": "fog"}, "recipe.kind must be one of"),
])  # fmt: skip
def test_bad_recipes_are_refused(name, changes, message):
    assert_refused(lambda: load_recipe(name, changes), message)


def test_engine_terms_are_needed_without_a_lab():
    table = {"name": "x", "material": {"thickness": 1.0, "optical_depth": 5.0, "g": 0.5}, "tilts": {"step": 1e-5}}
    with pytest.raises(ValueError, match="Recipe must be given by material.wavelength, window, camera, or by a"):
        KINDS["tilt-stack"](**table)


def test_lab_terms_and_engine_terms_make_the_same_images():
    """through-slab-lab written out in the engine's terms, by the formulas of physics.md 8."""
    lab = quick_recipe("through-slab-lab")
    n, wave = 1.4, 0.000532 / 1.4
    engine = lab.replace(
        lab=None,
        material=lab.material.replace(wavelength=wave),  # which has taken the faces of the laboratory
        window={"width": 5.0, "profile": "disc"},
        camera={"shape": [128, 128], "pixels_per_grain": (wave / 5.0) / (0.005 / (n * 100.0))},
        field={"pitch": 0.3 / 28 / (n * 200.0)}, light={"bandwidth": 1e-6, "refractive_index": n},
    )  # fmt: skip
    one, two = lab.sample(0, "train", 1), engine.sample(0, "train", 1)
    np.testing.assert_array_equal(one["object"], two["object"])
    assert np.mean(one["image"] != two["image"]) < 1e-3  # rounding decides hardly a photon
    # The two wavelengths differ in their last bit, and so do the pilots that the error is planned from.
    errors = [sample["parameters"].pop("expected_error") for sample in (one, two)]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)
    assert one["parameters"] == pytest.approx(two["parameters"], rel=1e-9)


def test_faces_of_a_material_reach_its_slab():
    """Written in the material or taken from the laboratory."""
    water = {"inside": 1.33, "outside": 1.0}
    plain, faced = load_recipe("through-slab"), load_recipe("through-slab", {"material": {"faces": water}})
    assert plain.material.extremes()[0].faces.matched
    assert all(slab.faces == Faces(inside=1.33) for slab in faced.material.extremes())
    assert faced.fingerprint() != plain.fingerprint()
    assert load_recipe("through-slab-lab").material.faces == Faces(inside=1.4)
    oiled = load_recipe("through-slab-lab", {"lab": {"faces": "matched"}})
    assert oiled.material.faces.matched
    setup = load_recipe("through-slab-lab", {"lab": {"wall": 1.52}})
    assert setup.material.extremes()[0].faces == Faces(inside=1.4, wall=1.52)
    # Its memory-effect range is that behind glass, not that of a bare layer.
    layer = setup.material.extremes()[0]
    matched = layer.replace(faces=Faces())
    ranges = [setup.material.known(each).half_range for each in (layer, matched)]
    assert ranges[0] < 0.5 * ranges[1]
    with pytest.raises(RuleError, match=r'Material.kernel must be "estimate", since the lookup'):
        load_recipe("unseen-material", {"material": {"faces": water, "kernel": "atlas"}})
    with pytest.raises(RuleError, match="Material.faces must be those of the lab"):
        load_recipe("through-slab-lab", {"lab": {"faces": "fresnel"}, "material": {"faces": water}})


def test_counts_are_the_exposed_image():
    """Each noise has a substream of the sample's own; the light is that of the recipe without noise."""
    noisy = quick_recipe("two-tilts", exposure=NOISE)
    assert noisy.exposure is not None
    sample = noisy.sample(0, "test", 4)
    ready = noisy.prepare(0, "test", 4)
    purposes = (Purpose.SHOT_NOISE, Purpose.BACKGROUND, Purpose.DARK_CURRENT, Purpose.READ_NOISE)
    streams = NoiseStreams(*(substream(0, "test", purpose, 4) for purpose in purposes))
    light = ready.images(sample["object"])
    np.testing.assert_array_equal(sample["stack"], expose(noisy.exposure, light, streams))
    assert sample["stack"].dtype == np.uint16
    again = noisy.sample(0, "test", 68)  # the same medium and other noise
    assert again["parameters"]["medium"] == sample["parameters"]["medium"]
    floating = noisy.replace(exposure=noisy.exposure.replace(bit_depth=None))
    assert floating.layout()["stack"].dtype == "float32"
    assert floating.sample(0, "test", 4)["stack"].dtype == np.float32


def test_frames_decorrelate_as_stated():
    """Intensities f frames apart are correlated by c^(2f), c = exp(-1 / correlation_time)."""
    dynamics = {"frames": 4, "correlation_time": 3.0}
    recipe = quick_recipe("dynamic-slab", dynamics=dynamics, camera={"shape": [24, 24]}, objects={"shape": [3, 3]})
    point = np.eye(1, 9, 4).reshape(3, 3)
    films = np.stack([recipe.prepare(0, "train", n).images(point) for n in range(150)]) - 1.0
    for lag in (0, 1, 3):
        found = (films[:, 0] * films[:, lag]).mean(axis=(1, 2))
        assert_mean(found, np.exp(-2 * lag / 3.0))
    refute_mean(found, np.exp(-lag / 3.0))  # a field taken for an intensity
    assert recipe.sample(0, "train", 0)["parameters"]["correlation_time"] == 3.0
    kept = recipe.frames_correlation(recipe.prepare(0, "train", 0))
    np.testing.assert_allclose(kept, np.exp(-np.arange(4) / 3.0), rtol=1e-12)


def test_material_regression_has_its_target():
    sample = quick_recipe("material-regression").sample(0, "train", 0)
    drawn = sample["parameters"]
    expected = [drawn["g"], np.log10(drawn["optical_depth"]), np.log10(drawn["thickness"])]
    np.testing.assert_allclose(sample["target"], expected, rtol=1e-6)
    assert sample["stack"].shape[0] == len(sample["tilts"]) == 9


@pytest.mark.parametrize("kind", KINDS)
def test_schema_knows_every_field(kind):
    schema = recipe_schema(kind)
    assert set(schema["properties"]) == set(KINDS[kind].model_fields)
    assert schema["properties"]["kind"]["const"] == kind
    assert {"const": "new"} in schema["properties"]["media"]["anyOf"]
    draws = json.dumps(schema["$defs"]["Material"]["properties"]["g"])
    assert all(part in draws for part in ("number", "Uniform", "LogUniform", "Choice"))


def test_command_line():
    run = CliRunner().invoke
    assert f"{len(recipe_names()) - 6} more: specklegen recipes --all" in run(app, ["recipes"]).output
    listed = run(app, ["recipes", "--all"])
    assert listed.exit_code == 0
    assert all(name in listed.output for name in recipe_names())
    shown = run(app, ["recipes", "show", "unseen-material", "--set", "material.albedo=0.99"])
    assert 'kind = "hidden-object"' in shown.output  # inherited twice
    assert "albedo = 0.99" in shown.output
    assert "inherits" not in shown.output
    assert json.loads(run(app, ["recipes", "schema", "two-tilts"]).output)["title"] == "TwoTilts"
    assert_refused(lambda: run(app, ["recipes", "show", "nope"], catch_exceptions=False), "recipe must be the name of")


def test_shown_recipe_is_the_recipe(tmp_path):
    for name in recipe_names():
        file = tmp_path / f"{name}.toml"
        file.write_text(CliRunner().invoke(app, ["recipes", "show", name]).output)
        assert load_recipe(file).fingerprint() == load_recipe(name).fingerprint()


# First three pixels of the middle row (of the last image) of sample 0 of seed 0 of train, and the mean.
GOLDEN = {"any-object": (8, [0.9766359, 0.9419461, 0.9345398, 1.011487]),
          "beyond-memory-effect": (8, [1.000374, 0.9650478, 0.9601802, 0.9803326]),
          "brownian-slab": (8, [0.7087883, 0.809357, 0.9011748, 1.010055]),
          "coherent-digits": (8, [2.855099, 3.276834, 3.684515, 1.252546]),
          "coherent-phase": (8, [0.6921861, 0.895062, 0.9052107, 1.019307]),
          "coherent-slab": (8, [3.1635058, 3.6252215, 3.9828312, 1.0098312]),
          "characters-of-new-fonts": (8, [1.074071, 1.074169, 1.076377, 1.009583]),
          "dynamic-slab": (8, [0.7764418, 0.8487779, 0.9052106, 1.015132]),
          "flow-vessel": (8, [0.514697, 0.7424139, 0.1001982, 1.024402]),
          "lsci-slab": (8, [0.5679868, 2.10164, 5.573182, 1.012225]),
          "star-behind-slab": (8, [0.232047, 0.4291241, 0.6934416, 0.9925156]),
          "masked-light-slab": (8, [0.9491207, 0.7559811, 0.587053, 1.025188]),
          "material-regression": (8, [0.9491832, 0.8015926, 0.2490684, 1.045898]),
          "one-angular-size": (8, [0.908139, 0.8600472, 0.8339479, 1.012123]),
          "partially-coherent-slab": (8, [0.3906497, 0.4650753, 0.6152182, 0.965831]),
          "points-beyond-range": (8, [0.8973294, 0.662657, 0.7019178, 1.013835]),
          "polarised-tissue": (8, [1.908316, 1.99683, 1.580259, 1.012428]),
          "refocus-stack": (8, [0.02838978, 0.1191803, 0.1704839, 0.2909596]),
          "registered-tilts": (8, [0.7689326, 0.228001, 0.03968719, 0.9849633]),
          "through-slab": (8, [1.068246, 1.091962, 1.108055, 1.013611]),
          "through-slab-lab": (8, [499, 480, 510, 468.5335]),
          "tilt-stack": (8, [0.6978172, 0.3607269, 0.230323, 1.010583]),
          "tissue-microscope": (8, [0.005284592, 0.0383306, 0.1009568, 0.3593013]),
          "two-tilts": (8, [0.9794568, 1.047421, 1.056434, 0.9758672]),
          "double-diffuser": (8, [0.9328063, 0.9142984, 0.9117794, 0.9967557]),
          "ground-glass": (8, [1.1869577, 1.2275707, 1.232235, 1.0148024]),
          "ground-glass-bench": (8, [56, 60, 64, 86.85057]),
          "tissue-bench": (8, [73, 74, 71, 86.59335]),
          "moving-diffuser": (8, [1.040494, 1.059963, 1.057312, 0.9894490]),
          "screen-stack": (8, [0.9306133, 0.9122893, 0.9099829, 0.9967672]),
          "unknown-slab": (8, [0.9316382, 0.9134352, 0.9114323, 0.996521]),
          "wide-field": (8, [0.9751981, 1.074292, 0.9566098, 1.002382]),
          "unseen-material": (8, [0.9295487, 0.9119015, 0.9108078, 0.9961757])}  # fmt: skip


@pytest.mark.parametrize("name", recipe_names())
def test_pixels_are_those_of_the_data_version(name):
    """If this fails on purpose, raise DATA_VERSION and write the new pixels down."""
    sample = load_recipe(name, few_paths(name)).sample(0, "train", 0)
    image = next(sample[key] for key in ("image", "stack", "frames") if key in sample)
    image_type, image = image.dtype, image.reshape(-1, *image.shape[-2:])[-1].astype(np.float64)
    found = [*image[len(image) // 2, :3], image.mean()]
    version, expected = GOLDEN[name]
    assert version == DATA_VERSION
    counts = image_type == np.uint16  # one may be rounded the other way elsewhere
    # Of all pixels and instruction sets the largest difference is 1.9e-6 of the mean (tests/instruction_sets.py).
    np.testing.assert_allclose(found[:3], expected[:3], rtol=0, atol=1.0 if counts else 3e-6)
    np.testing.assert_allclose(found[3], expected[3], rtol=3e-6)
