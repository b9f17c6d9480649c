import hashlib
import pickle
import shutil
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
import tifffile
import torch
from PIL import Image
from scipy.stats import chi2
from skimage.io import imsave

from specklegen.datasets.addresses import Addresses
from specklegen.datasets.objects import (
    Bars,
    Blobs,
    Digits,
    Families,
    Folder,
    Glyphs,
    Photographs,
    Points,
    Polygons,
    Scan,
    Silhouettes,
    Strokes,
    glyphs,
    outlines,
)
from specklegen.datasets.objects.digits import _digits
from specklegen.datasets.objects.glyphs import _filled
from specklegen.datasets.objects.outlines import CHARACTERS, FONTS
from specklegen.datasets.objects.photographs import PHOTOGRAPHS, _photograph
from specklegen.datasets.objects.pictures import fitted, read_grey, resampled
from specklegen.datasets.split import SPLITS, split_of
from tests.refusals import assert_refused
from tests.zscore import assert_mean, refute_mean

FALSE_ALARM = 1e-6  # chance that a right build fails, per test


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Sixty small colour pictures, no two alike, in every format."""
    path = tmp_path_factory.mktemp("pictures")
    rng = np.random.default_rng(0)
    for n in range(60):
        picture = rng.integers(0, 256, (20 + n % 5, 30, 3), dtype=np.uint8)
        suffix = (".png", ".jpg", ".tif", ".npy")[n % 4]
        if suffix == ".npy":
            np.save(path / f"{n}.npy", picture[:, :, 0] / 3.0)
        else:
            imsave(path / f"{n}{suffix}", picture, check_contrast=False)
    return path


FAMILIES = ["glyphs", "photographs", "silhouettes", "folder", "digits", "points", "bars", "strokes", "polygons",
            "blobs", "families", "scan"]  # fmt: skip


@pytest.fixture(params=FAMILIES)
def family(request, folder):
    shape = (24, 32)
    return {
        "glyphs": lambda: Glyphs(shape=shape), "photographs": lambda: Photographs(shape=shape),
        "folder": lambda: Folder(shape=shape, path=str(folder)),
        "digits": lambda: pytest.importorskip("sklearn") and Digits(shape=shape), "points": lambda: Points(shape=shape),
        "bars": lambda: Bars(shape=shape), "silhouettes": lambda: Silhouettes(shape=shape),
        "strokes": lambda: Strokes(shape=shape), "polygons": lambda: Polygons(shape=shape),
        "blobs": lambda: Blobs(shape=shape),
        "families": lambda: Families(shape=shape, families=(Glyphs(shape=shape), Points(shape=shape))),
        "scan": lambda: Scan(shape=shape, grid=(2, 3), step=8, of=Glyphs(shape=(16, 16))),
    }[request.param]()  # fmt: skip


def test_an_object_is_float32_from_0_to_1_with_something_on_it(family):
    for split in SPLITS:
        for index in range(40):
            image = family.image(3, split, index)
            assert image.dtype == np.float32
            assert image.shape == (24, 32)
            assert image.min() >= 0
            assert image.max() == 1
            assert image.std() > 0


def test_an_object_is_a_pure_function(family):
    indices = list(range(12))
    alone = [family.image(5, "train", index) for index in indices]
    again = family.replace()
    backwards = [again.image(5, "train", index) for index in indices[::-1]][::-1]
    pickled = pickle.loads(pickle.dumps(family))
    for index in indices:
        np.testing.assert_array_equal(alone[index], backwards[index])
        np.testing.assert_array_equal(alone[index], pickled.image(5, "train", index))
    others = [family.image(6, "train", index) for index in indices]
    assert any(not np.array_equal(one, other) for one, other in zip(alone, others, strict=True))


def assert_no_leak(source_of, samples):
    """No source of one split may appear in another; ``source_of(split, index)``."""
    seen = {split: {source_of(split, index) for index in range(samples)} for split in SPLITS}
    for split in SPLITS:
        for other in SPLITS:
            shared = seen[split] & seen[other] if split != other else set()
            assert not shared, f"leak between {split} and {other}: {sorted(shared)[:3]}"


def test_no_source_of_train_appears_in_validation_or_test(family):
    assert_no_leak(lambda split, index: family.source(11, split, index), samples=1000)


def test_the_leak_test_has_power(folder):
    """One source in a thousand samples drawn from another split must be found."""
    family = Glyphs()

    def leaky(split, index):
        return family.source(11, "train" if (split, index) == ("test", 417) else split, index)

    assert len(family.sources_of_split("train")) < 1000  # so that train shows every source it has
    with pytest.raises(AssertionError, match="leak between train and test"):
        assert_no_leak(leaky, samples=1000)


def test_listed_sources_are_disjoint_and_complete(family):
    if not hasattr(family, "sources_of_split"):
        pytest.skip("this family draws its sources")
    parts = [family.sources_of_split(split) for split in SPLITS]
    together = [source for part in parts for source in part]
    assert len(together) == len(set(together))
    assert set(together) == set(family.sources())
    assert all(parts)


@pytest.mark.parametrize(("disjoint", "part"), [("font", 0), ("character", 1)])
def test_glyph_splits_can_keep_fonts_or_characters_apart(disjoint, part):
    family = Glyphs(disjoint=disjoint)
    seen = [{source[part] for source in family.sources_of_split(split)} for split in SPLITS]
    assert not seen[0] & seen[1]
    assert not seen[0] & seen[2]
    assert not seen[1] & seen[2]


TEN = {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"}


def test_named_characters_are_held_out_in_every_font():
    family = Glyphs(**TEN)
    seen = {split: {source[1] for source in family.sources_of_split(split)} for split in SPLITS}
    assert seen["test"] == set(TEN["test"])
    assert seen["validation"] == set(TEN["validation"])
    assert seen["train"] == set(CHARACTERS) - seen["test"] - seen["validation"]
    assert all(len(family.sources_of_split(s)) == len(FONTS) * len(seen[s]) for s in SPLITS)
    assert "test" not in Glyphs().identity()  # data sets made before characters could be named keep their fingerprint


def test_labels_say_what_an_object_is():
    """The same names for every sample; of glyphs the character, of a mixture the family too, of points none."""
    family = Families(families=(Glyphs(**TEN), Points()))
    for index in range(40):
        source = family.source(0, "test", index)
        told = family.labels(source)
        assert list(told) == ["family", "label"]
        expected = CHARACTERS.index(source[2]) if source[0] == 0 else -1
        assert told == {"family": source[0], "label": expected}
    digits = pytest.importorskip("sklearn.datasets").load_digits()
    assert Digits().labels((17,)) == {"label": float(digits.target[17])}
    assert Photographs().labels((PHOTOGRAPHS[3],)) == Silhouettes().labels((PHOTOGRAPHS[3],)) == {"label": 3.0}


def test_labels_of_one_split_are_read_alone(monkeypatch):
    """Labels of a batch are those of its samples; sources of other splits, which may be files, are not opened."""
    family, opened = Glyphs(), set()
    plain = Glyphs.labels

    def watched(self, source):
        opened.add(source)
        return plain(self, source)

    monkeypatch.setattr(Glyphs, "labels", watched)
    found = family.labels_of(Addresses(5, "test", torch.device("cpu")), range(20))
    assert opened == set(family.sources_of_split("test"))
    assert found["label"].tolist() == [plain(family, family.source(5, "test", n))["label"] for n in range(20)]


def test_a_mixture_shows_what_its_members_show_as_often_as_asked():
    """Chi-square of the families over 2000 samples; every picture is that of the member."""
    members = (Points(count=3), Bars(), Points(count=7))
    family = Families(families=members, weights=(1, 2, 5))
    drawn = [family.member(0, "train", n) for n in range(2000)]
    expected = 2000 * np.array([1, 2, 5]) / 8
    found = np.bincount(drawn, minlength=3)
    assert chi2.sf((np.square(found - expected) / expected).sum(), 2) > FALSE_ALARM
    assert chi2.sf((np.square(found - 2000 / 3) / (2000 / 3)).sum(), 2) < FALSE_ALARM  # power: even shares are others
    for n in range(20):
        np.testing.assert_array_equal(family.image(0, "train", n), members[drawn[n]].image(0, "train", n))


def test_a_silhouette_lights_the_brightest_part_of_a_photograph():
    """Of one brightness but for pixels on its edge: those are few, and none of a photograph's are as even."""
    lit = [Silhouettes().image(0, "train", n) for n in range(100)]
    grey = [Photographs().image(0, "train", n) for n in range(100)]
    edge = lambda images: np.mean([(0.01 < x) & (x < 0.99) for x in images])  # noqa: E731
    assert edge(lit) < 0.5 < 0.9 < edge(grey)
    assert 0.05 < np.mean(lit) < 0.4


