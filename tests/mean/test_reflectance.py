"""Reflectance and transmittance against radiative transfer: published figures, adding and doubling, closed forms."""

import numpy as np
import pytest
import zscore
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.mean import reflectance
from specklegen.oracles.adding_doubling import adding_doubling

VAN_DE_HULST = sg.Slab(thickness=2.0, mean_free_path=1.0, albedo=0.9, scatterer=sg.HenyeyGreenstein(0.75))
GLASS = sg.Faces(inside=1.5, outside=1.0)
DEEP = 60.0
"""Mean free paths that stand for a half space: behind them exp(-10) of the light is left at albedo 0.99."""


def half_space(albedo, faces=None):
    return sg.Slab(thickness=DEEP, mean_free_path=1.0, albedo=albedo, scatterer=sg.Isotropic(),
                   faces=faces or sg.Faces())  # fmt: skip


@pytest.fixture(scope="module")
def slab_light():
    return sg.reflectance_transmittance(VAN_DE_HULST, paths=200_000, seed=1)


def assert_totals(found, reflectance, transmittance):
    """Both totals against exact ones, rounded to five digits."""
    assert_z([found.reflectance, found.transmittance], [reflectance, transmittance],
             [found.reflectance_error, found.transmittance_error], slack=5e-6)  # fmt: skip


def test_van_de_hulsts_slab(slab_light):
    assert_totals(slab_light, 0.09739, 0.66096)
    assert slab_light.ballistic == pytest.approx(np.exp(-2.0), rel=1e-12)
    assert slab_light.specular == 0.0


def test_a_small_error_of_the_lobe_is_caught():
    """g = 0.72 instead of 0.75 moves the reflectance by 0.012, eight standard errors of 50 000 paths."""
    wrong = VAN_DE_HULST.replace(scatterer=sg.HenyeyGreenstein(0.72))
    with pytest.raises(AssertionError, match="z ="):
        assert_totals(sg.reflectance_transmittance(wrong, paths=50_000, seed=1), 0.09739, 0.66096)


@pytest.mark.parametrize(("albedo", "expected"), [(0.5, 0.11523), (0.9, 0.41495), (0.99, 0.75272)])
def test_chandrasekhars_half_space(albedo, expected):
    found = sg.reflectance_transmittance(half_space(albedo), paths=50_000, seed=2)
    assert_z(found.reflectance, expected, found.reflectance_error, slack=5e-6)


def test_giovanellis_half_space_behind_a_step_of_the_index():
    """The figure, 0.2600, is that of the light that is thrown back altogether: 0.04 of it by the face."""
    found = sg.reflectance_transmittance(half_space(0.9, GLASS), paths=100_000, seed=3)
    assert_z(found.reflectance, 0.2600, found.reflectance_error, slack=5e-5)
    assert found.specular == pytest.approx(0.04, rel=1e-12)


@pytest.mark.parametrize(("depth", "g", "albedo"), [(0.5, 0.0, 1.0), (5.0, 0.9, 0.95)])
def test_slabs_are_those_of_adding_and_doubling(depth, g, albedo):
    scatterer = sg.HenyeyGreenstein(g) if g else sg.Isotropic()
    slab = sg.Slab(thickness=3.0, mean_free_path=3.0 / depth, albedo=albedo, scatterer=scatterer)
    exact = adding_doubling(depth, albedo=albedo, g=g)
    assert_totals(sg.reflectance_transmittance(slab, paths=50_000, seed=4), exact.reflectance, exact.transmittance)


def test_no_light_is_lost(slab_light):
    """Without absorption every path leaves; with it, what is absorbed is what does not."""
    for medium, angle in (
        (VAN_DE_HULST.replace(albedo=1.0), 0.0),
        (VAN_DE_HULST.replace(albedo=1.0, faces=GLASS), 1.0),
        (sg.Box(lower=[-1, -1, 0], upper=[1, 1, 2], mean_free_path=1.0, scatterer=sg.Isotropic()), 0.5),
    ):
        found = sg.reflectance_transmittance(medium, angle=angle, paths=4000)
        assert found.reflectance + found.transmittance + found.sides == pytest.approx(1.0, abs=1e-12)
    total = slab_light.reflectance + slab_light.transmittance + slab_light.absorptance
    assert total == pytest.approx(1.0, abs=1e-15)
    assert 0.2 < slab_light.absorptance < 0.28


