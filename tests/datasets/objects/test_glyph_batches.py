"""Glyphs in batches: outlines filled as by the kernel of the CPU, objects as the family draws them one by one."""

import numpy as np
import pytest
import torch

from specklegen.datasets.addresses import Addresses
from specklegen.datasets.objects import glyph_batches
from specklegen.datasets.objects.glyphs import Glyphs
from specklegen.datasets.objects.outlines import outlines
from specklegen.synthesis.fused import FORMS

CPU = torch.device("cpu")


@pytest.mark.parametrize("shape", [(28, 28), (17, 40)])
def test_coverage_of_every_kind_of_outline(shape):
    """Sums in another order: 200 edges of areas of at most 1 leave 1e-13; the padding of short outlines adds none."""
    outline_edges = glyph_batches.glyph_edges(CPU)
    places = torch.arange(0, 945, 31)
    angle = torch.from_numpy(np.random.default_rng(0).uniform(-0.5, 0.5, len(places)))
    edges = glyph_batches.turned(outline_edges, places, angle)
    ends = edges.unflatten(2, (2, 2)).flatten(1, 2)
    low, extent = ends.amin(1), ends.amax(1) - ends.amin(1)
    placed = (edges - low.repeat(1, 2)[:, None]) * (0.9 * min(shape) / extent.amax(1))[:, None, None] + 0.37
    found, expected = FORMS["coverage"](placed, *shape), glyph_batches.coverage(placed, *shape)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert len(outlines()[int(places[3])]) < outline_edges.shape[1]


@pytest.mark.parametrize("split", ["train", "test"])
def test_objects_are_those_of_the_family(split):
    """Drawn together or one by one, on both sides of a place where no room is left along x: to rounding of float32."""
    family = Glyphs(shape=(20, 28), size=(0.4, 1.0))
    found = family.images(Addresses(7, split, CPU), range(40))
    expected = np.stack([family.image(7, split, n) for n in range(40)])
    np.testing.assert_allclose(found, expected, atol=2e-7)
    assert np.abs(expected[1:] - expected[:-1]).max(axis=(1, 2)).min() > 0.1, "power"