def test_strokes_are_as_wide_as_their_pen():
    """A straight level stroke between two points covers its length times twice the pen, and its round ends."""

    class Level(Strokes):
        def drawn(self, rng):
            return np.clip(1.5 + 0.5 - self._distance(np.array([[10.5, 5.5], [10.5, 20.5]])), 0, 1)

    # The edge of a pixel is 1 wide: the half-discs' area is that of the radius, smoothed, + pi/12 in all.
    covered = Level().picture((0,), np.random.default_rng())
    assert covered.sum() == pytest.approx(15 * 3 + np.pi * (1.5**2 + 1 / 12), rel=0.01)


@pytest.mark.parametrize(("family", "place", "said"), [
    (Photographs(), ("photographs", "_FILES", {name: "0" * 16 for name in PHOTOGRAPHS}), "Photographs file"),
    (Digits(), ("digits", "_DIGEST", "0" * 16), "Digits data"),
])  # fmt: skip
def test_pictures_of_other_libraries_are_those_that_were_hashed(monkeypatch, family, place, said):
    """Another picture under the name is refused, whichever version of the library brings it."""
    if family.type == "Digits":
        pytest.importorskip("sklearn")
    expected = family.image(0, "train", 0)
    module, name, digests = place
    monkeypatch.setattr(f"specklegen.datasets.objects.{module}.{name}", digests)
    for memo in (_photograph, _digits):
        memo.cache_clear()
    assert_refused(lambda: family.image(0, "train", 0), f"{said} must be .*SHA-256 0000")
    monkeypatch.undo()
    for memo in (_photograph, _digits):
        memo.cache_clear()
    np.testing.assert_array_equal(family.image(0, "train", 0), expected)


