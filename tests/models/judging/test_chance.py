"""Chance: whose answer is held against which object, and that its scores are those of a search by hand."""

import numpy as np
import pytest
import torch

from specklegen.models.judging.chance import chance, partners
from specklegen.models.metrics import SCORES


def test_partners_show_another_object():
    labels, families = np.array([3, 3, 4, -1, -1, 3]), np.array([0, 0, 0, 1, 1, 2])
    # 3 of family 0 meets 4; what has no class meets the next one; 3 of family 2 is another thing than 3 of family 0
    assert partners(labels, families).tolist() == [2, 2, 3, 4, 5, 0]
    assert partners(np.array([7, 7]), np.array([0, 0])).tolist() == [1, 0]  # there is no other


def test_an_answer_that_is_the_other_object_has_a_chance_of_one():
    objects = torch.from_numpy(np.random.default_rng(0).random((4, 12, 12))).float()
    partner = np.array([1, 2, 3, 0])
    answers = objects[np.argsort(partner)].flip((1, 2))  # answer partner[n] is object n, upside down
    answers = torch.nn.functional.pad(answers, (5, 3, 2, 6), value=0.0)
    scores = chance(list(answers.split(2)), objects, partner)
    np.testing.assert_allclose(scores["pearson"], 1, rtol=1e-5)
    assert scores.keys() == SCORES.keys()


def test_chance_is_the_best_of_all_shifts_and_turns():
    """By hand, with plain loops, on a frame of 64."""
    rng = np.random.default_rng(1)
    answers, objects = rng.random((2, 2, 11, 11)).astype(np.float32)
    scores = chance([torch.from_numpy(answers)], torch.from_numpy(objects), np.array([1, 0]))["pearson"]
    for n, other in ((0, 1), (1, 0)):
        made = answers[other]
        edge = np.sort(np.concatenate([made[0], made[-1], made[:, 0], made[:, -1]]))[21]  # the lower of two medians
        frame, target = np.zeros((2, 64, 64))
        frame[:11, :11], target[:11, :11] = made - edge, objects[n]
        best = max(
            (np.roll(turned, (y, x), (0, 1)) for turned in (frame, frame[::-1, ::-1]) for y in range(64)
             for x in range(64)), key=lambda moved: float((moved * (target - target.mean())).sum()),
        )  # fmt: skip
        expected = np.corrcoef(best[:11, :11].ravel(), objects[n].ravel())[0, 1]
        assert scores[n] == pytest.approx(expected, abs=1e-5)
