"""Objects behind one medium from their images alone: found, the right way up; and nothing of the kind behind many.

The images are made here, by a literal sum of a moved pattern over the pixels of objects.
"""

from functools import cache

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from specklegen.models import Multiframe, Optics, align, joint_objects, multiframe_deconvolution
from specklegen.models.metrics import alignment, pearson
from tests.core.test_shielded import CONTEXTS
from tests.refusals import assert_refused

SIDE, STEP, CAMERA, GRAIN, COUNT, MEDIA = 13, 2, 128, 3.0, 5, 3
OPTICS = Optics(step=float(STEP), grain=GRAIN)


def pattern(rng, side, grain=GRAIN):
    """Speckle of a square window."""
    field = np.zeros((side, side), complex)
    wide = round(side / grain)
    field[:wide, :wide] = rng.normal(size=(wide, wide)) + 1j * rng.normal(size=(wide, wide))
    return np.abs(np.fft.fft2(field)) ** 2


def objects(rng):
    """Seven strokes each, three pixels long, down or across, of any brightness: no two alike, nowhere symmetric."""
    found = np.zeros((COUNT, SIDE, SIDE))
    for each in found:
        for y, x, down in zip(*rng.integers(0, SIDE - 2, (2, 7)), rng.random(7) < 0.5, strict=True):
            each[y : y + (3 if down else 1), x : x + (1 if down else 3)] += rng.uniform(0.3, 1)
    return found


def seen(light, rng, together=True):
    """Images float64[N, CAMERA, CAMERA]: x(v) = sum_j o(j) s(v + j), of one pattern or of one each."""
    side = CAMERA + STEP * SIDE
    patterns = [pattern(rng, side)] * len(light) if together else [pattern(rng, side) for _ in light]
    images = np.zeros((len(light), CAMERA, CAMERA))
    for image, own, speckle in zip(images, light, patterns, strict=True):
        for y, x in np.argwhere(own):
            image += own[y, x] * speckle[STEP * y : STEP * y + CAMERA, STEP * x : STEP * x + CAMERA]
    return torch.from_numpy(images)