def test_objects_ask_no_other_library_for_outlines():
    """An object is drawn where matplotlib cannot be imported: its version has no say in a pixel."""
    code = (
        "import sys; sys.modules['matplotlib'] = None; import hashlib, numpy as np;"
        "from specklegen.datasets.objects import Glyphs;"
        "print(hashlib.sha256(np.stack([Glyphs().image(0, 'train', n) for n in range(9)]).tobytes()).hexdigest())"
    )
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.strip()
    here = np.stack([Glyphs().image(0, "train", n) for n in range(9)])
    assert said == hashlib.sha256(here.tobytes()).hexdigest()


def test_the_outlines_that_are_shipped_are_frozen():
    """Of whatever was drawn from other outlines the pixels differ, and DATA_VERSION has to rise."""
    digest = hashlib.sha256(outlines.outlines().edges.tobytes() + outlines.outlines().starts.tobytes())
    assert digest.hexdigest() == "872f8475994e7333aa45f67b54b2c80d554e42930a70cbd8139a2e96adefa783"


def test_pieces_stay_near_their_curves():
    """A parabola cut into n chords lies 1/n^2 of its sagitta from them, at their middles; ends lie on it exactly."""
    segment = np.array([[[0, 0], [3200, 6400], [6400, 0]]])  # in 64ths: 100 wide, its vertex 50 high
    (whole,) = outlines.chords(segment, np.array([1]))
    np.testing.assert_array_equal(whole, [0, 0, 100, 0])
    for count in (2, 5, 40):
        edges = outlines.chords(segment, np.array([count]))
        assert edges.shape == (count, 4)
        np.testing.assert_array_equal(edges[1:, :2], edges[:-1, 2:])
        np.testing.assert_array_equal([*edges[0, :2], *edges[-1, 2:]], whole)
        x, y = edges[:, 2:].T
        np.testing.assert_allclose(y, 2 * x * (100 - x) / 100, atol=1e-12)
        middle = (edges[:, :2] + edges[:, 2:]) / 2
        gap = 2 * middle[:, 0] * (100 - middle[:, 0]) / 100 - middle[:, 1]
        np.testing.assert_allclose(gap, 50 / count**2, rtol=1e-9)


