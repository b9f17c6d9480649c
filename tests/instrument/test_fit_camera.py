"""Fitted cameras: five numbers with their errors, and frames that no camera can be fitted to."""

import json
import tomllib

import numpy as np
import pytest
from PIL import Image
from refusals import assert_refused
from scipy.ndimage import gaussian_filter, shift
from tifffile import imwrite
from typer.testing import CliRunner
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.cli.commands import app
from specklegen.instrument import Camera, NoiseStreams, expose, read_frames


def speckle(side, seed, grain=1.2):
    parts = np.random.default_rng(seed).standard_normal((2, side, side))
    light = np.square(gaussian_filter(parts, (0, grain, grain), mode="wrap")).sum(axis=0)
    return light / light.mean()


def frames(camera, light, photons, seed, darks=4):
    """Pairs of these mean electrons a pixel, and dark frames."""
    pairs = [
        np.stack([expose(camera.replace(photons=float(n)), light, NoiseStreams.of([seed, k, one])) for one in (0, 1)])
        for k, n in enumerate(photons)
    ]
    cover = camera.replace(photons=1.0)
    return pairs, np.stack([expose(cover, 0 * light, NoiseStreams.of([seed, 999, n])) for n in range(darks)])


PLAIN = Camera(photons=1.0, gain=2.5, read_noise=3.0, offset=20.0, bit_depth=12)
LEVELS = np.geomspace(20, 400, 12)


def drawn(seed):
    """A camera of 10 to 14 bits that is full before its converter is."""
    rng = np.random.default_rng([9, seed])
    gain, bits = float(np.exp(rng.uniform(np.log(0.4), np.log(6)))), int(rng.choice([10, 12, 14]))
    read = float(rng.uniform(0.8, 3))  # counts
    offset = 8 * read + float(rng.uniform(0, 20))
    full = (2**bits - 1 - offset) * gain * float(rng.uniform(0.4, 0.8))
    return Camera(photons=1.0, gain=gain, read_noise=read * gain, offset=offset, full_well=full, bit_depth=bits)


def fit_drawn(number, draw, side):
    camera, light = drawn(number), speckle(side, [number, draw])
    full = camera.full_well
    photons = [*np.geomspace(full / 300, full / (1.3 * light.max()), 10), full / 3, full / 1.5]
    return camera, sg.fit_camera(*frames(camera, light, photons, 1000 * number + draw), bit_depth=camera.bit_depth)


NUMBERS = ("gain", "read_noise", "offset", "full_well")


def pulls(camera, fit):
    return [(getattr(fit, name) - getattr(camera, name)) / getattr(fit, f"{name}_error") for name in NUMBERS]


def test_ten_cameras():
    found = np.array([pulls(*fit_drawn(number, 0, 96)) for number in range(10)])
    assert_z(found, 0.0, 1.0)
    # Means over the cameras: an error of the size of its standard error in all of them is caught.
    assert_z(found.mean(axis=0), 0.0, np.sqrt(0.1))
    refute_z(found.mean(axis=0) + 3.0, 0.0, np.sqrt(0.1))


def test_speckle_of_twelve_levels():
    """The plain camera in speckle light: gain and read noise within their errors, which are .25 and .3 % at 256."""
    light = speckle(256, 1)
    pairs, dark = frames(PLAIN, light, LEVELS, 3)
    fit = sg.fit_camera(pairs, dark)
    assert_z([fit.gain, fit.read_noise, fit.offset], [2.5, 3.0, 20.0],
             [fit.gain_error, fit.read_noise_error, fit.offset_error])  # fmt: skip
    assert fit.gain_error < 0.0065
    assert fit.read_noise_error < 0.012
    assert fit.full_well is None
    assert all("bits are the fewest" in doubt for doubt in fit.doubts)
    # One frame's own variance, which is the light's, would say a gain near 0.
    assert pairs[-1][0].mean() / pairs[-1][0].var() < 0.1
    # Power: the fit of frames of a gain 3 % larger is told.
    other = sg.fit_camera(*frames(PLAIN.replace(gain=2.575), light, LEVELS, 3))
    refute_z(other.gain, 2.5, other.gain_error)


