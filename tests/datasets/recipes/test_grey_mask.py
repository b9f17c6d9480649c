"""Grey masks of "masked-light": against a Rayleigh-Sommerfeld sum and against open squares; files, refusals."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.datasets import load_recipe

SMALL = {"material": {"kernel_paths": 2000}, "camera": {"shape": [48, 48]}}
WIDTH, WAVELENGTH = 100.0, 0.5


def recipe(mask, **changes):
    table = {**SMALL, "window": {"width": WIDTH}, "beams": 101, **changes}
    return load_recipe("star-behind-slab", table).replace(mask=mask)


def series(made, side):
    """Field complex[n, n] on the slab of the first sample's mask, at places ``side`` in windows."""
    numbers = made.mask.drawn(np.random.default_rng(0))
    waves = made._behind(made.mask.waves(numbers, *made._lattice)[0])
    wave = np.exp(2j * np.pi * np.outer(side, np.arange(101) - 50))
    return wave @ waves @ wave.T


def summed(amplitudes, size, turn, waist, distance, side):
    """Rayleigh-Sommerfeld integral I over a mask of ``size``, 8 x 8 points a pixel, less the phase of the axis."""
    fine = np.kron(amplitudes, np.ones((8, 8)))
    rows, columns = fine.shape
    pitch = size / max(rows, columns)
    x, y = np.meshgrid((np.arange(columns) - (columns - 1) / 2) * pitch, (np.arange(rows) - (rows - 1) / 2) * pitch)
    c, s = np.cos(turn), np.sin(turn)
    source = np.stack([c * x - s * y, s * x + c * y], axis=-1).reshape(-1, 2)
    light = fine.ravel() * (1 if waist is None else np.exp(-np.square(source / waist).sum(axis=1)))
    at = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) * WIDTH
    r = np.sqrt(np.square(at[:, None] - source).sum(axis=-1) + distance**2)
    k = 2 * np.pi / WAVELENGTH
    kernel = distance / (2 * np.pi) * (1 / r - 1j * k) * np.exp(1j * k * (r - distance)) / r**2
    return (kernel @ light * pitch**2).reshape(len(side), len(side))


def grey():
    """A spot aside of the middle with a shoulder, so that turns and flips are seen; 12 x 16."""
    x, y = np.meshgrid(np.linspace(-1, 1, 16), np.linspace(-1, 1, 12))
    spot = np.exp(-4 * ((x - 0.2) ** 2 + (y + 0.15) ** 2)) + 0.5 * np.exp(-8 * ((x + 0.3) ** 2 + (y - 0.2) ** 2))
    return np.where(spot > 0.03, spot / spot.max(), 0.0)


@pytest.mark.parametrize(("turn", "waist"), [(0.0, None), (0.7, None), (0.7, 12.0)])
def test_field_behind_a_grey_mask(turn, waist):
    """Within 1 % of the integral in l2; intensities taken for amplitudes, another turn and even light are caught."""
    side, share = np.linspace(-0.2, 0.2, 9), grey()
    mask = {"values": np.square(share).tolist(), "transmission": "intensity", "size": 0.4, "turn": turn}
    ours = series(recipe(mask, distance=100.0, waist=waist), side)
    exact = summed(share, 0.4 * WIDTH, turn, waist, 100.0, side)
    off = lambda field: np.linalg.norm(field - exact) / np.linalg.norm(exact)  # noqa: E731
    assert off(ours) < 0.01
    wrong = [{**mask, "transmission": "amplitude"}, {**mask, "turn": -turn - 0.1}, {**mask, "size": 0.42}]
    assert min(off(series(recipe(each, distance=100.0, waist=waist), side)) for each in wrong) > 0.03
    assert off(series(recipe(mask, distance=115.0, waist=waist), side)) > 0.02
    if waist:
        assert off(series(recipe(mask, distance=100.0), side)) > 0.3


