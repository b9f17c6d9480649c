"""Films of particles that move: what the paths of a material say, against the engine's own correlation in time."""

import numpy as np
import pytest
import torch
from quick_recipes import quick_recipe
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.brownian import moving
from specklegen.datasets.recipes.parts.material import known_motion
from specklegen.synthesis import films

# |g1|^2 at .1, .25, .5, 2, 3 of the time where g1 = 1/e, by another program, rounded to .0005; optical depth and g.
TABLE = {(10.0, 0.9): [0.588, 0.390, 0.249, 0.062, 0.037], (20.0, 0.9): [0.724, 0.485, 0.287, 0.050, 0.024],
         (10.0, 0.0): [0.781, 0.553, 0.329, 0.034, 0.012]}  # fmt: skip
TIMES = np.array([0.1, 0.25, 0.5, 2.0, 3.0])
POINT = np.eye(1, 9, 4).reshape(3, 3)


def recipe_of(depth=10.0, g=0.9, *, paths=20_000, **dynamics):
    """Small films of objects of 3 x 3 pixels, a quarter of the time where g1 = 1/e apart, that time a hundredth."""
    film = {"model": "brownian", "frames": 13, "interval": 0.0025, "correlation_time": 0.01} | dynamics
    return load_recipe("through-slab", {
        "kind": "dynamic-slab", "media": "new", "dynamics": film, "camera": {"shape": [24, 24]},
        "objects": {"shape": [3, 3]}, "material": {"optical_depth": depth, "g": g, "kernel_paths": paths},
    })  # fmt: skip


@pytest.mark.parametrize("case", TABLE)
def test_the_paths_of_a_material_say_what_other_programs_do(case):
    """Squared g1 at times over that of 1/e; 100 000 paths leave 1 % of x there, and of the figures what they change."""
    recipe = recipe_of(*case, paths=100_000)
    known = moving(recipe.material, recipe.material.extremes()[0])
    found = known.field(known.decay() * TIMES) ** 2
    slope = known.field(known.decay() * TIMES * 1.02) ** 2 - found
    assert_z(found, TABLE[case], np.hypot(slope, 0.003))
    assert known.field(known.decay()) == pytest.approx(np.exp(-1))


@pytest.mark.parametrize("case", [(10.0, 0.9), (10.0, 0.0)])
def test_frames_forget_as_the_engine_says(case):
    """Of beams, by z-test against paths of another seed: intensities of frames covary by |g1|^2."""
    recipe = recipe_of(*case, frames=9)
    media = [recipe.prepare(0, "train", n) for n in range(64)]
    frames = np.stack([each.images(POINT) for each in media]) - 1.0
    told, lags = media[0].parameters, np.array([0, 1, 2, 4, 8])
    products = [(frames[:, : 9 - lag] * frames[:, lag:]).mean(axis=(1, 2, 3)) for lag in lags]
    mean, spread = np.mean(products, axis=1), np.std(products, axis=1, ddof=1) / np.sqrt(len(media))
    medium = recipe.material.in_motion(recipe.material.extremes()[0])
    slab = medium.replace(motion=sg.Brownian(diffusion=told["diffusion"]))
    expected = sg.temporal_correlation(slab, wavelength=told["wavelength"], lags=lags * recipe.dynamics.interval,
                                       paths=40_000, seed=9)  # fmt: skip
    error = np.hypot(spread, 1.8 * expected.standard_error)  # of 20 000 paths of its own, and these
    assert_z(mean, expected.intensity, error, degrees=63)
    refute_z(mean, np.abs(expected.field), error, degrees=63)  # a field taken for an intensity
    if case == (10.0, 0.9):  # where one exponential is far off
        refute_z(mean, np.exp(-2 * lags * recipe.dynamics.interval / told["correlation_time"]), error, degrees=63)


