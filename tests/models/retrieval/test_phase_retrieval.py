"""Phase retrieval: exact recovery, options that do what they say, restarts that agree."""

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.kernels import projections as kernels
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval import projections
from specklegen.models.retrieval.apodisation import framed
from specklegen.models.retrieval.phase_retrieval import (
    Retrieval,
    fourier_modulus,
    hybrid_input_output,
    random_starts,
    retrieve,
)
from specklegen.models.retrieval.projections import (
    error_reduction,
    modulus_error,
    paired,
    shrunk,
    unpaired,
    with_modulus,
)
from specklegen.models.retrieval.restarts import consensus, lowest_error

N = 32


def sparse(seed=0, side=13, count=6):
    image = np.zeros(side * side)
    image[np.random.default_rng(seed).choice(side * side, count, replace=False)] = 1
    return torch.from_numpy(image.reshape(1, side, side))


def grey(seed=1, side=10):
    """Every pixel of a disc has a brightness of its own."""
    r2 = np.square(np.arange(side) - (side - 1) / 2)
    disc = (r2[:, None] + r2) <= (side / 2) ** 2
    return torch.from_numpy(np.random.default_rng(seed).random((1, side, side)) * disc)


def autocorrelated(objects, n=N):
    return torch.fft.irfft2(torch.fft.rfft2(framed(objects, n)).abs().square(), s=(n, n))


def scores(images, objects):
    target = framed(objects, images.shape[-1]).expand_as(images)
    return pearson(align(images.double(), target), target)


@pytest.mark.parametrize("make", [sparse, grey])
def test_the_object_is_recovered_from_its_autocorrelation(make):
    """Up to shift and flip; error reduction converges slowly, which leaves 1e-3 at most."""
    objects = make()
    found = retrieve(autocorrelated(objects), Retrieval(steps=20, error_reduction=300), threads=1)
    assert scores(lowest_error(found.restarts, found.error), objects) > 0.999
    assert scores(found.image, objects) > 0.99


def test_recovery_has_power():
    """The autocorrelation of another object does not give this one."""
    found = retrieve(autocorrelated(sparse(seed=7)), Retrieval(restarts=4), threads=1)
    assert scores(found.image, sparse()) < 0.9


def test_division_by_the_memory_effect_undoes_it():
    objects = sparse()
    step = torch.fft.fftfreq(N, 1 / N).double()
    c_i = torch.exp(-(step[:, None] ** 2 + step**2) / 60)
    lags = autocorrelated(objects) * c_i
    options = Retrieval(restarts=8, floor=1e-6)
    assert scores(retrieve(lags, options, memory_effect=c_i, threads=1).image, objects) > 0.99
    assert scores(retrieve(lags, options, threads=1).image, objects) < 0.9


def test_an_image_depends_on_nothing_but_itself():
    lags = torch.cat([autocorrelated(sparse()), autocorrelated(grey())])
    options = Retrieval(restarts=3, steps=2)
    together = retrieve(lags, options, seed=(3, 4), threads=2)
    alone = retrieve(lags[1:], options, seed=(3, 4), threads=1)
    for both, one in zip(together, alone, strict=True):
        assert torch.equal(both[1:], one)
    assert torch.equal(random_starts((3, 4), 5, N)[:3], random_starts((3, 4), 3, N))
    assert not torch.equal(random_starts(3, 1, N), random_starts((3, 0), 1, N))


