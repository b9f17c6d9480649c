"""Files that others send: a seeded subset of tests/fuzz_files.py, and HDF5 that asks for more than it holds."""

import logging
from importlib.util import find_spec

import numpy as np
import pytest
from fuzz_files import FORMATS, run

from specklegen.core.errors import RuleError
from specklegen.instrument.frames import read_frames
from specklegen.measured.files import read_raw
from specklegen.models.judging.entries import read_entry


def formats():
    needs = {".h5": "h5py", ".avi": "av", ".mkv": "av"}
    return tuple(suffix for suffix in FORMATS if find_spec(needs.get(suffix, "numpy")))


def test_a_mutated_file_is_read_or_refused_with_a_sentence(tmp_path):
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    counts = run(450, tmp_path, seed=1, formats=formats())
    assert [outcome for _, outcome in counts if outcome.startswith("raw")] == []
    assert {suffix for suffix, outcome in counts if outcome == "refused"} == set(formats())


def test_a_chunk_that_unpacks_to_gigabytes_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        file.create_dataset("frames", (2, 8, 8), np.uint8, maxshape=(None, None, None), chunks=(512, 1024, 1024))
    with pytest.raises(RuleError, match="decompress to more than 256 MiB"):
        read_raw("frames", tmp_path / "bomb.h5")


def test_a_virtual_data_set_of_another_file_is_not_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["frames"] = np.full((2, 8, 8), 7)
    with h5py.File(tmp_path / "sent.h5", "w") as file:
        layout = h5py.VirtualLayout((2, 8, 8), int)
        layout[:] = h5py.VirtualSource(tmp_path / "secret.h5", "frames", (2, 8, 8))
        file.create_virtual_dataset("frames", layout)
    with pytest.raises(RuleError, match="holds no frames"):
        read_raw("frames", tmp_path / "sent.h5")


def test_a_refusal_lists_the_endings_that_are_read(tmp_path):
    with pytest.raises(ValueError, match=r"none of \.tif, \.tiff, \.png, \.bmp, \.npy, \.avi, \.mkv, \.mov, \.spe$"):
        read_frames(tmp_path / "a.gif")


def test_an_entry_without_end_or_of_gigabytes_is_refused(tmp_path, monkeypatch):
    (tmp_path / "deep.json").write_text('{"tasks": ' * 100_000)
    with pytest.raises(RuleError, match="nested at most 64"):
        read_entry(tmp_path / "deep.json")
    monkeypatch.setattr("specklegen.core.tables.LARGEST_TEXT", 9)
    with pytest.raises(RuleError, match="a text file of at most"):
        read_entry(tmp_path / "deep.json")


@pytest.mark.parametrize("type_", [[], {}, None, 3])
def test_a_type_that_is_no_name_is_refused(type_):
    import specklegen as sg

    parts = dict.fromkeys(("medium", "sensor", "illumination"))
    for field in parts:
        with pytest.raises(RuleError):
            sg.Scene(wavelength=0.5, **parts | {field: {"type": type_}})
