"""Each operator's torch form, which other devices run, against the form of the CPU or against the engine's own."""

import math

import numpy as np
import pytest
import torch
from scipy.special import j0

from specklegen.coherence.partially_coherent import effective_source_modes, gaussian_brightness
from specklegen.datasets import load_recipe
from specklegen.datasets.batched import atlas, camera, fresh, glyphs, mixtures, optics, rendering
from specklegen.datasets.batched.fused import FORMS
from specklegen.datasets.objects.glyphs import Glyphs
from specklegen.datasets.objects.outlines import outlines
from specklegen.datasets.recipes.parts.material import Material
from specklegen.instrument.camera import Camera
from specklegen.samplers.stationary.atlas import atlas_correlation, load
from specklegen.samplers.stationary.contrast import lag_transform
from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
from specklegen.scene.scatterers import HenyeyGreenstein

RNG = np.random.default_rng(0)


def put(array):
    return torch.from_numpy(np.ascontiguousarray(array))


def test_j0():
    x = torch.linspace(0, 300, 200_001, dtype=torch.float64)
    np.testing.assert_allclose(mixtures.j0(x), j0(x.numpy()), rtol=0, atol=1e-14)


def test_mixtures():
    q, radius, share = put(RNG.uniform(0, 9, (3, 50))), put(RNG.uniform(0, 5, (3, 20))), put(RNG.random((3, 20)))
    np.testing.assert_allclose(FORMS["mixture"](q, radius, share), mixtures.mixture(q, radius, share), atol=1e-13)


def slab_of(thickness, depth, g, albedo):
    return Material.slab(thickness, depth, albedo, HenyeyGreenstein(g=g))


def slabs():
    """Ends and inside of the atlas, and slabs outside it."""
    made = [
        (1000.0, 10.0, 0.9, 1.0), (300.0, 3.0, 0.7, 1.0), (1500.0, 20.0, 0.95, 1.0), (800.0, 5.3, 0.83, 0.97),
        (4000.0, 0.2, 0.99, 1.0), (1000.0, 10.0, -0.5, 1.0), (1000.0, 1e4, 0.9, 1.0),
    ]  # fmt: skip
    return made, torch.tensor(made, dtype=torch.float64)


@pytest.mark.parametrize("tolerance", [0.02, 0.0])
def test_kernels_and_half_ranges_are_those_of_the_atlas(tolerance):
    made, tensor = slabs()
    tables = atlas.atlas_tables(torch.device("cpu"))
    found = atlas.kernels(tables, *tensor.unbind(-1), tolerance)
    half, known = mixtures.half_range(found.radius, found.share, found.single)
    by_form, _ = FORMS["half_range"](found.radius, found.share, found.single)
    inside = torch.tensor([load().place(slab_of(*numbers)) is not None for numbers in made])
    assert 3 < inside.sum() < len(made)
    np.testing.assert_allclose(half[inside], by_form[inside], rtol=1e-12)
    assert known[inside].all()
    for n, numbers in enumerate(made):
        slab = slab_of(*numbers)
        kernel = atlas_correlation(slab, tolerance)
        assert (kernel is not None) == bool(found.served[n])
        if kernel is None:
            continue
        np.testing.assert_allclose(found.radius[n], kernel.radius, rtol=1e-12)
        np.testing.assert_allclose(found.share[n], kernel.weights[0] / kernel.weights.sum(), rtol=1e-12)
        assert float(found.single[n]) == pytest.approx(kernel.single_share, rel=1e-12)
        assert float(half[n]) == pytest.approx(kernel.half_range(), rel=1e-11)
        # The interpolation is off by some 1e-6, the step of Newton by the square of that.
        assert kernel(kernel.half_range()) ** 2 == pytest.approx(0.5 + 0.5 * kernel.single_share**2, rel=1e-11)
    assert found.served.tolist() == [tolerance > 0 and atlas_correlation(slab_of(*m), tolerance) is not None
                                     for m in made]  # fmt: skip
    assert load().place(slab_of(*made[-1])) is None


def test_singly_scattered_light_has_no_half_range():
    radius, share = torch.tensor([[0.0, 1.0]], dtype=torch.float64), torch.tensor([[1.0, 1e-15]], dtype=torch.float64)
    _, known = mixtures.half_range(radius, share, torch.ones(1, dtype=torch.float64))
    assert not known.any()
    single = MemoryEffectCorrelation(radius[0].numpy(), share.numpy(), 1, 1.0)
    assert single.half_range() == np.inf


