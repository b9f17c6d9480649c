"""Panels: each against something else that knows, and the recipe that one takes along renders what was shown."""

import io
import re
import tomllib

import numpy as np
import pytest
from PIL import Image
from scipy.stats import t as student
from typer.testing import CliRunner
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.cli import commands, explore
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.explorer import drawing, page, panels, recipe, server
from specklegen.explorer.controls import CONTROLS, State, shown

FALSE_ALARM = 1e-6
BEGIN = State()
WIDE = State(extent=0.3, thickness=1500.0, camera=128)
UNMADE = ("tilt", "lag", "focus", "lens", "magnification", "analysers", "sample")
UNFIT = State(thickness=4000.0, aperture=5e3, camera=64)


LAB = State(setup="laboratory lengths")
LAYERS = State(medium="two layers")
GLASS = State(medium="ground glass")
BEGINS = (BEGIN, LAB, LAYERS, GLASS)


def states(begin=BEGIN, names=None):
    """Each control that is shown, or of some names, at another step than where it begins, and both ends of some."""
    for name in shown(begin) if names is None else names:
        for step in {CONTROLS[name].steps[0], CONTROLS[name].steps[-1]} - {getattr(begin, name)}:
            if name not in ("view", "medium", "setup"):
                yield begin.replace(**{name: step})


def possible(state):
    """Whether there is such a recipe; a laboratory alone refuses steps of its sliders."""
    try:
        return bool(recipe.recipe_of(state))
    except RuleError:
        if state.setup == "angles":
            raise
        return False


@pytest.mark.parametrize("begin", BEGINS, ids=("slab", "laboratory", "layers", "glass"))
def test_the_recipe_as_toml_and_python_is_the_recipe(begin, tmp_path):
    own = None if begin == BEGIN else set(shown(begin)) - set(shown(BEGIN))  # the others are those of the slab
    for n, state in enumerate(state for state in (begin, *states(begin, own)) if possible(state)):
        file = tmp_path / f"{n}.toml"
        file.write_text(recipe.toml(state))
        loaded, namespace = load_recipe(file), {}
        exec(recipe.python(state).rpartition("sample =")[0], namespace)  # noqa: S102 - our own text
        assert loaded == namespace["recipe"] == recipe.recipe_of(state)
        assert loaded.fingerprint() == recipe.recipe_of(state).fingerprint()
        written = tomllib.loads(file.read_text())
        side = written["lab"]["pixels"] if recipe.in_laboratory(state) else written["camera"]["shape"]
        assert side == [state.camera] * 2


@pytest.mark.parametrize("begin", BEGINS, ids=("slab", "laboratory", "layers", "glass"))
def test_every_physical_control_that_is_shown_changes_the_recipe(begin):
    """But the tilt, the lag, the lens, analysers and the number of the sample, which it is not made of."""
    tables = [repr(recipe.recipe_table(state)) for state in (begin, *states(begin))]
    unmade = sum(len({CONTROLS[n].steps[0], CONTROLS[n].steps[-1]} - {getattr(begin, n)})
                 for n in set(UNMADE) & set(shown(begin)))  # fmt: skip
    assert len(set(tables)) == len(tables) - unmade
    hidden = set(CONTROLS) - set(shown(begin))
    for name in hidden:  # and one that is not shown changes nothing
        other = begin.replace(**{name: next(s for s in CONTROLS[name].steps if s != getattr(begin, name))})
        assert recipe.recipe_table(other) == recipe.recipe_table(begin)


@pytest.mark.parametrize("state", [State(camera=64, sample=3), State(camera=64, photons=30.0, lobe="VonMisesFisher"),
                                   GLASS.replace(camera=64, sample=1, gap=500.0),
                                   LAB.replace(camera=64, refractive_index=1.4)])  # fmt: skip
