"""The surface integral against closed forms and itself."""

import numpy as np
import pytest
from references.rayleigh_sommerfeld import disc_axis, surface_field


def test_on_the_axis_of_a_disc():
    """A polygon of 720 sides and the area of the disc: O(1/720^2) of the phase beside the rim's wave."""
    turn, z = np.linspace(0, 2 * np.pi, 721), 6.0
    radius = 3.0 * np.sqrt((turn[1]) / np.sin(turn[1]))
    rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    wedges = np.stack([np.zeros((720, 2)), rim[:-1], rim[1:]], axis=1)
    found = surface_field(wedges, [[0, 0, z]], order=24)[0]
    assert found == pytest.approx(disc_axis(3.0, z), abs=1e-4)
    assert abs(found - disc_axis(3.01, z)) > 1e-2