def test_a_lamp_that_drifts_is_told_and_does_no_harm():
    light = speckle(128, 2)
    first, dark = frames(PLAIN, light, LEVELS, 4)
    brighter, _ = frames(PLAIN, light, 1.01 * LEVELS, 5)
    fit = sg.fit_camera([np.stack([a[0], b[1]]) for a, b in zip(first, brighter, strict=True)], dark)
    # 1 % is told where a level's own noise leaves .17 % of its mean: from 60 electrons on.
    assert sum("changed by" in doubt for doubt in fit.doubts) > len(LEVELS) // 2
    assert not any("changed by" in doubt for doubt in sg.fit_camera(first, dark).doubts)
    assert_z([fit.gain, fit.read_noise], [2.5, 3.0], [fit.gain_error, fit.read_noise_error])


def test_hot_pixels_are_left_out_and_told():
    light = speckle(128, 3)
    pairs, dark = frames(PLAIN, light, LEVELS, 6)
    hot = np.random.default_rng(0).choice(128 * 128, 30, replace=False)
    own = np.random.default_rng(1)
    for stack in (*pairs, dark):
        stack.reshape(len(stack), -1)[:, hot] += own.poisson(400, (len(stack), 30)).astype(np.uint16)
    fit = sg.fit_camera(pairs, dark)
    assert fit.doubts[0] == "30 hot pixels left out, found in the dark frames"
    assert_z([fit.gain, fit.offset], [2.5, 20.0], [fit.gain_error, fit.offset_error])


def test_levels_with_a_saturated_pixel_are_left_out_whole():
    camera = PLAIN.replace(bit_depth=8)
    light = speckle(128, 4)
    pairs, dark = frames(camera, light, [10, 15, 25, 35, 45, 200, 400], 7)
    fit = sg.fit_camera(pairs, dark)
    assert fit.bit_depth == 8
    assert [level.used for level in fit.levels] == [pair.max() < 255 for pair in pairs]
    assert not fit.levels[-1].used
    assert fit.full_well is None
    assert_z(fit.gain, 2.5, fit.gain_error)


def test_dim_light_has_no_full_well():
    """Where the read noise is wider than the shot noise, all pixels are near the end, and none is full."""
    camera = PLAIN.replace(read_noise=10.0, gain=1.0, offset=100.0)
    fit = sg.fit_camera(*frames(camera, speckle(128, 8), [5, 10, 20, 40], 10))
    assert fit.full_well is None
    assert all(level.used for level in fit.levels)
    assert_z([fit.gain, fit.read_noise], [1.0, 10.0], [fit.gain_error, fit.read_noise_error])


@pytest.fixture(scope="module")
def good():
    return frames(PLAIN, speckle(64, 6), LEVELS[::3], 9)


def compressed(pair):
    """Through JPEG's transform of blocks of 8, in coarse steps."""
    from scipy.fft import dctn, idctn

    blocks = pair.astype(float).reshape(2, 8, 8, 8, 8)
    coarse = 16 * np.rint(dctn(blocks, axes=(2, 4), norm="ortho") / 16)
    return np.clip(np.rint(idctn(coarse, axes=(2, 4), norm="ortho")), 0, None).reshape(2, 64, 64)


