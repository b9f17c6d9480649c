"""Scene values: checked once, frozen, equal by content, written and read without loss; errors that help."""

import json

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.core.errors import RuleError, reject, shown
from specklegen.datasets.recipes.parts.viewing import Window
from specklegen.datasets.recipes.specification import Samples


def scene(**changes) -> sg.Scene:
    return sg.Scene(
        wavelength=0.5,
        medium=sg.Slab(thickness=1000.0, mean_free_path=100.0, albedo=0.9, scatterer=sg.HenyeyGreenstein(g=0.9)),
        illumination=sg.CollimatedBeams.tilts(np.deg2rad(0.0005) * np.arange(3), width=50_000.0),
        sensor=sg.FarField.grid(shape=(5, 7), pitch=2.2e-6, center=(1e-4, -2e-4)),
    ).replace(**changes)


def object_scene(**changes) -> sg.Scene:
    brightness = [[0.0, 1.0], [2.5, 0.1]]
    fields = {"brightness": brightness, "pitch": 1e-5, "width": 5e4, "profile": "disc"} | changes
    return scene(illumination=sg.IncoherentObject(**fields))


def slab(**changes) -> sg.Slab:
    return sg.Slab(**({"thickness": 10.0, "mean_free_path": 1.0, "scatterer": sg.Isotropic()} | changes))


def voxels(**changes) -> sg.VoxelGrid:
    grid = {"lower": [0, 0], "upper": [2, 1], "extinction": [[1.0, 0.0]], "scatterers": (sg.Isotropic(),)}
    return sg.VoxelGrid(**(grid | changes))


AXIS = [0.0, 0.0, 1.0]
NAN, INF = float("nan"), float("inf")

