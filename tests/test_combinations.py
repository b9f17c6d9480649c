"""Every verb with every feature of media, light and sensors, and every packaged recipe with every field.

Each combination is answered or refused. An answer has no NaN, unless a warning says so; a refusal is a RuleError. A
part of the table each, all of it under ``slow``.
"""

import copy
import itertools
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

import specklegen as sg
from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.recipes.recipe_files import merged, recipe_table

OBLIQUE = [0.3, 0.2, np.sqrt(1 - 0.13)]
MOTIONS = (None, sg.media.Brownian(diffusion=1.0), sg.media.Shear(rate=1.0), sg.media.Drift(velocity=[1.0, 0.0, 0.0]))


def made(build: Callable[[], Any]) -> Any:
    """Return what is built, or None of what is refused."""
    try:
        return build()
    except sg.RuleError:
        return None


def media() -> dict[str, Any]:
    """Media by their features; combinations that are refused are left out."""
    forward = sg.media.HenyeyGreenstein(0.6)

    def layers(scatterer, motion, index, polarisation):
        own = {} if index is None else {"index": index}
        first = sg.media.Layer(thickness=20.0, mean_free_path=10.0, scatterer=scatterer, motion=motion, **own)
        last = sg.media.Layer(thickness=10.0, mean_free_path=10.0, scatterer=sg.media.Rayleigh(), motion=motion)
        return sg.Layers([first, last], polarisation=polarisation)

    def slab(scatterer, motion, inside, polarisation):
        return sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=scatterer, motion=motion,
                       faces=sg.media.Faces(inside=inside), polarisation=polarisation)  # fmt: skip

    found = {}
    for polarisation, motion in itertools.product(("scalar", "projector", "vector"), MOTIONS):
        scatterer, moving = sg.media.Rayleigh() if polarisation == "vector" else forward, type(motion).__name__
        for make, value in ((slab, 1.0), (slab, 1.4), (layers, None), (layers, 1.3)):
            found[f"{make.__name__} {polarisation} {moving} {value}"] = made(
                partial(make, scatterer, motion, value, polarisation)
            )
    box = sg.media.Box(lower=[-20, -20, 0], upper=[20, 20, 40], mean_free_path=20.0,
                       scatterer=sg.media.HenyeyGreenstein(0.5))
    found |= {"box": box, "box Brownian": box.replace(motion=MOTIONS[1])}
    found["no albedo"] = sg.Slab(thickness=40.0, mean_free_path=10.0, albedo=0.0, scatterer=forward)
    found["screen"] = sg.media.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    found["screens"] = sg.media.ScreenStack(screens=[found["screen"]] * 2, gaps=[50.0])
    found["moving screens"] = found["screens"].replace(velocities=((1.0, 0.0), (0.0, 0.0)))
    return {name: medium for name, medium in found.items() if medium is not None}


def curves() -> dict[str, Callable]:
    """Verbs that take a medium, with every side, view and analyser."""
    found: dict[str, Callable] = {}
    sides = (("transmission", {}), ("reflection", {}), ("transmission", {"view": OBLIQUE}),
             ("reflection", {"view": [0, 0, -1.0]}))  # fmt: skip
    channels = (("none", 0.0), ("co", 0.0), ("crossed", 0.7), ("circular", 0.0), ("flipped", 0.0))
    for (mode, aside), (channel, azimuth) in itertools.product(sides, channels):
        options = {"wavelength": 1.0, "mode": mode, "channel": channel, "azimuth": azimuth, "paths": 128, **aside}
        name = f"{mode} {len(aside)} {channel}"
        found[f"memory_effect {name}"] = partial(sg.memory_effect, tilts=[0.0, 0.01], **options)
        found[f"temporal_correlation {name}"] = partial(sg.statistics.temporal_correlation, lags=[0.0, 0.01], **options)
        found[f"temporal_correlation of tilts {name}"] = partial(
            sg.statistics.temporal_correlation, lags=[0.01], tilts=[0.0, 0.01], **options
        )
        found[f"contrast {name}"] = lambda medium, o=options: sg.statistics.temporal_correlation(
            medium, lags=[0.0], **o
        ).contrast([0.01])
    for mode, aside in sides:
        found[f"mueller_matrix {mode} {len(aside)}"] = partial(
            sg.statistics.mueller_matrix, wavelength=1.0, mode=mode, paths=128, **aside
        )
    joint = partial(sg.statistics.joint_correlation, wavelength=1.0, tilts=[0.0, 0.01], shifts=[0.0, 1.0], paths=128)
    found |= {"joint_correlation": joint, "joint_correlation of lags": partial(joint, lags=[0.01])}
    found["reflectance_transmittance"] = partial(sg.statistics.reflectance_transmittance, angle=0.4, paths=128)
    return found


