"""Laws of motion as values, and media that have one."""

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.scene.motion import fastest, reduced_time, step_roots

FLUID = sg.Brownian(diffusion=0.857)
LOBE = sg.HenyeyGreenstein(0.9)
SLAB = sg.Slab(thickness=100.0, mean_free_path=10.0, scatterer=LOBE)
BOX = sg.Box(lower=[-5, -5, 0], upper=[5, 5, 4], mean_free_path=2.0, scatterer=LOBE)
GRID = sg.VoxelGrid(lower=[-5, -5, 0], upper=[5, 5, 4], extinction=np.ones((2, 1, 1)), material=[[[0.0]], [[1.0]]],
                    scatterers=[LOBE, sg.Isotropic()])  # fmt: skip
LAYER = sg.Layer(thickness=5.0, mean_free_path=2.0, scatterer=LOBE)


class Slower(sg.Motion):
    """A law of a user's own."""

    amount: float
    power: float = 0.5

    def mean_square(self, lag):
        return self.amount * np.asarray(lag) ** self.power


def test_stokes_and_einstein():
    """A sphere of a quarter of a micrometre in water at 20 degrees Celsius."""
    found = sg.Brownian.of_sphere(radius=0.25, viscosity=1.002e-3, temperature=293.15)
    assert found.diffusion == pytest.approx(0.857, abs=5e-4)
    metres = sg.Brownian.of_sphere(radius=0.25e-6, viscosity=1.002e-3, temperature=293.15, unit=1.0)
    assert metres.diffusion == pytest.approx(found.diffusion * 1e-12)
    wavelength = 0.532 / 1.33
    assert 1 / (found.diffusion * (2 * np.pi / wavelength) ** 2) == pytest.approx(4.73e-3, rel=2e-3)
    for wrong in ("radius", "viscosity", "temperature", "unit"):
        numbers = {"radius": 1.0, "viscosity": 1.0, "temperature": 1.0, "unit": 1.0} | {wrong: 0.0}
        with pytest.raises(RuleError, match=f"of_sphere {wrong} must be .*above 0"):
            sg.Brownian.of_sphere(**numbers)


@pytest.mark.parametrize("medium", [SLAB, BOX, GRID, LAYER], ids=["slab", "box", "voxels", "layer"])
def test_rest_is_what_it_was_before_there_was_motion(medium):
    assert "motion" not in medium.canonical_json()
    moving = medium.replace(motion=FLUID)
    assert moving.fingerprint() != medium.fingerprint()
    assert moving.replace(motion=None).fingerprint() == medium.fingerprint()
    assert type(medium).from_toml(moving.to_toml()) == moving
    assert type(medium).from_json(moving.canonical_json()) == moving


def test_motion_decides_no_path():
    assert SLAB.replace(motion=FLUID).unitless_fingerprint() == SLAB.unitless_fingerprint()


def test_layers_and_materials_move_each_by_itself():
    layers = sg.Layers(layers=[LAYER, LAYER.replace(motion=FLUID), LAYER.replace(motion=sg.Brownian(diffusion=0.1))])
    law, speeds = fastest(layers.motions)
    assert law == FLUID
    np.testing.assert_allclose(speeds, [0, 1, 0.1 / 0.857])
    assert GRID.replace(motion=(None, FLUID)).motions == (None, FLUID)
    assert GRID.replace(motion=FLUID).motions == (FLUID, FLUID)
    assert not GRID.moves
    assert not SLAB.replace(motion=sg.Brownian(diffusion=0.0)).moves
    with pytest.raises(RuleError, match="VoxelGrid.motion must be one for all, or one for each of 2 scatterers"):
        GRID.replace(motion=(FLUID,))
    with pytest.raises(RuleError, match="motion must be of one law"):
        sg.Layers(layers=[LAYER.replace(motion=Slower(amount=1.0)), LAYER.replace(motion=FLUID)])


def test_a_law_of_ones_own():
    slab = SLAB.replace(motion=Slower(amount=2.0))
    assert sg.Slab.from_json(slab.canonical_json()) == slab
    assert reduced_time("lag", slab.motion, 2 * np.pi, 4.0) == pytest.approx(2.0 * 2.0 / 6)


@pytest.mark.parametrize("diffusion", [-1.0, np.nan, np.inf])
def test_diffusion_in_its_range(diffusion):
    assert_refused(lambda: sg.Brownian(diffusion=diffusion), "Brownian.diffusion must be")


def film(times, **changes):
    beams = sg.CollimatedBeams.tilts(np.zeros(len(times)), width=50.0, times=times)
    parts = {"medium": SLAB.replace(motion=FLUID), "sensor": sg.FarField.grid((4, 4), 0.005)} | changes
    return sg.Scene(wavelength=1.0, illumination=beams, **parts)


@pytest.mark.parametrize(("changes", "times", "field", "rule"), [
    ({"medium": SLAB}, [0.0, 1.0], "CollimatedBeams.times", "left out for a medium at rest"),
    ({}, [0.0, 2.0, 1.0], "CollimatedBeams.times", "increasing, since the medium moves"),
    ({}, [-1e308, 1e308], "CollimatedBeams.times", "such that k"),
])  # fmt: skip
def test_films_that_are_refused(changes, times, field, rule):
    assert_refused(lambda: film(times, **changes), f"{field} must be {rule}")


def test_a_film_is_drawn_by_the_paths_of_its_rest():
    one = film([0.0, 1.0])
    assert one.film
    assert len(one.at_rest.lights) == 1
    assert one.unitless_fingerprint() == film([0.0, 1.0, 2.0]).unitless_fingerprint()
    assert not film([3.0, 3.0]).film
    assert len(film([3.0, 3.0]).at_rest.lights) == 2


def test_verbs_that_know_no_time_refuse_a_film():
    scene = film([0.0, 1.0])
    for verb in (sg.covariance, sg.transmission_matrix):
        with pytest.raises(RuleError, match="scene must be a scene without times"):
            verb(scene, paths=100)
    with pytest.raises(RuleError, match="scene must be a scene without times"):
        sg.render_partially_coherent(scene, coherence_length=5.0, paths=100)
    assert_refused(lambda: sg.render(scene, sampler="covariance", paths=100), "scene must be a scene without times")


@pytest.mark.parametrize("law", [FLUID, Slower(amount=3.0), Slower(amount=3.0, power=1.5)], ids=["D", ".5", "1.5"])
def test_roots_of_steps_have_the_covariance_of_the_law(law):
    times = np.array([0.3, 0.3, 0.5, 1.0, 1.7])
    roots = step_roots("times", law, 1.0, times)
    x = reduced_time("times", law, 1.0, times[:, None] - times)
    expected = (x[:, :1] + x[:1] - x) / 2
    np.testing.assert_allclose(roots @ roots.T, expected, atol=1e-12 * expected.max())
    np.testing.assert_array_equal(step_roots("times", law, 1.0, times[:-1]), roots[:-1, :-1])


def test_a_law_that_no_process_follows_is_refused():
    with pytest.raises(RuleError, match="Slower.mean_square must be a stationary random motion"):
        step_roots("times", Slower(amount=1.0, power=3.0), 1.0, np.arange(4.0))
