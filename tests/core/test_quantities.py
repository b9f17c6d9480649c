"""Lengths with units: the same setup however it is written, and no number among units without one."""

import pickle

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.quantities import mark_of, nodes_of
from specklegen.core.units import METRES
from specklegen.datasets import load_recipe
from specklegen.fdtd import RandomLayer, coherent_transmission, slab_fresnel
from specklegen.measured import ContrastVersusBandwidth, MemoryCurve, Sphere, SphereReadings, TemporalCurve
from specklegen.theory.focused_light import gaussian_focus
from specklegen.theory.phase_screens import spread
from specklegen.theory.speckle_contrast import exponential_contrast_squared
from specklegen.wavetracing import (
    GaussianLaser,
    Geometry,
    Plane,
    Transmitter,
    coverage,
    itu_permittivity,
    perforated_screen,
    sample_slits,
    wedge_field,
)

UNITS = ("nm", "um", "mm", "m")


IN_UNITS = """
wavelength = "500 nm"
medium = {type = "Slab", thickness = "1 mm", mean_free_path = "0.1 mm", scatterer = {type = "Isotropic"}}
illumination = {type = "CollimatedBeams", directions = [[0.0, 0.0, 1.0]], width = "5 mm"}
sensor = {type = "FarFieldGrid", shape = [4, 4], pitch = 2e-5}
"""
SPHERES = """
type = "Slab"
thickness = "1 mm"
mean_free_path = "0.1 mm"
scatterer = {type = "Mie", radius = 0.7, wavelength = "500 nm", refractive_index = 1.2}
"""


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: sg.PhaseScreen(correlation_length="10 um", rms_height=1.0, index=1.5), "PhaseScreen.rms_height"),
        (lambda: sg.ScreenStack(screens=[sg.PhaseScreen(correlation_length="10 um", rms_phase=1.0)] * 2, gaps=[500.0]),
         "ScreenStack.gaps.0"),
        (lambda: sg.ScreenStack(screens=[sg.PhaseScreen(correlation_length="1 um", rms_phase=1.0)],
                                velocities=[(2.0, 0.0)]), "ScreenStack.velocities.0.0"),
        (lambda: GaussianLaser([0, 0, -10], [0, 0, 1], waist="5 um", wavelength=0.5), "GaussianLaser.position"),
        (lambda: Plane(center=["0 mm", "0 mm", "5 mm"], pitch=1.0), "Plane.pitch"),
        (lambda: sg.materials.memory_range("milk", wavelength=0.633, thickness="1 mm"), "memory_range wavelength"),
        (lambda: sg.memory_effect(sg.GroundGlass(grit=220), wavelength="532 nm", tilts=["0 mm"]),
         "tilts.0 must be a number in radians"),
        (lambda: sg.joint_correlation(slab(), wavelength="532 nm", tilts=[0.0], shifts=[1.0]),
         "joint_correlation shifts.0 must be written"),
        (lambda: sg.memory_effect(slab(), wavelength=0.532, tilts=[0.0]), "memory_effect wavelength"),
        (lambda: sg.materials.get("milk", 532e-9), 'It looks like metres: write 0.532 or "532 nm"'),
        (lambda: exponential_contrast_squared("5 ms", 0.005), 'as exposure = "5 ms" has one'),
        (lambda: sg.memory_effect(sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.Isotropic()),
                                  wavelength="532 nm", tilts=[0.0]), "memory_effect medium.thickness"),
        (lambda: slab().replace(thickness=700.0), "Slab.thickness"),
        (lambda: sg.materials.get("polystyrene", "633 nm", radius=0.5), "get numbers.radius"),
        (lambda: load_recipe("through-slab", {"lab": {"wavelength": "532 nm"}, "material": {
            "preset": {"name": "polystyrene", "radius": 0.5}, "thickness": "1 mm"}}), "material.preset.radius"),
        (lambda: spread(sg.PhaseScreen(correlation_length="9 um", rms_phase=1.0).stack, 0.5), "spread wavelength"),
        (lambda: sg.PhaseScreen(correlation_length="9 um", rms_phase=1.0).rms_angle(0.5), "rms_angle wavelength"),
        (lambda: gaussian_focus([[0, 0, 1.0]], [[0, 0, 0.0]], "5 um", "0.5 um"), "gaussian_focus places"),
        (lambda: exponential_contrast_squared("5 ms", 0.005), "exponential_contrast_squared correlation_time"),
        (lambda: coherent_transmission(RandomLayer(correlation_length="9 nm"), 0.6), "transmission wavelength"),
        (lambda: sphere_readings("1 mm", 1.0), "SphereReadings.slide_thickness"),
        (lambda: sample_slits(["5 um"], ["0 um"], [0.0], 10, 0), "sample_slits wavelength"),
        (lambda: wedge_field(1.5, "45 deg", "30 deg", "1 m", 10.0, "soft"), "wedge_field k"),
        (lambda: coverage(Geometry([perforated_screen([[-1, -1], [1, -1], [1, 1]])]), Transmitter([0, 0, -5]),
                          Plane(center=["0 m", "0 m", "5 m"], shape=(2, 2), pitch="1 m"), "1 GHz"), "coverage Plane"),
        (lambda: sg.Slab.from_toml(SPHERES), "Slab.scatterer.radius"),
    ],
)  # fmt: skip
def test_refused_by_field(make, field):
    with pytest.raises(RuleError) as error:
        make()
    assert field in str(error.value)