@pytest.mark.parametrize("waist", [None, 15.0])
def test_a_white_mask_is_an_open_square(waist):
    """The waves, power and picture of a slit as long as it is wide, whatever the turn."""
    numbers, order = {"mask_size": 0.3, "mask_turn": 0.4}, np.arange(15) - 7
    white = recipe({"values": np.ones((5, 5)).tolist(), "transmission": "amplitude"}, waist=waist).mask
    slit = recipe({"width": 0.3, "gap": 0.1, "length": 0.3, "count": 1, "turn": 0.4}, waist=waist).mask
    same = {"slit_count": 1, "slit_width": 0.3, "slit_gap": 0.1, "slit_length": 0.3, "slit_turn": 0.4}
    waist = waist and waist / WIDTH
    (ours, power), (exact, passed) = white.waves(numbers, order, waist), slit.waves(same, order, waist)
    assert ours == pytest.approx(exact, abs=1e-9)
    assert power == pytest.approx(passed, rel=1e-9)
    assert white.area(numbers) == pytest.approx(0.09)
    assert white.picture(numbers, 32) == pytest.approx(slit.picture(same, 32), abs=0.1)
    assert white.picture(numbers, 32).mean() == pytest.approx(0.09, rel=0.01)


def test_a_sample_from_a_file(tmp_path):
    """A picture of 8 bits is shares of 255; it counts by content, and lies beside the recipe's file."""
    from PIL import Image

    levels = np.round(255 * grey()).astype(np.uint8)
    Image.fromarray(levels).save(tmp_path / "mask.png")
    (tmp_path / "one.toml").write_text(
        'inherits = "star-behind-slab"\nname = "grey"\nbeams = 15\n'
        '[mask]\npath = "mask.png"\ntransmission = "amplitude"\nsize = { uniform = [0.4, 0.6] }\n'
    )
    made = load_recipe(tmp_path / "one.toml", SMALL)
    sample = made.sample(0, "train", 0)
    size = sample["parameters"]["mask_size"]
    assert 0.4 < size < 0.6
    assert sample["parameters"]["open_share"] == pytest.approx(np.square(levels / 255).sum() * (size / 16) ** 2)
    assert sample["mask"].mean() == pytest.approx(sample["parameters"]["open_share"], rel=0.02)
    assert 0.9 < sample["parameters"]["carried_share"] < 1
    assert np.isfinite(sample["image"]).all()
    assert np.array_equal(sample["image"], made.sample(0, "train", 0)["image"])

    np.save(tmp_path / "same.npy", levels)
    (tmp_path / "mask.png").rename(tmp_path / "moved.png")
    moved = load_recipe(tmp_path / "one.toml", {**SMALL, "mask": {"path": str(tmp_path / "moved.png")}})
    other = load_recipe(tmp_path / "one.toml", {**SMALL, "mask": {"path": str(tmp_path / "same.npy")}})
    assert moved.fingerprint() == made.fingerprint() != other.fingerprint()
    assert other.mask.amplitudes == pytest.approx(moved.mask.amplitudes)


GIVEN = {"values": [[0.5, 1.0]], "transmission": "amplitude"}


@pytest.mark.parametrize(("mask", "message"), [
    ({**GIVEN, "values": [[0.5, 1.5]]}, "from 0 to 1"), ({**GIVEN, "values": [[0.0, 0.0]]}, "not 0 everywhere"),
    ({**GIVEN, "values": [0.5]}, "of shape"), ({**GIVEN, "path": "mask.png"}, "a path, or values"),
    ({"transmission": "amplitude"}, "a path, or values"), ({"values": [[1.0]]}, "transmission"),
    ({**GIVEN, "transmission": "power"}, "intensity"), ({**GIVEN, "size": 1.1}, "at most 1"),
    ({**GIVEN, "size": 0.8, "turn": 0.1}, "at any rotation"), ({**GIVEN, "size": 0.0}, "greater than 0"),
    ({"path": "nowhere.png", "transmission": "amplitude"}, "an existing file"),
])  # fmt: skip
def test_refused(mask, message):
    assert_refused(lambda: recipe(mask).sample(0, "train", 0), message)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("mask.png", b"no picture", "a readable picture"), ("mask.npy", None, "from 0 to 1"),
    ("mask.txt", b"1", "an existing file"),
])  # fmt: skip
def test_files_refused(tmp_path, name, content, message):
    if content is None:
        np.save(tmp_path / name, np.array([[0.5, 2.0]]))
    else:
        (tmp_path / name).write_bytes(content)
    given = {"path": str(tmp_path / name), "transmission": "amplitude"}
    assert_refused(lambda: recipe(given).sample(0, "train", 0), message)