@pytest.mark.parametrize("faces", [sg.Faces(), GLASS])
def test_densities_add_up_to_the_scattered_light(faces):
    found = sg.reflectance_transmittance(VAN_DE_HULST.replace(faces=faces), angle=0.4, paths=4000, seed=5)
    steradians = -2 * np.pi * np.diff(np.cos(found.angles))
    assert steradians @ found.reflected == pytest.approx(found.reflectance - found.specular, abs=1e-12)
    assert steradians @ found.transmitted == pytest.approx(found.transmittance - found.ballistic, abs=1e-12)


def test_errors_of_densities_are_those_of_counted_paths():
    """Without absorption paths weigh 1 within 1 %: the binomial error of their share in each step."""
    found = sg.reflectance_transmittance(VAN_DE_HULST.replace(albedo=1.0), paths=4000, seed=5)
    steradians = -2 * np.pi * np.diff(np.cos(found.angles))
    for density, error in (found.reflected, found.reflected_error), (found.transmitted, found.transmitted_error):
        share = steradians * density
        expected = np.sqrt(share * (1 - share) / 4000) / steradians
        np.testing.assert_allclose(error[share > 0], expected[share > 0], rtol=0.01)


def test_densities_of_single_scattering():
    """A thin slab of albedo 0.05: what leaves straight ahead is the closed form of one collision, within its square."""
    depth, albedo = 0.2, 0.05
    thin = sg.Slab(thickness=1.0, mean_free_path=1.0 / depth, albedo=albedo, scatterer=sg.Isotropic())
    found = sg.reflectance_transmittance(thin, angles=[0.0, 0.5, 1.0, np.pi / 2], paths=200_000, seed=6)
    mu = np.linspace(np.cos(found.angles[:-1]), np.cos(found.angles[1:]), 4001)[1:]
    mu = np.where(np.isclose(mu, 1.0), 1 - 1e-9, np.maximum(mu, 1e-9))
    back = albedo / (4 * np.pi) * mu * (1 - np.exp(-depth * (1 + 1 / mu))) / (1 + mu)
    ahead = albedo / (4 * np.pi) * mu * (np.exp(-depth / mu) - np.exp(-depth)) / (mu - 1)
    for density, error, exact in (
        (found.reflected, found.reflected_error, back), (found.transmitted, found.transmitted_error, ahead),
    ):  # fmt: skip
        once = exact.mean(axis=0)
        # Of all light once scattered, less than 0.4 is scattered again, and albedo of that goes on.
        assert_z(density, once, error, slack=0.4 * albedo * once)
        refute_z(1.2 * density, once, error, slack=0.4 * albedo * once)


@pytest.mark.parametrize("depth", [1e-9, 0.2])
@pytest.mark.parametrize("layers", [False, True])
def test_plates_that_do_not_scatter_are_those_of_airy_in_intensity(depth, layers):
    """0 to 85 degrees: the echoes of either polarisation one after the other, their mean behind all of them."""
    plate = sg.Slab(thickness=1.0, mean_free_path=1 / depth, albedo=0.0, scatterer=sg.Isotropic(), faces=GLASS)
    if layers:  # the same plate in two parts, of which one has another lobe
        half = sg.Layer(thickness=0.5, mean_free_path=1 / depth, albedo=0.0, scatterer=sg.Isotropic(), index=1.5)
        plate = sg.Layers([half, half.replace(scatterer=sg.HenyeyGreenstein(0.5))])
    for degrees in (0.0, 30.0, 57.3, 75.0, 85.0):
        angle = np.deg2rad(degrees)
        inside, outside = np.sqrt(1 - (np.sin(angle) / 1.5) ** 2), np.cos(angle)
        s = (outside - 1.5 * inside) / (outside + 1.5 * inside)
        p = (1.5 * outside - inside) / (1.5 * outside + inside)
        r, b, n = np.square([s, p]), np.exp(-depth / inside), np.arange(200)[:, None]
        through = ((1 - r) ** 2 * b * (r * b) ** (2 * n)).sum(axis=0)
        back = r + ((1 - r) ** 2 * r * b**2 * (r * b) ** (2 * n)).sum(axis=0)
        found = sg.reflectance_transmittance(plate, angle=angle, paths=100)
        np.testing.assert_allclose([found.specular, found.ballistic], [back.mean(), through.mean()], rtol=1e-6)
        if degrees == 57.3:  # power: means at each face
            assert 2 * r.mean() / (1 + r.mean()) > 1.05 * (2 * r / (1 + r)).mean()


def test_light_that_cannot_enter_is_reflected():
    found = sg.reflectance_transmittance(VAN_DE_HULST.replace(faces=sg.Faces(inside=1.0, outside=1.5)), angle=1.0)
    assert (found.reflectance, found.specular, found.transmittance, found.paths) == (1.0, 1.0, 0.0, 0)


