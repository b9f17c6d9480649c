"""Points take the network's place where they explain what was measured, and nowhere else."""

import numpy as np
import torch
from torch.nn.functional import avg_pool2d, pad

from specklegen.datasets.objects import Glyphs, Points
from specklegen.models.learning.few_points import SURPRISE, few_points
from specklegen.models.learning.networks.unrolled import SCALARS, Candidates
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.metrics import align, pearson

SIDE, CAMERA, ANSWERS = 36, 128, 2


def test_sparse_images_of_points_alone_are_replaced():
    """Three points; a character that the network shows as points; a character that it shows as one."""
    points, glyph = (family.image(3, "train", 0) for family in (Points(count=3), Glyphs()))
    objects = pad(torch.from_numpy(np.stack([points, glyph, glyph])), (4, 4, 4, 4))
    steps = np.arange(1 - SIDE, SIDE)
    c_i = torch.from_numpy(np.exp2(-np.hypot(steps[:, None], steps) / 20)).float().expand(3, -1, -1)
    dark = Periodogram(torch.ones(3, CAMERA, CAMERA // 2 + 1), torch.zeros(3), 1.0, (CAMERA, CAMERA))
    likelihood = SpeckleLikelihood(dark, (SIDE, SIDE), Optics(1.5, 3.0))
    spectrum = likelihood.object_spectrum(objects, c_i)
    drawn = np.random.default_rng(0).exponential(1.0, spectrum.shape)
    likelihood = likelihood.seeing(spectrum * torch.from_numpy(drawn).float(), likelihood.noise, 1.0)
    shown = avg_pool2d(objects[[0, 0, 1]], 3, 1, 1)
    begun = Candidates(shown[:, None].repeat(1, 2 + 2 * ANSWERS, 1, 1), torch.zeros(3, 1 + ANSWERS),
                       torch.zeros(3, SCALARS))  # fmt: skip
    found, *none = few_points(shown, begun, likelihood, c_i, ANSWERS)
    assert none == [None, None]
    assert found is not None
    assert found.points == 3
    assert pearson(align(found.image[None], objects[:1]), objects[:1])[0] > 0.999
    assert found.evidence[0] < SURPRISE
    assert found.evidence.shape == (5,)
    assert found.evidence[2] > 0