def sphere_readings(thickness: object, slide: object) -> SphereReadings:
    sphere = Sphere("20 cm", "20 mm", "20 mm", "5 mm", 0.97)
    assert sphere == Sphere(200.0, 20.0, 20.0, 5.0, 0.97)
    read = {"reflection": np.array([0.4])}
    return SphereReadings(1.33, 1.5, thickness, slide, "2 mm", 0.99, 1, sphere, sphere, read, False, "")


@pytest.mark.parametrize("unit", UNITS)
def test_forms_of_theory_and_measured_data_do_not_know_the_unit(unit):
    """Of closed forms, presets and readings: texts in any unit give what numbers in the usual one give."""

    def length(micrometres):
        return f"{micrometres * 1e-6 / METRES[unit]:.12g} {unit}"

    inverse = f"{10.0 * METRES[unit] / 1e-6:.12g} /{unit}"
    screen = sg.PhaseScreen(correlation_length=length(9.0), rms_phase=1.0)
    stack = sg.ScreenStack(screens=[screen] * 2, gaps=[length(50.0)])
    bare = sg.ScreenStack(**stack.model_dump())
    place, focus = np.array([[0.0, 1.0, 2.0]]), np.array([0.0, 0.0, 1.0])
    written = [[length(x) for x in place[0]]], [length(x) for x in focus]
    pairs = [
        (spread(stack, length(0.5)), spread(bare, 0.5)),
        (gaussian_focus(*written, length(5.0), length(0.5)), gaussian_focus(place, focus, 5.0, 0.5)),
        (slab_fresnel(1.5, 1.0, length(3.0), [inverse]), slab_fresnel(1.5, 1.0, 3.0, np.array([10.0]))),
        (sg.materials.get("polystyrene", length(0.633), radius=length(0.5)).mean_free_path,
         sg.materials.get("polystyrene", 0.633, radius=0.5).mean_free_path),
        (wedge_field(1.5, "45 deg", "30 deg", length(90.0), inverse, "soft"),
         wedge_field(1.5, np.pi / 4, np.pi / 6, 90.0, 10.0, "soft")),
        (ContrastVersusBandwidth(bandwidths=[inverse], contrast=[0.9], error=0.01).at, [10.0]),
        (sphere_readings(length(1000.0), length(500.0)).thickness, 1.0),
    ]  # fmt: skip
    for n, (found, expected) in enumerate(pairs):
        np.testing.assert_allclose(found, expected, rtol=1e-9, err_msg=str(n))
    assert itu_permittivity("concrete", "2.4 GHz") == itu_permittivity("concrete", 2.4e9)


def slab(**fields: object) -> sg.Slab:
    given = {"thickness": "0.5 mm", "mean_free_path": "50 um", "scatterer": sg.HenyeyGreenstein(0.9)} | fields
    return sg.Slab(**given)


def test_images_do_not_know_the_unit():
    """The same bits of texts in any unit. Of bare numbers intensities are areas in it; what transforms leave out of
    path sums, a thousandth of a field at most, follows from last bits."""

    def image(length, angle):
        slab = sg.Slab(thickness=length(2e-4), mean_free_path=length(5e-5), scatterer=sg.HenyeyGreenstein(0.8))
        light = sg.CollimatedBeams.tilts([0.0, angle], width=length(4e-4))
        seen, scale = sg.FarField.grid((16, 16), 5e-4), length(5e-7)
        scene = sg.Scene(wavelength=scale, medium=slab, illumination=light, sensor=seen)
        return sg.render(scene, paths=500, seed=1, sampler="paths").intensity

    reference = image(lambda metres: metres * 1e6, 5e-4)
    for unit, size in ((unit, METRES[unit]) for unit in UNITS):
        written = image(lambda metres, unit=unit, size=size: f"{metres / size:.12g} {unit}", "0.5 mrad")
        np.testing.assert_array_equal(written, reference)
        bare = image(lambda metres, size=size: metres / size, 5e-4) * (size / 1e-6) ** 2
        np.testing.assert_allclose(bare, reference, rtol=0, atol=1e-4 * reference.mean())