def test_what_is_taken_along_renders_what_is_shown(state, tmp_path):
    """The picture in the page is, to the byte, that of the file's sample; and so is what the Python makes."""
    (tmp_path / "explored.toml").write_text(recipe.toml(state))
    rendered = load_recipe(tmp_path / "explored.toml").sample(recipe.SEED, recipe.SPLIT, state.sample)
    assert drawing.picture(drawing.png(rendered["image"]), "camera image") in page.panels(state)
    made = {}
    exec(recipe.python(state), made)  # noqa: S102
    np.testing.assert_array_equal(made["sample"]["image"], panels.sample(state)["image"])
    sixteen = panels.sixteen(state)
    np.testing.assert_array_equal(sixteen.images[state.sample], rendered["image"])
    np.testing.assert_array_equal(sixteen.objects[state.sample], rendered["object"])


def moved_back(images, shift):
    """Pearson correlation of two images, the second moved back by whole pixels along its rows."""
    assert abs(shift - round(shift)) < 1e-3
    one, other = images[0][:, : images.shape[2] - round(shift)], images[1][:, round(shift) :]
    return np.corrcoef(one.ravel(), other.ravel())[0, 1]


def test_tilted_speckle_correlates_as_is_said():
    """Over 16 media: Student's t at 1e-6; and the test has power: C_I of half the tilt is refused."""
    found = [panels.tilted(State(tilt=0.2, sample=n, camera=128)) for n in range(16)]
    measured = np.array([moved_back(each.images, each.shift) for each in found])
    assert found[0].shift == pytest.approx(0.2e-3 / (0.5 / 50_000 / 3), rel=1e-6)
    limit = student.isf(FALSE_ALARM / 2, 15) * measured.std(ddof=1) / 4
    assert abs(measured.mean() - found[0].correlation) < limit
    assert abs(measured.mean() - panels.c_i(BEGIN, np.array([0.1e-3]))[0]) > limit


def test_frames_forget_as_the_curve_says():
    """|g1|^2 against other paths of the slab, and the frames of 12 media against it at two lags; power with both."""
    found = panels.moved(BEGIN)
    assert np.interp(BEGIN.lag, found.lags, found.intensity) == pytest.approx(found.correlation, abs=1e-3)
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=recipe.SPHERES)
    some = found.lags[[10, 40, 80]]
    other = sg.temporal_correlation(slab, wavelength=0.5, lags=1e-3 * some, paths=40_000, seed=8)
    error = 1.8 * other.standard_error  # of 20 000 paths of its own, and these
    assert_z(found.intensity[[10, 40, 80]], other.intensity, error)
    refute_z(found.intensity[[20, 60, 100]], other.intensity, error)

    few = State(camera=64, extent=0.02)  # so small an object that its speckle is that of one beam
    measured = []
    for lag in (2.0, 100.0):
        frames = [panels.moved(few.replace(lag=lag, sample=n)) for n in range(12)]
        alike = np.array([np.corrcoef(each.images.reshape(2, -1))[0, 1] for each in frames])
        measured.append((alike.mean(), frames[0].correlation, alike.std(ddof=1) / np.sqrt(12)))
    assert_z(*np.transpose(measured), degrees=11, slack=0.02)  # of an image's own mean and a wide beam's
    assert measured[0][0] > measured[1][0] + 0.3


def test_layers_remember_as_their_paths_say():
    """The curve against other paths of the two layers; of a second one ten times as thin it is another."""
    curve = panels.memory_curve(LAYERS)
    layers = [sg.Layer(thickness=t, mean_free_path=m, scatterer=sg.HenyeyGreenstein(g))
              for t, m, g in ((1000.0, 100.0, 0.9), (500.0, 50.0, 0.8))]  # fmt: skip
    some = [8, 30, 60]
    for medium, alike in ((sg.Layers(layers=layers), True), (sg.Layers(layers=layers[:1]), False)):
        other = sg.memory_effect(medium, wavelength=0.5, tilts=1e-3 * curve.angles[some], paths=40_000, seed=8)
        error = 1.8 * other.standard_error  # of 20 000 paths of its own, and these
        if alike:
            assert_z(curve.c_i[some], other.intensity, error)
        else:
            refute_z(curve.c_i[some], other.intensity, error)


