"""Each operator's torch form, which other devices run, against the form of the CPU or against its literal sum."""

import numpy as np
import pytest
import torch
from scipy.special import j0

from specklegen.scene.window import Window
from specklegen.synthesis import contrast, mixtures, optics
from specklegen.synthesis.fused import FORMS

RNG = np.random.default_rng(0)


def put(array):
    return torch.from_numpy(np.ascontiguousarray(array))


def test_j0():
    x = torch.linspace(0, 300, 200_001, dtype=torch.float64)
    np.testing.assert_allclose(mixtures.j0(x), j0(x.numpy()), rtol=0, atol=1e-14)


@pytest.mark.parametrize("separate", [True, False])
def test_fields(separate):
    """Float64 inside the torch form, float32 envelopes: 3e-7 of the largest normal number, about 4, in each frame."""
    key = torch.tensor([[[1, 2], [5, 6]], [[2**32 - 1, 77], [8, 9]], [[0, 0], [3, 3]]])
    rows, columns = torch.tensor([5, 7, 6]), torch.tensor([4, 4, 3])
    kept = torch.tensor([0.0, 0.7, 1.0], dtype=torch.float64)
    envelope = put(RNG.random((3 if separate else 1, 7, 4)).astype(np.float32))
    found = FORMS["fields"](key, 0, kept, rows, columns, envelope, 3, [9, 6])
    np.testing.assert_allclose(found, optics.fields(key, 0, kept, rows, columns, envelope, 3, [9, 6]), atol=1e-6)
    assert found.shape == (3, 2, 3, 9, 6, 2)
    assert found[0, :, :, 5:].abs().max() == 0
    assert found[2, :, :, :, 3:].abs().max() == 0
    assert found[1, :, :, :7, :4].abs().min() > 0
    assert torch.equal(found[2, 0], found[2, 1])
    alone = FORMS["fields"](key[:, 1:], 0, kept, rows, columns, envelope, 3, [9, 6])[:, 0]
    share = kept[:, None, None, None, None]
    expected = share * found[:, 0] + torch.sqrt(1 - share**2) * alone
    np.testing.assert_allclose(found[:, 1], expected, atol=1e-6)


@pytest.mark.parametrize("precise", [False, True])
def test_waves(precise):
    along, across, gain = (put(RNG.uniform(-40, 40, (2, n))) for n in (7, 5, 5))
    turns = along[:, :, None].numpy() * across[:, None].numpy()
    exact = gain[:, None].numpy() * np.exp(2j * np.pi * turns)
    for form in (optics.waves, FORMS["waves"]):
        found = torch.view_as_complex(form(along, across, gain, precise))
        assert found.dtype == (torch.complex128 if precise else torch.complex64)
        np.testing.assert_allclose(found, exact, atol=40 * (1e-11 if precise else 1e-6))


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


def waves_at_lags(count, lags):
    """Waves complex[lags, count] of evenly spaced pixels, at lags in the order of an FFT."""
    lag = np.fft.fftfreq(lags, 1 / lags)
    return np.exp(0.37j * lag[:, None] * (np.arange(count) - 1.6))


