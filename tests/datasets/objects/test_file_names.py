"""Pictures of a folder by number and by name: in samples, batches, streams, stores, exports and collated batches."""

import json
import shutil

import numpy as np
import pytest
import torch
from skimage.io import imsave

from specklegen.datasets import SpeckleCache, load_recipe
from specklegen.datasets.objects import Families, Folder, Points
from specklegen.datasets.split import SPLITS
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.verify import verify

SMALL = {"material": {"kernel_paths": 1000}}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """Twelve pictures in two classes, one of which lies in a folder of its own."""
    path, rng = tmp_path_factory.mktemp("tree"), np.random.default_rng(0)
    for n in range(12):
        folder = path / ("cats" if n % 2 else "dogs/old")
        folder.mkdir(parents=True, exist_ok=True)
        imsave(folder / f"{n}.png", rng.integers(0, 256, (20, 20), dtype=np.uint8), check_contrast=False)
    return path


def recipe_of(tree):
    return load_recipe("through-slab", SMALL | {"objects": {"type": "Folder", "path": str(tree)}})


@pytest.fixture(scope="module")
def recipe(tree):
    return recipe_of(tree)


@pytest.fixture(scope="module")
def store(tree, recipe, tmp_path_factory):
    """A store of six samples, whose folder of pictures was renamed afterwards."""
    folder = tmp_path_factory.mktemp("store") / "a.zarr"
    generate(recipe, samples=6, folder=folder, processes=1)
    return folder


def test_the_name_is_that_of_the_picture_shown(tree, recipe):
    """By an own look at the pixels: the brightness of the file, fitted, is the object of the sample."""
    seen = set()
    for split in SPLITS:
        for n in range(3):
            sample = recipe.sample(0, split, n)
            alone = Folder(path=str(tree), shape=recipe.objects.shape)
            assert (tree / sample["file"]).is_file()
            assert alone.file(0, split, n) == tree / sample["file"]
            shown = Folder(path=str((tree / sample["file"]).parent), shape=recipe.objects.shape)
            digest = next(each for each, path in shown.files.items() if path == str(tree / sample["file"]))
            picture = shown.picture((digest,), np.random.default_rng(0))
            np.testing.assert_array_equal(picture / picture.max(), sample["object"])
            assert alone.class_names[int(sample["parameters"]["label"])] == sample["file"].split("/")[0]
            assert recipe.file_names[int(sample["parameters"]["file"])] == sample["file"]
            seen.add(sample["file"])
    assert len(seen) > 3


def test_numbers_follow_the_contents_and_not_the_names(tree, recipe, tmp_path):
    """A renamed folder makes the same data set: the numbers stay, the names follow."""
    moved = tmp_path / "moved"
    shutil.copytree(tree, moved)
    for path in list((moved / "cats").iterdir()):
        path.rename(path.with_name(f"z{99 - int(path.stem)}.png"))
    renamed = recipe_of(moved)
    assert renamed.fingerprint() == recipe.fingerprint()
    assert renamed.file_names != recipe.file_names
    for n, name in enumerate(recipe.file_names):
        assert (moved / renamed.file_names[n]).read_bytes() == (tree / name).read_bytes()


def test_stores_hand_out_what_samples_say(recipe, store):
    cache = SpeckleCache(store)
    assert cache.file_names == recipe.file_names
    for n in range(len(cache)):
        sample = recipe.sample(0, "train", n)
        assert cache[n]["file"] == sample["file"] == cache.numpy(n)["file"]
        assert cache[n]["parameters"]["file"] == sample["parameters"]["file"]
    checked = verify(store)
    assert (checked.damaged, checked.orphans, checked.metadata) == ((), 0, "")
    collated = next(iter(torch.utils.data.DataLoader(cache, batch_size=3)))
    assert collated["file"] == [cache[n]["file"] for n in range(3)]
    assert [cache.file_names[int(n)] for n in collated["parameters"]["file"]] == collated["file"]
    batch = cache.batch([2, 0])
    assert [cache.file_names[int(n)] for n in batch["parameters"]["file"]] == [cache[2]["file"], cache[0]["file"]]
    assert "file" not in batch


def test_a_store_without_its_names_reads_as_well(recipe, store, tmp_path):
    """Lost, or not as they were written: numbers stay numbers, whether a sample is read or rendered."""
    copy = tmp_path / "a.zarr"
    shutil.copytree(store, copy)
    file = copy / "valid" / "names.json"
    told = json.loads(file.read_text())
    told["content"]["names"][0] = "another.png"
    file.write_text(json.dumps(told))
    for _ in range(2):
        cache = SpeckleCache(copy, missing="render", recipe=recipe)
        assert cache.file_names == ()
        assert "file" not in cache[0]
        assert cache[0]["parameters"] == SpeckleCache(store)[0]["parameters"]
        file.unlink(missing_ok=True)
    cache.store.forget_shard(0)
    assert "file" not in SpeckleCache(copy, missing="render", recipe=recipe)[0]


def test_mixtures_number_the_files_of_all_families_through(tree):
    """Objects of families without files have the number -1, and "" for a name."""
    folders = [Folder(path=str(tree / name), shape=(28, 28)) for name in ("dogs", "cats")]
    mixed = Families(families=(folders[0], Points(), folders[1]))
    assert mixed.file_names == (*folders[0].file_names, *folders[1].file_names)
    kinds = set()
    for n in range(40):
        source = mixed.source(0, "train", n)
        told = mixed.labels(source)
        kinds.add(told["family"])
        assert list(told) == ["family", "label", "file"]
        if told["family"] == 1:
            assert told["file"] == -1
        else:
            shown = folders[int(told["family"]) // 2]
            assert mixed.file_names[int(told["file"])] == shown.files[source[1]].removeprefix(f"{shown.path}/")
    assert kinds == {0, 1, 2}
