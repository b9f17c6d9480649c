"""Display of results: a line, a table of facts, a picture; no arrays in full, and no address."""

import base64
import io
import re
import subprocess
import sys
from dataclasses import fields
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from PIL import Image
from public_names import RESULTS
from scenes import ROOT
from scipy.integrate import trapezoid
from small_stores import make

import specklegen as sg
from specklegen import coherence, fdtd, wavetracing
from specklegen.core.display.plot import Pictured, card, draw_images
from specklegen.core.values import Value
from specklegen.datasets import SpeckleCache, load_recipe
from specklegen.models import PhotographVerdict
from specklegen.models.calibration.material_fit import MaterialFit
from specklegen.models.judging.evaluation import Evaluation
from specklegen.models.judging.results import Results
from specklegen.models.likelihood.common_medium import Joint
from specklegen.models.likelihood.multiframe import Multiframe
from specklegen.models.likelihood.wide_field import WideField
from specklegen.models.recoverability.assessment import Finding, Findings
from specklegen.models.recoverability.speckle_test import SpeckleTest
from specklegen.models.recoverability.verdict import Reason

SLAB = sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(0.5))
SCENE = sg.Scene(wavelength=0.5, medium=SLAB, illumination=sg.CollimatedBeams.tilts([0.0, 1e-5], width=1000.0),
                 sensor=sg.FarField.grid((12, 13), 1e-4))  # fmt: skip
BOX = sg.Scene(
    wavelength=1.0, medium=sg.Box(lower=[-3, -3], upper=[3, 3], mean_free_path=6.0, scatterer=sg.Isotropic()),
    illumination=sg.PlaneWaves.tilts([0.0, 0.1], dimensions=2), sensor=sg.FarField.angles(np.deg2rad([0, 90, 180])),
)  # fmt: skip
VOXELS = sg.VoxelGrid(lower=[-3, -3], upper=[3, 3], extinction=[[0.1, 0.2]], scatterers=(sg.Isotropic(),))
ROW = SCENE.replace(sensor=sg.FarField(SCENE.views[::13]))
DARK = sg.Slab(thickness=600.0, mean_free_path=10.0, scatterer=sg.Isotropic())  # to ten paths
OBJECT = sg.IncoherentObject(brightness=[[0.0, 1.0]], pitch=1e-4, width=1000.0)

RANDOM = np.random.default_rng(0)
FORWARD = SLAB.replace(scatterer=sg.HenyeyGreenstein(0.98))
LEDGER = wavetracing.Ledger(1, 2, 3, 0, 0)
POWER = np.ma.masked_less(RANDOM.normal(-60, 10, (6, 8)), -70)
TIME = np.linspace(0, 9, 50)
SPECKLE = SpeckleTest(0.2, 0.2, 0.02, 0.5, 0.4, 0.1, 0.0, (0.0, 0.0, 0.0, 0.0))
REASON = Reason("noise", "3 photons", "light")
FOUND = Finding(RANDOM.random((9, 9)).astype(np.float32), 1.1, 1.0, 0.3, (REASON,), SPECKLE)
FACES = RANDOM.random((2, 2, 20))
SCORED = Evaluation(
    {name: {"sharp": {"pearson": faces}} for name, faces in zip(("Katz", "solver"), FACES[0], strict=True)},
    np.arange(20), np.full(20, -1), np.ones(20), np.zeros(20, np.int64), {},
)  # fmt: skip


CUBE = sg.Box(lower=[0, 0, 0], upper=[1, 1, 1], mean_free_path=1.0, scatterer=sg.Isotropic())


def curve_over(**changed):
    """Joint correlation, by default over tilts and shifts."""
    over = {"tilts": [2e-3, 0.0, 1e-3], "shifts": [0.0, 0.2]} | changed
    return sg.joint_correlation(SLAB, wavelength=0.5, paths=640, **over)