@pytest.mark.parametrize("separate", [True, False])
def test_fields(separate):
    """Float64 inside the torch form, float32 envelopes: 3e-7 of the largest normal number, about 4, in each frame."""
    key = torch.tensor([[[1, 2], [5, 6]], [[2**32 - 1, 77], [8, 9]], [[0, 0], [3, 3]]])
    rows, columns = torch.tensor([5, 7, 6]), torch.tensor([4, 4, 3])
    kept = torch.tensor([0.0, 0.7, 1.0], dtype=torch.float64)
    envelope = put(RNG.random((3 if separate else 1, 7, 4)).astype(np.float32))
    found = FORMS["fields"](key, kept, rows, columns, envelope, 3, [9, 6])
    np.testing.assert_allclose(found, optics.fields(key, kept, rows, columns, envelope, 3, [9, 6]), atol=1e-6)
    assert found.shape == (3, 2, 3, 9, 6, 2)
    assert found[0, :, :, 5:].abs().max() == 0
    assert found[2, :, :, :, 3:].abs().max() == 0
    assert found[1, :, :, :7, :4].abs().min() > 0
    assert torch.equal(found[2, 0], found[2, 1])
    alone = FORMS["fields"](key[:, 1:], kept, rows, columns, envelope, 3, [9, 6])[:, 0]
    share = kept[:, None, None, None, None]
    expected = share * found[:, 0] + torch.sqrt(1 - share**2) * alone
    np.testing.assert_allclose(found[:, 1], expected, atol=1e-6)


def test_waves():
    along, across, gain = (put(RNG.uniform(-40, 40, (2, n))) for n in (7, 5, 5))
    found, expected = FORMS["waves"](along, across, gain), optics.waves(along, across, gain)
    np.testing.assert_allclose(found, expected, atol=40 * 1e-6)
    turns = along[:, :, None].numpy() * across[:, None].numpy()
    exact = gain[:, None].numpy() * np.exp(2j * np.pi * turns)
    np.testing.assert_allclose(torch.view_as_complex(expected), exact, atol=40 * 1e-6)


def test_pairs_of_modes():
    views = RNG.standard_normal((2, 2, 3, 4, 5, 2))
    u = views[..., 0] + 1j * views[..., 1]
    r, q = np.triu_indices(3)
    expected = (u[:, :, r] * u[:, :, q].conj()).real.sum(1)
    for form in (optics.pair_products, FORMS["pair_products"]):
        np.testing.assert_allclose(form(put(views)), expected, atol=1e-14)
    modes, light = RNG.random((2, 2, 3, 6)), RNG.random((2, 2, 3))
    maps = modes[:, :, r] * modes[:, :, q] * light.reshape(2, 1, 1, 6) * np.where(r == q, 1, 2)[:, None]
    expected = maps.reshape(2, 2, 6, 2, 3).transpose(0, 3, 1, 2, 4)
    np.testing.assert_allclose(optics.mode_maps(put(modes), put(light)), expected, atol=1e-14)


@pytest.mark.parametrize(("tilts", "frames"), [(1, 1), (3, 1), (1, 4)])
def test_sums_over_pairs(tilts, frames):
    turned, spectra = RNG.standard_normal((2, 6, tilts, 5, 4, 2)), RNG.standard_normal((2, frames, 5, 6, 4, 2))
    one, two = turned[..., 0] + 1j * turned[..., 1], spectra[..., 0] + 1j * spectra[..., 1]
    expected = (one.transpose(0, 2, 3, 1, 4) * two).sum(2)
    for form in (optics.lag_sum, FORMS["lag_sum"]):
        np.testing.assert_allclose(torch.view_as_complex(form(put(turned), put(spectra))), expected, atol=1e-14)


