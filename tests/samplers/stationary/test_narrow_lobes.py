"""Slabs of narrow lobes, whose light stays about the beam: an envelope that the stationary sampler does not draw.

Where deflections are small a slab's lobe is that of a phase screen of sigma^2 = OD and (k xi)^2 = 2 / (1 - g).
"""

import numpy as np
import pytest
from zscore import assert_z

import specklegen as sg
from specklegen.benchmarking import Probes
from specklegen.benchmarking.estimates import paths_estimate
from specklegen.samplers.stationary.rule import scene_stationary_error
from specklegen.theory.phase_screens import lobes

HALF, CONCENTRATION, DEPTH = 60, 1000.0, 5.0


@pytest.fixture(scope="module")
def scene():
    """A camera of half a degree behind lobes of two degrees, so that its corners are some per cent darker."""
    medium = sg.Slab(thickness=2000.0, mean_free_path=2000.0 / DEPTH, scatterer=sg.VonMisesFisher(CONCENTRATION))
    return sg.Scene(
        wavelength=1.0, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0, 0.001], width=2000.0),
        sensor=sg.FarField.grid((2 * HALF + 1, 2 * HALF + 1), 1 / 6000),
    )  # fmt: skip


def darker(scene):
    """What the corner of a camera lacks of the middle's intensity, in closed form."""
    screen = sg.PhaseScreen(rms_phase=DEPTH**0.5, correlation_length=(2 * CONCENTRATION) ** 0.5 / (2 * np.pi))
    corner = np.hypot(*scene.sensor.corner_directions[0, :2])
    one, other = lobes(screen.stack, 1.0).density(np.array([corner, 0.0]))
    return 1 - one / other


def test_the_planner_states_how_much_the_envelope_varies_and_leaves_the_scene_to_path_sums(scene):
    plan = sg.plan(scene)
    assert plan.sampler == "paths"
    (said,) = [each.reason for each in plan.decisions if each.part == "stationary sampler"]
    found = scene_stationary_error(scene, 0.02, False)
    assert f"its intensities by {found.intensity:.2g}" in said
    assert found.correlation + 2 * found.correlation_error < 0.02  # the envelope alone is against it
    # The figure is the largest over five views, of which one is the middle: it may exceed the corner's by its error.
    off, error = np.array([found.intensity]), np.array([found.intensity_error])
    assert_z(off, np.array([darker(scene)]), error, degrees=63, slack=0.005)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(off, np.array([0.0]), error, degrees=63, slack=0.005)


def test_path_sums_have_the_envelope(scene):
    side = 2 * HALF + 1
    probes = Probes.among([(0, 0), (0, HALF * side + HALF)])
    found = np.array([paths_estimate(scene, probes, 4000, seed).value[:2].real for seed in range(64)])
    lacking = (found[:, 1] - found[:, 0]) / found[:, 1].mean()
    mean, error = lacking.mean(keepdims=True), np.array([lacking.std(ddof=1) / 8])
    assert_z(mean, np.array([darker(scene)]), error, degrees=63, slack=0.003)
    with pytest.raises(AssertionError, match="z ="):
        assert_z(mean, np.array([0.0]), error, degrees=63, slack=0.003)


def test_the_stationary_sampler_that_is_asked_for_warns_with_the_figure(scene):
    with pytest.warns(sg.DoubtWarning, match=r"its intensities by 0\.0[3-5]"):
        sg.render(scene, sampler="stationary", paths=2000)
    few = scene.replace(sensor=sg.FarField.grid((33, 33), 1 / 6000))
    assert sg.plan(few).sampler == "stationary"
    assert scene_stationary_error(few, 0.02, False).intensity < 0.02
