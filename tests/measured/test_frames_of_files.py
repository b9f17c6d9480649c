"""Frames that other libraries wrote come back number by number; what cannot be read is refused by field and remedy."""

import re

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import assert_refused
from scenes import ROOT
from scipy.io import savemat

from specklegen.core.errors import RuleError
from specklegen.measured import read_measurement
from specklegen.measured.files import FRAME_FILES, read_raw

COUNTS = np.random.default_rng(0).integers(1, 4000, (3, 24, 31)).astype(np.uint16)
BYTES = (COUNTS // 16).astype(np.uint8)


def pages(path, frames, **options):
    first, *rest = [Image.fromarray(frame) for frame in frames]
    first.save(path, save_all=True, append_images=rest, **options)


def write_bmp(folder):
    for n, frame in enumerate(BYTES):
        Image.fromarray(frame).save(folder / f"frame_{8 + n}.bmp")  # 8, 9, 10: by value, not by letter
    return folder, BYTES


def write_png(folder):
    for n, frame in enumerate(COUNTS):
        Image.fromarray(frame).save(folder / f"f{n}.png")
    return f"{folder}/f*.png", COUNTS


def write_lzw(folder):
    pages(folder / "many.tif", COUNTS, compression="tiff_lzw")
    return folder / "many.tif", COUNTS


def write_tiff(folder):
    for n, frame in enumerate(COUNTS):
        tifffile.imwrite(folder / f"{n}.tiff", frame)
    return [folder / "2.tiff", str(folder / "0.tiff")], COUNTS[[2, 0]]


def write_numpy(folder):
    np.save(folder / "f.npy", COUNTS.astype(np.float64) / 7)
    return str(folder / "f.npy"), COUNTS / 7


def write_matlab(folder):
    savemat(folder / "data.mat", {"raw": np.moveaxis(COUNTS, 0, -1), "fps": 30.0, "name": "flow"}, do_compression=True)
    return folder / "data.mat", COUNTS


def write_array(folder):
    return COUNTS[0], COUNTS[:1]


def write_film(path, frames, codec, pixels, source):
    """Write a film by FFmpeg, of frames whose pixels are of the type ``source``."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as film:
        stream = film.add_stream(codec, rate=10)
        stream.height, stream.width, stream.pix_fmt = *frames.shape[1:3], pixels
        for frame in frames:
            film.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format=source)))
        film.mux(stream.encode())
    return path


def write_raw_avi(folder):
    grey = BYTES[..., :30]
    return write_film(folder / "f.avi", np.repeat(grey[..., None], 3, -1), "rawvideo", "bgr24", "bgr24"), grey


def write_ffv1(folder):
    return write_film(folder / "f.mkv", COUNTS[..., :30], "ffv1", "gray16le", "gray16le"), COUNTS[..., :30]


def write_spe(folder):
    head = np.zeros(4100, np.uint8)
    head[108], head[42], head[656], head[1446] = 3, 31, 24, 3  # uint16; columns, rows, frames
    (folder / "f.spe").write_bytes(head.tobytes() + COUNTS.astype("<u2").tobytes())
    return folder / "f.spe", COUNTS


FILMS = [write_raw_avi, write_ffv1, write_spe]
WRITERS = [write_bmp, write_png, write_lzw, write_tiff, write_numpy, write_matlab, write_array, *FILMS]


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
def test_numbers_are_those_that_were_written(write, tmp_path):
    source, expected = write(tmp_path)
    found = read_measurement(source, hot_pixels=False)
    assert np.array_equal(found.light, expected)
    assert found.good.all()
    assert len(found.files) == {write_array: 0, write_tiff: 2, write_bmp: 3, write_png: 3}.get(write, 1)


@pytest.mark.filterwarnings("ignore:.*stored as RGB with separate component planes:DeprecationWarning")
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_frames_by_the_defaults_of_tifffile(count, tmp_path):
    """Three and four frames are stored as planes of one page."""
    frames = np.resize(COUNTS, (count, 24, 31))
    tifffile.imwrite(tmp_path / "f.tif", frames)
    assert np.array_equal(read_measurement(tmp_path / "f.tif", hot_pixels=False).light, frames)


def test_frames_appended_one_by_one(tmp_path):
    for frame in COUNTS:
        tifffile.imwrite(tmp_path / "f.tif", frame, append=True)
    assert np.array_equal(read_measurement(tmp_path / "f.tif", hot_pixels=False).light, COUNTS)
    tifffile.imwrite(tmp_path / "f.tif", COUNTS[0, :20], append=True)
    assert_refused(lambda: read_measurement(tmp_path / "f.tif"), "its pages have the shapes")


def test_files_named_by_metadata_are_not_read(tmp_path):
    """OME metadata may spread a stack over several files; a file has its own pages alone."""
    tifffile.imwrite(tmp_path / "other.ome.tif", COUNTS, metadata={"axes": "TYX"})
    described = tifffile.tiffcomment(tmp_path / "other.ome.tif")
    assert "<TiffData" in described
    described = described.replace("<TiffData", '<TiffData FirstT="1"', 1)
    tifffile.imwrite(tmp_path / "f.ome.tif", COUNTS[0], description=described, metadata=None)
    assert np.array_equal(read_measurement(tmp_path / "f.ome.tif", hot_pixels=False).light, COUNTS[:1])


@pytest.fixture
def h5py():
    return pytest.importorskip("h5py")


def test_hdf5_and_the_newest_matlab(h5py, tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/frames"] = COUNTS
        file["run/time"] = np.arange(3.0)
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/frames")
    assert np.array_equal(read_measurement(tmp_path / "a.h5", hot_pixels=False).light, COUNTS)
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file["raw"] = COUNTS.transpose(0, 2, 1)  # MATLAB's [h, w, n] from its last axis to its first
        file["raw"].attrs["MATLAB_class"] = np.bytes_("uint16")
        file["note"] = np.ones((2, 9), np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    with (tmp_path / "b.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    assert np.array_equal(read_measurement(tmp_path / "b.mat", hot_pixels=False).light, COUNTS)


def test_files_without_their_library_name_the_extra(tmp_path, monkeypatch):
    for library in ("h5py", "av"):
        monkeypatch.setitem(__import__("sys").modules, library, None)
    for name, extra in (("a.h5", "hdf5"), ("b.mat", "hdf5"), ("c.avi", "video")):
        (tmp_path / name).write_bytes(b"MATLAB 7.3 MAT-file" + bytes(4100))
        with pytest.raises(ImportError, match=re.escape(f'pip install "specklegen-torch[{extra}]"')):
            read_measurement(tmp_path / name)


def test_films_of_colours_of_loss_and_in_the_clothes_of_others_are_refused(tmp_path):
    colours = np.stack([BYTES[..., :30], BYTES[..., 1:], BYTES[..., :30]], -1)
    films = ("a.avi", "rawvideo", "bgr24", "colours"), ("b.mov", "mjpeg", "yuvj420p", "is lossy")
    for name, codec, pixels, told in films:
        write_film(tmp_path / name, colours, codec, pixels, "bgr24")
        assert_refused(lambda name=name: read_measurement(tmp_path / name), told)
    write_ffv1(tmp_path)
    (tmp_path / "list.avi").write_text("ffconcat version 1.0\nfile f.mkv\n")  # FFmpeg by itself would read f.mkv
    assert_refused(lambda: read_measurement(tmp_path / "list.avi"), "Reading the file failed")


def test_all_unreadable_files_of_a_folder_are_named(tmp_path):
    for n in range(3):
        (tmp_path / f"{n}.png").write_bytes(b"no picture")
    with pytest.raises(RuleError) as error:
        read_measurement(tmp_path)
    assert all(f"{n}.png" in str(error.value) for n in range(3))


def test_one_of_several_arrays_is_named(tmp_path):
    savemat(tmp_path / "d.mat", {"raw": np.moveaxis(COUNTS, 0, -1), "truth": COUNTS[0]})
    with pytest.raises(RuleError, match="read_measurement source must be files .* variable=.*raw 24 x 31 x 3, truth"):
        read_measurement(tmp_path / "d.mat")
    found = read_measurement(tmp_path / "d.mat", variable="truth", hot_pixels=False)
    assert np.array_equal(found.light, COUNTS[:1])
    assert_refused(lambda: read_measurement(tmp_path / "d.mat", variable="im"), 'no frames named "im"')


def write_two(folder):
    """Files of two measurements, as people have them."""
    for name, other in (("same", COUNTS), ("sizes", COUNTS[:, :9]), ("types", COUNTS / 7)):
        with tifffile.TiffWriter(folder / f"{name}.tif") as file:
            file.write(COUNTS, photometric="minisblack")
            file.write(other, photometric="minisblack")
    np.save(folder / "two.npy", np.stack([COUNTS, COUNTS]))
    savemat(folder / "two.mat", {"raw": np.stack([COUNTS, COUNTS])})


@pytest.mark.parametrize(("name", "told"), [
    ("sizes.tif", "each measurement to its own file"), ("types.tif", "each measurement to its own file"),
    ("two.npy", r"uint16 of the shape (2, 3, 24, 31), not frames of grey counts [h, w] or [n, h, w]"),
    ("two.mat", "it holds no frames [h, w] or [n, h, w]: raw 2 x 3 x 24 x 31"),
])  # fmt: skip
def test_two_measurements_in_a_file_are_refused_with_the_remedy(name, told, tmp_path):
    write_two(tmp_path)
    assert_refused(lambda: read_measurement(tmp_path / name), re.escape(told))


def test_two_measurements_of_one_size_and_type_are_read_whole(tmp_path):
    write_two(tmp_path)
    assert np.array_equal(read_raw("frames", tmp_path / "same.tif").frames, np.concatenate([COUNTS, COUNTS]))


def test_two_data_sets_and_two_films(tmp_path):
    h5py, av = pytest.importorskip("h5py"), pytest.importorskip("av")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["one"], file["group/two"] = COUNTS, COUNTS[:2]
    told = "choose one array by variable=: it has group/two 2 x 24 x 31, one 3 x 24 x 31"
    assert_refused(lambda: read_measurement(tmp_path / "a.h5"), told)
    assert len(read_raw("frames", tmp_path / "a.h5", "group/two").frames) == 2
    with av.open(str(tmp_path / "a.mkv"), "w") as film:
        streams = [film.add_stream("ffv1", rate=5, width=30, height=24, pix_fmt="gray") for _ in range(2)]
        for stream in streams:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(BYTES[0, :, :30]), format="gray")
            film.mux([*stream.encode(frame), *stream.encode()])
    assert_refused(lambda: read_measurement(tmp_path / "a.mkv"), "2 films: write each to a file of its own")


def test_the_list_of_formats_is_the_true_one(tmp_path):
    """Whatever is listed has a reader, whatever has one is listed, and the page for users names each."""
    (tmp_path / "a.xyz").write_bytes(b"0")
    with pytest.raises(RuleError) as refused:
        read_measurement(tmp_path / "a.xyz")
    listed = re.findall(r"\.\w+(?=[,;])", str(refused.value).partition("end in")[2])
    assert tuple(listed) == FRAME_FILES
    page = (ROOT / "docs" / "measured.md").read_text().partition("## Read frames")[2].partition("##")[0].lower()
    names = {".tif": "tiff", ".h5": "hdf5", ".mat": "matlab"}
    assert all(str(names.get(ending, ending.strip("."))) in page for ending in listed)
    for ending in listed:
        (tmp_path / f"a{ending}").write_bytes(b"0")
        with pytest.raises((RuleError, ImportError)) as refused:
            read_measurement(tmp_path / f"a{ending}")
        assert "end in" not in str(refused.value)


def test_a_folder_leaves_out_what_are_no_frames_and_doubts_dark_ones(tmp_path):
    np.save(tmp_path / "light.npy", COUNTS)
    np.save(tmp_path / "dark_1.npy", COUNTS // 100)
    (tmp_path / "notes.txt").write_text("Tuesday")
    found = read_measurement(tmp_path)
    assert found.light.shape[0] == 6
    assert any("1 file of" in line and "left out" in line for line in found.assumed)
    assert any("dark_1.npy suggests a dark or flat frame" in line for line in found.doubts)
    assert "doubt: " in found.explain()
    assert repr(found) == "Measurement(light=float64[6, 24, 31], doubts=<2 texts>)"
    assert found.facts()["frames"].startswith("6 of 24 x 31 pixels")


def bad_files(folder):
    np.save(folder / "a.npy", COUNTS)
    np.save(folder / "small.npy", COUNTS[:, :20])
    np.save(folder / "words.npy", np.array([["a", "b"]]))
    (folder / "empty").mkdir()
    (folder / "photo.jpg").write_bytes(b"\xff\xd8")
    (folder / "half.tif").write_bytes(b"II*\0\x08\0\0\0")
    Image.fromarray(np.zeros((20, 20, 3), np.uint8)).save(folder / "colours.png")


@pytest.mark.parametrize(("name", "told"), [
    ("absent.tif", "an existing file, folder or pattern of frames"),
    ("none_*.tif", "an existing file, folder or pattern of frames"),
    ("zero\0.tif", "an existing file, folder or pattern"),
    ("empty", r"A folder holds frames as \.tif"), ("photo.jpg", "compression is lossy"),
    ("half.tif", "that can be read"), ("colours.png", "colours"), ("words.npy", "read|grey"),
    ("*.npy", "frames of one size"),
])  # fmt: skip
def test_refusals_of_files(name, told, tmp_path):
    bad_files(tmp_path)
    if name == "*.npy":
        (tmp_path / "words.npy").unlink()
    assert_refused(lambda: read_measurement(f"{tmp_path}/{name}"), f"^read_measurement source must be .*({told})")


FLAT = np.full((24, 31), 3000.0)


@pytest.mark.parametrize(("field", "given", "told"), [
    ("source", {"source": b"abc"}, "array"), ("source", {"source": np.ones((2, 2, 2, 2))}, r"\[h, w\]"),
    ("source", {"source": np.ones((20, 4))}, "at least 8 x 8"),
    ("source", {"source": np.full((20, 20), np.nan)}, "finite"),
    ("source", {"source": np.zeros((20, 20))}, "brighter than the black level"),
    ("source", {"source": COUNTS + 1j}, "real numbers"),
    ("source", {"source": np.full((20, 20), 1e30)}, "at most 1e.18"), ("variable", {"variable": 3}, "name of an array"),
    ("hot_pixels", {"hot_pixels": "no"}, "True or False"), ("region", {"region": np.array(4.0)}, "find"),
    ("frames", {"frames": "a"}, "whole number"), ("bit_depth", {"bit_depth": np.ones(3)}, "whole number"),
    ("dark", {"dark": 1e6}, "darker than the frames"), ("dark", {"dark": float("nan")}, "finite"),
    ("dark", {"dark": np.ones((9, 9))}, "24 x 31"), ("dark", {"dark": np.full((24, 31), np.inf)}, "finite everywhere"),
    ("flat", {"flat": FLAT[:9]}, "24 x 31"),
    ("flat", {"flat": FLAT, "dark": COUNTS[0] * 0 + 3001, "source": COUNTS + 9000}, "even light"),
    ("envelope", {"envelope": -FLAT}, "greater than 0"), ("envelope", {"envelope": "gone.tif"}, "file"),
    ("envelope", {"envelope": "fit", "dark": 1990.0}, "above the black level everywhere"),
    ("region", {"region": (0, 0, 99, 9)}, "inside the frame of 24 x 31"),
    ("region", {"region": (0, 0, 4, 9)}, "at least 8 x 8"), ("region", {"region": "all"}, "find"),
    ("region", {"region": (0.5, 0, 9, 9)}, "whole number"), ("frames", {"frames": 3}, "at most 2"),
    ("frames", {"frames": slice(7, 9)}, "some of the 3"), ("frames", {"frames": slice("a", None)}, "slice"),
    ("bit_depth", {"bit_depth": 8}, "enough for counts"), ("bit_depth", {"bit_depth": 40}, "at most 16"),
    ("bit_depth", {"bit_depth": 12, "source": COUNTS / 7}, "not whole"),
])  # fmt: skip
def test_refusals_by_field(field, given, told):
    arguments = {"source": COUNTS} | given
    assert_refused(lambda: read_measurement(**arguments), rf"^read_measurement {field} must be .*{told}")


def test_the_size_is_judged_before_the_numbers_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("specklegen.measured.array_files.MOST_PIXELS", 1000)
    monkeypatch.setattr("specklegen.measured.files.MOST_PIXELS", 1000)
    savemat(tmp_path / "d.mat", {"raw": COUNTS})
    np.save(tmp_path / "d.npy", COUNTS)
    for name in ("d.mat", "d.npy"):
        with pytest.raises(RuleError, match="1000"):
            read_measurement(tmp_path / name)


def write_hdf5(folder):
    with pytest.importorskip("h5py").File(folder / "a.h5", "w") as file:
        file.create_dataset("frames", data=COUNTS, compression="gzip")


DAMAGED = [write_bmp, write_png, write_lzw, write_tiff, write_numpy, write_matlab, write_hdf5, *FILMS]


@pytest.mark.parametrize("write", DAMAGED)
def test_damaged_files_are_refused_or_read_and_nothing_else(write, tmp_path):
    """Bytes changed, cut off and doubled, 40 times a format: a RuleError or a Measurement."""
    write(tmp_path)
    path = sorted(tmp_path.iterdir())[0]
    whole = path.read_bytes()
    refused = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        damaged = bytearray(whole)
        for at in rng.integers(0, min(len(whole), 400 if seed % 2 else len(whole)), rng.integers(1, 9)):
            damaged[at] = rng.integers(256)
        if seed % 4 == 0:
            damaged = damaged[: rng.integers(len(whole))]
        path.write_bytes(damaged)
        try:
            assert read_measurement(path).light.ndim == 3
        except RuleError:
            refused += 1
    assert refused >= 10  # those that were cut off


def test_a_small_file_that_unfolds_to_a_large_one_is_refused(tmp_path):
    header = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    text = b"{'descr': '|u1', 'fortran_order': False, 'shape': (1, 100000, 100000), }"
    (tmp_path / "bomb.npy").write_bytes(header + text.ljust(117) + b"\n")
    assert_refused(lambda: read_measurement(tmp_path / "bomb.npy"), "read_measurement source")
