"""Light that crosses an absorbing medium: paths that have not seen it are refused, those that have are right."""

import warnings

import numpy as np
import pytest
from references.correlation_transfer import exchange
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.paths.deep_absorption import LEAST, crossing_variances
from specklegen.paths.pilot import volume_pilot
from specklegen.paths.stretching import crossing_variance, decay, flat_decay, relative_variance

AHEAD, BACK, ASIDE = [0.0, 0.0, 1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]


def slab(albedo: float, optical_depth: float, g: float = 0.0) -> sg.Slab:
    scatterer = sg.media.HenyeyGreenstein(g=g) if g else sg.media.Isotropic()
    return sg.Slab(thickness=25.0 * optical_depth, mean_free_path=25.0, albedo=albedo, scatterer=scatterer)


def box(albedo: float, optical_depth: float, dimensions: int = 3) -> sg.media.Box:
    corners = np.array([[-200.0, -200.0, 0.0], [200.0, 200.0, 25 * optical_depth]])[:, -dimensions:]
    return sg.media.Box(lower=corners[0], upper=corners[1], mean_free_path=25.0, albedo=albedo,
                        scatterer=sg.media.Isotropic())


def scene(medium: sg.Slab, sensor=None, side="transmission") -> sg.Scene:
    return sg.Scene(wavelength=0.5, medium=medium,
                    illumination=sg.light.CollimatedBeams.tilts([0.0, 1e-5], width=5000.0),
                    sensor=sensor or sg.sensors.FarField.grid(shape=(6, 6), pitch=4e-5, side=side))  # fmt: skip


def unseen(made: sg.Scene) -> float:
    return min(crossing_variances(made), default=0.0)


def seen(medium, *views) -> sg.Scene:
    """A plane wave on a box, seen from afar."""
    flat = isinstance(medium, sg.media.Box) and len(medium.lower) == 2
    light = sg.light.PlaneWaves(directions=[[0.0, 1.0] if flat else AHEAD])
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sg.sensors.FarField(directions=views))


def layers(albedo: float, optical_depth: float) -> sg.Scene:
    """A thin layer that does not absorb before a deep one that does, of the same scatterers."""
    optical = np.repeat([0.5, 0.5, optical_depth / 2, optical_depth / 2], 4).reshape(4, 2, 2)
    medium = sg.media.VoxelGrid(lower=[-100, -100, 0], upper=[100, 100, 1000], extinction=optical / 250,
                          albedo=np.repeat([1.0, 1.0, albedo, albedo], 4).reshape(4, 2, 2),
                          scatterers=(sg.media.Isotropic(),))  # fmt: skip
    return seen(medium, AHEAD)


# ---- Right ---------------------------------------------------------------------------------------------
def test_the_memory_effect_of_a_deep_slab():
    """Analog paths gave a single share of 0.226 at optical depth 40, albedo 0.5."""
    found = sg.memory_effect(slab(0.5, 40.0), wavelength=0.5, tilts=[0.0], reverse=False)
    exact = 0.5 * 40 * np.exp(-40) / (4 * np.pi) / adding_doubling(40.0, albedo=0.5, g=0.0).transmitted
    assert exact == pytest.approx(0.1029, abs=1e-4)
    # 100 000 paths of relative variance 2 know a share of 0.1 to 0.5 %, which is bounded here at 5.5 of that.
    assert found.single_share == pytest.approx(exact, rel=0.03)
    with pytest.raises(AssertionError):
        assert found.single_share == pytest.approx(1.1 * exact, rel=0.03)


def test_its_curve_is_that_of_the_transfer_equation():
    """C_I of tilts at optical depth 30, albedo 0.9, against the integral equation."""
    medium, q = slab(0.9, 30.0), np.array([1.0, 3.0, 6.0])
    found = sg.memory_effect(medium, wavelength=0.5, tilts=np.arcsin(q * 0.5 / (2 * np.pi * 750)), paths=30_000)
    parts = [
        exchange(kappa, optical_depth=30.0, albedo=0.9, source=1.0 + 0j, sensor=1.0 + 0j)
        for kappa in (0.0, *(q / 30.0))
    ]
    light = np.array([(part.single + part.multiple).real for part in parts])
    assert_z(found.intensity, np.square(light[1:] / light[0]), found.standard_error, degrees=63)


@pytest.mark.parametrize(("albedo", "depth"), [(0.5, 40.0), (0.9, 30.0), (0.9, 100.0)])
def test_a_planned_render_is_right_within_its_error(albedo, depth):
    """Five seeds of rel_error 0.05: analog paths gave 0.13 to 0.28 of the light, 0.045 and 2e-16 of it."""
    sines = 2e-3 * np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(-1, 2)  # 20 grains apart: independent
    views = sg.sensors.FarField(directions=np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(-1))]))
    made = scene(slab(albedo, depth), views).replace(illumination=sg.light.CollimatedBeams.tilts([0.0], width=5000.0))
    plan = sg.plan(made, rel_error=0.05, sampler="paths")
    assert plan.expected_error <= 0.05
    assert plan.paths < 10_000
    exact = 5000.0**2 * adding_doubling(depth, albedo=albedo, g=0.0).transmitted
    stacks = [sg.render(made, paths=plan.paths, seed=n, realizations=6, sampler="paths") for n in range(5)]
    found = np.array([stack.intensity.mean() for stack in stacks]) / exact
    # 16 views of 6 media: speckle of contrast 1, and the error that the views of one medium share.
    error = np.sqrt(1 / 96 + plan.expected_error**2 / 6)
    assert_z(found, 1.0, error, slack=0.002)  # views at 1e-2 rad are not quite the axis
    refute_z(1.9 * found, 1.0, error)