def clipped_area(corners, low_x, low_y):
    """Area of a polygon within a unit square, by Sutherland and Hodgman: an oracle that knows no rows or edges."""
    polygon = [np.array(corner) for corner in corners]
    for axis, bound, sign in ((0, low_x, 1), (0, low_x + 1, -1), (1, low_y, 1), (1, low_y + 1, -1)):
        clipped = []
        for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            inside, following = sign * (a[axis] - bound) >= 0, sign * (b[axis] - bound) >= 0
            if inside:
                clipped.append(a)
            if inside != following:
                clipped.append(a + (b - a) * (bound - a[axis]) / (b[axis] - a[axis]))
        if not clipped:
            return 0.0
        polygon = clipped
    x, y = np.array(polygon).T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def edges_of(corners):
    return np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)


def test_a_pixel_is_as_grey_as_it_is_covered():
    """Random triangles, a polygon of 40 corners about a point, and one with corners and edges on the grid."""
    rng = np.random.default_rng(3)
    turns = np.sort(rng.uniform(0, 2 * np.pi, 40))
    star = (8 + rng.uniform(1, 7.5, (40, 1)) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)).clip(0, 16)
    shapes = [rng.uniform(0, 16, (3, 2)) for _ in range(6)]
    shapes += [star, np.array([[2.0, 3.0], [9.0, 3.0], [9.0, 12.0], [5.5, 7.0], [2.0, 12.0]])]
    for corners in shapes:
        filled = _filled(edges_of(corners), 16, 16)
        # Sutherland and Hodgman leave edges of no width where a star falls apart: their area is 0 all the same.
        exact = [[clipped_area(corners, column, 15 - row) for column in range(16)] for row in range(16)]
        np.testing.assert_allclose(filled, exact, atol=1e-10)
    hole = np.concatenate([edges_of(star), edges_of((8 + 0.1 * (star - 8))[::-1])])
    ring = _filled(hole, 16, 16)
    assert abs(ring.sum() - 0.99 * _filled(edges_of(star), 16, 16).sum()) < 1e-9


def test_a_glyph_stays_inside_its_frame(monkeypatch):
    """The outline handed to the rasteriser must stay in the frame, and come near each of its edges."""
    margins = []

    def record(edges, rows, columns):
        low, high = edges[:, :2].min(axis=0), edges[:, :2].max(axis=0)
        margins.append([*low, columns - high[0], rows - high[1]])
        return np.ones((rows, columns))

    monkeypatch.setattr(glyphs, "_filled", record)
    family = Glyphs(shape=(20, 28), size=(0.3, 1.0), rotation=180)
    for index in range(500):
        family.image(0, "train", index)
    assert np.min(margins) > -1e-12
    assert (np.min(margins, axis=0) < 0.5).all()  # missed by chance at odds below 1e-6


def test_digits_name_the_extra_where_scikit_learn_is_missing(monkeypatch):
    from specklegen.datasets.objects import digits

    digits._digits.cache_clear()
    monkeypatch.setitem(sys.modules, "sklearn.datasets", None)
    with pytest.raises(ImportError, match=r'pip install "specklegen-torch\[digits\]"'):
        Digits().image(0, "train", 0)


def test_renaming_and_moving_a_folder_changes_nothing(folder, tmp_path):
    moved = tmp_path / "elsewhere"
    (moved / "deep").mkdir(parents=True)
    for n, path in enumerate(sorted(folder.iterdir(), reverse=True)):
        shutil.copy(path, moved / ("deep" if n % 2 else ".") / f"{n:03d}-renamed{path.suffix.upper()}")
    one, other = Folder(path=str(folder)), Folder(path=str(moved))
    assert one.identity() == other.identity()
    for split in SPLITS:
        for index in range(10):
            np.testing.assert_array_equal(one.image(0, split, index), other.image(0, split, index))


