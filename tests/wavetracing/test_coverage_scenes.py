"""The street of forty blocks that the figures map: a pure function of its seed, with an error in every cell."""

import numpy as np
import pytest
from scenes import of_the_figures

from specklegen.wavetracing import coverage

forty_blocks = of_the_figures("_coverage_scenes").forty_blocks


def test_forty_blocks_follow_from_their_seed():
    one, again, other = (forty_blocks(seed).scene.meshes for seed in (3, 3, 4))
    assert [mesh.fingerprint for mesh in one] == [mesh.fingerprint for mesh in again]
    assert [mesh.fingerprint for mesh in one] != [mesh.fingerprint for mesh in other]
    heights = np.array([mesh.vertices[:, 2].max() for mesh in one[1:]])
    assert len(np.unique(heights)) == 40
    assert 12 <= heights.min() < heights.max() <= 30
    place = forty_blocks(3)
    assert place.outside(np.array(place.antenna.position))
    assert not place.air.all()


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