SHOWN = {
    "joint correlation": curve_over,
    "joint correlation of one shift": lambda: curve_over(shifts=[0.0]),
    "joint correlation of one tilt": lambda: curve_over(tilts=[0.0]),
    "screens in the place of a slab": lambda: sg.stack_like(FORWARD, wavelength=0.5, paths=640),
    "coverage": lambda: wavetracing.Coverage(POWER, POWER * 0 + 1, LEDGER, None),
    "power on receivers": lambda: wavetracing.WaveTrace([FACES[0]], [FACES[1]], [], [], LEDGER, None),
    "field on a plane": lambda: wavetracing.PlaneField(FACES[0], 0.1, 0.5),
    "wavevectors of slits": lambda: wavetracing.sample_slits([1.0], [0.0], [0.0], 200, 0),
    "wavevectors of an opening": lambda: wavetracing.Pattern(RANDOM.normal(size=(200, 2)), 300, 0, 0),
    "Green's function": lambda: coherence.GreensMatrix(FACES[0] + 1j, FACES[1]),
    "scattered field": lambda: fdtd.ScatteredField(TIME, np.sin(TIME), np.sin(TIME), np.cos([TIME, TIME])),
    "mean field": lambda: fdtd.MeanField(TIME, np.sin(TIME), np.sin(TIME), np.cos(TIME), back_error=0.1 * TIME,
                                         forward_error=0.2 * TIME, realizations=3),
    "what one image tells": lambda: FOUND, "what images tell": lambda: Findings((FOUND, FOUND), 1e-4, None),
    "what images together tell": lambda: Joint(torch.rand(3, 8, 8), torch.tensor([False, True, False]),
                                               torch.zeros(3, 2, dtype=torch.int64), 0.9, 0.7),
    "objects through one medium": lambda: Multiframe(torch.rand(3, 8, 8).clamp(0.1), 0.97, 0.9),
    "wide object": lambda: WideField(torch.rand(8, 20), torch.rand(8, 20) > 0.1, torch.rand(6), 16.0),
    "evaluation": lambda: SCORED, "benchmark": lambda: Results({"thin": SCORED, "noise": SCORED}, 20),
    "scene of beams": lambda: SCENE, "scene seen all round": lambda: BOX,
    "scene of points": lambda: BOX.replace(illumination=sg.PointSources([[0, -9]]), sensor=sg.NearField([[0, 9]])),
    "scene of voxels": lambda: BOX.replace(medium=VOXELS),
    "scene of a screen": lambda: SCENE.replace(medium=sg.PhaseScreen(rms_phase=1.0, correlation_length=10.0)),
    "scene of an object": lambda: SCENE.replace(illumination=OBJECT), "plan": lambda: sg.plan(SCENE, paths=64),
    "stack": lambda: sg.render(SCENE, paths=64),
    "stack of several media": lambda: sg.render(SCENE, paths=64, realizations=2),
    "stack of one image": lambda: sg.render(SCENE.replace(illumination=OBJECT), paths=64),
    "stack of a row of views": lambda: sg.render(ROW, paths=64),
    "curve": lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts=[0.0, 1e-3], paths=128),
    "curve of no light": lambda: sg.memory_effect(DARK, wavelength=0.5, tilts=[0.0], paths=10),
    "reflectance and transmittance": lambda: sg.reflectance_transmittance(SLAB, paths=64),
    "reflectance of a box": lambda: sg.reflectance_transmittance(CUBE, paths=64),
    "covariance": lambda: sg.covariance(BOX, paths=64),
    "covariance of pairs": lambda: sg.covariance(BOX, paths=64, pairs=[[0, 0, 0, 0], [0, 1, 1, 1]]),
    "scatterer": lambda: SLAB.scatterer,
    "mixture": lambda: sg.Mixture(types=(sg.Isotropic(), sg.HenyeyGreenstein(0.9)), fractions=(0.5, 0.5)),
    "recipe of objects": lambda: load_recipe("through-slab"), "recipe of tilts": lambda: load_recipe("tilt-stack"),
}  # fmt: skip


LINES = {
    "joint correlation": "JointCorrelation(tilts=float64[3], shifts=float64[2], magnitude=float64[3, 2], standard_",
    "plan": "Plan(sampler='paths', summation='nufft', paths=64, expected_error=",
    "stack": "SpeckleStack(field=complex64[2, 12, 13], sampler='paths', paths=64)",
    "curve": "MemoryEffect(tilts=float64[2], intensity=float64[2], ",
    "covariance": "Covariance(value=complex128[2, 3, 2, 3], paths=64, ",
}
TABLES = {"joint correlation": {"tilts (sine)": "3 values, 0 to 0.002", "|C|": "3 x 2 values, 0."},
          "coverage": {"received power, dB over 1 mW": "6 x 8 values, -69.22 to -40.4, 5 undefined"},
          "curve of no light": {"standard error": "1 values, 1 undefined", "reversed paths": "no"},
          "objects through one medium": {"objects": "3 x 8 x 8 values, 0.", "agreement of starts": "0.97"},
          "plan": {"memory": "", "time": "", "stationary sampler": "left out: "},
          "reflectance of a box": {"share out of the sides": "0.4375 ± 0.06"},
          "stack": {"paths": "64", "mean field added": "no", "speckle": "enough paths"},
          "what images together tell": {"turned by 180 degrees": "1 of 3"}}  # fmt: skip


@pytest.mark.parametrize("name", SHOWN)
def test_a_result_has_a_line_a_table_and_a_picture(name):
    thing = SHOWN[name]()
    line = repr(thing)
    assert line.startswith(LINES.get(name, f"{type(thing).__name__}("))
    assert "\n" not in line or isinstance(thing, Value)
    text = thing._repr_html_()
    assert len(text) < 600_000
    tree = ElementTree.fromstring(text)
    assert tree.findtext("strong") == type(thing).__name__
    rows = {row.findtext("th"): row.findtext("td") for row in tree.iter("tr")}
    assert rows == thing.facts()
    assert all(rows[fact].startswith(start) for fact, start in TABLES.get(name, {}).items()), rows
    encoded = tree.find("img").get("src").removeprefix("data:image/png;base64,")
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(encoded))).convert("L"))
    assert picture.min() < 128 < picture.max()  # something is drawn
    axes = Figure().subplots()
    assert thing.plot(axes, "fog") is axes
    assert axes.lines or axes.images or axes.patches or axes.collections
    labels = [*axes.get_legend_handles_labels()[1], axes.get_title()]
    assert any("fog" in label for label in labels)  # the name of a curve, or a title