def test_all_violations_are_told_at_once():
    with pytest.raises(RuleError) as error:
        load_recipe("through-slab", {"material": {"thickness": 0.5, "wavelength": "532 nm"}, "window": {"width": 5.0}})
    assert [line.split(" must")[0] for line in str(error.value).split("\n")] == ["material.thickness", "window.width"]


def test_a_ground_glass_takes_no_wavelength_in_metres():
    glass = sg.GroundGlass(grit=220)
    with pytest.raises(RuleError, match='It looks like metres: write 0.532 or "532 nm"'):
        sg.memory_effect(glass, wavelength=532e-9, tilts=[0.0, 1e-3])
    right = sg.memory_effect(glass, wavelength="532 nm", tilts=[0.0, 1e-3]).intensity
    assert np.array_equal(right, sg.memory_effect(glass, wavelength=0.532, tilts=[0.0, 1e-3]).intensity)
    in_metres = sg.GroundGlass(grit=220, unit=1.0)
    assert sg.memory_effect(in_metres, wavelength=532e-9, tilts=[0.0, 1e-3]).intensity == pytest.approx(right)
    with pytest.raises(RuleError, match="one unit of length"):
        sg.ScreenStack(screens=(glass, in_metres), gaps=(1.0,))


def test_measured_curves_take_units():
    tilts = MemoryCurve(tilts=["0.1 mrad", "0.2 mrad"], c_i=[0.9, 0.7], error=0.01)
    assert np.allclose(tilts.at, [1e-4, 2e-4], rtol=1e-12)
    lags = TemporalCurve(lags=["1 ms", "10 ms"], g2=[1.6, 1.1], error=0.01)
    assert np.array_equal(lags.at, [1e-3, 1e-2])
    with pytest.raises(RuleError, match=r"TemporalCurve.lags.1 must be written with its unit"):
        TemporalCurve(lags=["1 ms", 10.0], g2=[1.6, 1.1], error=0.01)


def test_presets_know_their_unit():
    milk = sg.materials.get("milk", wavelength="633 nm")
    assert milk == sg.materials.get("milk", wavelength=0.633)
    medium = milk.slab("0.5 mm", None)
    assert medium == milk.slab(500.0, None)
    with pytest.raises(RuleError, match="It looks like millimetres"):
        sg.memory_effect(medium, wavelength=0.000475, tilts=[0.0])
    metres = sg.materials.get("milk", wavelength="633 nm", unit=1.0).slab("0.5 mm", None)
    assert metres.thickness == 0.0005


def test_marks_decide_no_result():
    """A value with units equals that without, is pickled, and goes through every verb."""
    medium = slab(motion=sg.Drift(velocity=["3 um/s", 0.0, 0.0]))
    beams = sg.CollimatedBeams.tilts([0.0, 1e-5], width="7 mm")
    written = sg.Scene(wavelength="0.6 um", medium=medium, illumination=beams, sensor=sg.FarField.grid((4, 4), 2e-5))
    plain = sg.Scene(**written.model_dump())
    assert written == plain
    assert mark_of(plain) is None
    again = pickle.loads(pickle.dumps(written))
    assert again == written
    assert mark_of(again) == mark_of(written)
    still = written.medium.replace(motion=None)
    verbs = {
        "render": lambda s: sg.render(s, paths=2000, seed=1).intensity,
        "plan": lambda s: [sg.plan(s, paths=2000).sampler],
        "covariance": lambda s: sg.covariance(s, paths=500, seed=1).value,
        "mean_field": lambda s: sg.mean_field(s),
    }
    for name, verb in verbs.items():
        assert np.array_equal(verb(written), verb(plain)), name
    curve = sg.memory_effect(still, wavelength="600 nm", tilts=["0 deg", "1 mrad"], paths=2000)
    bare = sg.Slab(**still.model_dump())
    assert np.array_equal(
        curve.intensity, sg.memory_effect(bare, wavelength=plain.wavelength, tilts=[0, 1e-3], paths=2000).intensity
    )


def test_parts_of_a_table_with_units_have_units_too():
    """They were taken for bare numbers: no part of a scene in TOML could be changed, or used with a wavelength."""
    read = sg.Scene.from_toml(IN_UNITS)
    assert read.replace(medium=read.medium.replace(albedo=0.5)).medium.albedo == 0.5
    assert sg.memory_effect(read.medium, wavelength="500 nm", tilts=["0 deg"], paths=100).intensity == 1.0


def test_dimensions_are_those_of_fields():
    assert {name for name, node in nodes_of(sg.Slab).items() if node.dimension} == {"thickness", "mean_free_path"}
    assert nodes_of(sg.Drift)["velocity"].dimension.unit == "um/s"