def test_voxels_are_the_box_that_they_make():
    corners = {"lower": [-1, -1, 0], "upper": [1, 1, 2]}
    box = sg.Box(**corners, mean_free_path=1.0, albedo=0.9, scatterer=sg.HenyeyGreenstein(0.5))
    grid = sg.VoxelGrid(**corners, extinction=np.ones((4, 3, 5)), albedo=0.9, scatterers=[sg.HenyeyGreenstein(0.5)])
    one, other = (sg.reflectance_transmittance(medium, angle=0.3, paths=4000, seed=7) for medium in (box, grid))
    for name in ("reflectance", "transmittance", "sides", "ballistic"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-9)


def test_a_wide_box_is_a_slab(slab_light):
    box = sg.Box(lower=[-1e4, -1e4, 0], upper=[1e4, 1e4, 2], mean_free_path=1.0, albedo=0.9,
                 scatterer=sg.HenyeyGreenstein(0.75))  # fmt: skip
    found = sg.reflectance_transmittance(box, paths=50_000, seed=8)
    assert_totals(found, 0.09739, 0.66096)
    assert_z(found.ballistic, np.exp(-2.0), np.sqrt(np.exp(-2.0) / 50_000))


def test_an_error_is_reached():
    found = sg.reflectance_transmittance(VAN_DE_HULST, rel_error=4e-3, seed=9)
    errors = found.reflectance_error, found.transmittance_error, found.absorptance_error
    assert 0.7 * 4e-3 < max(errors) < 4e-3
    again = sg.reflectance_transmittance(VAN_DE_HULST, paths=found.paths, seed=9)
    assert again.reflectance == found.reflectance


def test_what_was_never_seen_has_an_error():
    dark = sg.Slab(thickness=1000.0, mean_free_path=1.0, albedo=0.5, scatterer=sg.Isotropic())
    found = sg.reflectance_transmittance(dark, paths=1000)
    assert found.transmittance_error == pytest.approx(3e-3 / 1.96)
    assert found.transmittance < 1e-300


def test_errors_of_few_paths_hold_the_truth(monkeypatch):
    """Three of 25 paths pass: of 800 runs, so many as 0.93 leaves at a false-alarm rate of 1e-6; 0.86 without it."""
    layers = sg.Layers([
        sg.Layer(thickness=10.0, mean_free_path=2.0, scatterer=sg.HenyeyGreenstein(0.6)),
        sg.Layer(thickness=10.0, mean_free_path=1.0, scatterer=sg.Isotropic()),
    ])  # fmt: skip
    truth = 0.12616  # of 300 000 paths

    def coverage() -> float:
        runs = (sg.reflectance_transmittance(layers, paths=25, seed=seed, threads=1) for seed in range(800))
        return float(np.mean([abs(run.transmittance - truth) <= 1.96 * run.transmittance_error for run in runs]))

    least = 0.93 - zscore.limit() * np.sqrt(0.93 * 0.07 / 800)
    assert coverage() > least
    monkeypatch.setattr(reflectance, "tail_factor", lambda deviations: 1.0)
    monkeypatch.setattr(reflectance, "_UNSEEN", 1.0)
    assert coverage() < least


@pytest.mark.parametrize(("change", "field"), [
    ({"medium": sg.PhaseScreen(rms_phase=1.0, correlation_length=5.0)}, "medium"),
    ({"medium": sg.Box(lower=[0, 0], upper=[1, 1], mean_free_path=1.0, scatterer=sg.Isotropic())}, "medium"),
    ({"angle": np.pi / 2}, "angle"), ({"angle": -0.1}, "angle"), ({"angle": np.nan}, "angle"),
    ({"angles": [0.0, 1.0]}, "angles"), ({"angles": [0.0, 1.0, 0.5, np.pi / 2]}, "angles"), ({"paths": 0}, "paths"),
    ({"paths": 10**14}, "paths"), ({"rel_error": 2.0}, "rel_error"),
])  # fmt: skip
def test_arguments_out_of_range_are_refused_by_name(change, field):
    arguments = {"medium": VAN_DE_HULST} | change
    with pytest.raises(sg.RuleError, match=rf"^(Budget\.|reflectance_transmittance ){field} must be"):
        sg.reflectance_transmittance(arguments.pop("medium"), **arguments)


def test_media_too_deep_to_walk_are_refused():
    deep = sg.Slab(thickness=1e5, mean_free_path=1.0, scatterer=sg.Isotropic())
    assert_refused(lambda: sg.reflectance_transmittance(deep, paths=10), "^Slab.optical_depth must be at most")