def test_glass_remembers_as_its_lobe_says():
    """Alone without end; two of them by C_I = exp(-(k theta_1 gap sine)^2 / 2), the closed form of strong lobes."""
    lone = panels.memory_curve(GLASS)
    assert lone.range == np.inf
    np.testing.assert_allclose(lone.c_i, 1.0, atol=1e-9)
    assert "stroke-dasharray" not in drawing.curve_svg(lone)  # no range to mark
    assert "nan" not in drawing.curve_svg(lone)
    curve = panels.memory_curve(GLASS.replace(gap=1000.0))
    angle = sg.GroundGlass(grit=220).screen.rms_angle(0.5)
    sines = np.sin(1e-3 * curve.angles)
    np.testing.assert_allclose(curve.c_i, np.exp(-np.square(2 * np.pi / 0.5 * angle * 1000.0 * sines) / 2), atol=0.01)
    assert "stroke-dasharray" in drawing.curve_svg(curve)


def test_a_glass_that_glides_forgets_as_it_says():
    """A lone one keeps its pattern while it stays in the light; the first of two does not."""
    lone, pair = (panels.moved(GLASS.replace(camera=64, gap=gap, lag=2.0)) for gap in (0.0, 1000.0))
    assert lone.correlation > 0.999
    assert np.corrcoef(lone.images.reshape(2, -1))[0, 1] > 0.99
    assert pair.correlation < 0.9
    assert np.interp(pair.fallen, pair.lags, pair.intensity) == pytest.approx(0.5, abs=0.02)
    assert "A single glass keeps its pattern" in page._moved(GLASS.replace(camera=64))


def test_a_laboratory_is_what_its_lengths_say():
    """Angles in the medium are those of the file's own; and what it cannot do is said."""
    state = LAB.replace(refractive_index=1.4, object_width=0.5, object_distance=100.0, camera=128)
    lab = recipe.recipe_of(state).lab
    assert lab.medium_wavelength == pytest.approx(0.5)
    assert lab.object_extent / lab.object_distance == pytest.approx(5e-3)
    assert np.sin(1e-3 * recipe.extent_of(state)) == pytest.approx(5e-3 / 1.4)
    assert panels.memory_curve(state).extent == recipe.extent_of(state)
    assert recipe.extent_of(BEGIN) == BEGIN.extent
    assert "LabSetup.pixel_pitch must be at most" in page.panels(LAB.replace(pixel=11.0, camera=64))


def test_panels_come_one_by_one_and_old_ones_are_grey_until_then(monkeypatch):
    titles = ["What the camera sees", "Feasibility", "Recipe"]
    made = tuple(
        page.Panel(title, False, lambda state, title=title: f"{title} of {state.sample}", (BEGIN.view,))
        for title in titles
    )
    monkeypatch.setattr(page, "_PANELS", made)
    kept = {}
    first = list(page.coming(BEGIN.replace(sample=3), kept))
    assert [text.count("of 3") for text in first] == [1, 2, 3]
    assert [text.count("sg-late") for text in first] == [2, 1, 0]
    assert first[-1] == page.panels(BEGIN.replace(sample=3))
    second = list(page.coming(BEGIN.replace(sample=4), kept))
    assert [text.count("of 4") for text in second] == [1, 2, 3]
    assert [text.count("of 3") for text in second] == [2, 1, 0]
    assert re.search(r'class="sg-late">Feasibility of 3<', second[0])


VIEWS = CONTROLS["view"].steps


