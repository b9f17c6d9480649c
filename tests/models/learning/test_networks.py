"""Networks and their inputs: shapes, stated sizes, and the symmetries that they must have."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core import statistics
from specklegen.models.learning import inputs
from specklegen.models.learning.examples import mirrored
from specklegen.models.learning.networks import NETWORKS, build, parameter_count

RNG = torch.Generator().manual_seed(1)


def count_by_hand(width, side, fold, shape=28):
    """Weights of the U-Net, layer by layer."""
    double = lambda i, o: 9 * i * o + 9 * o * o + 4 * o  # noqa: E731  two convolutions, two norms
    w = [width, 2 * width, 4 * width]
    bottom = w[2] * (side // fold // 4) ** 2
    return (
        (2 * fold**2 * width + width)
        + double(w[0], w[0]) + double(w[0], w[1]) + double(w[1], w[2])
        + (bottom * 8 * width + 8 * width) + (8 * width * bottom + bottom)
        + double(w[1] + w[2], w[1]) + double(w[0] + w[1], w[0])
        + 4 * width + 4
    )  # fmt: skip


@pytest.mark.parametrize(("side", "fold"), [(64, 4), (128, 8)])
@pytest.mark.parametrize("width", [8, 16])
def test_unet_has_the_stated_size(side, fold, width):
    net = build("unet", side, (28, 28), width, seed=0)
    assert parameter_count(net) == count_by_hand(width, side, fold)


def test_residual_net_sees_each_pair_of_lags_once():
    """An autocorrelation's other half says the same; here it is made to say something else, but for the background."""
    net = build("residual", 64, (28, 28), 4, seed=0)
    pictures = torch.rand(2, 2, 64, 64, generator=RNG)
    net.first.weight.data[:, 28 * 55 : 2 * 28 * 55] = 0  # the image of zero phases needs both halves
    changed = pictures.clone()
    changed[:, 0, 33:] += 1
    assert torch.equal(net(changed), net(pictures))
    changed[:, 0, 32, 31] += 1
    assert not torch.equal(net(changed), net(pictures))


def test_zero_phases():
    """From the autocorrelation, what the object's own transform gives; rounding of the power goes by its root."""
    objects = torch.rand(3, 28, 20, generator=RNG, dtype=torch.float64)
    spectrum = np.abs(np.fft.fft2(objects.numpy(), (64, 64)))
    image, lags = (np.fft.fftshift(np.fft.ifft2(x).real, (1, 2)) for x in (spectrum, spectrum**2))
    image /= image.max((1, 2), keepdims=True)
    found = inputs.zero_phase(torch.from_numpy(lags + 0.3))  # a background is no object
    np.testing.assert_allclose(found.numpy(), image, atol=1e-6)


@pytest.mark.parametrize("side", [64, 128])
@pytest.mark.parametrize("shape", [(28, 28), (32, 32), (20, 28)])
@pytest.mark.parametrize("name", ["unet", "dense", "residual"])
def test_output_has_the_objects_shape(name, side, shape):
    net = build(name, side, shape, 4, seed=0)
    assert net(torch.randn(3, 2, side, side)).shape == (3, *shape)


def test_stack_net_takes_any_number_in_any_order():
    net = build("stack-unet", 64, (28, 28), 4, seed=0).eval()
    stack = torch.randn(2, 5, 2, 64, 64, generator=RNG)
    turned = net(stack[:, torch.tensor([3, 1, 4, 0, 2])])
    torch.testing.assert_close(turned, net(stack), rtol=0, atol=1e-5)  # float32 mean of five, another order
    assert net(stack[:, :2]).shape == (2, 28, 28)


@pytest.mark.parametrize("name", NETWORKS)
def test_first_weights_are_a_function_of_the_seed(name):
    torch.manual_seed(9)
    before = torch.get_rng_state()
    shape = (64, 64) if name == "contrast" else (28, 28)  # that one draws maps of what it sees
    nets = (build(name, 64, shape, 4, seed) for seed in (5, 5, 6))
    one, two, other = (torch.cat([p.flatten() for p in net.parameters()]) for net in nets)
    assert torch.equal(one, two)
    assert not torch.equal(one, other)
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("unet", 20, (28, 28), 4, 0), "at least that of the object"), (("unet", 64, (28, 28), 6, 0), "multiple of 4"),
     (("residual", 50, (28, 28), 4, 0), "twice that of the object"),
     (("vit", 64, (28, 28), 4, 0), "network must be one of")],
)  # fmt: skip
def test_bad_networks_are_refused(arguments, message):
    assert_refused(lambda: build(*arguments), message)


