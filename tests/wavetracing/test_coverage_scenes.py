"""A street of forty blocks: every cell of its map has an error."""

import numpy as np
import pytest
from scenes import of_the_figures

from specklegen.wavetracing import PointEmitter, coherent_rays, coverage

forty_blocks = of_the_figures("_coverage_scenes").forty_blocks


@pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
@pytest.mark.parametrize("frequency", [0.9e9, 30e9])
def test_every_cell_of_a_street_has_an_error(frequency):
    place = forty_blocks()
    plane = place.plane.replace(center=[0, -27, 1.5], shape=(1, 8), pitch=12.0)
    found = coverage(place.scene, place.antenna, plane, frequency, diffractions=1, samples=2)
    seen = ~found.rss_dBm.mask
    assert seen.all()
    assert (found.error.data[seen] > 0).all()
    assert np.isfinite(found.error.data[seen]).all()


@pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")
def test_exchange_in_a_street_of_forty_blocks():
    """Source and receiver change places at one mirror and two edges; most edges are dark, and none of them is tried."""
    place = forty_blocks()
    one, two = place.antenna.position + [0.3, 1.7, 0], np.array([71.3, 20.4, 1.5])
    there, back = (
        coherent_rays(place.scene, PointEmitter(a, 0.1), [b], surfaces="material") for a, b in ((one, two), (two, one))
    )
    assert there == pytest.approx(back, rel=1e-8)