def test_a_copy_of_a_picture_cannot_leak_into_another_split(folder, tmp_path):
    twice = tmp_path / "twice"
    shutil.copytree(folder, twice)
    for path in list(twice.iterdir()):
        shutil.copy(path, twice / f"copy-{path.name}")
    assert set(Folder(path=str(twice)).sources()) == set(Folder(path=str(folder)).sources())


def test_subfolders_are_classes(folder, tmp_path):
    """Labels follow the names of subfolders, come with samples, and are of the identity; a flat folder has none."""
    tree = tmp_path / "tree"
    for n, path in enumerate(sorted(folder.iterdir())):
        (tree / ("dogs" if n % 3 else "cats")).mkdir(parents=True, exist_ok=True)
        shutil.copy(path, tree / ("dogs" if n % 3 else "cats") / path.name)
    flat, sorted_ = Folder(path=str(folder)), Folder(path=str(tree))
    assert sorted_.class_names == ("cats", "dogs")
    assert flat.class_names == ()
    assert set(flat.sources()) == set(sorted_.sources())
    assert flat.identity() != sorted_.identity()
    for split in SPLITS:
        for index in range(10):
            shown = sorted_.file(0, split, index)
            label = sorted_.labels(sorted_.source(0, split, index))["label"]
            assert sorted_.class_names[int(label)] == shown.parent.name
            assert flat.labels(flat.source(0, split, index))["label"] == -1.0
            assert flat.file(0, split, index).read_bytes() == shown.read_bytes()
    (tree / "cats").rename(tree / "zebras")
    turned = Folder(path=str(tree))
    assert turned.identity() != sorted_.identity()
    assert all(turned.labels(each)["label"] == 1 - sorted_.labels(each)["label"] for each in turned.sources())
    one = next((tree / "dogs").iterdir())
    shutil.copy(one, tree / "zebras" / f"both{one.suffix}")
    with pytest.raises(ValueError, match=r"Folder\.path must be a folder that has each image in one class only"):
        Folder(path=str(tree)).labels(turned.sources()[0])


def test_folders_that_cannot_serve_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match=r"Folder\.path must be an existing folder; got '.*nowhere'"):
        Folder(path=str(tmp_path / "nowhere")).image(0, "train", 0)
    (tmp_path / "readme.txt").write_text("no picture")
    with pytest.raises(ValueError, match=r"Folder\.path must be a folder with pictures \(\.png, .*\.npy\)"):
        Folder(path=str(tmp_path)).image(0, "train", 0)
    shutil.copy(folder / "0.png", tmp_path)
    shutil.copy(folder / "4.png", tmp_path)
    assert Folder(path=str(tmp_path)).image(0, "train", 0).max() == 1
    with pytest.raises(ValueError, match="enough for the split 'test'; got '2 in all'"):
        Folder(path=str(tmp_path)).image(0, "test", 0)


def _truncated(path, folder):
    path.with_suffix(".jpg").write_bytes((folder / "1.jpg").read_bytes()[:300])


@pytest.mark.parametrize(("spoil", "name"), [
    (lambda path, _: path.with_suffix(".png").write_text("no picture"), "bad.png"),
    (_truncated, "bad.jpg"),
    (lambda path, _: np.save(path, np.array([[1.0, np.nan]])), "bad.npy"),
    (lambda path, _: np.save(path, np.array([[1.0, -1.0]])), "bad.npy"),
    (lambda path, _: np.save(path, np.zeros((4, 4))), "bad.npy"),
    (lambda path, _: np.save(path, np.ones((4, 4, 7))), "bad.npy"),
    (lambda path, _: np.save(path, np.array([["a"]])), "bad.npy"),
    (lambda path, _: np.save(path, np.array([{}], dtype=object), allow_pickle=True), "bad.npy"),
])  # fmt: skip
def test_an_unreadable_picture_is_named(folder, tmp_path, spoil, name):
    shutil.copy(folder / "0.png", tmp_path)
    spoil(tmp_path / "bad.npy", folder)
    with pytest.raises(ValueError, match=rf"Folder picture must be readable; got '.*{name}'"):
        Folder(path=str(tmp_path)).image(0, "train", 0)