def test_images_are_the_double_sums_over_pixels_and_lags():
    """Literally, pixel by pixel and lag by lag; one camera for all, and one for each sample."""
    pick = lambda *shape: RNG.standard_normal(shape) + 1j * RNG.standard_normal(shape)  # noqa: E731
    b, t, r, h, w, n, m, rows, columns = 2, 3, 2, 3, 4, 5, 3, 4, 2
    modes, light, spectra = RNG.random((b, t, r, h * w)), RNG.random((b, h, w)), pick(b, 1, 3, n, m)
    for each in (1, b):
        down, across = pick(each, n, h), pick(each, w, m)
        up, along = pick(each, t, rows, n), pick(each, t, m, columns)
        expected = np.zeros((b, t, rows, columns))
        for s in range(b):
            c = s % each
            for tilt in range(t):
                lags = np.zeros((n, m), complex)
                for pair, (i, j) in enumerate([(0, 0), (0, 1), (1, 1)]):
                    map_ = (light[s].ravel() * modes[s, tilt, i] * modes[s, tilt, j]).reshape(h, w) * (1 + (i != j))
                    lags += spectra[s, 0, pair] * (down[c] @ map_ @ across[c])
                expected[s, tilt] = (up[c, tilt] @ lags @ along[c, tilt]).real
        parts = np.stack([along.real, -along.imag], -1).transpose(0, 1, 3, 2, 4).reshape(each, t, columns, 2 * m)
        transforms = {"object_rows": down, "object_columns": across, "camera_rows": up, "camera_columns": parts}
        found = optics.images(put(spectra), put(modes), put(light), {name: put(v) for name, v in transforms.items()})
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_beams_of_a_source():
    recipe = load_recipe("partially-coherent-slab", {"coherence_length": {"uniform": [20_000.0, 1e5]}})
    source, (count, pitch) = fresh.source_of(recipe, torch.device("cpu")), recipe.lattice
    lengths = [20_000.0, 33_333.0, 1e5, math.inf]
    beams = fresh.beams(source, torch.tensor(lengths, dtype=torch.float64))
    modes = fresh.effective_modes(source, beams)
    for n, length in enumerate(lengths):
        expected = gaussian_brightness(count, pitch, 0.5, min(length, 100 * 50_000.0))
        np.testing.assert_allclose(beams[n], expected, rtol=1e-13)
        assert float(modes[n]) == pytest.approx(effective_source_modes(expected, pitch, 0.5, 50_000.0), rel=1e-12)


@pytest.mark.parametrize("pixel", [0.0, 0.03])
def test_transforms_of_windows(pixel):
    power, size, wavevector = RNG.random((2, 9)), np.array([1.0, 1.3]), np.array([0.1, 0.4])
    pixels = torch.full((2,), pixel, dtype=torch.float64)
    found = rendering.lag_transform(put(power), put(size), put(wavevector), pixels, 6)
    for n in range(2):
        expected = lag_transform(power[n], size[n], wavevector[n] * np.arange(6), pixel)
        np.testing.assert_allclose(found[n], expected, rtol=1e-12)


@pytest.mark.parametrize("shape", [(28, 28), (17, 40)])
def test_coverage_of_every_kind_of_outline(shape):
    """Sums in another order: 200 edges of areas of at most 1 leave 1e-13; the padding of short outlines adds none."""
    tables = glyphs.glyph_tables(Glyphs(shape=shape), torch.device("cpu"))
    places = torch.arange(0, 945, 31)
    angle = put(RNG.uniform(-0.5, 0.5, len(places)))
    edges = glyphs.turned(tables.edges, places, angle)
    ends = edges.unflatten(2, (2, 2)).flatten(1, 2)
    low, extent = ends.amin(1), ends.amax(1) - ends.amin(1)
    placed = (edges - low.repeat(1, 2)[:, None]) * (0.9 * min(shape) / extent.amax(1))[:, None, None] + 0.37
    found, expected = FORMS["coverage"](placed, *shape), glyphs.coverage(placed, *shape)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert len(outlines()[int(places[3])]) < tables.edges.shape[1]


CAMERAS = {
    "all": Camera(photons=300.0, background=5.0, dark_current=3.0, exposure=0.5, read_noise=2.0, gain=1.7,
                  full_well=1500.0, offset=50.0, bit_depth=12),
    "shot": Camera(photons=20.0, bit_depth=None),
    "bright": Camera(photons=1e5, background=800.0, read_noise=1.0),
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_counts(name):
    """The same uniform numbers: equal counts but where an expansion is off by its 1e-6, of 7000 pixels none or one."""
    images = put(RNG.exponential(size=(2, 3, 33, 35)).astype(np.float32))
    keys = torch.randint(0, 2**32, (2, 4, 2), generator=torch.Generator().manual_seed(0))
    light = CAMERAS[name].photons * images.double()
    numbers = camera.numbers_of(CAMERAS[name])
    found, expected = FORMS["exposed"](light, keys, numbers), camera.exposed(light, keys, numbers)
    assert ((found - expected).abs() > 1e-3).sum() <= 1
    counts = camera.expose(CAMERAS[name], images, keys)
    np.testing.assert_array_equal(counts.float(), expected)
    assert counts.dtype == (torch.float32 if CAMERAS[name].bit_depth is None else torch.uint16)
