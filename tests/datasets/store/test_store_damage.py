"""Failing samples and damaged stores: named, found, mended."""

import shutil

import numpy as np
import pytest
from fake_recipe import FakeRecipe
from small_stores import contents, make

from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.info import info
from specklegen.datasets.store.verify import verify


@pytest.mark.parametrize("processes", [1, 2])
def test_a_failing_sample_is_named_and_the_others_are_stored(tmp_path, processes):
    with pytest.raises(GenerationError, match=r"\(seed=0, split='train', index=7\) failed: ArithmeticError"):
        make(tmp_path / "a.zarr", FakeRecipe(fails_at=7), processes=processes)
    assert info(tmp_path / "a.zarr")["done"] == 17
    assert make(tmp_path / "a.zarr")["done"] == 22


def test_verify_finds_a_flipped_byte_in_any_file_and_a_missing_shard(tmp_path):
    folder = tmp_path / "a.zarr"
    make(folder)
    good = contents(folder)
    assert verify(folder).damaged == ()
    random = np.random.default_rng(0)
    victims = [name for name in good if name.split("/")[1:2] == ["c"]]
    assert len(victims) == 5 * 10
    for name in victims:
        shard = int(name.split("/")[2])
        data = bytearray(good[name])
        data[random.integers(len(data))] ^= 1 << int(random.integers(8))
        (folder / name).write_bytes(data)
        assert verify(folder).damaged == (shard,), name
        assert verify(folder, repair=FakeRecipe()).damaged == (shard,)
        assert contents(folder) == good
    (folder / "image/c/3/0/0").unlink()
    shutil.rmtree(folder / "valid/c")
    (folder / "image/c/1/0/0").unlink()
    found = verify(folder)
    assert (found.damaged, found.unfinished) == ((), (0, 1, 2, 3, 4))
    verify(folder, repair=FakeRecipe())
    assert contents(folder) == good
    (folder / "image/c/3/0/0").unlink()
    assert verify(folder).damaged == (3,)
    verify(folder, repair=FakeRecipe())
    assert contents(folder) == good


def test_repair_with_another_recipe_is_refused(tmp_path):
    make(tmp_path / "a.zarr")
    with pytest.raises(ValueError, match="thickness"):
        verify(tmp_path / "a.zarr", repair=FakeRecipe(thickness=1.0))


def test_generate_on_a_damaged_ledger_points_to_verify(tmp_path):
    make(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/valid/c/1").write_bytes(b"torn")
    with pytest.raises(OSError, match="verify FOLDER --repair"):
        make(tmp_path / "a.zarr")