def test_autocorrelation_is_that_of_numpy():
    images = torch.rand(2, 16, 20, generator=RNG, dtype=torch.float64)
    slow = np.stack([statistics.autocorrelation(image) for image in images.numpy()])
    np.testing.assert_allclose(inputs.speckle_autocorrelation(images), slow, atol=1e-12)


@pytest.mark.parametrize(("shape", "steps"), [((40, 40), (0.3, 1.0, 1.7)), ((31, 48), (0.9, 2.5, 6.0))])
def test_lags_that_are_kept_alone_are_those_of_all_lags(shape, steps):
    """Finer and coarser than the camera's pixels, within the camera and beyond; companions change no bit."""
    images = torch.rand(3, *shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64) ** 3
    step = torch.tensor(steps, dtype=torch.float64)
    expected = inputs.resampled_lags(inputs.speckle_autocorrelation(images), step, 16)
    found = inputs.object_lags(images, step, 16)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert torch.equal(inputs.object_lags(images[1:2], step[1:2], 16), found[1:2])
    assert (inputs.object_lags(images, step * 1.01, 16) - expected).abs().max() > 1e-3  # power: 1 % of the pitch


@pytest.mark.parametrize("step", [0.4, 1.7, 3.0])
def test_resampling_keeps_a_plane(step):
    """Linear weights reproduce a linear function, wherever the triangle is whole."""
    y = torch.arange(-60, 61, dtype=torch.float64)
    plane = (2 * y[:, None] + 3 * y + 1)[None]
    found = inputs.resampled_lags(plane, torch.tensor([step], dtype=torch.float64), 16)[0]
    n = (torch.arange(16, dtype=torch.float64) - 8) * step
    expected = 2 * n[:, None] + 3 * n + 1
    # Only where old and new pitch are commensurate are the weights exactly symmetric: elsewhere half a pixel at most.
    tolerance = 1e-9 if step in (0.4, 3.0) else 0.5 * 5
    assert (found - expected).abs().max() <= tolerance


def test_mirrored_input_is_that_of_the_mirrored_image():
    images, step = torch.rand(3, 40, 40, generator=RNG), torch.full((3,), 1.5)
    target = torch.rand(3, 28, 28, generator=RNG)
    straight, turned = (inputs.autocorrelation_input(i, step) for i in (images, images.flip(-1)))
    which = torch.tensor([True, False, True])
    found, moved = mirrored(straight, target, which)
    torch.testing.assert_close(found[which][..., 1:], turned[which][..., 1:])
    assert torch.equal(found[1], straight[1])
    assert torch.equal(moved, torch.where(which[:, None, None], target.flip(-1), target))


def test_an_autocorrelation_has_forgotten_the_flip():
    images, step = torch.rand(2, 40, 40, generator=RNG), torch.full((2,), 1.0)
    one, other = (inputs.autocorrelation_input(i, step) for i in (images, images.flip((-2, -1))))
    torch.testing.assert_close(one, other, rtol=0, atol=1e-5)  # float32 transforms


def test_inputs_of_batches():
    drawn = {"object_pitch": torch.tensor([2.0, 3.0]), "camera_pitch": torch.tensor([1.0, 2.0])}
    batch = {"image": torch.rand(2, 40, 40), "object": torch.rand(2, 28, 28), "parameters": drawn}
    made = inputs.network_input(batch, "camera")
    assert made.shape == (2, 2, 40, 40)
    assert made[1, 1, 0, 0] == pytest.approx(np.log2(1.5))
    assert made[:, 0].mean((-2, -1)).abs().max() < 1e-6
    frames = {"frames": torch.rand(2, 3, 40, 40), "object": batch["object"], "parameters": drawn}
    stack = inputs.network_input(frames, "autocorrelation")
    assert stack.shape == (2, 3, 2, 64, 64)
    alone = inputs.network_input({**batch, "image": frames["frames"][:, 1]}, "autocorrelation")
    torch.testing.assert_close(stack[:, 1], alone)
    assert_refused(lambda: inputs.network_input(batch, "fourier"), "input must be one of camera")
    assert_refused(lambda: inputs.network_input({"parameters": drawn}, "camera"), "batch must be a batch with")
