"""Reading pictures that people put into a folder: odd ones are read, dangerous ones refused by their headers."""

import struct
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets.objects.folder import Folder
from specklegen.datasets.objects.glyphs import Glyphs
from specklegen.datasets.objects.pictures import MOST_PIXELS, SUFFIXES, read_grey

RAMP = np.linspace(0.1, 1, 12).reshape(3, 4)
SIDE = 9000  # squared above the limit, and below that of Pillow, which has a word of its own


def _png(path, width: int, height: int) -> None:
    """A PNG whose header promises a size, and whose data are a few bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    content = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + content)


def _npy(path, shape: tuple[int, ...]) -> None:
    """An NPY file with a header and no data: a hole as long as the header says."""
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|u1", "fortran_order": False, "shape": shape})
        file.truncate(file.tell() + int(np.prod(shape)))


def _tiff(path) -> None:
    """A small file that holds a large picture: zeros, compressed."""
    tifffile.imwrite(path, np.zeros((SIDE, SIDE), np.uint8), compression="zlib", rowsperstrip=SIDE)


@pytest.mark.parametrize("name", ["large.png", "large.npy", "large.tif"])
def test_a_large_picture_in_a_small_file_is_refused_by_its_header(tmp_path, name):
    path = tmp_path / name
    {"large.png": lambda: _png(path, SIDE, SIDE), "large.npy": lambda: _npy(path, (SIDE, SIDE)),
     "large.tif": lambda: _tiff(path)}[name]()  # fmt: skip
    with pytest.raises(ValueError, match=f"{SIDE * SIDE} pixels, more than {MOST_PIXELS}"):
        read_grey(path)


def test_a_picture_of_another_format_is_not_decoded(tmp_path):
    """A file is what its name says: a TIFF, or anything else that Pillow reads, does not pass for a PNG."""
    Image.fromarray((RAMP * 255).astype(np.uint8)).save(tmp_path / "true.tif")
    (tmp_path / "false.png").write_bytes((tmp_path / "true.tif").read_bytes())
    with pytest.raises(OSError, match="cannot identify"):
        read_grey(tmp_path / "false.png")


def test_odd_pictures_are_read(tmp_path):
    """RGBA, 16 bits, floats, palettes: the same grey picture, to the rounding of its format."""
    eight, sixteen = np.rint(RAMP * 255).astype(np.uint8), np.rint(RAMP * 65535).astype(np.uint16)
    opaque = np.dstack([eight, eight, eight, np.full_like(eight, 255)])
    Image.fromarray(opaque).save(tmp_path / "rgba.png")
    Image.fromarray(sixteen).save(tmp_path / "sixteen.png")
    Image.fromarray(eight).convert("P").save(tmp_path / "palette.png")
    tifffile.imwrite(tmp_path / "sixteen.tiff", sixteen)
    tifffile.imwrite(tmp_path / "float.tif", RAMP.astype(np.float32))
    np.save(tmp_path / "colour.npy", np.dstack([RAMP] * 3))
    for path in sorted(tmp_path.iterdir()):
        read = read_grey(path)
        assert np.abs(read / read.max() - RAMP).max() < 0.5 / 255 + 1e-6, path.name  # half a step of eight bits


def test_compressed_and_palette_tiffs_and_thumbnails_are_read(tmp_path):
    """tifffile has no codec for the first, and takes the second for grey numbers."""
    eight = np.rint(RAMP * 255).astype(np.uint8)
    Image.fromarray(eight).save(tmp_path / "lzw.tif", compression="tiff_lzw")
    Image.fromarray(eight).convert("P").save(tmp_path / "palette.tif")
    with tifffile.TiffWriter(tmp_path / "thumbnail.tif") as file:
        file.write(np.dstack([eight] * 3))
        file.write(np.dstack([eight[:1, :2]] * 3), subfiletype=1)
    for path in sorted(tmp_path.iterdir()):
        read = read_grey(path)
        assert np.abs(read / read.max() - RAMP).max() < 0.5 / 255 + 1e-6, path.name


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_corrupt_picture_is_named(tmp_path, suffix):
    (tmp_path / f"torn{suffix}").write_bytes(b"\x89PNG no more")
    with pytest.raises(RuleError, match=rf"Folder picture must be readable; got '.*torn{suffix}'"):
        Folder(path=str(tmp_path)).sources()


@pytest.mark.parametrize("columns", [3, 4])
def test_pages_are_no_colours(tmp_path, columns):
    """3000 pages of 4 x 4 pixels were read as one picture of 3000 x 4 pixels, red, green, blue and opacity."""
    tifffile.imwrite(tmp_path / "pages.tif", np.ones((30, 4, columns), np.uint8), photometric="minisblack")
    with pytest.raises(ValueError, match="not one grey or colour picture"):
        read_grey(tmp_path / "pages.tif")


def test_objects_beyond_memory_are_refused():
    """A batch of them is held at a time; [10000, 10000] pixels ended in a raw error of memory, or in hours."""
    assert_refused(lambda: Glyphs(shape=(10**6, 10**6)), "Glyphs.shape must be of at most")
