"""Where "auto" leaves reversed paths out, they add less than it says: held against paths weighed both ways."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.reversal import reversal_decision, scene_reversal
from specklegen.paths.tracer import Tracer, plane_tracer, volume_tracer
from specklegen.scene.illumination import directions_of_sines

AXIS = np.array([[0.0, 0.0, 1.0]])
FORWARD = sg.Slab(thickness=25.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.9))


def reflected(degrees: float) -> np.ndarray:
    return directions_of_sines("view", [[np.sin(np.deg2rad(degrees)), 0.0]], -1.0)


def excess(slab: sg.Slab, view: np.ndarray, paths: int) -> tuple[float, float]:
    """Share of the intensity that reversed paths add, and its standard error; wavelength 1."""
    return excess_of(plane_tracer(slab, 1.0, AXIS, view, True), paths)


def excess_of(tracer: Tracer, paths: int) -> tuple[float, float]:
    """The same of any tracer of one light and view that weighs paths both ways."""
    bank = tracer.trace(3, paths, threads=1)
    single = np.square(np.abs(single_amplitudes(tracer.layout, bank.single))).sum()
    many = bank.multiple
    both, apart = (
        np.square(np.abs(multiple_amplitudes(tracer.layout, many, bidirectional=True, reverse=way)[0]))
        for way in (True, False)
    )
    added = np.bincount(many.paths, both - apart[: len(many)] - apart[len(many) :], paths)
    total = single + apart.sum()
    return added.sum() / total, np.sqrt(paths) * added.std() / total


def bound(slab: sg.Slab, view: np.ndarray) -> float:
    """The least tolerance at which reversed paths are left out."""
    low, high = 1e-6, 1.0
    while high / low > 1.01:
        middle = np.sqrt(low * high)
        kept = reversal_decision(slab, 1.0, AXIS, view, "auto", middle).needed
        low, high = (middle, high) if kept else (low, middle)
    return high


def test_forward_scatterers_keep_reversed_paths_six_degrees_off():
    """They add 15 to 18 % there; 0.65/(k l |i + v|) of isotropic scatterers promised 1.9 %."""
    view = reflected(6.1)
    added, error = excess(FORWARD, view, 20_000)
    assert added - 6 * error > 0.05
    assert reversal_decision(FORWARD, 1.0, AXIS, view, "auto", 0.1).needed
    curve = sg.memory_effect(FORWARD, wavelength=1.0, tilts=[0.0], mode="reflection", view=view[0], paths=64)
    assert curve.reverse


@pytest.mark.parametrize(("g", "optical_depth", "mean_free_path"), [
    (0.99, 0.5, 50.0), (0.9, 2.0, 10.0), (0.6, 0.3, 20.0), (0.0, 0.5, 50.0), (-0.5, 0.5, 20.0), (-0.9, 3.0, 20.0),
])  # fmt: skip
def test_the_bound_holds_beside_paths_weighed_both_ways(g, optical_depth, mean_free_path):
    """Above the excess by no more than 5 of its standard errors less (chance 3e-7), and no trivial 1."""
    scatterer = sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    slab = sg.Slab(thickness=optical_depth * mean_free_path, mean_free_path=mean_free_path, scatterer=scatterer)
    for degrees in (4.0, 12.0):
        view = reflected(degrees)
        added, error = excess(slab, view, 4000)
        assert added - 5 * error < bound(slab, view) < 0.9, (degrees, added, error)


def flat(g: float, degrees: float) -> sg.Scene:
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=np.array([-25.0, 0.0]), upper=np.array([25.0, 25.0]), mean_free_path=50.0,
                      scatterer=sg.HenyeyGreenstein(g=g)),
        illumination=sg.PlaneWaves.tilts([0.0], dimensions=2), sensor=sg.FarField.angles(np.deg2rad([180 - degrees])),
    )  # fmt: skip


def test_flatland_is_bounded_by_its_own_lobe():
    """9 degrees off backscattering; 0.56/(k l |i + v|) promised 1.1 %."""
    scene = flat(0.9, 9.0)
    added, error = excess_of(volume_tracer(scene, True), 20_000)
    assert added - 5 * error > 0.02, (added, error)
    assert scene_reversal(scene, "auto", 0.02).needed
    assert not scene_reversal(flat(0.9, 179.0), "auto", 0.02).needed


def test_transmission_leaves_them_out():
    ahead = directions_of_sines("view", [[0.0, 0.0]], 1.0)
    for g in (0.0, 0.9, 0.99):
        slab = FORWARD.replace(scatterer=sg.HenyeyGreenstein(g=g))
        assert not reversal_decision(slab, 1.0, AXIS, ahead, "auto", 0.02).needed


def test_nothing_is_reversed_behind_refracting_faces():
    """Within 0.6 wavelengths of free path the bound of an unlimited medium is above any tolerance, also behind it."""
    slab = sg.Slab(thickness=3.0, mean_free_path=0.6, scatterer=sg.Isotropic(), faces=sg.Faces(inside=1.33))
    lights = sg.CollimatedBeams.tilts([0.0, 0.3], width=100.0)
    scene = sg.Scene(wavelength=1.0, medium=slab, illumination=lights, sensor=sg.FarField.grid((8, 8), pitch=0.003))
    assert not scene_reversal(scene, "auto", 1e-9).needed
    assert scene_reversal(scene.replace(sensor=scene.sensor.replace(side="reflection")), "auto", 0.02).needed