BAD = {
    "single frames": (lambda p, d: ([pair[0] for pair in p], d),
                      "of shape .frames, rows, columns.*take two at one light level"),
    "copies": (lambda p, d: ([pair[[0, 0]] for pair in p], d), "a frame and its copy"),
    "three": (lambda p, d: ([pair[[0, 1, 1]] for pair in p], d), "of two frames each; got 3"),
    "few": (lambda p, d: (p[:2], d), "of at least 3 levels of light"),
    "one dark": (lambda p, d: (p, d[:1]), "dark must be at least two frames"),
    "moved": (lambda p,
              d: ([np.stack([a, np.rint(shift(b.astype(float), (0.5, 0), mode="nearest"))]) for a, b in p], d),
              "The pattern moved"),
    "JPEG": (lambda p, d: ([compressed(pair) for pair in p], d), "compressed .JPEG."),
    "8 bits in 16": (lambda p, d: ([257 * (pair // 16) for pair in p], d), "counts in steps of 1; got .steps of 257"),
    "12 bits in 16": (lambda p, d: ([16 * pair.astype(int) for pair in p], d), "divide pairs and dark frames by 16"),
    "normalised": (lambda p, d: ([pair / pair.max() for pair in p], d), "raw counts: whole numbers"),
    "colours": (lambda p, d: ([pair[..., None] for pair in p], d), "of shape .frames, rows, columns"),
    "text": (lambda p, d: ("abc", d), "frames of numbers"),
    "dark cut off": (lambda p, d: (p, np.maximum(d.astype(int) - 20, 0)), "no pixel is at 0"),
    "another light": (lambda p, d: ([np.stack([p[0][0], p[-1][0]]), *p[1:]], d), "of one light each; got 'means"),
    "another camera": (lambda p, d: (p, d[:, :32]), "of the dark frames' shape .32, 64."),
    "dark as bright": (lambda p, d: ([d[:2]] * 3, p[0]), "brighter than the dark frames"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_fitted_is_refused_with_its_reason(name, good):
    spoil, words = BAD[name]
    assert_refused(lambda: sg.fit_camera(*spoil(*good)), words)


@pytest.mark.parametrize(("bits", "words"), [(0, "at least 1 and at most 16"), (8, "enough for counts of")])
def test_bits_that_cannot_be_are_refused(bits, words, good):
    assert_refused(lambda: sg.fit_camera(*good, bit_depth=bits), words)


def test_the_command_writes_an_exposure_table(tmp_path, good):
    pairs, dark = good
    for level, pair in enumerate(pairs):
        for n, frame in enumerate(pair):
            Image.fromarray(frame.astype(np.uint16)).save(
                tmp_path / f"bright_{2 * level + n}.tif", compression="tiff_lzw"
            )
    imwrite(tmp_path / "dark.tif", dark.astype(np.uint16), photometric="minisblack")
    bright = sorted(str(file) for file in tmp_path.glob("bright_*.tif"))
    out, picture = tmp_path / "camera.toml", tmp_path / "curve.png"
    words = ["fit", "camera", "--pairs", *bright, "--dark", str(tmp_path / "d*.tif"), "--out", str(out)]
    result = CliRunner().invoke(app, [*words, "--picture", str(picture)])
    assert result.exit_code == 0, result.output
    expected = sg.fit_camera(pairs, dark)
    assert tomllib.loads(out.read_text())["exposure"] == pytest.approx(expected.table)
    assert "# photons" in out.read_text()
    assert "electrons a count" in result.output
    assert picture.stat().st_size > 1000
    told = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert told["gain"] == pytest.approx(expected.gain)
    assert told["gain_error"] == pytest.approx(expected.gain_error)
    odd = CliRunner().invoke(app, ["fit", "camera", "--pairs", bright[0], "--dark", bright[1]])
    assert "even number of frames" in str(odd.exception)


@pytest.mark.parametrize("suffix", [".tif", ".png", ".bmp", ".npy"])
def test_frames_are_read_as_they_are(tmp_path, suffix):
    deep = suffix != ".bmp"
    frame = np.arange(600).reshape(20, 30) % (600 if deep else 256)
    frame = frame.astype(np.uint16 if deep else np.uint8)
    file = tmp_path / f"frame{suffix}"
    if suffix == ".npy":
        np.save(file, frame)
    else:
        Image.fromarray(frame).save(file)
    assert np.array_equal(read_frames(file), frame[None])


def test_files_that_are_no_frames_say_why(tmp_path):
    colours = Image.fromarray(np.zeros((20, 30, 3), np.uint8))
    for name, words in (("a.png", "holds colours"), ("a.jpg", "compression is lossy"), ("a.tif", "grey counts"),
                        ("a.gif", "its file type is none of")):  # fmt: skip
        colours.save(tmp_path / name)
        with pytest.raises(ValueError, match=words):
            read_frames(tmp_path / name)
    np.save(tmp_path / "a.npy", np.zeros(3))
    with pytest.raises(ValueError, match="not frames of grey counts"):
        read_frames(tmp_path / "a.npy")
    asked = CliRunner().invoke(app, ["fit", "camera", "--pairs", str(tmp_path / "none.tif"), "--dark", "x"])
    assert "fit camera --pairs must be an existing file, folder or pattern of frames" in str(asked.exception)
