"""Single scattering in closed form instead of Monte Carlo: on both sides of the gate, against the full computation."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg


def thin(mean_free_path: float, **changes) -> sg.Scene:
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=[-5.0, -4.0], upper=[5.0, 4.0], mean_free_path=mean_free_path, albedo=0.8,
                      scatterer=sg.Mixture(types=(sg.Isotropic(), sg.HenyeyGreenstein(g=0.5)), fractions=(0.4, 0.6))),
        illumination=sg.PlaneWaves.tilts([0.0, 0.05], dimensions=2), sensor=sg.FarField.angles([0.3, 0.35, 2.0]),
    ).replace(**changes)  # fmt: skip


def test_thin_media_are_closed_form_and_equal_to_monte_carlo():
    scene = thin(2000.0)
    closed = sg.covariance(scene)
    full = sg.covariance(scene, orders="all", paths=40_000, seed=1)
    assert closed.paths == 0
    assert not closed.decisions[1].needed
    assert "closed form" in closed.decisions[1].reason
    scale = np.sqrt(np.multiply.outer(full.intensity, full.intensity))
    # What was left out is allowed for, and named.
    assert closed.rel_error < 0.02
    assert_z(closed.value / scale, full.value / scale, full.standard_error / scale, degrees=63, slack=closed.rel_error)
    assert_z(closed.value, full.single, full.standard_error, degrees=63)


def test_thick_media_are_not():
    scene = thin(10.0)
    found = sg.covariance(scene, paths=64)
    assert found.paths == 64
    assert found.decisions[1].needed
    single = sg.covariance(scene, orders="single")
    full = sg.covariance(scene, orders="all", paths=40_000, seed=1)
    assert_z(single.value, full.single, full.standard_error, degrees=63)
    refute_z(single.value, full.value, full.standard_error, degrees=63)


def test_pairs_are_entries_of_the_whole():
    scene = thin(2000.0)
    rows = np.array([[0, 1, 1, 2], [1, 0, 0, 0]])
    some = sg.covariance(scene, pairs=rows)
    np.testing.assert_allclose(some.value, sg.covariance(scene).value[tuple(rows.T)], rtol=1e-12)


def test_scenes_without_a_closed_form_say_so():
    near = thin(2000.0, sensor=sg.NearField(points=[[0.0, 9.0]]))
    assert "no closed form" in sg.covariance(near, paths=64).decisions[1].reason
    assert_refused(lambda: sg.covariance(near, orders="single"), "covariance orders must be .*far-field sensor")
    assert_refused(lambda: sg.covariance(near, orders="double"), "covariance orders must be")


@pytest.mark.parametrize("kind", ["box", "voxels", "spheres", "points"])
def test_the_unit_of_length_sways_no_choice(kind):
    """Pilots are keyed by the scene in wavelengths; any other change of the scene gives another key."""

    def scene(unit: float, stretch: float = 1.0) -> sg.Scene:
        corners = {"lower": [-5.0 * unit, -4 * unit, 0], "upper": [5.0 * unit, 4 * unit, 3.3 * stretch * unit]}
        sphere = sg.Mie(radius=0.7 * unit, wavelength=unit, refractive_index=1.2)
        particle = sphere if kind == "spheres" else sg.Isotropic()
        return sg.Scene(
            wavelength=unit,
            medium=sg.VoxelGrid(extinction=[[[0.1 / unit]], [[0.3 / unit]]], scatterers=(sg.Isotropic(),), **corners)
            if kind == "voxels"
            else sg.Box(mean_free_path=60.0 * unit, scatterer=particle, **corners),
            illumination=sg.PointSources(points=[[0, 0, -9.0 * unit]]) if kind == "points"
            else sg.CollimatedBeams.tilts([0.0, 0.05], width=30.0 * unit),
            sensor=sg.NearField(points=[[0, 1.0 * unit, 30.0 * unit]]) if kind == "points"
            else sg.FarField.grid(shape=(2, 2), pitch=0.01),
        )  # fmt: skip

    print_ = scene(1.0).unitless_fingerprint()
    for unit in (1e-3, 0.7, 532.0, 1e9 / 3):
        assert scene(unit).unitless_fingerprint() == print_
    assert scene(1.0, 1 + 1e-6).unitless_fingerprint() != print_
