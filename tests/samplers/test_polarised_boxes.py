"""Polarised light through boxes and voxels: the matrix between two ends, wide boxes as slabs, refusals."""

import warnings

import numpy as np
import pytest

import specklegen as sg
from specklegen.paths.bank import walk_frame
from specklegen.paths.endpoint_factors import contributions_of_pairs
from specklegen.paths.tracer import slab_tracer, volume_tracer
from tests.refusals import assert_refused
from tests.zscore import assert_z, refute_z

RAYLEIGH, HG = sg.media.Rayleigh(), sg.media.HenyeyGreenstein(0.6)
WIDE = {"lower": [-300.0, -300.0, 0.0], "upper": [300.0, 300.0, 20.0]}
BEAM = sg.light.CollimatedBeams.tilts([0.0], width=60.0)
VIEWS = sg.sensors.FarField([[0.0, 0.0, 1.0], [0.3, 0.2, np.sqrt(0.87)], [0.5, 0.0, -np.sqrt(0.75)]])
CROSSED, PARALLEL = sg.light.Polarisers.crossed(), sg.light.Polarisers.parallel()


def box(scatterer=RAYLEIGH, polarisation="vector", **parts):
    corners = WIDE | {name: parts.pop(name) for name in ("lower", "upper") if name in parts}
    return sg.media.Box(**corners, mean_free_path=10.0, scatterer=scatterer, polarisation=polarisation, **parts)


def scene(medium, polarisers=PARALLEL, sensor=VIEWS):
    return sg.Scene(wavelength=1.0, medium=medium, illumination=BEAM, sensor=sensor, polarisers=polarisers)


def intensities(seen, tracer, paths=1500):
    """Mean intensity at each view, of 20 batches of paths: means and standard errors float64[V]."""
    batches = []
    for n in range(20):
        bank = tracer(seen, False).trace(4, paths, first=n * paths, threads=1)
        batches.append(contributions_of_pairs(tracer(seen, False).layout, bank)[0].sum(axis=-1) / paths)
    batches = np.array(batches)
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / 20**0.5


def test_a_walk_of_three_scatterings_carries_the_one_between():
    """M is then the projection across the second direction, over the root of (1 + cos^2) / 2."""
    bank = volume_tracer(scene(box(HG, "projector")), False).trace(1, 3000, threads=1)
    three = bank.select(bank.orders == 3)
    assert len(three) > 100
    one, other = three.entry_direction, three.exit_direction
    cos = (one * other).sum(axis=-1)[:, None, None]
    outer = np.eye(3) - other[:, :, None] * other[:, None, :]
    expected = outer @ (np.eye(3) - one[:, :, None] * one[:, None, :]) * np.sqrt(2 / (1 + cos**2))
    found = np.swapaxes(walk_frame(other), -1, -2) @ three.jones @ walk_frame(one)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("polarisers", [PARALLEL, CROSSED])
@pytest.mark.parametrize(("scatterer", "polarisation"), [(RAYLEIGH, "vector"), (HG, "projector")])
def test_a_wide_box_is_a_slab(scatterer, polarisation, polarisers):
    """Mean intensities behind both analysers and in reflection, by two walks; half of natural light is told."""
    slab = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=scatterer, polarisation=polarisation)
    found, error = intensities(scene(box(scatterer, polarisation), polarisers), volume_tracer)
    expected, spread = intensities(scene(slab, polarisers), slab_tracer)
    assert (np.hypot(error, spread) < 0.06 * expected).all()
    assert_z(found, expected, np.hypot(error, spread), degrees=19)
    natural, _ = intensities(scene(slab.replace(polarisation="scalar"), None), slab_tracer)
    refute_z(found, natural / 2, np.hypot(error, spread), degrees=19)


def test_a_seed_is_one_medium_behind_all_analysers():
    """What an analyser at 45 degrees passes is the sum of both components over the root of 2."""
    camera = sg.sensors.FarField.grid((6, 6), 4e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
        co, crossed, turned = (
            sg.render(scene(box(), each, camera), paths=300, seed=2, threads=1, sampler="paths").field[0]
            for each in (PARALLEL, CROSSED, sg.light.Polarisers(analyser=[1, 1]))
        )
    np.testing.assert_allclose(turned, (co + crossed) / 2**0.5, atol=1e-5 * np.abs(co).max())


@pytest.mark.slow
def test_voxels_are_the_box_of_their_density():
    """Of even voxels in one material: the mean intensity of the box, by walks that cross voxels."""
    few = {"lower": [-30.0, -30.0, 0.0], "upper": [30.0, 30.0, 20.0]}
    even = sg.media.VoxelGrid(**few, extinction=np.full((2, 3, 3), 0.1), scatterers=[RAYLEIGH], polarisation="vector")
    found, error = intensities(scene(even), volume_tracer)
    expected, spread = intensities(scene(box(**few)), volume_tracer)
    assert_z(found, expected, np.hypot(error, spread), degrees=19)


def test_what_is_not_scattered_keeps_its_polarisation():
    views = sg.sensors.FarField([[0.0, 0.0, 1.0]])
    co, crossed = (sg.statistics.mean_field(scene(box(), each, views)) for each in (PARALLEL, CROSSED))
    scalar = sg.statistics.mean_field(scene(box(polarisation="scalar"), None, views))
    np.testing.assert_allclose(co, scalar, rtol=1e-12)
    assert np.abs(crossed).max() < 1e-9 * np.abs(co).max()


@pytest.mark.parametrize(("message", "make"), [
    (r'Box\.polarisation must be "scalar" in flatland',
     lambda: box(lower=[-9.0, 0.0], upper=[9.0, 9.0])),
    (r'Box\.polarisation must be "scalar" or "projector" of HenyeyGreenstein', lambda: box(HG)),
    (r"Box\.motion must be random", lambda: box(motion=sg.media.Shear(rate=1.0))),
    (r"Scene\.polarisers must be given for polarised light", lambda: scene(box(), None)),
    (r"Scene\.polarisers must be left out for scalar light.*Give the Box", lambda: scene(box(polarisation="scalar"))),
])  # fmt: skip
def test_refused(message, make):
    assert_refused(make, message)
