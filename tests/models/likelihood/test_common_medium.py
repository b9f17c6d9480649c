"""Several objects through one medium: brought into line, turned right, improved; and nothing of the kind through many.

The images are made here, by a literal sum of a moved pattern over the pixels of objects.
"""

import numpy as np
import pytest
import torch

from specklegen.models import Optics, align, joint_objects
from specklegen.models.metrics import alignment, pearson

SIDE, STEP, CAMERA, GRAIN, COUNT = 14, 2, 96, 3.0, 5
OPTICS = Optics(step=float(STEP), grain=GRAIN)


def pattern(rng, side):
    """Speckle of a square window, its grains three pixels."""
    field = np.zeros((side, side), complex)
    wide = round(side / GRAIN)
    field[:wide, :wide] = rng.normal(size=(wide, wide)) + 1j * rng.normal(size=(wide, wide))
    return np.abs(np.fft.fft2(field)) ** 2


def objects(rng):
    """Three bars each, nowhere symmetric."""
    found = np.zeros((COUNT, SIDE, SIDE))
    for each in found:
        for y, x, long, down in zip(*rng.integers(1, 6, (2, 3)) + 2, (9, 7, 4), (True, False, True), strict=True):
            each[y : y + (long if down else 2), x : x + (2 if down else long)] = 1
    return found


def seen(light, rng, together=True):
    """Images float64[N, CAMERA, CAMERA]: x(v) = sum_j o(j) s(v + j), of one pattern or of one each."""
    side = CAMERA + STEP * SIDE
    patterns = [pattern(rng, side)] * COUNT if together else [pattern(rng, side) for _ in light]
    images = np.zeros((COUNT, CAMERA, CAMERA))
    for image, own, speckle in zip(images, light, patterns, strict=True):
        for y, x in np.argwhere(own):
            image += own[y, x] * speckle[STEP * y : STEP * y + CAMERA, STEP * x : STEP * x + CAMERA]
    return torch.from_numpy(images)


def alone(light, rng):
    """What a method might say of each alone: blurred, uncertain, moved, and half of them turned; who was turned."""
    near = torch.from_numpy(light)[:, None]
    near = torch.nn.functional.avg_pool2d(near, 3, 1, 1)[:, 0] + 0.12 * torch.from_numpy(rng.normal(size=light.shape))
    moved = [own.roll(tuple(rng.integers(-2, 3, 2).tolist()), (0, 1)) for own in near.clamp_min(0)]
    turned = np.array([0, 1, 0, 1, 1], bool)
    return torch.stack([own.flip((0, 1)) if turn else own for own, turn in zip(moved, turned, strict=True)]), turned


def cases(together=True, optics=OPTICS):
    """Of six media: gains float64[6, N], whether objects came out upright, and how well either way up fits."""
    gains, upright, fits = [], [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        light = objects(rng)
        given, turned = alone(light, rng)
        found = joint_objects(seen(light, rng, together), given, optics)
        target = torch.nn.functional.pad(torch.from_numpy(light), (4, 4, 4, 4)).float()
        before = torch.nn.functional.pad(given, (4, 4, 4, 4)).float()
        gains.append(pearson(align(found.image, target), target) - pearson(align(before, target), target))
        upright.append((~alignment(found.image, target).flipped).numpy())
        fits.append(found.upright / found.turned)
        if together:
            np.testing.assert_array_equal(found.flipped.numpy(), turned == upright[-1])
    return torch.stack(gains).numpy(), np.array(upright), np.array(fits)


@pytest.fixture(scope="module")
def found():
    return cases()


def test_all_are_improved_and_come_out_the_right_way_up(found):
    """The mean gain of six media is above 0 by four standard errors; what solvers gain: docs/notes/likelihood.md."""
    gains, upright, fits = found
    each = gains.mean(1)
    assert each.mean() / (each.std(ddof=1) / len(each) ** 0.5) > 4
    assert upright.all()
    assert (fits > 1.05).all()


def test_images_through_media_of_their_own_have_nothing_in_common(found):
    gains, upright, fits = cases(together=False)
    assert gains.mean() < found[0].mean() - 0.05
    assert not upright.all()
    assert fits.mean() < found[2].mean()


def test_a_wrong_step_is_found_out(found):
    assert cases(optics=OPTICS._replace(step=1.4 * STEP))[0].mean() < found[0].mean() - 0.03


def test_what_cannot_be_joined_is_refused():
    images, guess = torch.rand(3, 64, 64), torch.rand(3, 8, 8)
    for bad in (
        (images[:1], guess[:1], OPTICS), (images, guess[:2], OPTICS), (images, -guess, OPTICS),
        (images, 0 * guess, OPTICS), (0 * images + 1, guess, OPTICS),
        (images, guess, Optics(step=torch.tensor([2.0, 2.0, 2.5]), grain=3.0)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="joint_objects"):
            joint_objects(*bad)
