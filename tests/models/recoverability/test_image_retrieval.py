"""Phase retrieval from an image alone: what it finds of the setup, and the object, on even light and on uneven."""

from functools import lru_cache

import numpy as np
import pytest
import torch
from refusals import assert_refused
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.datasets import load_recipe
from specklegen.measured import read_curve
from specklegen.models import Retrieval, align, retrieve_image
from specklegen.models.metrics import pearson

QUICK = Retrieval(restarts=6, steps=5)


@lru_cache(maxsize=1)
def seen():
    """Image of an object behind ground glass, the object, camera pixels in its pixel and in a grain."""
    batch = load_recipe("ground-glass").batch(0, "test", range(2))
    drawn = batch["parameters"]
    step = float(drawn["object_pitch"][1] / drawn["camera_pitch"][1])
    grain = float(drawn["wavelength"][1] / drawn["width"][1] / drawn["camera_pitch"][1])
    return batch["image"][1].astype(float), batch["object"][1], step, grain


def score(found, brightness):
    whole = np.zeros((1, 64, 64), np.float32)
    whole[0, :28, :28] = brightness
    made, whole = torch.from_numpy(found.image)[None], torch.from_numpy(whole)
    return float(pearson(align(made, whole), whole)[0])


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_an_image_alone_gives_its_object(tilt):
    image, brightness, step, grain = seen()
    tilted = image * (1 + tilt * np.linspace(-1, 1, image.shape[1]))
    found = retrieve_image(tilted, pixel=step, retrieval=QUICK)
    assert score(found, brightness) > 0.8
    assert found.grain == pytest.approx(grain, rel=0.05)
    assert bool(found.measured.envelope_order) == (tilt > 0)
    if tilt:
        left_in = retrieve_image(tilted, pixel=step, retrieval=QUICK, envelope=None, extent=found.extent)
        assert left_in.taper > 0
        assert score(left_in, brightness) > 0.6


def test_what_is_given_is_used(tmp_path):
    image, *_ = seen()
    curve = tmp_path / "curve.csv"
    curve.write_text("distance,value\n0,1\n20,0.9\n40,0.6\n80,0.2\n")
    found = retrieve_image(
        np.stack([image, image]), grain=2.5, extent=40, noise=0, pixel=2, memory_effect=read_curve(curve),
        region=(0, 0, 96, 96), retrieval=Retrieval(restarts=1, steps=1), seed=1,
    )  # fmt: skip
    assert (found.grain, found.extent, found.noise, found.pixel) == (2.5, 40, 0, 2)
    assert found.measured.light.shape == (2, 96, 96)
    assert 0 < found.error < 1
    assert "speckle size" in str(found.facts())


def test_command(tmp_path):
    np.save(tmp_path / "frame.npy", seen()[0])
    asked = ["retrieve", str(tmp_path / "frame.npy"), "--restarts", "1", "--out", str(tmp_path / "new" / "seen.png")]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert "speckle size, camera pixels: 3.0" in done.output
    assert np.load(tmp_path / "new" / "seen.npy").shape == (64, 64)
    assert (tmp_path / "new" / "seen.png").exists()


def test_a_command_doubts_saturated_images(tmp_path):
    image = seen()[0]
    np.save(tmp_path / "frame.npy", np.minimum(4095 * image / np.median(image), 4095).astype(np.uint16))
    asked = ["retrieve", str(tmp_path / "frame.npy"), "--restarts", "1", "--out", str(tmp_path / "seen.png")]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert "doubt: 47 % of pixels saturated" in done.output


def test_refusals():
    image = seen()[0]
    assert_refused(lambda: retrieve_image(image[:20]), "at least 32")
    assert_refused(lambda: retrieve_image(np.ones((64, 64)), envelope=None), "must be of speckle.*(even|contrast)")
    assert_refused(lambda: retrieve_image(image, grain=-1.0), "retrieve_image grain")
    assert_refused(lambda: retrieve_image(image, extent=90, pixel=1), "at most 32 object pixels")
