"""Measured frames: shapes in every size, files that are fetched by whoever has them, and what is said without them."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scipy.ndimage import gaussian_filter

from specklegen.core.errors import RuleError
from specklegen.measured import public_data
from specklegen.models import benchmark
from specklegen.models.judging import frames
from specklegen.models.judging.results import Results
from specklegen.models.judging.tasks import TASKS, complete_run, counted_tasks, task

NAME = "measured frames"


def test_every_sample_is_one_file_of_the_set():
    files = [frames._file(shape, grit) for grit in frames.GRITS for shape in frames.SHAPES]
    assert len(set(files)) == frames.SAMPLES == task(NAME).samples
    assert set(files) == set(public_data(frames.SET).files)


@pytest.mark.parametrize("shape", ["◇", "pi"])
def test_a_drawn_shape_has_the_area_of_its_outline(shape):
    """Shoelace formula on the vertices, contours of the diamond running against each other."""
    outlines = [frames._PI] if shape == "pi" else frames._DIAMOND
    signed = 0.0
    for one in outlines:
        x, y = np.array(one).T
        signed += 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    ends = np.vstack([np.array(one) for one in outlines])
    scale = frames.HEIGHTS[-1] / np.ptp(ends, axis=0).max()
    drawn = frames.printed(shape)[-1].double()
    assert float(drawn.sum()) == pytest.approx(abs(signed) * scale**2, rel=1e-6)


def test_shapes_are_drawn_in_every_size_and_way_up():
    bank = frames.printed("J")
    assert bank.shape == (4 * len(frames.HEIGHTS), *frames.OBJECT)
    for n, height in enumerate(frames.HEIGHTS):
        rows, columns = ((bank[4 * n].sum(axis) > 0).sum() for axis in (1, 0))
        assert max(rows, columns) == height
    large = bank[-4:].double()
    alike = (large.flatten(1) @ large.flatten(1).T) / large.square().sum((1, 2))
    assert (alike - torch.eye(4, dtype=torch.float64)).max() < 0.9  # a J is not its own mirror image


def test_an_answer_is_scored_at_its_best_size_and_way_up():
    """Eight orientations of a printed shape, anywhere: all right; another shape is not."""
    shape = frames.SHAPES.index("7")
    one = frames.printed("7")[4 * 8]
    ways = torch.stack([x.rot90(n) for x in (one, one.flip(0)) for n in range(4)])
    ways = torch.nn.functional.pad(ways, (3, 9, 11, 2))
    found = frames.scores(3 * ways + 2, [shape] * 8)
    np.testing.assert_allclose(found["pearson"], 1, rtol=1e-5)
    assert frames.scores(ways[:1], [frames.SHAPES.index("X")])["pearson"] < 0.9
    assert frames.named(ways[:1], [shape]).all()
    assert not frames.named(ways[:1], [frames.SHAPES.index("T")]).any()


def test_what_an_answer_shows_beside_a_shape_counts():
    """A bright square left of or above a J, as a T has an arm there: Pearson's r of these very pixels, by NumPy."""
    shape = frames.SHAPES.index("J")
    small = frames.printed("J")[4 * 3]  # 14 pixels high, in the first corner
    for place in ((slice(20, 30), slice(2, 12)), (slice(2, 12), slice(20, 30))):
        answer = torch.zeros(1, 36, 36)
        answer[0, 20:, 20:] = small[:16, :16]
        answer[0][place] = 1.0
        whole, alone = (np.pad(each.numpy(), (0, 28)).ravel() for each in (answer[0], small.roll((20, 20), (0, 1))))
        there = np.corrcoef(whole, alone)[0, 1]
        best = frames.scores(answer, [shape])["pearson"][0]
        assert there - 1e-6 <= best < 0.7  # another size may suit a little better, none well


def test_the_digest_has_the_files_and_the_shapes(monkeypatch):
    before = frames.digest()
    monkeypatch.setattr(frames, "_PI", (*frames._PI[:-1], (3.6, 45.8)))
    assert frames.digest() != before
    assert_refused(lambda: task(NAME).recipe(), "benchmark task 'measured frames' must be that of version")


def test_without_files_the_task_is_skipped_and_said(tmp_path):
    function = lambda batch: batch["image"][:, 50:78, 50:78]  # noqa: E731
    found = benchmark(function, tasks=["thin"], samples=2)
    assert found.skipped == ()  # nobody asked for it
    said = Results(found.evaluations, 2, skipped=(NAME,)).markdown()
    assert "Skipped, since their files were not named: measured frames. `specklegen check measured get" in said
    with pytest.raises(RuleError,
                       match="benchmark tasks must be tasks whose files are on this machine; got 'measured frames'"):
        benchmark(function, tasks=[NAME])
    with pytest.raises(RuleError, match="benchmark measured must be a folder of hidden-shapes"):
        benchmark(function, tasks=["thin"], samples=2, measured=tmp_path)
    assert_refused(lambda: next(task(NAME).batches(range(2))), "run with its files")


def test_it_is_no_part_of_a_complete_run_nor_of_a_mean():
    assert [each.name for each in TASKS if each.fetched] == [NAME]
    assert NAME not in [each.name for each in complete_run()]
    assert counted_tasks(["thin", NAME]) == ["thin"]
    assert counted_tasks([NAME]) == [NAME]


@pytest.fixture
def there(monkeypatch):
    """Stands in for the files: every frame shows its shape, in noise."""

    def seen(numbers, folder):  # noqa: ARG001
        drawn = np.random.default_rng(1).random((len(numbers), frames.SIDE, frames.SIDE))
        made = torch.from_numpy(gaussian_filter(drawn, (0, 1, 1))).float()
        for one, number in zip(made, numbers, strict=True):
            one[100:136, 100:136] += frames.printed(frames.SHAPES[number % 8])[4 * 9 + number % 4]
        return made

    monkeypatch.setattr(frames, "missing", lambda folder: folder is None)
    monkeypatch.setattr(frames, "images", seen)


def test_measured_frames_are_scored_beside_another_task(there):
    """What cuts the shape out is right, by the mean of all tasks it is nothing: that is of the other task alone."""
    results = benchmark(
        {"cuts": lambda batch: batch["image"][:, 100:136, 100:136] > 1 if batch["image"].shape[1] > 200
         else batch["object"]},
        tasks=["thin", NAME], samples=10, measured="somewhere",
    )  # fmt: skip
    assert results.interval("cuts", NAME).mean > 0.8
    assert results.chance("cuts", NAME) < results.interval("cuts", NAME).low
    assert results.score("cuts") == results.interval("cuts", "thin").mean == 0
    assert results.evaluations[NAME].labels.tolist() == [*range(8), 0, 1]
    assert results.evaluations[NAME].media.tolist() == [0] * 8 + [1] * 2


def test_the_grain_that_was_measured_is_told(there):
    """By the width of the window; object pixels stay pixels of the camera."""
    known = next(task(NAME).batches(range(3), measured="somewhere"))["parameters"]
    grain = known["wavelength"] / known["width"] / known["camera_pitch"]
    np.testing.assert_allclose(grain, frames.GRAIN, rtol=1e-12)
    np.testing.assert_allclose(known["object_pitch"], known["camera_pitch"], rtol=1e-12)


def test_baselines_answer_to_frames(there):
    results = benchmark({}, baselines=["mean image", "packaged network"], tasks=[NAME], samples=2, measured="somewhere")
    assert not results.failures
    assert results.functions == ["mean image", "packaged network"]