@pytest.mark.parametrize(("tilts", "frames"), [(1, 1), (3, 1), (1, 4)])
@pytest.mark.parametrize(("h", "w"), [(1, 1), (3, 4), (4, 3), (2, 1)])
def test_maps_at_the_lags(h, w, tilts, frames):
    """Literally, pixel by pixel, but at the lag of half the grid, which no window reaches."""
    b, pairs, n, m = 2, 5, 8, 4
    maps, spectra = RNG.standard_normal((b, h, tilts, pairs, w)), RNG.standard_normal((b, frames, pairs, n, m, 2))
    for each in (1, b):
        rows = np.stack([waves_at_lags(h, n) * np.exp(1j * k) for k in range(each)])
        columns = np.stack([waves_at_lags(w, 2 * m)[:m].T for _ in range(each)])
        factor = np.einsum("bny,bytpx,bxm->btpnm", np.broadcast_to(rows, (b, n, h)), maps,
                           np.broadcast_to(columns, (b, w, m)))  # fmt: skip
        expected = (factor * (spectra[..., 0] + 1j * spectra[..., 1])).sum(2)
        for form in (optics.map_lags, FORMS["map_lags"]):
            found = torch.view_as_complex(form(put(maps), put(rows), put(columns), put(spectra))).numpy()
            found[:, :, n // 2], expected[:, :, n // 2] = 0, 0
            np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("camera", [(4, 5), (5, 4), (1, 2)])
@pytest.mark.parametrize("beams", [0, 3])
def test_half_of_a_camera_tells_the_other(camera, beams):
    """Literally, view by view and lag by lag; beams that are tilted, and straight ones."""
    b, n, m = 2, 8, 5
    spectrum, gains = RNG.standard_normal((b, 3, n, m, 2)), (RNG.random(n // 2), RNG.random(m))
    spectrum[:, :, n // 2] = 0
    lag = np.fft.fftfreq(n, 1 / n)
    views = [0.3 * (np.arange(count) - (count - 1) / 2) for count in camera]
    phase = views[0][:, None] * lag, views[1][:, None] * np.arange(m)
    gain = np.concatenate([gains[0], [0], gains[0][:0:-1]])
    halves = [[f(angle[count // 2 :, : len(own)]) * own for f in (np.cos, np.sin)]
              for angle, count, own in zip(phase, camera, gains, strict=True)]  # fmt: skip
    turns = np.exp(1j * RNG.random((b, beams, n + m)))
    lags = spectrum[..., 0] + 1j * spectrum[..., 1]
    if beams:
        lags = lags * turns[:, :, :n, None] * turns[:, :, None, n:]
    expected = (np.exp(-1j * phase[0]) * gain @ lags @ (np.exp(-1j * phase[1]) * gains[1]).T).real
    parts = np.stack([turns.real, turns.imag], -1)
    for form in (optics.half_seen, FORMS["half_seen"]):
        found = form(put(spectrum), *(put(np.array(half)[None]) for half in halves), put(parts), [*camera])
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_images_are_the_double_sums_over_pixels_and_lags():
    """Literally, pixel by pixel and lag by lag; one camera for all, and one for each sample."""
    pick = lambda *shape: RNG.standard_normal(shape) + 1j * RNG.standard_normal(shape)  # noqa: E731
    b, t, r, h, w, n, m, rows, columns = 2, 3, 2, 3, 4, 6, 3, 4, 2
    modes, light, spectra = RNG.random((b, t, r, h * w)), RNG.random((b, h, w)), pick(b, 1, 3, n, m)
    spectra[..., n // 2, :] = 0
    for each in (1, b):
        down = np.stack([waves_at_lags(h, n)] * each)
        across = np.stack([waves_at_lags(w, 2 * m)[:m].T] * each)
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


@pytest.mark.parametrize("profile", ["square", "gaussian"])
def test_powers_of_windows(profile):
    """Of batches, beyond each window 0, against the window's own; windows of other widths differ."""
    width, count, size = torch.tensor([10.0, 7.5]).double(), torch.tensor([9, 5]), torch.tensor([1.3, 1.9]).double()
    arguments = width, count, size, 11, profile == "gaussian"
    for form in (contrast.window_power, FORMS["window_power"]):
        found = form(*arguments)
        for n in range(2):
            own, distance = int(count[n]), float(size[n])
            positions = (np.arange(own) - (own - 1) / 2) * distance
            power = Window(profile, float(width[n])).cell_power(positions, distance)
            np.testing.assert_allclose(found[n, :own], power / power.sum(), rtol=1e-13)
            assert not found[n, own:].any()
            wrong = Window(profile, 1.01 * float(width[n])).cell_power(positions, distance)
            assert np.abs(found[n, :own] - wrong / wrong.sum()).max() > 1e-5


@pytest.mark.parametrize("pixel", [0.0, 0.03])
def test_transforms_of_lags(pixel):
    """Sum over all pairs of cells of their powers, of the pixel's sinc, and of a wave between two object pixels."""
    power, size, wavevector = RNG.random((2, 9)), np.array([1.0, 1.3]), np.array([0.1, 0.4])
    cells = np.arange(9)
    lag = (cells[:, None] - cells) * size[:, None, None]
    seen = power[:, :, None] * power[:, None] * np.sinc(pixel * lag) ** 2
    waves = np.cos(np.arange(6)[:, None, None] * wavevector[:, None, None, None] * lag[:, None])
    expected = (seen[:, None] * waves).sum((2, 3))
    arguments = put(power), put(size), put(wavevector), torch.full((2,), pixel, dtype=torch.float64), 6
    for form in (contrast.lag_transform, FORMS["lag_transform"]):
        np.testing.assert_allclose(form(*arguments), expected, rtol=1e-12, atol=1e-12)


def test_contrasts_of_objects():
    """Literally, over all pairs of object pixels."""
    light, variance = RNG.random((2, 3, 4)), RNG.random((2, 3, 4))
    y, x = (axis.ravel() for axis in np.indices((3, 4)))
    apart = np.abs(y[:, None] - y), np.abs(x[:, None] - x)
    expected = []
    for own, known in zip(light, variance, strict=True):
        expected.append(np.sqrt(own.ravel() @ known[apart] @ own.ravel()) / own.sum())
    for form in (contrast.speckle_contrast, FORMS["speckle_contrast"]):
        np.testing.assert_allclose(form(put(light), put(variance)), expected, rtol=1e-13)
