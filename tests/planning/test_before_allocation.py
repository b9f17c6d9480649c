"""What does not fit is refused before it is allocated, and deep slabs are planned within bounds."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.core import budgets, memory
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.paths import roulette
from specklegen.paths.endpoints import AXIS
from specklegen.paths.tracer import slab_tracer, volume_tracer
from specklegen.paths.volume_tracer import VolumeTracer
from specklegen.scene.illumination import object_sines, require_corner
from specklegen.synthesis.imaging import image_operations


def slab(optical_depth: float, albedo: float = 1.0) -> sg.Slab:
    return sg.Slab(thickness=10.0 * optical_depth, mean_free_path=10.0, albedo=albedo, scatterer=sg.Isotropic())


def scene(medium: sg.Slab) -> sg.Scene:
    return sg.Scene(wavelength=0.5, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0], width=5000.0),
                    sensor=sg.FarField.grid(shape=(4, 4), pitch=4e-5))  # fmt: skip


def test_a_tilt_is_the_same_among_many_and_alone():
    """Tilts are taken one after the other: amplitudes of all at once took 75 GiB for 1e5 of them."""
    many, one = (
        sg.memory_effect(slab(5.0), wavelength=0.5, tilts=tilts, paths=640, reverse=False)
        for tilts in (np.linspace(0, 1, 9), [0.5])
    )
    assert many.intensity[4] == pytest.approx(one.intensity[0], rel=1e-9)  # sums over batches are rounded otherwise
    assert many.standard_error[4] == pytest.approx(one.standard_error[0], rel=1e-9)


def test_more_tilts_than_anybody_waits_for_are_refused_before_a_path_is_traced():
    with pytest.raises(RuleError, match="memory_effect tilts must be done within 30 days.*fewer paths"):
        sg.memory_effect(slab(5.0), wavelength=0.5, tilts=np.linspace(0, 1, 10**5), paths=10**10)


VERBS = "render", "render_tiles", "covariance", "joint_correlation", "transmission_matrix", "reflectance_transmittance"


@pytest.mark.parametrize("owner", VERBS)
def test_what_nobody_waits_for_is_refused_alike(owner, monkeypatch):
    """A millisecond stands for the month that anybody waits at most, so that few paths stand for many."""
    monkeypatch.setattr(budgets, "MOST_SECONDS", 1e-3)
    verb, this, few = getattr(sg, owner), scene(slab(5.0)), {"paths": 10**6}
    if owner in ("joint_correlation", "reflectance_transmittance"):
        this = this.medium
    if owner == "joint_correlation":
        few |= {"wavelength": 0.5, "tilts": [1e-4], "shifts": [0.0]}
    assert_refused(lambda: verb(this, **few), f"^{owner} paths must be done within")


def test_slabs_too_deep_to_trace_are_refused():
    for ask in (
        lambda: sg.plan(scene(slab(3e4)), paths=10),
        lambda: sg.memory_effect(slab(3e4), wavelength=0.5, tilts=[0.0], paths=10),
        lambda: sg.covariance(scene(slab(3e4)), paths=10, pairs=[[0, 0, 0, 0]]),
    ):
        assert_refused(ask, "Slab.optical_depth must be at most 4e")


def test_the_pilot_of_a_deep_slab_is_bounded(monkeypatch):
    """In memory, which all its connections share; a hundredth of the bound stands for a slab a hundred times deeper."""
    monkeypatch.setattr(roulette, "_SLAB_CONNECTIONS", 2**23 // 100)
    medium = slab(60.0)
    sg.memory_effect(slab(1.0), wavelength=0.5, tilts=[0.0], paths=10, reverse=False)  # compiles
    tracemalloc.start()
    sg.memory_effect(medium, wavelength=0.5, tilts=[0.0], paths=10, reverse=False)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 100e6


def test_the_pilot_of_any_geometry_is_bounded(monkeypatch):
    """At optical depth 1000 it walked ten million scatterings: 35 s and 1.8 GB."""
    held, trace = [], VolumeTracer.trace

    def counted(self, *arguments, **options):
        bank = trace(self, *arguments, **options)
        held.append(len(bank))
        return bank

    monkeypatch.setattr(VolumeTracer, "trace", counted)
    volume_tracer(scene(slab(700.0)), False)
    # 2^20 are asked for; lengths of paths are so uneven that twice as many may come.
    assert max(held) < 2**21


def test_the_pilot_of_a_slab_is_weighed_in_parts(monkeypatch):
    """The threshold has the bits of all paths at once, and the memory is that of a part: an eighth, and the weights."""
    tracer = slab_tracer(scene(slab(100.0)), False)
    whole = replace(tracer, proposal=replace(tracer.proposal, threshold=0.0))

    def found():
        tracemalloc.start()
        threshold = roulette.slab_roulette(whole, AXIS, 3).proposal.threshold
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return threshold, most

    found()  # compiles
    in_parts, little = found()
    monkeypatch.setattr(roulette, "_LEAST_AT_ONCE", roulette.SLAB_PATHS)
    at_once, much = found()
    assert in_parts == at_once
    assert little < much / 4


SCREEN = sg.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
MANY = np.broadcast_to(0.0, 10**9)  # of 8 bytes


@pytest.mark.parametrize("ask", [
    lambda: sg.memory_effect(slab(5.0), wavelength=0.5, tilts=MANY),
    lambda: sg.memory_effect(SCREEN, wavelength=0.5, tilts=MANY),
    lambda: sg.joint_correlation(slab(5.0), wavelength=0.5, tilts=MANY[: 10**5], shifts=MANY[: 10**5]),
    lambda: sg.joint_correlation(SCREEN, wavelength=0.5, tilts=MANY[: 10**5], shifts=MANY[: 10**5]),
    lambda: sg.mean_field(scene(slab(5.0)).replace(sensor=sg.FarField.grid((10**5, 10**5), 1e-8))),
])  # fmt: skip
def test_more_than_memory_holds_is_refused_by_name_before_it_is_worked_on(ask, monkeypatch):
    """It was worked on for minutes without a word, and ended in a raw MemoryError."""
    monkeypatch.setattr(memory, "available_memory", lambda: 2**33)
    assert_refused(ask, "must be (held|of a field that is held) within")


def test_a_curve_behind_screens_takes_memory_in_proportion_to_its_tilts():
    """The correlation of every two tilts was formed, of which one row is asked for."""
    sg.memory_effect(SCREEN, wavelength=0.5, tilts=[0.0])  # imports
    tracemalloc.start()
    sg.memory_effect(SCREEN, wavelength=0.5, tilts=np.linspace(0, 1e-3, 1000))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 8 * 1000**2


@pytest.mark.parametrize(("owner", "ask"), [
    ("memory_effect tilts", lambda: sg.memory_effect(SCREEN, wavelength=0.5, tilts=[0.0, 1e-3])),
    ("joint_correlation tilts", lambda: sg.joint_correlation(SCREEN, wavelength=0.5, tilts=[0.0], shifts=[1.0])),
    ("mean_field scene", lambda: sg.mean_field(scene(slab(5.0)))),
])  # fmt: skip
def test_closed_forms_are_held_against_the_time_too(owner, ask, monkeypatch):
    monkeypatch.setattr(budgets, "MOST_SECONDS", 1e-9)
    assert_refused(ask, f"^{owner} must be done within")


def test_an_image_that_nobody_waits_for_is_refused_before_it_is_made(monkeypatch):
    """A camera of 5000 x 5000 pixels was worked on for minutes without a word."""
    recipe = load_recipe("unknown-slab", {"camera": {"shape": [64, 64]}, "objects": {"shape": [16, 16]}})
    recipe.sample(0, "train", 0)  # planned, and its medium made ready
    monkeypatch.setattr(budgets, "MOST_SECONDS", 1e-9)
    assert_refused(lambda: recipe.sample(0, "train", 1), "^object_imaging must be done within")


def test_paths_that_do_not_fit_are_named():
    """They were refused as tilts and views, of which there were few."""
    with pytest.raises(RuleError, match=f"{10**12} paths'. Render fewer tilts or fewer views or paths"):
        sg.plan(scene(slab(5.0)), paths=10**12)


def hidden(pixels: int) -> sg.Scene:
    """An object that is always as large, of more or fewer pixels."""
    brightness = np.random.default_rng(0).random((pixels, pixels))
    light = sg.IncoherentObject(brightness=brightness, pitch=6e-3 / pixels, width=5000.0)
    return scene(slab(5.0)).replace(illumination=light)


@pytest.mark.parametrize("pixels", [20, 90])
def test_a_hidden_object_is_planned_by_its_modes(pixels):
    """Every pixel was counted as a tilt: 2000 x 2000 on 32 x 32 views were refused for 30.5 GiB of them."""
    made = sg.plan(hidden(pixels), paths=1000, sampler="stationary")
    imaging = made.chosen.prepare(0, 1).shared.imaging
    cells = imaging.envelope[0].numel()
    # Modes are those of the atlas's K, not of 1000 paths, and of fewer pixels: one or two more or fewer.
    assert made.operations["normal"] / cells == pytest.approx(imaging.rank, abs=2)
    few, many = (min(image_operations(imaging.lags, imaging.rank + more, 1, pixels**2, 1)) for more in (-2, 2))
    assert few <= made.operations["image"] <= many
    assert made.memory_bytes < 2**30
    assert 5 < imaging.rank < pixels**2 / 10  # otherwise modes were as many as pixels


def test_directions_of_an_object_are_not_laid_out_where_they_do_not_fit(monkeypatch):
    """Of 50 000 x 50 000 pixels 160 GB were, to see that the corner is within the half space."""
    monkeypatch.setattr(memory, "available_memory", lambda: 2**33)
    shape = 50_000, 50_000
    tracemalloc.start()
    assert_refused(lambda: object_sines("object", shape, 1e-9), "object must be held within")
    require_corner("object", shape, 1e-9)
    some = object_sines("object", shape, 1e-9, np.array([0, 50_000 * 50_000 - 1]))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1e6
    assert some == pytest.approx(np.array([[24999.5, 24999.5], [-24999.5, -24999.5]]) * 1e-9, rel=1e-12)
    assert_refused(lambda: require_corner("object", shape, 1e-4), "object.pitch must be small enough")
    few = object_sines("object", (3, 4), 0.1)
    assert np.array_equal(few[[1, 7]], object_sines("object", (3, 4), 0.1, np.array([1, 7])))
    assert few[1] == pytest.approx([0.05, 0.1])
