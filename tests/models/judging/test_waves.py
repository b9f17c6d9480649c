"""Images of waves that come with the package: those that the script makes, and what the mapping says of their media."""

from importlib.resources import files

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scenes import script_at
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.measured.envelope import fit_envelope
from specklegen.models.judging import baselines, waves
from specklegen.models.judging.benchmark import blinded
from specklegen.models.judging.tasks import task


@pytest.fixture(scope="module")
def script():
    return script_at("scripts/build/make_wave_images.py")


@pytest.fixture(scope="module")
def every():
    (batch,) = task("waves").batches(range(waves.SAMPLES))
    return batch


def test_the_file_is_small_and_frozen(monkeypatch):
    assert files("specklegen.models").joinpath(waves.FILE).stat().st_size < 1.5e6
    content = dict(waves.stored())
    counts = content["counts"].copy()
    counts[7, 40, 40] ^= 1
    monkeypatch.setattr(waves, "stored", lambda: content | {"counts": counts})
    assert_refused(lambda: task("waves").recipe(), "benchmark task 'waves' must be that of version")


def test_samples_are_laid_out_as_those_of_a_recipe(every):
    assert every["image"].shape == (48, 96, 96)
    assert every["object"].shape == (48, 28, 28)
    torch.testing.assert_close(every["image"].mean((1, 2)), torch.ones(48), rtol=1e-4, atol=0)
    assert every["object"].amin() == 0
    assert 0.9 < every["object"].amax() <= 1
    assert every["parameters"]["medium"].tolist() == [n // 2 for n in range(48)]
    assert every["parameters"]["family"].tolist() == [n % 2 for n in range(48)]
    assert ((every["parameters"]["label"] >= 0) == (every["parameters"]["family"] == 0)).all()
    assert every["parameters"]["extent_over_range"].amin() < 0.3
    assert every["parameters"]["extent_over_range"].amax() > 2.7


def test_the_mapping_tells_pairs_of_a_medium_and_the_memory_effect(every):
    recipe = task("waves").recipe()
    some = next(task("waves").batches(range(20, 24)))
    seen = blinded(some, recipe)
    assert seen["medium"].tolist() == [0, 0, 1, 1]
    assert not {"label", "family", "medium"} & seen["parameters"].keys()
    place = 28 / some["parameters"]["extent_over_range"].numpy()
    half = [np.interp(p, np.arange(64), c) for p, c in zip(place, seen["memory_effect"].numpy(), strict=True)]
    np.testing.assert_allclose(half, 0.5, atol=0.02)  # estimates of 1e5 paths each, of C_I at half range: 2 % of it


def test_the_script_makes_these_images(script, every, monkeypatch):
    """The sample with the fewest lit pixels, wave by wave, behind a slab as thick as the one of the file.

    That thickness was chosen by a range of 1e5 paths; other paths give one within 2 %: four standard errors.
    """
    lit = (every["object"] > 0).sum((1, 2))
    n = int(lit.argmin())
    hidden = script.objects()[n : n + 1]
    np.testing.assert_array_equal(hidden, waves.stored()["objects"][n : n + 1])
    drawn, thickness = script.drawn_slab(n // 2), float(every["parameters"]["thickness"][n])
    assert drawn.slab.thickness == pytest.approx(thickness, rel=0.02)
    assert drawn.slab.scatterer.concentration == every["parameters"]["scatterer_concentration"][n]
    same = script.slab(thickness, drawn.slab.optical_depth, drawn.slab.scatterer.concentration)
    monkeypatch.setattr(script, "drawn_slab", lambda *_: drawn._replace(slab=same))
    (image,) = script.images(n // 2, hidden)
    np.testing.assert_allclose(image, every["image"][n].numpy(), rtol=0, atol=6e-4 * image.max())


SLAB = dict(thickness=80.0, depth=5.0, concentration=360.0)
RINGS = (0, 15, 30, 45, 70)


def in_rings(script, pattern):
    views = script._views()
    radius = np.hypot(views, views[:, None])
    return [pattern[(low <= radius) & (radius < high)].mean() for low, high in zip(RINGS, RINGS[1:], strict=False)]


@pytest.fixture(scope="module")
def alone(script):
    """Patterns of three pixels in a row, the first on the axis, behind 24 slabs: float64[24, 3, 96, 96]."""
    lit = np.zeros((28, 28), bool)
    lit[14, [14, 17, 24]] = True
    medium = script.slab(**SLAB)
    return np.array([script.patterns(medium, lit, seed) for seed in range(24)])


@pytest.mark.slow
def test_what_the_images_are_divided_by_is_their_mean(script, alone):
    """Light straight ahead over its envelope is even from ring to ring; undivided it is not."""
    divided = np.array([in_rings(script, each[0] / script.envelope(script.slab(**SLAB))) for each in alone])
    every = divided / divided.mean()
    assert_mean(every, 1.0)
    plain = np.array([in_rings(script, each[0]) for each in alone])
    refute_mean(plain / plain.mean(), 1.0)


def test_neighbouring_pixels_have_the_memory_effect_that_the_mapping_tells(script, alone):
    """Correlation of patterns moved back by 3, 7 and 10 pixels against C_I by random paths, within .02 as waves are. An
    independent judge of the sampler that learns C_I from paths: they share no line. Neither pattern shows where the
    light lies that was not scattered."""
    medium = script.slab(**SLAB)
    tilts = np.arcsin([3 / 256, 7 / 256, 10 / 256])
    curve = sg.memory_effect(medium, wavelength=1.0, tilts=tilts, paths=50_000, seed=1)
    flat = alone / alone.mean((0, 2, 3), keepdims=True) / script.envelope(medium)
    for expected, (one, other, apart) in zip(curve.intensity, ((0, 1, 3), (1, 2, 7), (0, 2, 10)), strict=True):
        moved = flat[:, other, 20:76, 20 + apart : 76 + apart], flat[:, one, 20:76, 20:76]
        centred = [each / each.mean((1, 2), keepdims=True) - 1 for each in moved]
        covariance = (centred[0] * centred[1]).mean((1, 2))
        assert_mean(covariance, expected, slack=0.03)
    refute_mean(covariance, curve.intensity[0], slack=0.03)


@pytest.mark.parametrize("name", ["image", "frames"])
def test_even_light_takes_off_a_slope_and_leaves_even_light_as_it_is(name):
    """Exact where the fit says even light; a slope of a factor of three goes, but for the error of its fit."""
    rng = np.random.default_rng(3)
    speckle = np.abs(np.fft.ifft2(np.fft.fft2(rng.normal(size=(6, 96, 96)) + 1j * rng.normal(size=(6, 96, 96)))
                                  * (np.hypot(*np.meshgrid(*[np.fft.fftfreq(96)] * 2)) < 0.25))) ** 2  # fmt: skip
    flat = torch.from_numpy(0.3 * speckle / speckle.mean((1, 2), keepdims=True) + 0.7).float()
    slope = torch.linspace(0.5, 1.5, 96).expand(96, 96)
    seen = []
    keep = baselines.on_even_light(lambda batch: seen.append(batch[name]) or batch["object"])
    as_frames = (lambda x: x[:, None].expand(-1, 2, -1, -1)) if name == "frames" else (lambda x: x)
    for images in (flat, flat * slope):
        keep({name: as_frames(images), "object": torch.zeros(6, 4, 4)})
    even, sloped = [each[:, 0] for each in seen] if name == "frames" else seen
    orders = [fit_envelope(one.double().numpy(), np.ones((96, 96), bool), "test").order for one in flat]
    assert orders.count(0) >= 4
    assert torch.equal(even[[order == 0 for order in orders]], flat[[order == 0 for order in orders]])
    left = lambda images: (images.mean((1, 2)), (images[..., 48:].mean((1, 2)) / images[..., :48].mean((1, 2))))  # noqa: E731
    assert_mean(left(sloped)[1].numpy() - left(flat)[1].numpy(), 0.0)
    refute_mean(left(flat * slope)[1].numpy() - left(flat)[1].numpy(), 0.0)


def test_integer_counts_are_divided_by_the_envelope_too():
    """An envelope in the images' own type of integers would be 0 and 1."""
    counts = torch.from_numpy(np.random.default_rng(4).poisson(80.0, (1, 64, 64)).astype(np.uint16))
    seen = baselines.on_even_light(lambda batch: batch["image"])({"image": counts})
    assert torch.allclose(seen, counts.float(), rtol=0.1)