# What is built, and what its message must say: the field, the rule, the value, and where there is one the remedy.
REFUSED = {
    "missing field": (lambda: sg.Slab(thickness=1.0, scatterer=sg.Isotropic()), ["Slab.mean_free_path", "given"]),
    "unknown field": (lambda: slab(thicknes=2.0), ["Slab.thicknes", "there is no such field", "2.0"]),
    "unknown scatterer": (lambda: slab(scatterer={"type": "Dipoles"}), ["Slab.scatterer", "Isotropic", "Dipoles"]),
    "g = 1": (lambda: sg.HenyeyGreenstein(g=1.0), ["HenyeyGreenstein.g", "-1 and 1, both excluded", "1.0", "0.999"]),
    "medium not one": (lambda: scene(medium=3), ["Scene.medium", "3"]),
    "plane wave on a slab": (lambda: scene(illumination=sg.PlaneWaves(directions=[AXIS])),
                             ["Scene.illumination", "limited sideways", "PlaneWaves", "CollimatedBeams"]),
    "directions of one axis": (lambda: sg.CollimatedBeams(directions=AXIS, width=1.0),
                               ["CollimatedBeams.directions", "(T, 3)", "(3,)"]),
    "flatland and space": (
        lambda: scene(illumination=sg.CollimatedBeams.tilts([0.0], width=10.0, dimensions=2)),
        ["Scene", "all in space or all in flatland", "illumination of 2 coordinates", "sensor of 3 coordinates"],
    ),
    "beam from behind": (lambda: sg.CollimatedBeams(directions=[[0.0, 0.0, -1.0]], width=1.0),
                         ["CollimatedBeams.directions", "towards +z", "-1.", "smallest z"]),
    "point of one coordinate": (lambda: sg.PointSources(points=[[1.0]]),
                                ["PointSources.points", "length 2 or 3", "(1, 1)"]),
    "box inside out": (lambda: sg.Box(lower=[0, 1], upper=[1, 1], mean_free_path=1.0, scatterer=sg.Isotropic()),
                       ["Box.upper", "above lower", "every axis"]),
    "box of two dimensions and three": (
        lambda: sg.Box(lower=[0, 0], upper=[1, 1, 1], mean_free_path=1.0, scatterer=sg.Isotropic()),
        ["Box.upper", "as many coordinates as lower"],
    ),
    "voxels of too many axes": (lambda: voxels(extinction=[[[1.0]]]), ["VoxelGrid.extinction", "2 axes", "(1, 1, 1)"]),
    "voxels of an unknown material": (lambda: voxels(material=[[0.0, 2.0]]),
                                      ["VoxelGrid.material", "from 0 to 0", "2.0"]),
    "albedo of another shape": (lambda: voxels(albedo=[1.0, 1.0]),
                                ["VoxelGrid.albedo", "extinction's shape (1, 2)", "(2,)"]),
    "tilt of 90 degrees": (lambda: sg.CollimatedBeams.tilts([0.0, 90.0], width=1.0),
                           ["CollimatedBeams.tilts angles", "-pi/2 and pi/2", "90", "np.deg2rad"]),
    "tilts beyond the circle": (lambda: sg.CollimatedBeams.tilts([[1.2, 1.2]], width=1.0),
                                ["CollimatedBeams.tilts angles", "inside the unit circle", "1.3"]),
    "profile unknown": (
        lambda: sg.CollimatedBeams.tilts([0.0], width=1.0, profile="round"),  # type: ignore[arg-type]
        ["CollimatedBeams.profile", "'square', 'disc' or 'gaussian'", "'round'"],
    ),
    "dark object": (lambda: object_scene(brightness=[[-1.0]]), ["IncoherentObject.brightness", "at least 0", "-1.0"]),
    "object too wide": (lambda: object_scene(brightness=np.ones((3, 3)), pitch=0.9),
                        ["IncoherentObject.pitch", "sine below 1", "0.9"]),
    "grid beyond grazing": (lambda: sg.FarField.grid(shape=(101, 101), pitch=0.02),
                            ["FarFieldGrid.pitch", "sine of at most 1", "0.02", "1.41", "lower shape, pitch"]),
    "grid off the sphere": (lambda: sg.FarField.grid(shape=(1, 1), pitch=1e-3, center=(0.8, 0.8)),
                            ["FarFieldGrid.pitch", "at most 1", "1.13"]),
    "grid on no side": (
        lambda: sg.FarField.grid(shape=(1, 1), pitch=1e-3, side="behind"),  # type: ignore[arg-type]
        ["FarFieldGrid.side", "'transmission' or 'reflection'", "'behind'"],
    ),
    "view not unit": (lambda: sg.FarField(directions=[[0, 0, 2.0]]), ["FarField.directions", "unit vectors", "2."]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_error_names_field_rule_and_value(case):
    build, parts = REFUSED[case]
    with pytest.raises(RuleError) as caught:
        build()
    message = str(caught.value)
    for part in (*parts, " must be ", "; got "):
        assert part in message, message
    assert isinstance(caught.value, ValueError)
    assert "pydantic" not in message


def test_every_broken_rule_is_told_at_once():
    with pytest.raises(RuleError) as caught:
        slab(thickness=-1.0, albedo=2.0)
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize(("width", "rule"), [(NAN, "finite or one of 'fitted'; got nan."),
                                             (-1.0, "greater than 0.0 or one of 'fitted'; got -1.0."),
                                             ("x", "a number or one of 'fitted'; got 'x'.")])  # fmt: skip
def test_the_members_of_a_union_are_one_rule(width, rule):
    """As people wrote the field, without the names of a library's types."""
    with pytest.raises(RuleError) as caught:
        Window(width=width)
    assert str(caught.value) == f"Window.width must be {rule}"


def test_a_number_of_too_many_digits_is_told_in_words():
    with pytest.raises(RuleError, match=r"^Samples\.train must be a whole number of fewer digits; got 1e\+300\.$"):
        Samples(train=1e300)


def test_reject_puts_the_remedy_last():
    with pytest.raises(RuleError, match=r"^Owner\.field must be odd; got 2\. Add one\.$"):
        reject("Owner.field", "odd", 2, "Add one.")
    assert len(shown(np.arange(10_000))) < 130
    assert len(shown("x" * 1000)) <= 120


# ---- Round trips ---------------------------------------------------------------------------------------
VALUES = {
    "beams": scene(), "isotropic": scene(medium=slab()), "zero thickness": scene(medium=slab(thickness=0.0)),
    "object": object_scene(), "views": scene(sensor=sg.FarField(directions=[[0.6, 0.0, 0.8], [0.0, 0.6, -0.8]])),
    "reflection": scene(sensor=sg.FarField.grid(shape=(2, 3), pitch=0.1 + 0.2, side="reflection")),
    "no tilts": scene(illumination=sg.CollimatedBeams(directions=np.empty((0, 3)), width=1.0)),
    "gaussian": scene(illumination=sg.CollimatedBeams.tilts([[0.1, 0.2]], width=1 / 3, profile="gaussian")),
}  # fmt: skip


@pytest.mark.parametrize("name", VALUES)
def test_json_and_toml_give_the_value_back(name):
    value = VALUES[name]
    for copy in (sg.Scene.from_json(value.canonical_json()), sg.Scene.from_toml(value.to_toml())):
        assert copy == value
        assert hash(copy) == hash(value)
        assert copy.fingerprint() == value.fingerprint()
        assert copy.canonical_json() == value.canonical_json()


def test_json_is_canonical():
    text = scene().canonical_json()
    assert text == json.dumps(json.loads(text), sort_keys=True, separators=(",", ":"))
    # Numbers in their shortest form that reads back to the same bits.
    tilted = scene(illumination=sg.CollimatedBeams.tilts([0.1, 1 / 3], width=0.1))
    back = sg.Scene.from_json(tilted.canonical_json())
    assert back.beams.directions.tobytes() == tilted.beams.directions.tobytes()


CHANGES = {"wavelength": lambda s: s.replace(wavelength=np.nextafter(s.wavelength, 1)),
           "thickness": lambda s: s.replace(medium=s.medium.replace(thickness=1001.0)),
           "mean_free_path": lambda s: s.replace(medium=s.medium.replace(mean_free_path=101.0)),
           "albedo": lambda s: s.replace(medium=s.medium.replace(albedo=0.91)),
           "g": lambda s: s.replace(medium=s.medium.replace(scatterer=sg.HenyeyGreenstein(g=0.91))),
           "scatterer": lambda s: s.replace(medium=s.medium.replace(scatterer=sg.Isotropic())),
           "directions": lambda s: s.replace(illumination=s.beams.replace(directions=s.beams.directions[::-1])),
           "width": lambda s: s.replace(illumination=s.beams.replace(width=5.1e4)),
           "profile": lambda s: s.replace(illumination=s.beams.replace(profile="disc")),
           "illumination": lambda s: object_scene(),
           "shape": lambda s: s.replace(sensor=s.sensor.replace(shape=(7, 5))),
           "pitch": lambda s: s.replace(sensor=s.sensor.replace(pitch=2.3e-6)),
           "center": lambda s: s.replace(sensor=s.sensor.replace(center=(1e-4, 2e-4))),
           "side": lambda s: s.replace(sensor=s.sensor.replace(side="reflection")),
           "sensor": lambda s: s.replace(sensor=sg.FarField(directions=s.sensor.directions))}  # fmt: skip


def test_the_fingerprint_changes_with_any_field():
    prints = {scene().fingerprint()} | {change(scene()).fingerprint() for change in CHANGES.values()}
    assert len(prints) == 1 + len(CHANGES)
    assert scene().fingerprint() == scene().fingerprint()
    objects = [object_scene()] + [
        object_scene(**change)
        for change in ({"brightness": [[0.0, 1.0], [2.5, 0.2]]}, {"pitch": 2e-5}, {"width": 4e4}, {"profile": "square"})
    ]
    assert len({o.fingerprint() for o in objects}) == len(objects)


# ---- Frozen, replace -----------------------------------------------------------------------------------
def test_values_are_frozen():
    value = scene()
    with pytest.raises(RuleError, match=r"Scene\.wavelength must be unchanged.*\.replace"):
        value.wavelength = 1.0
    with pytest.raises(ValueError, match="read-only"):
        value.beams.directions[0, 0] = 1.0
    mine = np.array([AXIS])
    beams = sg.CollimatedBeams(directions=mine, width=1.0)
    mine[0] = [1.0, 0.0, 0.0]
    assert beams.directions.tolist() == [AXIS]


def test_replace_checks_anew_and_leaves_the_original():
    value = scene()
    assert value.replace(wavelength=0.6).wavelength == 0.6
    assert value.wavelength == 0.5
    assert_refused(lambda: value.medium.replace(albedo=3.0), r"Slab\.albedo")
    assert_refused(lambda: value.replace(wavelenght=0.6), r"Scene\.wavelenght must be left out")
    assert_refused(lambda: value.replace(illumination=sg.PlaneWaves(directions=[AXIS])), "limited sideways")


# ---- What values say of themselves ---------------------------------------------------------------------
def test_grid_is_regular_in_sines_with_row_0_smallest():
    grid = sg.FarField.grid(shape=(3, 4), pitch=0.01, center=(0.1, -0.2))
    assert grid.directions.shape == (3, 4, 3)
    np.testing.assert_allclose(grid.directions[0, :, 0], 0.1 + 0.01 * np.array([-1.5, -0.5, 0.5, 1.5]), atol=1e-15)
    np.testing.assert_allclose(grid.directions[:, 0, 1], -0.2 + 0.01 * np.array([-1, 0, 1]), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(grid.directions, axis=-1), 1, atol=1e-15)
    assert (grid.replace(side="reflection").directions[..., 2] < 0).all()


def test_object_pixels_send_beams_from_the_other_side():
    """Pixel (row, column) at sines -(index - centre) pitch: the image behind a thin layer is turned by 180 degrees."""
    pixels = sg.IncoherentObject(brightness=np.ones((2, 3)), pitch=0.01, width=1.0)
    sines = pixels.directions.reshape(2, 3, 3)
    np.testing.assert_allclose(sines[0, :, 0], [0.01, 0.0, -0.01], atol=1e-17)
    np.testing.assert_allclose(sines[:, 0, 1], [0.005, -0.005], atol=1e-17)
    lit = sg.IncoherentObject(brightness=[[0.0, 2.0]], pitch=0.01, width=1.0)
    assert lit.beams.directions.shape == (1, 3)
    assert lit.beams.directions[0, 0] == -0.005


@pytest.mark.parametrize("g", [-0.7, 0.0, 0.9, 0.999])
def test_amplitude_squared_is_the_phase_function(g):
    cos = np.linspace(-1, 1, 11)
    expected = (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cos) ** 1.5)
    np.testing.assert_allclose(sg.HenyeyGreenstein(g=g).amplitude(cos) ** 2, expected, rtol=1e-9)
    np.testing.assert_allclose(sg.Isotropic().amplitude(cos) ** 2, 1 / (4 * np.pi), rtol=1e-14)


def test_derived_lengths():
    medium = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=0.9))
    assert medium.optical_depth == 10
    assert medium.extinction == 0.01
    assert medium.transport_length == pytest.approx(1000.0)
    assert scene().speckle_size == pytest.approx(1e-5)
    assert scene().wavenumber == pytest.approx(4 * np.pi)


