"""Beams of Gaussian Schell-model sources in batches are those of the engine, source by source."""

import math

import numpy as np
import pytest
import torch

from specklegen.coherence.partially_coherent import effective_source_modes, gaussian_brightness
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.parts.source import source_of


def test_beams_and_modes_are_those_of_each_source():
    recipe = load_recipe("partially-coherent-slab", {"coherence_length": {"uniform": [20_000.0, 1e5]}})
    (count, pitch), seen = recipe.lattice, recipe.geometry
    source = source_of(count, pitch, seen.wavelength, seen.width, seen.profile, torch.device("cpu"))
    lengths = [20_000.0, 33_333.0, 1e5, math.inf]
    beams = source.beams(torch.tensor(lengths, dtype=torch.float64))
    modes = source.effective_modes(beams)
    for n, length in enumerate(lengths):
        expected = gaussian_brightness(count, pitch, 0.5, min(length, 100 * 50_000.0))
        np.testing.assert_allclose(beams[n], expected, rtol=1e-13)
        assert float(modes[n]) == pytest.approx(effective_source_modes(expected, pitch, 0.5, 50_000.0), rel=1e-12)