def scenes() -> dict[str, Callable]:
    """Verbs that take a scene, with every kind of light and sensor; of polarised media with crossed polarisers."""
    tilts = partial(sg.light.CollimatedBeams.tilts, [0.0, 0.002], width=400.0)
    lights = {"tilts": tilts(), "film": tilts(times=[0.0, 0.01]), "exposure": tilts(times=[0.0, 0.1], exposure=0.02),
              "focus": sg.light.FocusedBeams([[0.0, 0.0, 10.0]], waist=4.0),
              "points": sg.light.PointSources(points=[[0.0, 0.0, -50.0]])}  # fmt: skip
    shown = np.array([[1.0, 1j], [0.0, -1.0]])
    lights |= {"object": sg.light.CoherentObject(shown, 20.0, distance=30.0),
               "object, film": sg.light.CoherentObject(shown, 20.0, times=[0.0, 0.01])}  # fmt: skip
    lens = partial(sg.sensors.Imaging, shape=(4, 4), pitch=1.0, aperture=0.1)
    far = partial(sg.sensors.FarField.grid, (4, 4), 1e-3)
    sensors = {"far": far(), "far oblique": far(center=(0.3, 0.1)), "back": far(side="reflection"), "lens": lens(),
               "lens back": lens(side="reflection"),
               "near": sg.sensors.NearField(np.array([[0.0, 0.0, 60.0], [3.0, 2.0, 80.0]]))}  # fmt: skip
    verbs = {"render": partial(sg.render, paths=60), "covariance": partial(sg.statistics.covariance, paths=64),
             "mean_field": sg.statistics.mean_field, "plan": sg.plan}  # fmt: skip
    found: dict[str, Callable] = {}
    for (light, beams), (sensor, camera), (verb, call) in itertools.product(
        lights.items(), sensors.items(), verbs.items()
    ):
        parts = {"wavelength": 1.0, "illumination": beams, "sensor": camera}
        found[f"{verb} {light}, {sensor}"] = lambda medium, call=call, parts=parts: call(
            sg.Scene(medium=medium, polarisers=None if is_scalar(medium) else sg.light.Polarisers.crossed(), **parts)
        )
    return found


def is_scalar(medium: Any) -> bool:
    """Whether a medium knows no polarisation."""
    return getattr(medium, "polarisation", "scalar") == "scalar"


def numbers(result: Any) -> list[np.ndarray]:
    """Arrays of numbers of a result."""
    if isinstance(result, np.ndarray | float | complex):
        return [np.asarray(result)]
    return [np.asarray(each) for each in vars(result).values() if isinstance(each, np.ndarray | float | complex)]


ANSWERED, REFUSED = "answered", "refused"