def framed(image):
    return torch.nn.functional.pad(torch.as_tensor(image).float(), [(32 - image.shape[-1]) // 2] * 4)


def judged(found, light):
    """Correlations float64[N] with the true objects on the best shift and turn, and whether that is no turn."""
    target = torch.nn.functional.pad(torch.from_numpy(light), (0, 1, 0, 1)).float()
    image, target = framed(found.image), framed(target)
    return pearson(align(image, target), target).numpy(), ~alignment(image, target).flipped.numpy()


@cache
def medium(seed):
    """Objects, their images, and what was found, through one medium."""
    rng = np.random.default_rng(seed)
    light = objects(rng)
    images = seen(light, rng)
    return light, images, multiframe_deconvolution(images, OPTICS, 16, starts=2)


@pytest.mark.slow
def test_objects_are_found_without_a_prior_and_the_right_way_up():
    """Correlations beside those with the objects of the next medium, which are chance: two starts, not eight. The mean
    gain of a medium is above .4 by 4 standard errors. Upright are all: by chance in 2^-15."""
    media = [medium(seed) for seed in range(MEDIA)]
    scores, upright = zip(*(judged(found, light) for light, _, found in media), strict=True)
    chance = [judged(found, media[(n + 1) % MEDIA][0])[0] for n, (*_, found) in enumerate(media)]
    gain = (np.array(scores) - np.array(chance)).mean(1)
    assert (gain.mean() - 0.4) / (gain.std(ddof=1) / MEDIA**0.5) > 4
    assert np.array(upright).all()


def test_mirrored_images_are_of_mirrored_objects():
    """The camera's mirror image: what is found of it is the mirror image, and not as it was."""
    light, images, _ = medium(1)
    mirrored = multiframe_deconvolution(images.flip(-1), OPTICS, 16, starts=2)
    straight, upright = judged(mirrored, light[..., ::-1].copy())
    assert upright.all()
    assert straight.mean() > 0.8
    assert judged(mirrored, light)[0].mean() < straight.mean() - 0.1


def test_steps_between_camera_pixels_and_a_wrong_one():
    """Three objects, 1.5 camera pixels a cell, on a camera that is no square: the pattern is known at half pixels."""
    rng = np.random.default_rng(5)
    light, fine = objects(rng)[:3], pattern(rng, 320, 2 * GRAIN)
    images = torch.zeros(3, 96, 112, dtype=torch.float64)
    for image, own in zip(images, light, strict=True):
        for y, x in np.argwhere(own):
            image += own[y, x] * torch.from_numpy(fine[3 * y : 3 * y + 192 : 2, 3 * x : 3 * x + 224 : 2])
    optics = Optics(step=1.5, grain=GRAIN)
    scores, upright = judged(multiframe_deconvolution(images, optics, 16, starts=2), light)
    assert scores.min() > 0.9
    assert upright.all()
    wrong = multiframe_deconvolution(images, optics._replace(step=2.0), 16, starts=2)
    assert judged(wrong, light)[0].mean() < scores.mean() - 0.1


def test_images_through_media_of_their_own_are_told():
    rng = np.random.default_rng(9)
    light = objects(rng)
    found = multiframe_deconvolution(seen(light, rng, together=False), OPTICS, 16, starts=1)
    assert found.explained < 0.6 < 0.85 < medium(1)[-1].explained


def test_an_envelope_a_background_and_the_unit_of_light_change_little():
    light, images, found = medium(1)
    beam = torch.exp(-2 * ((torch.arange(CAMERA) - 50.0) / 150.0).square())
    lit = 40 * images * beam[:, None] * beam + 300
    assert lit.mean() > 2 * 300
    again = multiframe_deconvolution(lit, OPTICS, 16, starts=2, background=300.0, sigma=25.0)
    own, _ = judged(found, light)
    other, upright = judged(again, light)
    assert upright.all()
    assert other.mean() > own.mean() - 0.1


def test_it_is_a_function_of_images_and_seed():
    images, one = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0)), Optics(step=1.0, grain=3.0)
    found = multiframe_deconvolution(images, one, 10, starts=2)
    torch.manual_seed(7)
    torch.rand(5)
    again = multiframe_deconvolution(images, one, 10, starts=2)
    assert torch.equal(again.image, found.image)
    assert (again.agreement, again.explained) == (found.agreement, found.explained)
    other = multiframe_deconvolution(images, one, 10, starts=1, seed=3)
    assert not torch.equal(other.image, found.image)
    assert np.isnan(other.agreement)
    assert isinstance(other, Multiframe)
    assert repr(other).startswith("Multiframe(image=float32[3, ")


@pytest.mark.parametrize(("change", "message"), [
    ({"images": torch.rand(1, 64, 64)}, "N at least 2"), ({"images": torch.ones(3, 64, 64)}, "images with contrast"),
    ({"images": -torch.rand(3, 64, 64)}, "brighter in the mean than their background"),
    ({"optics": Optics(step=torch.tensor([2.0, 2.0, 2.5]), grain=3.0)}, "the same for all images"),
    ({"optics": Optics(step=2.0, grain=60.0)}, "several speckle grains"), ({"size": 40}, "at most 32"),
])  # fmt: skip
def test_what_cannot_be_is_refused(change, message):
    given = {"images": torch.rand(3, 64, 64), "optics": OPTICS, "size": 8} | change
    assert_refused(lambda: multiframe_deconvolution(**given), message)


@pytest.mark.parametrize("call", [
    lambda images: multiframe_deconvolution(images, Optics(step=2.0, grain=3.0), 12, starts=1).image,
    lambda images: joint_objects(images, images[:, :12, :12], Optics(step=2.0, grain=3.0)).image,
], ids=["images alone", "joint"])  # fmt: skip
def test_what_the_program_has_set_does_not_matter(call):
    rng = np.random.default_rng(0)
    seen = torch.from_numpy(1 + gaussian_filter(rng.standard_normal((3, 48, 48)), (0, 1.3, 1.3)))
    expected = call(seen)
    for name in ("autocast", "double", "inference", "meta device", "threads"):
        with CONTEXTS[name]():
            found = call(seen)
        assert found.dtype == torch.float32, name
        assert torch.equal(found.cpu(), expected), name


def test_images_made_in_inference_mode_serve():
    with torch.inference_mode():
        seen = torch.from_numpy(1 + 0.3 * np.random.default_rng(0).random((3, 48, 48))) * 1.0
    assert seen.is_inference()
    assert multiframe_deconvolution(seen, Optics(step=2.0, grain=3.0), 12, starts=1).image.isfinite().all()
