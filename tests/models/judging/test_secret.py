"""Tasks at a secret seed: other images, a commitment in every result, and words that prove it."""

import hashlib
import json

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.models import benchmark
from specklegen.models.judging.recheck import missing_tasks, recheck
from specklegen.models.judging.secret import commitment, seed_of
from specklegen.models.judging.tasks import SEED, TASKS, task

WORDS = "otter lantern seven quarry mild ferry"


def test_seed_and_commitment_are_two_digests_of_the_words():
    told = hashlib.sha256(b"specklegen benchmark commitment\n" + WORDS.encode()).hexdigest()
    drawn = hashlib.sha256(b"specklegen benchmark seed\n" + WORDS.encode()).digest()
    assert commitment(WORDS) == told
    assert seed_of(WORDS) == int.from_bytes(drawn[:8], "big") // 2 < 2**63
    assert seed_of(WORDS + " ") != seed_of(WORDS)


@pytest.mark.parametrize("words", ["", "fifteen letters", 20])
def test_words_that_can_be_tried_out_are_refused(words):
    with pytest.raises(RuleError, match="at least 16 characters"):
        commitment(words)


@pytest.fixture(scope="module")
def found():
    seen = []

    def mine(batch):
        seen.append(batch["image"])
        return batch["image"][:, 50:78, 50:78]

    return benchmark({"mine": mine}, tasks=["thin"], samples=2, secret=WORDS, limits=None), seen


def test_images_are_of_that_seed_and_of_no_other(found):
    _, (images,) = found
    (own,) = task("thin").batches(range(2), seed_of(WORDS))
    (usual,) = task("thin").batches(range(2), SEED)
    assert torch.equal(images, own["image"])
    assert not torch.equal(images, usual["image"])


def test_results_state_the_commitment_and_neither_seed_nor_words(found, tmp_path):
    results, _ = found
    results.write(tmp_path)
    assert commitment(WORDS) in (tmp_path / "results.md").read_text()
    assert all(row["commitment"] == commitment(WORDS) for row in results.rows())
    assert json.loads((tmp_path / "entries" / "0.json").read_text())["commitment"] == commitment(WORDS)
    with np.load(tmp_path / "answers.npz") as content:
        stated = str(content["stated"])
    for file in tmp_path.rglob("*.*"):
        for told in (WORDS, str(seed_of(WORDS))):
            assert told not in stated
            assert told.encode() not in file.read_bytes()


def test_whoever_has_the_words_can_check(found, tmp_path):
    results, _ = found
    results.write(tmp_path)
    file = tmp_path / "answers.npz"
    assert recheck(file, WORDS)["thin", "mine"] == pytest.approx(results.interval("mine", "thin").mean, rel=1e-6)
    with pytest.raises(RuleError, match="must be the words of the commitment"):
        recheck(file, WORDS.upper())
    with pytest.raises(RuleError, match="given for answers at a secret seed"):
        recheck(file)
    assert "waves" not in missing_tasks(file)  # it cannot be drawn


def test_images_that_come_with_the_package_are_left_out():
    with pytest.raises(RuleError, match="drawn by a seed, where it is secret; got 'waves'"):
        benchmark(lambda batch: batch["object"], tasks=["waves"], secret=WORDS)
    assert [each.name for each in TASKS if each.stored] == ["waves", "measured frames"]