def test_all_unreadable_pictures_are_listed(folder, tmp_path):
    shutil.copy(folder / "0.png", tmp_path)
    for n in range(8):
        (tmp_path / f"bad{n}.png").write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"got '.*bad0.png'.*bad1.png.*bad5.png.*and 2 more. Repair or remove these"):
        Folder(path=str(tmp_path)).image(0, "train", 0)


def test_a_picture_that_changes_under_a_data_set_is_found(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    family = Folder(path=str(copy), shape=(9, 9))
    assert family.sources()
    for path in copy.glob("*.npy"):
        np.save(path, np.ones((5, 5)))
    changed = next(n for n in range(60) if family.files[family.source(0, "train", n)[0]].endswith(".npy"))
    assert_refused(lambda: family.image(0, "train", changed), "must be unchanged since the folder was first read")


def test_colours_opacity_and_depth_become_grey(tmp_path):
    white = np.full((4, 6), 255, dtype=np.uint8)
    imsave(tmp_path / "rgb.png", np.dstack([white, white * 0, white * 0]), check_contrast=False)
    veil = np.tile([0, 51, 255], (4, 2)).astype(np.uint8)
    imsave(tmp_path / "rgba.png", np.dstack([white, white, white, veil]), check_contrast=False)
    tifffile.imwrite(tmp_path / "deep.tif", np.full((4, 6), 40_000, dtype=np.uint16))
    np.testing.assert_allclose(read_grey(tmp_path / "rgb.png"), 0.2125 * 255, rtol=1e-6)
    np.testing.assert_allclose(read_grey(tmp_path / "rgba.png")[0, :3] / 255, [0, 0.2, 1], rtol=1e-6)
    np.testing.assert_array_equal(read_grey(tmp_path / "deep.tif"), 40_000)


@pytest.mark.parametrize("mode", ["1", "P", "CMYK", "I;16"])
def test_rarer_modes_are_read(tmp_path, mode):
    """A ramp must stay a ramp: the palette's numbers, say, are no brightness."""
    ramp = Image.fromarray(np.tile(np.array([0, 255, 0, 255], dtype=np.uint8), (4, 1)))
    if mode == "P":
        ramp.putpalette([255 - n // 3 for n in range(768)])
    name = "ramp.jpg" if mode == "CMYK" else "ramp.png"
    (ramp if mode == "P" else ramp.convert("L").convert(mode)).save(tmp_path / name, quality=95)
    row = read_grey(tmp_path / name)[0]
    expected = [1, 0, 1, 0] if mode == "P" else [0, 1, 0, 1]
    np.testing.assert_allclose(row / row.max(), expected, atol=0.05)  # JPEG at quality 95 is off by 2/255


def test_a_photograph_is_turned_upright(tmp_path):
    exif = Image.Exif()
    exif[274] = 6  # orientation: turn a quarter clockwise to see it upright
    Image.fromarray(np.eye(4, 6, dtype=np.uint8) * 200).save(tmp_path / "phone.png", exif=exif)
    assert read_grey(tmp_path / "phone.png").shape == (6, 4)


def test_resampling_averages_and_does_not_alias():
    stripes = np.tile(np.array([0, 1], dtype=np.float32), (64, 32))
    np.testing.assert_allclose(resampled(stripes, (4, 4, 60, 60), (7, 7)), 0.5, atol=1e-6)


def test_a_fitted_picture_keeps_its_aspect():
    frame = fitted(np.ones((20, 40), dtype=np.float32), (28, 28))
    assert np.count_nonzero(frame.any(axis=1)) == 14
    assert np.count_nonzero(frame.any(axis=0)) == 28
    np.testing.assert_array_equal(frame, frame[::-1])


def test_points_have_their_count_and_even_directions():
    """Two points: the sign of the slope between them must be fair (chi squared, one degree)."""
    family = Points(shape=(16, 16), count=2)
    slopes = Counter()
    for index in range(600):
        image = family.image(0, "train", index)
        assert image.sum() == 2
        (_, x0), (_, x1) = np.argwhere(image)
        slopes[np.sign(x1 - x0)] += 1
    up, down = slopes[1], slopes[-1]
    assert (up - down) ** 2 / (up + down) < chi2.isf(FALSE_ALARM, 1)


def test_brightness_of_points_is_drawn_and_moves_none():
    """Over the brightest, uniform numbers from .2 to 1 have the mean of u / max; places are those of even points."""
    even, uneven = Points(count=4), Points(count=4, faintest=0.2)
    assert even.identity() == {"type": "Points", "count": 4}
    assert uneven.identity()["faintest"] == 0.2
    shown = np.stack([uneven.image(0, "train", n) for n in range(400)])
    assert np.array_equal(shown > 0, np.stack([even.image(0, "train", n) for n in range(400)]) > 0)
    assert (shown.max((1, 2)) == 1).all()
    expected = {}
    for faintest in (0.2, 0.1):
        drawn = np.random.default_rng(1).uniform(faintest, 1, (400_000, 4))
        expected[faintest] = (drawn / drawn.max(1, keepdims=True)).sum(1).mean()
    assert_mean(shown.sum((1, 2)), expected[0.2])
    refute_mean(shown.sum((1, 2)), expected[0.1])


def test_a_constellation_is_one_source_wherever_it_lies():
    family = Points(shape=(9, 9), count=3)
    rng = np.random.default_rng(0)
    y, x = np.array(family.propose(rng)).reshape(-1, 2).T
    assert y.min() == x.min() == 0
    placed = {tuple(np.argwhere(family.picture((0, 1, 2, 0, 2, 3), rng))[0]) for _ in range(500)}
    assert len(placed) == 7 * 6  # every place where a constellation of 3 by 4 fits


def test_a_frame_too_small_for_three_splits_is_refused():
    only = Points(shape=(1, 2), count=2)
    home = split_of("Points/0/0/0/1")
    assert only.image(0, home, 0).sum() == 2
    with pytest.raises(ValueError, match=r"Points\.shape must be large enough for patterns of the split"):
        only.image(0, next(split for split in SPLITS if split != home), 0)


def test_bars_fit_their_frame_exactly():
    for index in range(200):
        level, count, width, gap, length = Bars(shape=(15, 11)).source(0, "train", index)
        across, along = (15, 11) if level else (11, 15)
        assert count * width + (count - 1) * gap <= across
        assert 1 <= length <= along
        image = Bars(shape=(15, 11)).image(0, "train", index)
        assert image.sum() == count * width * length


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Glyphs(size=(0.9, 0.4)), r"Glyphs\.size must be given as \(smallest, largest\)"),
    (lambda: Glyphs(test="5", validation="6"), r"Glyphs\.disjoint must be \"character\" if"),
    (lambda: Glyphs(disjoint="character", test="5"), r"Glyphs\.validation must be different characters of 0123"),
    (lambda: Glyphs(disjoint="character", test="5I", validation="6"), r"Glyphs\.test must be different char"),
    (lambda: Families(families=()), r"Families\.families must be at least one family"),
    (lambda: Families(families=(Points(), Bars(shape=(9, 9)))), r"Families\.families must be of the mixture's"),
    (lambda: Families(families=(Points(),), weights=(1, 2)), r"Families\.weights must be one for each of 1"),
    (lambda: Photographs(size=(0.5, 0.2)), r"Photographs\.size must be"),
    (lambda: Points(shape=(2, 2), count=5).image(0, "train", 0), r"Points\.count must be at most"),
    (lambda: Bars(count=(4, 2)).image(0, "train", 0), r"Bars\.count must be"),
    (lambda: Glyphs().image(0, "dev", 0), "split must be one of"),
])  # fmt: skip
def test_bad_input_names_field_rule_and_value(make, message):
    assert_refused(make, message)
