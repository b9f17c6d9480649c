"""Views between those at which connections are judged, beside narrow lobes: as many paths make their light as any."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.roulette import between_probes
from specklegen.paths.tracer import probe_views, seen_views, slab_tracer, volume_tracer
from specklegen.theory.phase_screens import lobes

PATHS = 6000
RADII = [0.0, 0.05, 0.1, 0.15, 0.2]  # the last in the middle of an edge of the camera
AXIS = np.array([0.0, 0.0, 1.0])
NARROW = {"vMF": sg.VonMisesFisher(316.0), "HG": sg.HenyeyGreenstein(0.97)}


def scene_of(scatterer, half=0.2, tilts=(0.0,), medium=None):
    medium = medium or sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=scatterer)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=sg.CollimatedBeams.tilts(list(tilts), width=200.0),
                    sensor=sg.FarField.grid((161, 161), half / 80))  # fmt: skip


def light_at(tracer, bank):
    """What each connection sends to the views of RADII along x, float64[V, M]."""
    views = np.array([[r, 0.0, np.sqrt(1 - r * r)] for r in RADII])
    return np.array([contributions(tracer.layout.at(AXIS, view), bank) for view in views])


def counted(powers):
    """How many connections of one power would vary as much, float64[V]."""
    return np.square(powers.sum(axis=1)) / np.square(powers).sum(axis=1)


@pytest.mark.parametrize("lobe", NARROW)
def test_every_view_is_made_of_as_many_paths_as_without_roulette(lobe):
    scene = scene_of(NARROW[lobe])
    tracer = slab_tracer(scene, False)
    share = between_probes([NARROW[lobe]], 3, seen_views(scene, np.zeros((1, 2))), probe_views(scene))

    def counts(times):
        judged = replace(tracer.proposal, threshold=times * tracer.proposal.threshold)
        bank = replace(tracer, proposal=judged).trace(1, PATHS, threads=1)
        return counted(light_at(tracer, bank))

    least = 0.5 * counts(0.0)
    assert (counts(1.0) > least).all()
    assert (counts(1 / share) < 0.3 * least).any()  # judged as if there were nothing between, which it was


@pytest.mark.parametrize("scatterer", [sg.VonMisesFisher(800.0), sg.HenyeyGreenstein(0.985)], ids=["vMF", "HG"])
@pytest.mark.parametrize("medium", ["box", "voxels"])
def test_walks_through_volumes_keep_the_light_between_their_probes(scatterer, medium):
    """They judge connections at five of the views; the share of the threshold keeps those that are bright elsewhere."""
    box = sg.Box(lower=[-80.0, -80.0, 0.0], upper=[80.0, 80.0, 100.0], mean_free_path=8.0, scatterer=scatterer)
    if medium == "voxels":
        cells = np.full((2, 2, 2), 1 / 8)
        box = sg.VoxelGrid(lower=box.lower, upper=box.upper, extinction=cells, scatterers=[scatterer])
    tracer = volume_tracer(scene_of(scatterer, medium=box), False)
    views = tracer.layout.views
    share = between_probes([scatterer], 3, views.of(np.arange(0, len(views), 97)).vectors, views.probed().vectors)
    angles = np.arange(8) * np.pi / 4
    seen = [[0.0, 0.0], *(r * np.array([np.cos(a), np.sin(a)]) for r in (0.1, 0.2) for a in angles)]
    seen = [np.append(each, np.sqrt(1 - each @ each)) for each in map(np.asarray, seen)]

    def counts(times):
        bank = replace(tracer, threshold=times * tracer.threshold).trace(1, 2000, threads=1)
        found = np.array([contributions(tracer.layout.at(AXIS, view), bank) for view in seen])
        return counted(found), len(bank)

    (every, all_kept), (kept, some), (judged, _) = counts(0.0), counts(1.0), counts(1 / share)
    assert some < 0.8 * all_kept  # roulette there is
    assert (kept > 0.8 * every).all()
    assert (judged < 0.3 * every).any()  # judged as if there were nothing between, which it was


def test_views_between_probes_are_as_bright_as_a_screen_of_the_same_lobe():
    """Where deflections are small a slab's lobe is that of a phase screen of sigma^2 = OD, (k xi)^2 = 2 kappa."""
    kappa, depth = 316.0, 5.0
    tracer = slab_tracer(scene_of(sg.VonMisesFisher(kappa)), False)
    batches = []
    for n in range(20):
        bank = tracer.trace(3, 1000, first=1000 * n, threads=1)
        batches.append(light_at(tracer, bank).sum(axis=1))
    found, error = jackknife(np.array(batches), lambda total: total[1:] / total[0])
    screen = sg.PhaseScreen(rms_phase=depth**0.5, correlation_length=(2 * kappa) ** 0.5 / (2 * np.pi))
    exact = lobes(screen.stack, 1.0).density(np.array(RADII))
    expected = exact[1:] / exact[0]
    assert_z(found, expected, error, degrees=19, slack=0.03 * expected)
    refute_z(0.8 * found, expected, 0.8 * error, degrees=19, slack=0.03 * expected)


def test_an_error_is_stated_for_the_views_between_too():
    """The plan's, of five views, is at least that of a view in the middle of an edge."""
    made = sg.plan(scene_of(NARROW["vMF"]), paths=PATHS, sampler="paths")
    tracer = made.chosen.tracer
    worst = counted(light_at(tracer, tracer.trace(1, PATHS, threads=1))).min() ** -0.5
    assert 0.9 * worst < made.expected_error < 0.15


def test_cameras_that_are_narrow_beside_the_lobe_are_judged_as_before():
    for scatterer, half in ((sg.HenyeyGreenstein(0.9), 0.05), (sg.Isotropic(), 0.6), (NARROW["vMF"], 0.02)):
        scene = scene_of(scatterer, half)
        assert between_probes([scatterer], 3, seen_views(scene, np.zeros((1, 2))), probe_views(scene)) == 1.0
    nothing = np.empty((0, 3))
    assert between_probes([NARROW["vMF"]], 3, nothing, nothing) == 1.0


def test_views_are_those_that_the_middle_light_sees():
    scene = scene_of(NARROW["vMF"], 0.1)
    seen = seen_views(scene, np.array([[-0.05, 0.0], [0.0, 0.0], [0.05, 0.0]]))
    assert seen[:, 0].min() == pytest.approx(-0.15)
    assert seen[:, 0].max() == pytest.approx(0.15)
    np.testing.assert_allclose(np.abs(seen[:, 1]).max(), 0.1)
    np.testing.assert_allclose(np.square(seen).sum(axis=1), 1.0)
    back = scene.replace(sensor=scene.sensor.replace(side="reflection"))
    assert (seen_views(back, np.array([[-0.05, 0.0], [0.05, 0.0]]))[:, 2] < 0).all()