def test_a_view_makes_its_own_panels_alone(monkeypatch):
    """None that is not on the page is computed, and none is on no page."""
    made = {view: [] for view in VIEWS}

    def noted(title):
        return lambda state: made[state.view].append(title) or title

    monkeypatch.setattr(page, "_PANELS", tuple(each._replace(body=noted(each.title)) for each in page._PANELS))
    for view in VIEWS:
        text = page.panels(State(view=view))
        assert [title for title in made[view] if title not in text] == []
    assert set().union(*made.values()) == {each.title for each in page._PANELS}
    assert "Through a lens" in made["a lens"]
    assert "Through a lens" not in made["seeing through"] + made["motion"] + made["polarisation"]


@pytest.mark.parametrize("view", VIEWS)
def test_each_view_hands_out_the_recipe_of_what_it_shows(view, tmp_path):
    state = State(view=view, camera=64, thickness=200.0)
    written = {}
    for _, name, held in page.files(state):
        (tmp_path / name).write_bytes(held)
        written[name] = held.decode()
    taken, made = load_recipe(tmp_path / "explored.toml"), {}
    exec(written["explored.py"].rpartition("sample =")[0], made)  # noqa: S102 - our own text
    assert taken == made["recipe"] == recipe.shown_of(state)
    kinds = {"HiddenObject", "DynamicSlab", "AnalysedObject", "LensStack"}
    assert type(taken).__name__ in kinds
    assert len({type(recipe.shown_of(state.replace(view=each))) for each in VIEWS}) == len(kinds)


def test_what_the_image_does_not_depend_on_makes_it_anew_never(monkeypatch):
    """A tilt, a lag and a view leave the image, phase retrieval and the verdict as they are."""
    state = State(camera=64, sample=2)
    kept = panels.sample(state), panels.retrieved(state), panels.verdict(state)
    for other in (state.replace(tilt=0.5), state.replace(lag=10.0), state.replace(view="motion")):
        assert panels.sample(other) is kept[0]
        assert panels.retrieved(other) is kept[1]
        assert panels.verdict(other) is kept[2]
    assert panels.sample(state.replace(sample=3)) is not kept[0]


@pytest.mark.slow
def test_analysers_show_the_file_that_is_taken_along(tmp_path):
    """Both images and their shares, in linear and in circular light, through faces too."""
    begun = State(view="polarisation", camera=64, thickness=500.0)
    for state in (begun, begun.replace(analysers="circular", refractive_index=1.33)):
        (tmp_path / "analysed.toml").write_text(recipe.toml(state))
        found = panels.analysed(state)
        sample = load_recipe(tmp_path / "analysed.toml").sample(1, "test", 0)
        np.testing.assert_array_equal(found.images, sample["stack"])
        assert found.images.shape == (2, 64, 64)
        assert sum(found.shares) == pytest.approx(1)
        assert found.shares[0] > 0.9  # forward light keeps its polarisation
    assert "flipped: " in page._analysed(state)


THIN = State(view="a lens", thickness=200.0, mean_free_path=50.0, camera=64, focus=200.0)


def test_what_the_lens_shows_is_the_file_that_is_taken_along(tmp_path):
    """Both planes, and each of the three sliders makes other images."""
    (tmp_path / "lens.toml").write_text(recipe.toml(THIN))
    found = panels.focused(THIN)
    np.testing.assert_array_equal(found.images, load_recipe(tmp_path / "lens.toml").sample(1, "test", 0)["stack"])
    assert found.images.shape == (2, 64, 64)
    for name, step in (("focus", -100.0), ("lens", 0.01), ("magnification", 3.0)):
        other = panels.focused(THIN.replace(**{name: step}))
        assert not np.allclose(other.images[1], found.images[1], rtol=0.05), name
    on_face = panels.focused(THIN.replace(focus=0.0)).images  # one plane
    assert on_face.shape == (1, 64, 64)


def test_a_plane_is_as_large_as_pixels_over_magnification():
    """The pitch of the engine's camera, half of it at twice the magnification."""
    for magnification, pitch in ((2.0, 3.25), (5.0, 1.3)):
        state = THIN.replace(magnification=magnification)
        made = recipe.lens_of(state)
        lens = made.lenses(made.material.extremes()[0], np.zeros(1))[0]
        assert lens.camera.pitch == pytest.approx(pitch)
        assert panels.focused(state).field == pytest.approx(64 * pitch)
        assert panels.focused(state).grain == pytest.approx(0.5 / (2 * 0.02))