@pytest.mark.parametrize("made", [
    seen(box(0.9, 40.0), AHEAD), seen(box(0.9, 40.0, dimensions=2), [0.0, 1.0]),
    scene(slab(0.9, 40.0), sg.sensors.NearField(points=[[0.0, 0.0, 1100.0]])),
    seen(sg.media.VoxelGrid(lower=[-100, -100, 0], upper=[100, 100, 1000], extinction=np.full((4, 2, 2), 0.04),
                            albedo=0.9,
                      scatterers=(sg.media.Isotropic(),)), AHEAD),
    layers(0.9, 40.0),
], ids=["box", "flatland", "near", "voxels", "layers"])  # fmt: skip
def test_so_are_those_through_any_geometry(made):
    assert unseen(made) > 1e6
    with pytest.raises(RuleError, match="covariance paths must be enough that light crosses"):
        sg.statistics.covariance(made, paths=1000, reverse=False)
    assert_refused(lambda: sg.plan(made, paths=1000, reverse=False), "plan paths must be enough")


def test_light_falls_by_the_decay_of_each_material_that_it_crosses():
    """Of layers: of the absorbing one alone; of many albedos, that of their brighter neighbours among 64."""
    deep, whole = unseen(layers(0.9, 40.0)), seen(box(0.9, 40.0), AHEAD)
    assert deep / 3 < unseen(whole) < 3 * deep
    assert unseen(layers(1.0, 40.0)) == 0
    many = np.linspace(0.8, 0.9, 400).reshape(100, 2, 2)
    grid = sg.media.VoxelGrid(lower=[-200, -200, 0], upper=[200, 200, 1000], extinction=np.full(many.shape, 0.04),
                        albedo=many, scatterers=(sg.media.Isotropic(),))  # fmt: skip
    assert unseen(whole) < unseen(seen(grid, AHEAD)) < unseen(seen(box(0.8, 40.0), AHEAD))


def test_what_paths_see_is_answered():
    point = sg.sensors.NearField(points=[[0.0, 0.0, -10.0]])
    lit = [seen(box(0.9, 40.0), BACK), seen(box(0.9, 40.0), ASIDE), seen(box(1.0, 40.0), AHEAD),
           seen(box(0.9, 3.0), AHEAD), scene(slab(0.9, 40.0), point),
           scene(slab(0.5, 40.0), side="reflection")]  # fmt: skip
    assert [unseen(made) for made in lit] == [0.0] * len(lit)
    assert [relative_variance(slab(*of)) for of in ((1.0, 300.0), (0.9, 3.0), (0.0, 99.0))] == [0, 0, 0]
    assert sg.plan(scene(slab(0.5, 40.0), side="reflection"), paths=1000).paths == 1000


def test_enough_paths_are_answered():
    medium = slab(0.9, 14.0)
    needed = int(LEAST * relative_variance(medium)) + 1
    assert sg.plan(scene(medium), paths=needed, reverse=True).paths == needed


def test_the_variance_is_that_of_paths_where_they_can_tell():
    """Within a factor 4 of a pilot at a depth that it still sees, a little below where it is believed no more."""
    for albedo, optical_depth in ((0.9, 11.0), (0.5, 8.0)):
        found = volume_pilot(scene(slab(albedo, optical_depth)), False).moments.relative_variance
        nu = decay(slab(albedo, 1.0))
        said = np.exp(nu * optical_depth) * max(1 - nu, 1 / optical_depth) ** 2 / (2 - nu)
        assert said / 4 < found < said * 4, (albedo, found, said)


@pytest.mark.parametrize("albedo", [0.3, 0.9, 0.999])
def test_light_falls_in_flatland_as_the_closed_form_says(albedo):
    assert flat_decay(sg.media.Isotropic(), albedo) == pytest.approx(np.sqrt(1 - albedo**2), rel=1e-3)
    assert flat_decay(sg.media.Isotropic(), 1.0) == 0
    assert crossing_variance(0.5, 3.0) == 0


# ---- Dark views beside bright ones ---------------------------------------------------------------------
def test_dark_views_beside_bright_ones_are_told():
    """Optical depth 40, albedo 0.9: single scattering was 0.11 of exact at the dark view, without a word."""
    both = seen(box(0.9, 40.0), BACK, AHEAD)
    with pytest.warns(DoubtWarning, match="dark views: .*of the brightest.*separate scene"):
        sg.statistics.covariance(both, paths=2000, reverse=False)
    with pytest.warns(DoubtWarning, match="dark views"):
        sg.render(both, paths=2000, reverse=False)
    with pytest.warns(DoubtWarning, match="dark views"):
        next(iter(sg.statistics.covariance_blocks(both, rows=1, paths=2000, reverse=False)))
    two_sides = scene(slab(0.9, 40.0), sg.sensors.FarField(directions=[BACK, AHEAD]))
    assert any("dark views" in doubt for doubt in sg.plan(two_sides, paths=2000).doubts)
    assert "dark views: used: some views have" in sg.plan(two_sides, paths=2000).explain()


def test_views_that_are_lit_alike_are_not():
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        sg.statistics.covariance(seen(box(1.0, 5.0), BACK, AHEAD), paths=2000, reverse=False)
        sg.render(seen(box(0.9, 2.0), BACK, AHEAD, ASIDE), paths=2000, reverse=False)
    assert [str(each.message) for each in said if issubclass(each.category, DoubtWarning)] == []