def test_iterations_are_those_of_the_literature():
    """g' where it is positive, g - beta g' elsewhere, with complex transforms of the whole plane."""
    full = np.sqrt(np.clip(np.fft.fft2(autocorrelated(grey()).numpy()).real, 0, None))
    full /= np.sqrt(np.square(full).mean())
    start = random_starts(0, 2, N).double()
    options = Retrieval(steps=1, error_reduction=0, shrink_wrap=0.0)
    found = hybrid_input_output(torch.from_numpy(full[..., : N // 2 + 1]), start, options)[0].numpy()
    for restart, image in enumerate(start.numpy()):
        for beta in np.arange(40, -1, -1) * 0.05:
            spectrum = np.fft.fft2(image)
            proposed = np.fft.ifft2(full[0] * spectrum / np.abs(spectrum)).real
            image = np.where(proposed > 0, proposed, image - beta * proposed)
        # Rounding, which the chaos of 41 steps multiplies; in float32 it would reach 1.
        np.testing.assert_allclose(found[restart], np.maximum(proposed, 0), atol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_pairs_are_images(count):
    images = torch.rand(3, count, N, N)
    assert paired(images).shape == (3, (count + 1) // 2, N, N, 2)
    assert torch.equal(unpaired(paired(images), count), images)


@pytest.mark.parametrize("side", [2, 8, 30, N])
def test_pairs_get_their_modulus_as_each_image_alone(side):
    """By kernel and by arrays, as NumPy does for each image: rounding, times how much brighter the partner is."""
    generator = torch.Generator().manual_seed(side)
    images = torch.randn(2, 5, side, side, generator=generator, dtype=torch.float64)
    images[0, 1] *= 1e4  # a bright partner
    modulus = torch.fft.rfft2(torch.rand(2, 1, side, side, generator=generator, dtype=torch.float64)).abs()
    spectrum = np.fft.rfft2(images.numpy())
    expected = np.fft.irfft2(modulus.numpy() * spectrum / np.abs(spectrum), s=(side, side))
    for made in (with_modulus(paired(images), modulus), projections._with_modulus_by_arrays(paired(images), modulus)):
        np.testing.assert_allclose(unpaired(made, 5).numpy(), expected, rtol=0, atol=1e-8)


def test_kernels_do_what_arrays_do():
    rng = np.random.default_rng(0)
    spectra = np.zeros((2, 8, 8), np.complex64)
    kernels.replace_moduli(spectra, rng.random((1, 8, 5), np.float32))
    assert not spectra.any()  # what is dark has no phase
    image, proposed = rng.standard_normal((2, 500)).astype(np.float32)
    proposed[:9] = 0
    allowed = (rng.random(500) < 0.5).astype(np.float32)
    expected = np.where((proposed > 0) & (allowed > 0), proposed, image - np.float32(0.7) * proposed)
    kernels.feed_back(image, proposed, allowed, np.float32(0.7))
    np.testing.assert_allclose(image, expected, rtol=0, atol=1e-6)  # fused or not: one rounding of about 1


def test_projections_project():
    pairs = paired(random_starts(1, 3, N))
    modulus = fourier_modulus(autocorrelated(grey()))

    def error(made):
        return modulus_error(unpaired(made, 3), modulus)

    put_right = with_modulus(pairs, modulus)
    assert float(error(put_right).max()) < 1e-10  # float32 rounding, squared
    torch.testing.assert_close(error(2 * put_right), torch.ones(3), rtol=1e-5, atol=0)  # of twice the modulus
    torch.testing.assert_close(with_modulus(put_right, modulus), put_right, rtol=0, atol=1e-5)
    better = [error(error_reduction(pairs.clone(), modulus, steps)) for steps in (1, 10, 100)]
    assert (better[0] > better[1]).all()  # error reduction never raises the error (Fienup)
    assert (better[1] > better[2]).all()


def test_shrink_wrap_covers_the_object_and_little_else():
    image = torch.zeros(N, N)
    image[4:9, 5:12] = 1
    support = unpaired(shrunk(paired(image[None]), 1.0, 0.1), 1)[0]
    assert (support[4:9, 5:12] == 1).all()
    assert support.sum() < (5 + 6) * (7 + 6)  # three sigmas around


def test_modulus_has_unit_energy_and_is_apodised():
    modulus = fourier_modulus(autocorrelated(sparse()))
    image = with_modulus(paired(random_starts(0, 1, N)), modulus)
    assert float(image[..., 0].square().sum()) == pytest.approx(1, rel=1e-5)
    flat = torch.zeros(1, N, N)
    flat[0, 0, 0] = 1
    low_pass = torch.zeros(N, N)
    low_pass[0, 0], low_pass[0, 1] = 1, 0.25
    apodised = fourier_modulus(flat, low_pass)
    assert float(apodised[0, 0, 1] / apodised[0, 0, 0]) == pytest.approx(0.5, rel=1e-6)


def test_consensus_is_nearer_than_the_noisy_restarts_it_is_made_of():
    objects = sparse().float()
    truth = framed(objects, N)
    generator = torch.Generator().manual_seed(0)
    noise = 0.15 * torch.rand(1, 12, N, N, generator=generator)
    restarts = torch.stack([torch.roll(truth[0], (k, 3 * k), (0, 1)) for k in range(12)])[None]
    restarts = torch.where((torch.arange(12) % 2 == 1)[:, None, None], restarts.flip((-2, -1)), restarts) + noise
    modulus = fourier_modulus(autocorrelated(objects))
    error = modulus_error(restarts, modulus[:, None])
    agreed = scores(consensus(restarts, error, modulus), objects)
    assert agreed > scores(lowest_error(restarts, error), objects)
    assert agreed > 0.99


def test_bad_autocorrelations_are_refused():
    for lags in (torch.ones(N, N), torch.ones(1, N, N - 2), torch.ones(1, 15, 15), torch.zeros(1, N, N)):
        with pytest.raises(RuleError):
            retrieve(lags, threads=1)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no accelerator")
def test_other_devices_agree():
    lags = autocorrelated(sparse())
    here, there = (retrieve(lags.to(device), Retrieval(restarts=4)).image.cpu() for device in ("cpu", "cuda"))
    assert scores(there, sparse()) == pytest.approx(float(scores(here, sparse())), abs=0.02)
