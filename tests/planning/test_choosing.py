"""The planner takes what is quickest to draw all realizations: set-up and draws, by counted operations."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import seconds
from specklegen.paths.pilot import scene_pilot
from specklegen.planning import choosing, planning
from specklegen.samplers.path_sums.cost import least_operations
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.stationary import rule
from specklegen.samplers.stationary.stationarity import FIRST_PATHS, MOST_PATHS

BOX = sg.Box(lower=[-20.0] * 3, upper=[20.0] * 3, mean_free_path=15.0, scatterer=sg.HenyeyGreenstein(0.5))


def directions(count):
    angles = np.linspace(0.05, 0.3, count)
    return np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)


def box(views=12):
    return sg.Scene(wavelength=1.0, medium=BOX, illumination=sg.PlaneWaves(directions=directions(2)),
                    sensor=sg.FarField(directions=directions(views)))  # fmt: skip


def slab(tilts=3, **fields):
    fields = {"scatterer": sg.HenyeyGreenstein(0.8)} | fields
    medium = sg.Slab(thickness=100.0, mean_free_path=25.0, **fields)
    light = sg.CollimatedBeams.tilts(np.arange(tilts) * 1e-4, width=5000.0)
    return sg.Scene(wavelength=0.5, medium=medium, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))


def test_one_realization_is_summed_and_many_are_drawn_from_their_covariance():
    one, many = sg.plan(box(), paths=5000), sg.plan(box(), paths=5000, realizations=40)
    assert (one.sampler, many.sampler) == ("paths", "covariance")
    assert sg.render(box(), paths=5000).report.sampler == "paths"
    report = sg.render(box(), paths=5000, realizations=40).report
    assert report.sampler == "covariance"
    said = next(each for each in report.decisions if each.part == "covariance")
    assert "common to all 40 realizations" in said.reason
    assert many.alternatives["path sums"] == pytest.approx(40 * one.seconds, rel=1e-9)
    told = many.explain()
    assert f"for all 40, {many.memory_bytes / 2**20:.0f} MiB" in told
    assert "Alternative: path sums, about" in told


@pytest.mark.parametrize("count", [1, 3, 10, 100])
@pytest.mark.parametrize("scene", [box(), box(40), slab(), slab(scatterer=sg.Isotropic())])
def test_nothing_that_serves_is_predicted_to_be_quicker(scene, count):
    """Beyond what a covariance has to gain to be taken unasked."""
    made = sg.plan(scene, paths=3000, realizations=count)
    for sampler in ("stationary", "paths", "covariance"):
        try:
            other = sg.plan(scene, paths=3000, realizations=count, sampler=sampler)
        except sg.RuleError:
            continue
        if not other.doubts:
            assert 0.8 * made.total_seconds <= other.total_seconds * (1 + 1e-9), sampler


@pytest.mark.parametrize("scene", [slab(), slab(12), slab(scatterer=sg.Isotropic())])
def test_the_bound_of_path_sums_is_one(scene):
    made = sg.plan(scene, paths=4000, sampler="paths", threads=1)
    least = seconds(least_operations(scene, scene_pilot(scene, False), 4000), 1)
    assert 0 < least <= made.seconds


def test_setup_counts_once():
    made = sg.plan(slab(), paths=4000, realizations=7, threads=1)
    assert made.sampler == "stationary"
    draw = made.seconds - made.setup_seconds
    assert made.total_seconds == pytest.approx(made.setup_seconds + 7 * draw)
    assert 0 < draw < 0.2 * made.setup_seconds
    once = sg.plan(slab(), paths=4000, sampler="paths", realizations=7, threads=1)
    assert once.setup_seconds == 0
    assert once.total_seconds == pytest.approx(7 * once.seconds)


@pytest.mark.parametrize("scene", [slab(), box()])
def test_a_choice_depends_on_what_is_asked_alone(scene):
    """Not on threads, and not on what was planned before."""
    found = [sg.plan(scene, paths=2000, realizations=n, threads=t).sampler for n in (1, 50) for t in (1, 4)]
    again = [sg.plan(scene, paths=2000, realizations=n, threads=t).sampler for n in (50, 1) for t in (4, 1)]
    assert found == again[::-1]


def test_longer_pilots_are_traced_where_they_may_save_more(monkeypatch):
    """One of 65 536 paths to judge a render of 1000 cost 30 times that render."""
    asked, plain = [], rule.stationary_error

    def noted(*arguments, most=MOST_PATHS, **named):
        asked.append(most)
        return plain(*arguments, most=FIRST_PATHS, **named)

    monkeypatch.setattr(rule, "stationary_error", noted)
    scene = slab(4)
    rule.scene_stationary_error.cache_clear()
    sg.plan(scene, paths=1000)
    assert set(asked) == {FIRST_PATHS}
    asked.clear()
    sg.plan(scene, paths=1000, realizations=10_000)
    assert set(asked) == {MOST_PATHS}
    asked.clear()
    rule.scene_stationary_error.cache_clear()
    sg.plan(scene, paths=1000, sampler="stationary")
    assert set(asked) == {MOST_PATHS}  # whoever asks for it wants to know
    rule.scene_stationary_error.cache_clear()


def test_rare_paths_leave_no_covariance_behind(monkeypatch):
    """What one of them adds would be on every realization."""
    plain = choosing.Eigenfields.propose.__func__

    def doubtful(kind, scene, request):
        drawn, told = plain(kind, scene, request)
        doubt = Decision("rare paths", True, "one carries all", doubt=True)
        object.__setattr__(drawn.pilot, "decisions", (doubt,))
        return drawn, told

    scene = box(11)
    assert sg.plan(scene, paths=5000, realizations=40).sampler == "covariance"
    monkeypatch.setattr(choosing.Eigenfields, "propose", classmethod(doubtful))
    planning._proposed.cache_clear()
    assert sg.plan(scene, paths=5000, realizations=40).sampler == "paths"


def test_path_sums_are_proposed_only_where_they_may_win(monkeypatch):
    """To look into the sums of a scene costs as much as a small render."""
    plain, asked = PathSums.propose.__func__, []

    def noted(kind, scene, request):
        asked.append(scene)
        return plain(kind, scene, request)

    monkeypatch.setattr(PathSums, "propose", classmethod(noted))
    made = sg.plan(slab(5), realizations=3)
    assert made.sampler == "stationary"
    assert not asked
    assert made.alternatives["path sums, at least"] > made.total_seconds


def test_a_film_asks_for_paths_of_its_own():
    """The atlas knows no momentum transfers: what serves the slab at rest must not serve it in motion."""
    fluid = sg.Brownian(diffusion=1.0)
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=fluid)
    light = {"directions": [[0.0, 0.0, 1.0]] * 2, "width": 2e4}
    scenes = [sg.Scene(wavelength=0.4, medium=slab, illumination=sg.CollimatedBeams(**light, **times),
                       sensor=sg.FarField.grid((16, 16), 1e-5)) for times in ({}, {"times": [0.0, 1e-3]})]  # fmt: skip
    still, moving = (sg.plan(scene, sampler="stationary") for scene in scenes)
    assert still.paths == 0
    assert moving.paths > 0
    assert np.isfinite(sg.render(scenes[1], sampler="stationary").field).all()
