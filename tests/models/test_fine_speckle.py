"""Speckle of fewer than two pixels a grain: images by a few lines of NumPy are reconstructed as coarser ones are."""

import numpy as np
import pytest
import torch

from specklegen.datasets import load_recipe
from specklegen.models import reconstruct
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.evaluation import on_frame
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval.camera_noise import camera_noise

FINER = 3  # points along each side of a pixel
ELECTRONS = 1000.0


def frames(objects, grain, side, seed):
    """Counts [B, side, side] of pixels that average over their area, behind a disc."""
    rng = np.random.default_rng(seed)
    points = FINER * (side + 48)
    f = np.fft.fftfreq(points) * grain * FINER
    pupil = np.hypot(f[:, None], f) <= 0.5
    images = []
    for brightness in objects:
        white = rng.normal(size=(points, points)) + 1j * rng.normal(size=(points, points))
        speckle = np.abs(np.fft.ifft2(np.fft.fft2(white) * pupil)) ** 2
        rows, columns = brightness.shape
        lit = np.zeros((points, points))
        lit[: rows * FINER : FINER, : columns * FINER : FINER] = brightness
        image = np.fft.ifft2(np.fft.fft2(speckle) * np.fft.fft2(lit)).real[-side * FINER :, -side * FINER :]
        image = image.reshape(side, FINER, side, FINER).mean((1, 3))
        images.append(rng.poisson(ELECTRONS * image / image.mean()))
    return torch.from_numpy(np.stack(images)).float()


def setup_of(grain, side, **changes):
    pixels = {"grain": grain, "object_pixel": 1.0, "shape": [side, side]}
    return load_recipe("ground-glass", {"pixels": pixels, **changes})


def hidden(setup, count):
    return np.stack([setup.objects.image(0, "test", n) for n in range(count)])


@pytest.mark.parametrize("grain", [1.6, 1.8, 2.0])
def test_noise_behind_a_disc_is_read_off_the_image(grain):
    """Also by reconstruct, which forgot the window's profile and refused two pixels a grain."""
    setup = setup_of(grain, 256)
    images = frames(hidden(setup, 4), grain, 256, seed=3)
    noise = ELECTRONS * camera_noise(images, grain, "unknown", "disc")
    assert noise.mean() == pytest.approx(1, abs=0.3)  # six standard errors at 1.6
    assert setup.pixel_integration == (grain < 2)


def test_a_setup_of_fine_speckle_is_assessed():
    setup = setup_of(1.6, 128)
    found = reconstruct(frames(hidden(setup, 1), 1.6, 128, seed=4)[:, None], setup, fast=True)
    assert found.each[0].speckle.passes


@pytest.mark.slow
@pytest.mark.parametrize("grain", [1.6, 2.5])
def test_objects_are_found_behind_fine_speckle(grain):
    """Medians of eight are 0.88 and 0.92, standard errors 0.02; what is not reconstructed has 0.5."""
    setup = setup_of(grain, 256, exposure={"photons": ELECTRONS})
    batch = setup.batch(0, "test", range(8))
    objects = torch.from_numpy(np.asarray(batch["object"]))
    images = frames(objects.numpy(), grain, 256, seed=5)
    truth = on_frame(objects, dark=False)
    numbers = {name: torch.as_tensor(np.asarray(each)) for name, each in batch["parameters"].items()}
    phase = katz(camera=setup.exposure, profile="disc")({"image": images, "object": objects, "parameters": numbers})
    solved = reconstruct(images[:, None], setup, fast=True)
    for made, least in ((phase, 0.8), (torch.from_numpy(np.stack([each.image for each in solved.each])), 0.85)):
        assert pearson(align(on_frame(made), truth), truth).median() > least