def test_beams_apart_forget_sooner():
    """Fields of all beams in all frames against K(q, x) of other paths, within the modes' tolerance; no product. The
    modes leave out at most 1e-4 of the intensity, so at most .02 of a correlation of one; .003 in the mean of some."""
    depth, g = 10.0, 0.0
    recipe = recipe_of(depth, g, frames=3, interval=0.005, paths=200_000).replace(mode_tolerance=1e-4)
    recipe = recipe.replace(field=recipe.field.replace(extent_over_range=3.0))
    medium = recipe.prepare(0, "train", 0)
    imaging, told = medium.imaging, medium.parameters
    root, rank, modes = imaging.film[0].double(), imaging.rank, imaging.modes[0, 0].double()  # [R, pixels]
    whole = (root @ root.T).unflatten(0, (3, rank)).unflatten(2, (3, rank))
    pairs = [(4, 4), (4, 5), (3, 5), (0, 8)]
    angle = [np.arcsin(told["object_pitch"] * np.hypot(a // 3 - b // 3, a % 3 - b % 3)) for a, b in pairs]
    lags = recipe.dynamics.interval * np.arange(3)
    slab = recipe.material.in_motion(recipe.material.extremes()[0])
    slab = slab.replace(motion=sg.Brownian(diffusion=told["diffusion"]))
    expected = sg.temporal_correlation(slab, wavelength=told["wavelength"], lags=lags, tilts=np.array(angle)[:, None],
                                       paths=200_000, seed=9)  # fmt: skip
    found = np.array([[float(modes[:, a] @ whole[0, :, f] @ modes[:, b]) ** 2 for f in range(3)] for a, b in pairs])
    error = 1.5 * expected.standard_error
    assert_z(found, expected.intensity, error, slack=0.003)
    product = found[:, :1] * found[:1]
    refute_z(product, expected.intensity, error, slack=0.003)


def test_a_longer_film_keeps_its_frames_and_begins_at_rest():
    """To the bit, in either form of an image: the first frame is that of the recipe without motion."""
    recipe = quick_recipe("brownian-slab", camera={"shape": [48, 40]})
    short, numbers = recipe.replace(dynamics=recipe.dynamics.replace(frames=3)), [0, 5]
    film, part = (each.batch(3, "test", numbers)["frames"] for each in (recipe, short))
    assert np.array_equal(film[:, :3], part)
    rest = quick_recipe("through-slab", media="new", camera={"shape": [48, 40]}).batch(3, "test", numbers)["image"]
    assert np.array_equal(film[:, 0], rest)
    half = recipe.replace(light=recipe.light.replace(polarised=False)).sample(3, "test", 0)["frames"]
    assert half.std() < 0.85 * film[0].std()


def test_fields_covary_as_the_root_says():
    """Of white fields of 3 modes in 4 frames; a root of the first frames is that of the first frames."""
    rng = np.random.default_rng(0)
    some = rng.standard_normal((1, 12, 12))
    root = torch.linalg.cholesky(torch.from_numpy(some @ some.transpose(0, 2, 1) + np.eye(12)))
    white = torch.from_numpy(rng.standard_normal((1, 4, 3, 200, 100, 2)))
    drawn = films.filmed(root, white)
    assert torch.equal(films.filmed(root[:, :6, :6], white[:, :2]), drawn[:, :2])
    flat = drawn[0].flatten(2).flatten(0, 1).numpy()
    products = (flat[:, None] * flat).reshape(12, 12, 400, -1).mean(-1)
    expected = (root @ root.mT)[0].numpy()
    assert_mean(np.moveaxis(products, -1, 0), expected)
    refute_mean(np.moveaxis(products, -1, 0), 1.05 * expected)


def test_one_speed_three_ways():
    """Diffusion, tau0 and the time of 1/e follow from each other; films that are given by either are of one bit."""
    recipe = recipe_of(frames=2)
    told = recipe.sample(0, "train", 0)["parameters"]
    assert told["correlation_time"] == pytest.approx(0.01)
    assert told["tau0"] * told["diffusion"] * (2 * np.pi / 0.5) ** 2 == pytest.approx(1)
    assert 0 < told["static_share"] == pytest.approx(told["single_share"])
    for name in ("diffusion", "tau0"):
        other = recipe_of(frames=2, correlation_time=None, **{name: told[name]}).sample(0, "train", 0)
        for key in ("diffusion", "tau0", "correlation_time"):
            assert other["parameters"][key] == pytest.approx(told[key], rel=1e-12)
    film = recipe.dynamics.interval * np.arange(2) / told["tau0"]
    slab = recipe.material.in_motion(recipe.material.extremes()[0])
    kept = recipe.frames_correlation(recipe.prepare(0, "train", 0))
    np.testing.assert_allclose(kept, known_motion(slab, 20_000).field(film), rtol=1e-12)


def test_a_drawn_speed_is_that_of_its_medium():
    recipe = recipe_of(frames=2, correlation_time={"log_uniform": [0.001, 0.1]})
    batch = recipe.batch(0, "train", range(6))
    times = batch["parameters"]["correlation_time"]
    assert len(set(times)) == 6
    assert ((times > 0.001) & (times < 0.1)).all()
    kept = [np.corrcoef(film.reshape(2, -1))[0, 1] for film in batch["frames"]]
    assert kept[times.argmax()] > kept[times.argmin()]


def test_layers_at_rest_keep_their_share():
    """Skull over brain: what meets the skull alone never decorrelates, and the engine says so too."""
    layers = [{"thickness": 100.0, "mean_free_path": 60.0, "g": 0.9, "at_rest": True},
              {"thickness": 200.0, "mean_free_path": 100.0, "g": 0.9}]  # fmt: skip
    material = {"wavelength": 0.5, "layers": layers, "kernel_paths": 20_000}
    recipe = load_recipe("through-slab", {
        "kind": "dynamic-slab", "media": "new", "material": material, "objects": {"shape": [3, 3]},
        "dynamics": {"model": "brownian", "frames": 2, "interval": 1e-3, "tau0": 1e-3}, "camera": {"shape": [24, 24]},
    })  # fmt: skip
    told = recipe.sample(0, "train", 0)["parameters"]
    medium = recipe.material.in_motion(recipe.material.extremes()[0])
    expected = sg.temporal_correlation(medium, wavelength=0.5, lags=[0.0], paths=40_000, seed=4).static_share
    assert told["static_share"] == pytest.approx(expected, abs=0.02)
    assert told["static_share"] > 1.1 * told["single_share"]
    assert recipe.material.layers[1].fingerprint() == recipe.material.layers[1].replace(at_rest=False).fingerprint()


@pytest.mark.parametrize(("changes", "says"), [
    ({"dynamics": {"diffusion": 1.0}}, "given by one of diffusion, tau0, correlation_time"),
    ({"dynamics": {"correlation_time": None}}, "given by one of diffusion, tau0, correlation_time"),
    ({"dynamics": {"interval": None}}, "Dynamics.interval must be given"),
    ({"dynamics": {"correlation_time": np.inf}}, "Dynamics.correlation_time must be finite"),
    ({"dynamics": {"correlation_time": None, "tau0": 0.0}}, "Dynamics.tau0 must be greater than 0"),
    ({"dynamics": {"velocities": [[1.0, 0.0]]}}, "Dynamics.velocities must be left out"),
    ({"dynamics": {"model": "autoregression"}}, "Dynamics.interval must be left out"),
    ({"dynamics": {"interval": -1.0}}, "greater than 0"),
    ({"material": {"kernel": "atlas"}}, "Material.kernel must be \"estimate\""),
    ({"light": {"bandwidth": 1e-4}}, "Recipe.light.bandwidth must be 0"),
])  # fmt: skip
def test_bad_input_is_named(changes, says):
    assert_refused(lambda: load_recipe("brownian-slab", changes), says)
