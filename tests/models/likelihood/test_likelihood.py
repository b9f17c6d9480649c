"""The expected spectrum against a literal sum, and the likelihood by its own calibration: Euler's constant."""

from functools import lru_cache

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import assert_z, refute_z

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, expected_deviance, memory_effect_between
from specklegen.models.likelihood.periodogram import Periodogram, periodogram
from specklegen.models.retrieval.edges import edge_taper, taper_of
from specklegen.scene.window import PROFILES, Window

FAMILIES = ({"type": "Glyphs"}, {"type": "Points"}, {"type": "Points", "count": 12}, {"type": "Strokes"},
            {"type": "Polygons"}, {"type": "Blobs"}, {"type": "Bars"}, {"type": "Photographs"},
            {"type": "Silhouettes"})  # fmt: skip
SPREAD = np.sqrt(np.pi**2 / 6 - 1)
"""Of x - 1 - log x, x exponentially distributed: the spread of one frequency's deviance."""
IMAGES = 45
PHOTONS = 20.0


def flat(shape, count=1, noise=0.0, looks=1.0):
    """A periodogram of ones: for what does not depend on the data."""
    power = torch.ones(count, shape[0], shape[1] // 2 + 1, dtype=torch.float64)
    return Periodogram(power, torch.full((count,), noise, dtype=torch.float64), looks, shape)


def objects(shape, seed=0, count=1):
    return torch.from_numpy(np.random.default_rng(seed).random((count, *shape)))


def literal(brightness, c_i, shape, step, grain, profile, pixel=False, share=0.0):
    """S(f) by the sums of the definition; a pixel's area by a mean over 9 x 9 points of Gauss-Legendre."""
    o = brightness / brightness.sum()
    h, w = o.shape
    lag_y, lag_x = np.arange(1 - shape[0], shape[0]), np.arange(1 - shape[1], shape[1])
    tri = np.outer(*(np.correlate(h, h, "full") / len(h) for h in (edge_taper(n, share) for n in shape)))
    nodes, weights = np.polynomial.legendre.leggauss(9)
    # The autocorrelation of a pixel is a triangle: two halves, so that each is smooth.
    places = np.concatenate([(nodes - 1) / 2, (nodes + 1) / 2]) if pixel else np.zeros(1)
    share = np.concatenate([weights, weights]) / 2 * (1 - np.abs(places)) if pixel else np.ones(1)
    window = Window(profile, 1.0)
    covariance = np.zeros(tri.shape)
    for dy in range(1 - h, h):
        for dx in range(1 - w, w):
            paired = sum(
                o[y, x] * o[y + dy, x + dx]
                for y in range(max(0, -dy), min(h, h - dy)) for x in range(max(0, -dx), min(w, w - dx))
            )  # fmt: skip
            for a, at in zip(share, places, strict=True):
                for b, bt in zip(share, places, strict=True):
                    y, x = (lag_y - dy * step + at) / grain, (lag_x - dx * step + bt) / grain
                    grains = window.coherence(x[None], y[:, None]) ** 2
                    covariance += a * b * paired * c_i[dy + h - 1, dx + w - 1] * grains
    rows, columns = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(shape[1])
    down, across = (np.exp(-2j * np.pi * np.outer(f, lags)) for f, lags in ((rows, lag_y), (columns, lag_x)))
    return (down @ (tri * covariance) @ across.T).real


@pytest.mark.parametrize(
    ("profile", "pixel", "share"), [(p, False, 0.0) for p in PROFILES] + [("square", True, 0.0), ("square", False, 0.5)]
)
def test_the_expected_spectrum_is_the_sum_over_lags(profile, pixel, share):
    """Up to the products that are left out, 1e-4 of the largest, and the Gaussian window beyond 1e-6."""
    shape, side, step, grain = (16, 20), (3, 4), 1.7, 2.6
    brightness = objects(side)
    distance = np.hypot(np.arange(-2, 3)[:, None], np.arange(-3, 4))
    c_i = np.exp(-0.3 * distance)
    likelihood = SpeckleLikelihood(flat(shape)._replace(taper=share), side, Optics(step, grain, profile, pixel))
    found = likelihood.object_spectrum(brightness, torch.from_numpy(c_i))[0].numpy()
    exact = literal(brightness[0].numpy(), c_i, shape, step, grain, profile, pixel, share)
    reach = len(found) // 2
    exact = exact[np.arange(-reach, reach + 1) % shape[0]][:, : found.shape[1]]
    if pixel:
        exact *= found.max() / exact.max()  # P(0) = 1 there, too: brightness is profiled out
    slack = 2e-3 if profile == "disc" else 2e-5
    assert np.abs(found - exact).max() < slack * exact.max()
    assert np.abs(found * 1.01 - exact).max() > slack * exact.max()  # 1 % would be seen


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_gradients_are_those_of_differences(noise):
    brightness = objects((3, 3), 2, 2)
    likelihood = SpeckleLikelihood(flat((12, 12), 2, noise), (3, 3), Optics(1.2, 2.5))
    spread = torch.from_numpy(np.random.default_rng(1).gamma(4.0, 0.25, likelihood.power.shape))
    likelihood.power = (likelihood.object_spectrum(brightness) + noise) * spread
    brightness.requires_grad_()
    c_i = torch.from_numpy(np.exp(-0.2 * np.hypot(*np.mgrid[-2:3, -2:3]))).requires_grad_()
    # The brightness is profiled out; where its scoring has converged, its own derivative adds nothing.
    assert torch.autograd.gradcheck(lambda o, c: likelihood(o, c), (brightness, c_i), atol=1e-6)


def test_several_objects_of_one_image_are_those_one_by_one():
    likelihood = SpeckleLikelihood(flat((24, 24), 2, 0.1), (5, 5), Optics(torch.tensor([1.1, 1.4]), 3.0))
    brightness = torch.stack([objects((5, 5), seed, 2) for seed in (1, 2, 3)], dim=1)
    together = likelihood(brightness)
    for n in range(3):
        assert torch.allclose(together[:, n], likelihood(brightness[:, n]), rtol=1e-12)


@pytest.mark.parametrize("looks", [1.0, 4.0])
def test_variance_of_lags_is_their_spread(looks):
    """Of 600 measurements of even power at all frequencies: 144 independent lags, each over its share of pixel pairs.
    The relative variance of a variance is 2 / 600; that of a lag's square adds 6 / 312 frequencies / looks at most."""
    count, size, shape = 600, 17, (25, 25)
    even = SpeckleLikelihood(flat(shape, count, looks=looks), (4, 4), Optics(1.0, 1.5))
    assert (even.frequencies == 312).all()  # all but f = 0, one of two opposite
    power = np.random.default_rng(4).gamma(looks, 1 / looks, even.power.shape)
    likelihood = even.seeing(torch.from_numpy(power), even.noise, looks)
    pairs = 1 - np.abs(np.fft.fftfreq(size, 1 / size)) / shape[0]
    lags = (likelihood.lags(size).numpy() * np.outer(pairs, pairs)).reshape(count, -1)[:, 1 : (size**2 + 1) // 2]
    ratio = lags.var(0, ddof=1).mean() / likelihood.lag_variance().mean().item()
    error = np.sqrt((2 + 6 / 312 / looks) / count / lags.shape[1])
    assert_z(ratio, 1.0, error, slack=0.01)
    refute_z(1.05 * ratio, 1.0, error, slack=0.01)


@lru_cache(maxsize=1)
def scenes():
    """Images of nine families behind five slabs up to three ranges wide, half of them with 20 photons a pixel."""
    families = {"type": "Families", "shape": [28, 28], "families": list(FAMILIES)}
    recipe = load_recipe("one-angular-size", {"objects": families, "media_group": 9, "mode_tolerance": 0.002})
    batch = recipe.batch(3, "train", range(IMAGES))
    drawn = batch["parameters"]
    c_i = [
        memory_effect_between(recipe.material_of(3, "train", int(medium)).correlation, wavelength, pitch, (28, 28))
        for medium, wavelength, pitch in zip(drawn["medium"], drawn["wavelength"], drawn["object_pitch"], strict=True)
    ]
    images = batch["image"].astype(np.float64).clip(0)
    images[::2] = np.random.default_rng(7).poisson(images[::2] * PHOTONS) / PHOTONS
    optics = Optics(torch.from_numpy(drawn["object_pitch"] / drawn["camera_pitch"]),
                    torch.from_numpy(drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]))  # fmt: skip
    return torch.from_numpy(images)[:, None], torch.from_numpy(batch["object"]), torch.stack(c_i), optics


def judged(images, brightness, c_i, optics, noise=1 / PHOTONS, tile=None):
    seen = periodogram(images, tile=tile)
    level = torch.zeros(len(images), dtype=torch.float64)
    level[::2] = noise
    likelihood = SpeckleLikelihood(seen._replace(noise=level), (28, 28), optics)
    return likelihood, likelihood(brightness, c_i).numpy()


def excess(likelihood, deviance):
    """Mean deviance less that expected, and its standard error; the profiled brightness takes 1 / (2 n)."""
    count = likelihood.frequencies.numpy()
    return (deviance - np.euler_gamma + 0.5 / count).mean(), SPREAD * np.sqrt((1 / count).sum()) / len(count)


def test_the_true_object_has_eulers_constant():
    """The whole chain, nothing fitted: median within .02 of .577, and the mean by a z-score. The memory effect is drawn
    with modes (tolerance .002) and read from the atlas: .002 of deviance is left for it."""
    likelihood, deviance = judged(*scenes())
    assert abs(np.median(deviance) - np.euler_gamma) < 0.02
    found, error = excess(likelihood, deviance)
    assert_z(found, 0.0, error, slack=0.002)


def test_the_true_object_has_eulers_constant_under_uneven_light():
    """Light that falls off by 30 % (rms), under the taper that it asks for; without one it is seen."""
    images, brightness, c_i, optics = scenes()
    u = torch.linspace(-1, 1, images.shape[-1], dtype=torch.float64)
    uneven = images * (1 + 0.4 * u + 0.3 * u[:, None])
    level = torch.zeros(len(images), dtype=torch.float64)
    level[::2] = 1 / PHOTONS
    found = []
    for share in (taper_of(uneven), 0.0):
        seen = periodogram(uneven, taper=share)._replace(noise=level)
        likelihood = SpeckleLikelihood(seen, (28, 28), optics)
        deviance, count = likelihood(brightness, c_i).numpy(), likelihood.frequencies.numpy()
        error = (likelihood.spread.numpy() / count).mean() / np.sqrt(len(count))
        found.append(((deviance - np.euler_gamma + 0.5 / count).mean(), 0.0, error))
    assert_z(*found[0], slack=0.005)  # of a law that takes the light for even
    refute_z(*found[1], slack=0.005)


@pytest.mark.parametrize("wrong", ["noise", "memory effect", "object", "step"])
def test_a_wrong_model_is_found_out(wrong):
    """Half the noise, a memory effect of another shape, a mirrored object, objects 2 % wider: far less probable. A
    wrong model is more probable than the true one by a factor of e^14 with a chance of e^-14 at most (Markov)."""
    images, brightness, c_i, optics = scenes()
    likelihood, deviance = judged(images, brightness, c_i, optics)
    noise = 1 / PHOTONS
    if wrong == "noise":
        noise *= 0.5
    elif wrong == "memory effect":
        c_i = c_i**0.5
    elif wrong == "object":
        brightness = brightness.flip(-1)
    else:
        optics = optics._replace(step=optics.step * 1.02)
    worse = judged(images, brightness, c_i, optics, noise)[1]
    assert (likelihood.frequencies.numpy() * (worse - deviance)).sum() > 14


def test_a_wrong_grain_is_found_out():
    """20 % of it; other grains use other frequencies, so that this one is judged by the bound above."""
    images, brightness, c_i, optics = scenes()
    found, error = excess(*judged(images, brightness, c_i, optics._replace(grain=optics.grain * 1.2)))
    refute_z(found, 0.0, error, slack=0.002)


def test_tiles_and_frames_have_the_deviance_of_their_looks():
    """Four tiles are four looks; tiles that touch share a little light, which lowers the deviance by a few per cent."""
    likelihood, deviance = judged(*scenes(), tile=64)
    assert likelihood.looks == 4
    assert np.median(deviance) == pytest.approx(expected_deviance(4), abs=0.02)
    assert expected_deviance(1) == pytest.approx(np.euler_gamma)


@pytest.mark.slow
def test_paths_sampler_images_agree():
    """Sums over paths know nothing of the likelihood's Gaussian statistics."""
    recipe = load_recipe(
        "beyond-memory-effect",
        {"sampler": "paths", "camera": {"shape": [64, 64]}, "objects": {"shape": [10, 10]},
         "field": {"extent_over_range": 2.0}, "media": 64},
    )  # fmt: skip
    batch = recipe.batch(0, "train", range(8))
    drawn = batch["parameters"]
    pitch = drawn["object_pitch"][0]
    c_i = memory_effect_between(recipe.material_of(0, "train", 0).correlation, recipe.wavelength, pitch, (10, 10))
    seen = periodogram(torch.from_numpy(batch["image"]).double()[:, None])
    likelihood = SpeckleLikelihood(seen, (10, 10), Optics(float(pitch / drawn["camera_pitch"][0]), 3.0))
    deviance = likelihood(torch.from_numpy(batch["object"]), c_i).numpy()
    assert abs(np.median(deviance) - np.euler_gamma) < 0.02
    found, error = excess(likelihood, deviance)
    assert_z(found, 0.0, error, slack=0.01)  # of the paths: expected_error of the recipe


@pytest.mark.parametrize("looks", [1.0, 4.0])
def test_thinned_measurements_are_independent(looks):
    """Two of half as many looks: of that deviance for the true object each, uncorrelated, their mean as it was."""
    brightness, count = objects((6, 6)), 6
    layout = SpeckleLikelihood(flat((96, 96), count), (6, 6), Optics(2.0, 3.0))
    spectrum = layout.object_spectrum(brightness.expand(count, -1, -1))
    power = spectrum * torch.from_numpy(np.random.default_rng(2).gamma(looks, 1 / looks, spectrum.shape))
    whole = layout.seeing(power, layout.noise, looks)
    parts = whole.thinned(seed=3)
    assert torch.allclose((parts[0].power + parts[1].power) / 2, power, rtol=1e-12)
    ratios = [((part.power / spectrum)[part.used]).numpy() for part in parts]
    n = ratios[0].size
    product = (ratios[0] - 1) * (ratios[1] - 1)
    # Frequencies of one place share the beta variable over the images: that leaves the spread of a product as it is.
    assert_z(product.mean(), 0.0, product.std() / np.sqrt(n))
    correlated = product + 0.1 * np.square(ratios[0] - 1)
    refute_z(correlated.mean(), 0.0, correlated.std() / np.sqrt(n))
    for part, ratio in zip(parts, ratios, strict=True):
        assert part.looks == looks / 2
        assert_z(np.var(ratio), 2 / looks, np.std(np.square(ratio - 1)) / np.sqrt(n))
        each = ratio - 1 - np.log(ratio)
        assert_z(each.mean(), expected_deviance(looks / 2), each.std() / np.sqrt(n))
    assert torch.equal(whole.thinned(seed=3)[0].power, parts[0].power)
    assert torch.equal(layout.power, torch.ones_like(layout.power))  # what it was made of is as it was


def test_bad_optics_are_refused():
    with pytest.raises(RuleError, match=r"Optics\.grain must be finite and above 0"):
        SpeckleLikelihood(flat((16, 16)), (4, 4), Optics(1.0, 0.0))
    with pytest.raises(RuleError, match=r"Optics\.step must be .* one for each of 1 objects"):
        SpeckleLikelihood(flat((16, 16)), (4, 4), Optics(torch.ones(3), 2.0))
    assert_refused(lambda: SpeckleLikelihood(flat((16, 16)), (4, 4), Optics(1.0, 40.0)),
                   "large enough for a frequency inside")
