"""What a measurement says of a picture: the gradient against differences, the step of phase retrieval."""

import numpy as np
import pytest
import torch

from specklegen.datasets.objects import Glyphs
from specklegen.models.learning.feedback import LAGS, NUMBERS, PICTURES, Measured
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram

FRAME = 36


@pytest.fixture(scope="module")
def case():
    """Two characters, and a measurement of the first without noise of any kind: its periodogram is its mean."""
    family = Glyphs(shape=(28, 28))
    both = torch.from_numpy(np.stack([family.image(3, "test", n) for n in range(2)])).double()
    objects = torch.nn.functional.pad(both, (4, 4, 4, 4))
    blank = Periodogram(torch.ones(1, 128, 65, dtype=torch.float64), torch.zeros(1).double(), 1000.0, (128, 128))
    layout = SpeckleLikelihood(blank, (FRAME, FRAME), Optics(2.0, 2.2))
    seen = layout.seeing(layout.object_spectrum(objects[:1]), torch.zeros(1).double(), 1000.0)
    return objects, Measured.of(seen, *(torch.ones(1, side, side).double() for side in (2 * FRAME - 1, LAGS)))


def test_the_shown_gradient_points_where_the_likelihood_rises(case):
    """By differences along five directions: proportional, with one factor above 0."""
    objects, measured = case
    picture = objects[1].clamp(0.01, 0.99)[None, None]
    shown = measured(picture)[0][0, 0, 1]
    assert float(shown.square().mean().sqrt()) == pytest.approx(0.25)
    generator, factors = torch.Generator().manual_seed(0), []
    for _ in range(5):
        along = torch.randn(FRAME, FRAME, generator=generator).double()
        ahead, behind = (measured.deviance(picture + sign * 1e-6 * along) for sign in (1, -1))
        factors.append(float((behind - ahead) / 2e-6) / float((shown * along).sum()))
    assert factors == pytest.approx([factors[0]] * 5, rel=1e-3)
    assert factors[0] > 0


def test_the_true_object_is_asked_for_by_its_own_lags(case):
    """The step keeps its phases, and amplitudes are its own but for the grain, which is half an object pixel."""
    objects, measured = case
    own, other = (measured(each[None, None])[0][0, 0, 2] for each in objects)
    assert torch.corrcoef(torch.stack([own.flatten(), objects[0].flatten()]))[0, 1] > 0.9
    assert torch.corrcoef(torch.stack([other.flatten(), objects[1].flatten()]))[0, 1] < 0.9


def test_moved_pictures_get_moved_hints(case):
    objects, measured = case
    moved = objects.roll((2, -1), (-2, -1))
    one, other = (measured(each[None, 1:])[0][0, 0] for each in (objects, moved))
    assert one.shape == (PICTURES, FRAME, FRAME)
    # The scale is that of the whole frame, of which the moved picture shows another part: proportional inside.
    for n in range(PICTURES):
        inside = [x[n, 8:-8, 8:-8].flatten() for x in (one.roll((2, -1), (-2, -1)), other)]
        assert torch.corrcoef(torch.stack(inside))[0, 1] > 0.999


def test_the_true_object_explains_what_was_measured(case):
    objects, measured = case
    _, told, deviance = measured(objects[None])
    assert told.shape == (1, 2, NUMBERS)
    assert deviance[0, 0] < 1e-3 < deviance[0, 1]