def outcome(call: Callable, *arguments: Any) -> str:
    """Return "answered" or "refused"; of anything else, an error or NaN without a warning, what it is."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            arrays = numbers(call(*arguments))
        except sg.RuleError:
            return REFUSED
        except Exception as error:  # whatever else it is, it is the finding
            return f"{type(error).__name__}: {str(error)[:120]}"
    told = any(issubclass(each.category, UserWarning) for each in caught)  # not that a name has moved
    bad = not told and any(np.isnan(each).any() for each in arrays if each.dtype.kind in "fc")
    return "NaN without a warning" if bad else ANSWERED


def check(outcomes: Iterable[tuple[str, str]], answers: float) -> None:
    """Hold names and outcomes to an answer or a refusal each, and a share of answers."""
    found = list(outcomes)
    assert [f"{name}: {what}" for name, what in found if what not in (ANSWERED, REFUSED)] == []
    assert sum(what == ANSWERED for _, what in found) >= answers * len(found)


def of_media(table: dict[str, Callable], step: int, first: int = 0) -> Iterator[tuple[str, str]]:
    """Names and outcomes of every ``step``-th combination of a medium and a call."""
    pairs = [
        pair for pair in itertools.product(media().items(), table.items())
        if not (is_scalar(pair[0][1]) and pair[1][0].split()[-1] in ("co", "crossed", "circular", "flipped"))
    ]  # fmt: skip
    for (medium, value), (name, call) in pairs[first::step]:
        yield f"{name} of {medium}", outcome(call, value)


# ---- Recipes -------------------------------------------------------------------------------------------

CHANGES: list[dict[str, Any]] = [
    {},
    *({"light": {"polarisation": kind, "analyser": analyser}} for kind in ("projector", "vector")
      for analyser in ("none", "co", "crossed", "circular", ["co", "crossed"])),
    {"light": {"polarised": False}}, {"light": {"bandwidth": 1e-3, "spectrum": "flat"}},
    {"light": {"refractive_index": 1.4}}, {"material": {"faces": "air"}}, {"material": {"kernel": "atlas"}},
    {"material": {"albedo": 0.9}}, {"material": {"g": 0.0}}, {"material": {"scatterer": {"type": "Rayleigh"}}},
    {"material": {"preset": "milk"}}, {"material": {"polarisation": "vector"}}, {"material": {"motion": "Brownian"}},
    {"material": {"layers": [{"thickness": 50.0, "mean_free_path": 20.0, "g": 0.9, "index": 1.4}]}},
    {"material": {"screens": [{"type": "PhaseScreen", "correlation_length": 10.0, "rms_phase": 3.0}]}},
    {"dynamics": {"frames": 2, "model": "brownian", "correlation_time": 2.0}},
    {"dynamics": {"frames": 2, "velocities": [1.0]}}, {"exposures": {"durations": [0.1, 1.0], "tau0": 1.0}},
    {"exposure": {"photons": 100.0, "read_noise": 2.0, "bit_depth": 8, "full_well": 1000.0}},
    {"bench": {"rotation": 5.0, "blur": 0.5, "stray": 0.1}}, {"tilts": {"count": 2, "step": 1e-3}},
    {"lens": {"aperture": 0.05, "focus": 10.0}}, {"mask": {"count": 2, "width": 0.1, "gap": 0.1, "length": 0.5}},
    {"vessel": {"depth": 10.0, "radius": 5.0, "speed": 1.0}}, {"mode": "reflection"}, {"side": "reflection"},
    {"camera": {"pixels_per_grain": 1.6}}, {"camera": {"shape": [16, 24]}}, {"camera": {"distance": 100.0}},
    {"window": {"profile": "gaussian"}}, {"window": {"width": "fitted"}}, {"field": {"pitch": 1e-3}},
    {"field": {"extent_over_range": 3.0}}, {"field": {"pixels": 5.0}}, {"aperture": 0.1}, {"distance": 1e4},
    {"coherence_length": 10.0}, {"media": "new"}, {"media": 2}, {"media": 2, "media_group": 2},
    {"mode_tolerance": 0.1}, {"beams": 2}, {"pixels": 8}, {"strict": True}, {"lab": {"wavelength": 0.5}},
    *({"sampler": name} for name in ("paths", "stationary", "covariance", "screens", "convolution")),
    *({"objects": {"type": kind}} for kind in ("Points", "Digits", "Bars", "Blobs", "GroundGlass")),
]  # fmt: skip


def changed_sample(name: str, change: dict[str, Any]) -> Any:
    """A sample of a packaged recipe of few pixels and paths, one part of it changed."""
    table = recipe_table(name)
    small: dict[str, Any] = {"camera": {"shape": [24, 24]}}
    if "lab" in table:
        small = {"lab": {"pixels": [48, 48], "object_extent": 0.2}}
    if "pixels" in table.get("field", {}):
        small["field"] = {"pixels": 8.0}
    if "screens" not in table["material"]:
        small["material"] = {"kernel_paths": 64}
    recipe = load_recipe(name, merged(small, copy.deepcopy(change)))
    sample = recipe.sample(0, "train", 0)
    return np.concatenate([np.ravel(each).astype(complex) for name, each in sample.items() if name != "parameters"])


def of_recipes(step: int, first: int = 0) -> Iterator[tuple[str, str]]:
    """Names and outcomes of every ``step``-th combination of a packaged recipe and a change."""
    for name, change in itertools.islice(itertools.product(recipe_names(), CHANGES), first, None, step):
        yield f"{name} with {change}", outcome(changed_sample, name, change)


# ---- The tests -----------------------------------------------------------------------------------------


def test_curves_are_answered_or_refused():
    check(of_media(curves(), 227), 0.2)


def test_scenes_are_answered_or_refused():
    check(of_media(scenes(), 131), 0.2)


def test_changed_recipes_are_answered_or_refused():
    check(of_recipes(277), 0.1)  # 1 of 8


def test_what_is_neither_is_found():
    """NaN without a warning, errors that are not the library's own, and a table of refusals."""
    assert outcome(lambda: np.array([1.0, np.nan])) == "NaN without a warning"
    assert outcome(lambda: warnings.warn("of age", DeprecationWarning, 1) or np.nan) == "NaN without a warning"
    assert outcome(lambda: warnings.warn("none lit", sg.DoubtWarning, 1) or np.nan) == ANSWERED
    assert outcome(lambda: [][1]) == "IndexError: list index out of range"
    assert outcome(lambda: sg.media.HenyeyGreenstein(2.0)) == REFUSED
    assert outcome(lambda: np.ones(2)) == ANSWERED
    for name in ("NaN without a warning", REFUSED):
        with pytest.raises(AssertionError):
            check([("a call", name)], 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(8))
def test_all_curves_are_answered_or_refused(first):
    check(of_media(curves(), 8, first), 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(16))
def test_all_scenes_are_answered_or_refused(first):
    check(of_media(scenes(), 16, first), 0.1)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(4))
def test_all_changed_recipes_are_answered_or_refused(first):
    check(of_recipes(4, first), 0.2)
