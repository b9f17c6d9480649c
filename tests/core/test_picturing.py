"""Pictures and tables of results: what a notebook shows, and ``.plot()``."""

import base64
import io
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from scenes import ROOT

import specklegen as sg
from specklegen.core.picturing import card, draw_images
from specklegen.datasets import load_recipe

SLAB = sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(0.5))
SCENE = sg.Scene(
    wavelength=0.5,
    medium=SLAB,
    illumination=sg.CollimatedBeams.tilts([0.0, 1e-5], width=1000.0),
    sensor=sg.FarField.grid((12, 13), 1e-4),
)
BOX = sg.Scene(
    wavelength=1.0,
    medium=sg.Box(lower=[-3, -3], upper=[3, 3], mean_free_path=6.0, scatterer=sg.Isotropic()),
    illumination=sg.PlaneWaves.tilts([0.0, 0.1], dimensions=2),
    sensor=sg.FarField.angles(np.deg2rad([0, 90, 180])),
)
VOXELS = sg.VoxelGrid(lower=[-3, -3], upper=[3, 3], extinction=[[0.1, 0.2]], scatterers=(sg.Isotropic(),))
ROW = SCENE.replace(sensor=sg.FarField(SCENE.views[::13]))
DARK = SLAB.replace(albedo=0.0)
OBJECT = sg.IncoherentObject(brightness=[[0.0, 1.0]], pitch=1e-4, width=1000.0)

SHOWN = {
    "scene of beams": lambda: SCENE,
    "scene seen all round": lambda: BOX,
    "scene of points": lambda: BOX.replace(illumination=sg.PointSources([[0, -9]]), sensor=sg.NearField([[0, 9]])),
    "scene of voxels": lambda: BOX.replace(medium=VOXELS),
    "scene of an object": lambda: SCENE.replace(illumination=OBJECT),
    "plan": lambda: sg.plan(SCENE, paths=64),
    "stack": lambda: sg.render(SCENE, paths=64),
    "stack of several media": lambda: sg.render(SCENE, paths=64, realizations=2),
    "stack of one image": lambda: sg.render(SCENE.replace(illumination=OBJECT), paths=64),
    "stack of a row of views": lambda: sg.render(ROW, paths=64),
    "curve": lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts=[0.0, 1e-3], paths=128),
    "curve of no light": lambda: sg.memory_effect(DARK, wavelength=0.5, tilts=[0.0], mode="reflection"),
    "covariance": lambda: sg.covariance(BOX, paths=64),
    "covariance of pairs": lambda: sg.covariance(BOX, paths=64, pairs=[[0, 0, 0, 0], [0, 1, 1, 1]]),
    "scatterer": lambda: SLAB.scatterer,
    "mixture": lambda: sg.Mixture(types=(sg.Isotropic(), sg.HenyeyGreenstein(0.9)), fractions=(0.5, 0.5)),
    "recipe of objects": lambda: load_recipe("through-slab"),
    "recipe of tilts": lambda: load_recipe("tilt-stack"),
}  # fmt: skip


class Tree(HTMLParser):
    """Counts what is opened and closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells.append(data)


def picture(text: str) -> np.ndarray:
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(encoded))).convert("L"))


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_shows_a_picture_and_a_table(name):
    thing = SHOWN[name]()
    text = thing._repr_html_()
    tree = Tree(text)
    assert tree.open == []
    assert tree.cells[0] == type(thing).__name__
    assert len(tree.cells) >= 5  # a title, and at least two rows
    assert len(text) < 600_000
    assert picture(text).min() < 128 < picture(text).max()  # something is drawn


@pytest.mark.parametrize("name", SHOWN)
def test_plot_draws_on_the_axes_that_it_is_given(name):
    axes = Figure().subplots()
    assert SHOWN[name]().plot(axes) is axes
    assert axes.lines or axes.images or axes.patches or axes.collections


def test_a_curve_is_plotted_as_it_is():
    curve = sg.memory_effect(SLAB, wavelength=0.5, tilts=[-1e-3, 0.0, 2e-3], paths=128)
    axes = Figure().subplots()
    curve.plot(axes, label="fog")
    line = axes.lines[0]
    np.testing.assert_array_equal(line.get_xdata(), np.abs(curve.q))
    np.testing.assert_array_equal(line.get_ydata(), curve.intensity)
    assert axes.get_legend_handles_labels()[1] == ["fog"]


def test_a_plot_without_axes_makes_a_figure():
    program = (
        "import matplotlib; matplotlib.use('agg')\n"
        "from specklegen import HenyeyGreenstein\nprint(HenyeyGreenstein(0.9).plot())"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert "Axes" in done.stdout, done.stderr


def test_the_phase_function_that_is_plotted_has_unit_integral():
    axes = Figure().subplots()
    SHOWN["mixture"]().plot(axes)
    degrees, power = axes.lines[0].get_data()
    angles = np.deg2rad(degrees)
    solid = 2 * np.pi * np.trapezoid(power * np.sin(angles), angles)
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