def test_pixels_larger_than_half_a_grain_are_refused_in_their_panel():
    text = page.panels(THIN.replace(magnification=1.0))
    assert "CameraGrid.pixels_per_grain must be at least 2" in text
    assert text.count("sg-refused") == 3  # and where its recipe would stand
    assert page.files(THIN.replace(magnification=1.0)) == []
    assert "200 µm behind it" in page.panels(THIN)


def test_the_frames_are_of_the_object_that_is_shown():
    """Behind the same fields, to the bit: the first frame is that of the recipe at rest."""
    state = State(refractive_index=1.5)  # which no table holds
    np.testing.assert_array_equal(panels.moved(state).images[0], panels.sample(state)["image"])


def test_the_memory_curve_is_that_of_the_slab():
    """Against paths of the slab, drawn anew: five of their standard errors, and the atlas's own 0.02."""
    curve = panels.memory_curve(BEGIN)
    assert curve.c_i[0] == pytest.approx(1)
    assert np.interp(curve.range, curve.angles, curve.c_i) == pytest.approx(0.5, abs=2e-3)  # linear between 121 points
    assert np.interp(curve.extent, curve.angles, curve.c_i) == pytest.approx(curve.across, abs=2e-3)
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9))
    tilts = 1e-3 * curve.angles[[10, 40, 80]]
    other = sg.memory_effect(slab, wavelength=0.5, tilts=tilts, paths=20_000)
    assert (np.abs(curve.c_i[[10, 40, 80]] - other.intensity) < 5 * other.standard_error + 0.02).all()
    # power: of a slab half as thick it is another curve
    assert panels.c_i(State(thickness=500.0), np.array([tilts[1]]))[0] > curve.c_i[40] + 0.1


def test_the_autocorrelation_is_summed_lag_by_lag():
    state = State(camera=96)
    found, shown = panels.autocorrelations(state), panels.sample(state)
    hidden = np.asarray(shown["object"], np.float64)
    middle = np.array(found.object.shape) // 2
    for down, across in ((0, 0), (3, 5), (10, -4)):
        a = hidden[max(0, down) :, max(0, across) :][: 28 - abs(down), : 28 - abs(across)]
        b = hidden[max(0, -down) :, max(0, -across) :][: 28 - abs(down), : 28 - abs(across)]
        assert found.object[tuple(middle + (down, across))] == pytest.approx((a * b).sum() / (hidden**2).sum())
    image = np.asarray(shown["image"], np.float64)
    image -= image.mean()
    centre = found.image.shape[0] // 2
    assert found.image.shape[0] == 2 * round(1e-4 / (0.5 / 50_000 / 3)) + 1
    expected = (image[2:] * image[:-2]).mean() / np.square(image).mean()
    assert found.image[centre + 2, centre] == pytest.approx(expected)


def test_phase_retrieval_shows_its_object():
    found, hidden = panels.retrieved(BEGIN), panels.sample(BEGIN)["object"]
    assert found.correlation == pytest.approx(np.corrcoef(found.image.ravel(), hidden.ravel())[0, 1], abs=1e-5)
    assert found.correlation > 0.6  # of another object 0.41 to 0.51, tests/models/judging/test_evaluation.py
    assert found.limited > found.correlation  # a window's detail is lost to any method
    assert panels.retrieved(WIDE).correlation < found.correlation


def test_the_verdict_knows_why():
    assert panels.verdict(State(extent=0.05)).works
    names = [reason.name for reason in panels.verdict(WIDE).reasons]
    assert "beyond the memory-effect range" in names
    said = drawing.verdict_html(panels.verdict(WIDE))
    assert "fails" in said
    assert "Remedy: " in said