def test_the_best_shift_of_a_tilt_is_drawn_through_the_maximum():
    """Behind one screen the pattern stands still at the screen: nothing is lost along the line, all off it."""
    gap, tilts = 2000.0, np.array([-2e-3, 0.0, 2e-3])
    screens = sg.ScreenStack(screens=(sg.PhaseScreen(rms_phase=8.0, correlation_length=4.0),), behind=gap)
    found = sg.joint_correlation(screens, wavelength=0.5, tilts=tilts, shifts=gap * tilts)
    axes = Figure().subplots()
    found.plot(axes)
    shift, tilt = axes.lines[0].get_data()
    np.testing.assert_allclose(shift, gap * tilt, rtol=1e-12)
    drawn = axes.collections[0].get_array()
    np.testing.assert_allclose(np.diag(drawn), 1.0, rtol=1e-12)
    assert drawn[0, 2] < 0.5


def test_a_store_shows_what_is_there_already(tmp_path):
    make(tmp_path / "a.zarr", samples=3)
    cache = SpeckleCache(tmp_path / "a.zarr")
    shown = cache.plot(Figure().subplots()).images[0].get_array()
    image = np.abs(cache.numpy(0)[cache.keys[0]])
    np.testing.assert_array_equal(shown[: image.shape[-2], : image.shape[-1]], image.reshape(-1, *image.shape[-2:])[0])
    assert cache.facts()["samples"] == "3"


IN_WORDS = (sg.Plan, sg.Advice, PhotographVerdict, MaterialFit)
"""Results that say themselves in a sentence, or show the few numbers of a problem that they hold."""
UNPICTURED = {"Edges": "of the geometry, for the tracer", "Mesh": "of the geometry", "Incidence": "of the march",
              "Moments": "of the layer's cells", "SingleDelay": "coefficients of one approximation",
              "Periodogram": "what the likelihood is computed from", "Optics": "a number for each object",
              "RayPath": "one path of many", "ImpulseResponse": "a few paths; xarray draws them"}  # fmt: skip
"""Results of arrays without a picture, and what they are for."""


def test_every_public_result_of_arrays_has_a_picture():
    for kind in RESULTS:
        holds_arrays = re.search("ndarray|Tensor|MaskedArray", str(kind.__annotations__))
        assert not holds_arrays or issubclass(kind, Pictured) or kind.__name__ in UNPICTURED, kind


@pytest.mark.parametrize("kind", [kind for kind in RESULTS if kind not in IN_WORDS])
def test_a_result_of_many_numbers_shows_none_of_them(kind):
    """Whatever a result is made of, here a million numbers in each array field."""
    many = np.zeros((1000, 1000), np.float32)
    names = kind._fields if hasattr(kind, "_fields") else [field.name for field in fields(kind)]
    said = {name: str(kind.__annotations__.get(name)) for name in names}
    held = {
        name: many if re.search("ndarray|Tensor", of) else () if of.startswith("tuple[") else 1.0
        for name, of in said.items()
    }
    if hasattr(kind, "_fields"):
        shown = kind(**held)
    else:
        shown = object.__new__(kind)
        for name, value in held.items():
            object.__setattr__(shown, name, value)
    told = repr(shown)
    assert told.startswith(kind.__name__ + "(")
    assert len(told) < 500
    assert told.count("float32[1000, 1000]") <= sum(value is many for value in held.values())
    assert "..." not in told  # no array has been cut short


def test_the_phase_function_that_is_plotted_has_unit_integral():
    degrees, power = SHOWN["mixture"]().plot(Figure().subplots()).lines[0].get_data()
    angles = np.deg2rad(degrees)
    solid = 2 * np.pi * trapezoid(power * np.sin(angles), angles)
    assert solid == pytest.approx(1, abs=2e-3)  # of the trapezoidal rule at a quarter of a degree


def test_images_lie_side_by_side_in_their_order():
    axes = Figure().subplots()
    images = np.arange(7)[:, None, None] * np.ones((7, 4, 5))
    draw_images(axes, images, [str(n) for n in range(7)])
    (strip,) = axes.images
    row = strip.get_array().filled(np.nan)[0]
    assert row[~np.isnan(row)].tolist() == np.repeat(np.arange(6.0), 5).tolist()
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "1", "2", "3", "4", "5"]


def test_facts_cannot_be_markup():
    text = card("<b>", {"<i>": "<script>alert(1)</script>"}, lambda axes: None)
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_without_matplotlib_there_is_still_a_table():
    program = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from specklegen import HenyeyGreenstein\nprint(HenyeyGreenstein(0.9)._repr_html_())"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert "<table>" in done.stdout, done.stderr
    assert "<img" not in done.stdout