def test_spheres_must_be_made_for_the_wavelength_of_the_scene():
    pytest.importorskip("miepython")
    sphere = sg.Mie(radius=0.3, wavelength=0.5, refractive_index=1.2)
    scene(medium=slab(scatterer=sphere))
    with pytest.raises(RuleError, match=r"Mie\.wavelength must be the wavelength of the scene, 0\.6"):
        scene(wavelength=0.6, medium=slab(scatterer=sphere))


def test_there_is_one_zero():
    """0.0 and -0.0 are equal, and so are values of them, wherever they stand: one fingerprint, one medium."""
    import specklegen as sg

    fields = '"thickness": 1.0, "mean_free_path": 1.0'
    lobe = '"scatterer": {"type": "HenyeyGreenstein", "g": '
    for plus, minus in (
        *((sg.HenyeyGreenstein(0.0), sg.HenyeyGreenstein(zero)) for zero in (-0.0, np.float32(-0.0), np.array(-0.0))),
        (sg.FarField.grid((2, 2), 1e-3, center=(0.0, 0.0)), sg.FarField.grid((2, 2), 1e-3, center=(-0.0, 0.0))),
        tuple(sg.Slab.from_json("{" + f"{fields}, {lobe}{g}" + "}}") for g in ("0.0", "-0.0")),
        (sg.NearField([[0.0, 0.0, 1.0]]), sg.NearField([[0.0, -0.0, 1.0]])),
    ):
        assert minus == plus
        assert minus.fingerprint() == plus.fingerprint()
        assert plus.replace() == minus.replace()


def test_what_a_value_keeps_of_its_fields_is_read_only():
    """Whoever turns the directions of one scene would turn those of all equal ones that are rendered later."""
    hidden = sg.IncoherentObject(brightness=np.ones((2, 2)), pitch=1e-4, width=1000.0)
    sphere = sg.Mie(radius=0.2, wavelength=0.5, refractive_index=1.2)
    for kept in (hidden.directions, hidden.beams.directions, sphere.coefficients):
        with pytest.raises(ValueError, match="read-only"):
            kept[:] = 0