def test_doubts_are_told_again_and_again():
    """A recipe warns once; the page is drawn often."""
    assert panels.doubts(BEGIN) == ()
    for _ in range(2):
        assert any("stationary sampler: asked for" in each for each in panels.doubts(UNFIT))
    assert "<em>Doubt</em>" in page.panels(UNFIT)


@pytest.mark.parametrize("g", CONTROLS["g"].steps)
def test_both_lobes_have_the_anisotropy_of_the_slider(g):
    """Six digits are written down."""
    kappa = recipe.concentration_of(g)
    assert 1 / np.tanh(kappa) - 1 / kappa == pytest.approx(g, rel=1e-5)


def test_a_picture_is_its_numbers():
    values = np.array([[0.0, 0.5], [1.0, 3.0]])
    read = np.asarray(Image.open(io.BytesIO(drawing.png(values, high=1.0))))
    np.testing.assert_array_equal(read, [[0, 128], [255, 255]])
    sheet = drawing.sheet(np.arange(1, 4)[:, None, None] * np.ones((3, 2, 2)), columns=2)
    np.testing.assert_array_equal(sheet, [[1, 1, 0, 2, 2], [1, 1, 0, 2, 2], [0] * 5, [3, 3, 0, 0, 0], [3, 3, 0, 0, 0]])


def test_the_object_is_marked_where_it_is():
    """The band covers of the axis what the object covers of the curve's angles, to the tenth of a pixel written."""
    curve = panels.memory_curve(State(extent=0.2))
    text = drawing.curve_svg(curve)
    band = float(re.search(r'class="sg-object".*?width="([\d.]+)"', text)[1])
    pairs = re.search(r'points="(.*?)"', text)[1].split()
    first, last = (float(pair.split(",")[0]) for pair in (pairs[0], pairs[-1]))
    assert band / (last - first) == pytest.approx(0.2 / curve.angles[-1], abs=2e-3)


def test_what_is_impossible_is_said_and_does_nothing(monkeypatch):
    """Words of an error are shown as they are; the other panels stay."""

    def refuse(state):
        raise RuleError("slab must be <b>thin</b>")

    monkeypatch.setattr(panels, "verdict", refuse)
    text = page.panels(State(camera=64))
    assert "slab must be &lt;b&gt;thin&lt;/b&gt;" in text
    assert "phase retrieval" in text
    assert "One beam, no object" in text


def test_sixteen_samples_can_be_taken_along():
    state = State(camera=64, photons=10.0)
    text, archive = page.sixteen(state)
    assert "samples a second" in text
    arrays = np.load(io.BytesIO(archive))
    assert arrays["image"].shape == (16, 64, 64)
    np.testing.assert_array_equal(arrays["image"][0], panels.sample(state)["image"])


def test_without_the_extra_a_sentence_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr(explore, "find_spec", lambda name: None)
    with pytest.raises(SystemExit) as end:
        commands.main(["explore"])
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "error: specklegen explore needs the package marimo: pip install 'specklegen-torch[explore]'\n"
    )


def test_it_is_served_to_this_machine_alone(monkeypatch, capsys):
    """At the port that was asked for, the usual one, or a free one; one that is taken is refused."""
    served = []
    monkeypatch.setattr(explore, "find_spec", lambda name: object())
    monkeypatch.setattr(server, "serve", lambda ear: served.append(ear.getsockname()))
    with server.listening() as ear:  # now the usual port is taken, by us or by somebody else
        assert ear.getsockname()[0] == "127.0.0.1"
        told = CliRunner().invoke(commands.app, ["explore", "--no-browser"])
        ((host, free),) = served
        assert host == "127.0.0.1"
        assert free not in (server.USUAL, ear.getsockname()[1])
        assert f"http://127.0.0.1:{free}/" in told.stdout
        with pytest.raises(SystemExit) as end:
            commands.main(["explore", "--no-browser", "--port", str(ear.getsockname()[1])])
    assert end.value.code == 2
    assert "port must be free" in capsys.readouterr().err
