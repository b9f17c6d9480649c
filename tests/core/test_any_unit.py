"""500 drawn setups in nm, um, mm, m and bare numbers, in TOML and in Python: one setup; a missing unit is refused."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
import tomli_w

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.units import METRES, SECONDS
from specklegen.datasets import load_recipe
from specklegen.wavetracing import CollimatedEmitter, GaussianLaser, PointEmitter

UNITS, TIMES = ("nm", "um", "mm", "m"), ("us", "ms", "s")
SETUPS = 500


class Size(NamedTuple):
    """A quantity in metres and seconds, its powers of them, and the field that errors name."""

    value: float
    field: str
    length: int = 1
    time: int = 0


class Sizes:
    """Draws sizes of four digits."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def __call__(self, low: float, high: float, field: str, length: int = 1, time: int = 0) -> Size:
        return Size(float(f"{self.rng.uniform(low, high):.4g}"), field, length, time)


def scene(size: Sizes, medium: dict[str, Any]) -> dict[str, Any]:
    beams = {"type": "CollimatedBeams", "directions": [[0.0, 0.0, 1.0]], "width": size(5e-3, 9e-3, "width")}
    sensor = {"type": "FarFieldGrid", "shape": [4, 4], "pitch": 2e-5}
    light = medium.get("scatterer", {}).get("wavelength", size(0.4e-6, 0.8e-6, "wavelength"))
    return {"wavelength": light, "medium": medium, "illumination": beams, "sensor": sensor}


def bulk(size: Sizes) -> dict[str, Any]:
    return {"thickness": size(1e-4, 9e-4, "thickness"), "mean_free_path": size(2e-5, 9e-5, "mean_free_path")}


def moving_slab(size: Sizes) -> dict[str, Any]:
    motion = {"type": "Drift", "velocity": [size(1e-6, 9e-6, "velocity", 1, -1), 0.0, 0.0]}
    scatterer = {"type": "HenyeyGreenstein", "g": 0.9}
    return scene(size, {"type": "Slab", **bulk(size), "scatterer": scatterer, "motion": motion})


def brownian_spheres(size: Sizes) -> dict[str, Any]:
    spheres = {"type": "Mie", "radius": size(2e-7, 3e-7, "radius"), "wavelength": size(5e-7, 6e-7, "wavelength"),
               "refractive_index": 1.2}  # fmt: skip
    motion = {"type": "Brownian", "diffusion": size(1e-12, 9e-12, "diffusion", 2, -1)}
    return scene(size, {"type": "Slab", **bulk(size), "scatterer": spheres, "motion": motion})


def layers(size: Sizes) -> dict[str, Any]:
    each = [{**bulk(size), "scatterer": {"type": "HenyeyGreenstein", "g": 0.8}} for _ in range(2)]
    return scene(size, {"type": "Layers", "layers": each})


def screens(size: Sizes, first: dict[str, Any]) -> dict[str, Any]:
    second = {"type": "PhaseScreen", "correlation_length": size(9e-6, 5e-5, "correlation_length"), "rms_phase": 3.0}
    return {
        "type": "ScreenStack", "screens": [first, second], "gaps": [size(5e-4, 2e-3, "gaps.0")],
        "velocities": [[size(1e-6, 9e-6, "velocities.0.0", 1, -1), 0.0], [0.0, 0.0]],
    }  # fmt: skip


def phase_screens(size: Sizes) -> dict[str, Any]:
    rough = {"type": "PhaseScreen", "correlation_length": size(9e-6, 5e-5, "correlation_length"), "index": 1.5,
             "rms_height": size(5e-7, 2e-6, "rms_height")}  # fmt: skip
    return scene(size, screens(size, rough))


def ground_glass(size: Sizes) -> dict[str, Any]:
    return scene(size, screens(size, {"type": "GroundGlass", "grit": int(size.rng.choice([220, 600]))}))


def emitter(size: Sizes) -> dict[str, Any]:
    place, axis = [0.0, 0.0, size(-2e-2, -1e-2, "position")], [0.0, 0.0, 1.0]
    wavelength = size(4e-7, 8e-7, "wavelength")
    corner = [size(1e-3, 2e-3, "upper") for _ in range(2)]
    return [
        {"type": "GaussianLaser", "position": place, "direction": axis, "waist": size(1e-5, 9e-5, "waist"),
         "wavelength": wavelength},
        {"type": "PointEmitter", "position": place, "wavelength": wavelength},
        {"type": "CollimatedEmitter", "lower": [0.0, 0.0, 0.0], "upper": [*corner, 0.0], "direction": axis,
         "beam_radius": size(1e-5, 9e-5, "beam_radius"), "wavelength": wavelength},
    ][size.rng.integers(3)]  # fmt: skip


def lab(size: Sizes, *names: str) -> dict[str, Any]:
    ends = {
        "wavelength": (5.1e-7, 8e-7), "object_distance": (0.4, 0.6), "object_extent": (2e-4, 4e-4),
        "aperture": (4e-3, 6e-3), "camera_distance": (0.15, 0.2), "pixel_pitch": (3e-6, 4.5e-6),
        "bandwidth": (2e-10, 9e-10),
    }  # fmt: skip
    return {name: size(*ends[name], f"lab.{name}") for name in names or ends if name != "bandwidth" or not names}


BENCH = ("wavelength", "object_distance", "object_extent", "aperture", "camera_distance", "pixel_pitch")


def hidden(size: Sizes) -> dict[str, Any]:
    ends = [size(2e-5, 9e-5, "uniform.0"), size(1e-4, 9e-4, "uniform.1")]
    setup = lab(size) | {"pixels": [64, 64], "refractive_index": 1.4}
    return {"inherits": "through-slab", "lab": setup, "material": {"thickness": {"uniform": ends}}}


def preset(size: Sizes) -> dict[str, Any]:
    setup = lab(size, *BENCH) | {"pixels": [64, 64]}
    return {"inherits": "through-slab", "lab": setup, "material": {
        "preset": "brain", "thickness": size(1e-4, 9e-4, "material.thickness")}}  # fmt: skip


def preset_layers(size: Sizes) -> dict[str, Any]:
    each = [{"thickness": size(1e-4, 9e-4, f"layers.{n}.thickness"), "g": 0.9,
             "mean_free_path": size(2e-5, 9e-5, f"layers.{n}.mean_free_path")} for n in range(2)]  # fmt: skip
    setup = lab(size, *BENCH) | {"pixels": [64, 64]}
    return {"inherits": "through-slab", "lab": setup, "material": {"layers": each}}


def glasses(size: Sizes) -> dict[str, Any]:
    screen = {"type": "GroundGlass", "grit": 220}
    return {"inherits": "double-diffuser", "lab": lab(size, *BENCH) | {"pixels": [64, 64]}, "material": {
        "screens": [screen, screen], "gaps": [size(5e-4, 2e-3, "gaps.0")]}}  # fmt: skip


def changed_lab(size: Sizes) -> dict[str, Any]:
    """Of a laboratory that is inherited, in millimetres, two fields."""
    return {"inherits": "through-slab-lab",
            "lab": lab(size, "wavelength", str(size.rng.choice(["object_distance", "object_extent"])))}  # fmt: skip


def moving_glass(size: Sizes) -> dict[str, Any]:
    speeds = [size(1e-7, 9e-7, f"log_uniform.{n}")._replace(value=(n + 1) * 5e-7) for n in range(2)]
    velocities = [[{"log_uniform": speeds}, 0.0], [0.0, 0.0]]
    return {"inherits": "moving-diffuser", "material": {
        "wavelength": size(4e-7, 8e-7, "wavelength"), "gaps": [size(5e-4, 2e-3, "gaps.0")]},
        "dynamics": {"velocities": velocities}}  # fmt: skip


def brownian(size: Sizes) -> dict[str, Any]:
    material = {"wavelength": size(4e-7, 8e-7, "wavelength"), "thickness": size(5e-4, 9e-4, "thickness")}
    dynamics = {"interval": size(1e-3, 2e-3, "interval", 0, 1),
                "correlation_time": size(4e-3, 9e-3, "correlation_time", 0, 1)}  # fmt: skip
    return {"inherits": "brownian-slab", "material": material, "window": {"width": size(3e-2, 5e-2, "width")},
            "dynamics": dynamics}  # fmt: skip


PARTS = (moving_slab, brownian_spheres, layers, phase_screens, ground_glass, emitter)
RECIPES = (hidden, preset, preset_layers, glasses, changed_lab, moving_glass, brownian)
SCALED = (ground_glass,)
"""Parts with a physical scale, which no wavelength of theirs brings into another unit."""
EMITTERS = {each.__name__: each for each in (CollimatedEmitter, GaussianLaser, PointEmitter)}


def mapped(content: Any, write: Callable[[Size], Any]) -> Any:
    """Return a table with what ``write`` makes of each size."""
    if isinstance(content, Size):
        return write(content)
    if isinstance(content, dict):
        return {name: mapped(each, write) for name, each in content.items()}
    return [mapped(each, write) for each in content] if isinstance(content, list) else content


def sizes_in(content: Any) -> Iterator[Size]:
    if isinstance(content, Size):
        yield content
    elif isinstance(content, dict | list):
        for each in content.values() if isinstance(content, dict) else content:
            yield from sizes_in(each)


def texts(rng: np.random.Generator, bare: Size | None = None) -> Callable[[Size], Any]:
    """Return what writes each size in a unit of its own, but one without its unit."""

    def write(size: Size) -> str | float:
        length, time = str(rng.choice(UNITS)), str(rng.choice(TIMES))
        value = size.value / METRES[length] ** size.length / SECONDS[time] ** size.time
        pairs = ((length, size.length), (time, size.time))
        powers = [unit if power == 1 else f"{unit}^{power}" for unit, power in pairs if power]
        number = f"{value:.12g}"
        if size is bare:
            return number if rng.integers(2) else float(number)
        return f"{number} {'*'.join(powers)}"

    return write


def numbers(unit: str) -> Callable[[Size], float]:
    """Return what writes sizes as bare numbers in one unit and seconds."""
    return lambda size: float(f"{size.value / METRES[unit] ** size.length:.12g}")


def in_python(table: dict[str, Any]) -> Any:
    """Make a recipe by changes, or a part by its constructors."""
    if "inherits" in table:
        return load_recipe(table["inherits"], {name: each for name, each in table.items() if name != "inherits"})
    fields = {name: in_python(each) if isinstance(each, dict) else each for name, each in table.items()}
    for name, part in (("screens", None), ("layers", sg.Layer)):
        if name in fields:
            fields[name] = [in_python(each) if part is None else part(**each) for each in fields[name]]
    kind = fields.pop("type", "Scene")
    return EMITTERS.get(kind, getattr(sg, kind, None))(**fields)


def in_toml(table: dict[str, Any], folder: Any) -> Any:
    """Read a recipe or a part from TOML."""
    if "inherits" in table:
        (folder / "drawn.toml").write_text(tomli_w.dumps(table))
        return load_recipe(folder / "drawn.toml")
    kind = EMITTERS.get(table.get("type", ""), sg.Scene)
    return kind.from_toml(tomli_w.dumps({name: each for name, each in table.items() if each != kind.__name__}))


def drawn(seed: int, count: int) -> Iterator[tuple[Any, dict[str, Any], np.random.Generator]]:
    """Yield kinds of setups in turn, a setup of each, and a generator of units."""
    rng = np.random.default_rng(seed)
    kinds = PARTS + RECIPES
    for n in range(count):
        kind = kinds[n % len(kinds)]
        yield kind, kind(Sizes(rng)) | ({"name": "drawn"} if kind in RECIPES else {}), rng


def free_of_units(made: Any) -> list[float]:
    """Numbers of a setup that do not know its unit."""
    if hasattr(made, "tangent"):
        return [made.tangent, made.beam_radius / made.wavelength]
    if hasattr(made, "material"):
        speeds = [] if getattr(made, "dynamics", None) is None else made.dynamics.velocities or []
        media = made.material.extremes()
        ratios = [speeds[0][0].log_uniform[1] / made.wavelength] if speeds else [made.geometry.grid.pitch]
    else:
        media, ratios = [made.medium], [made.illumination.width / made.wavelength]
    for medium in media:
        ratios.append(medium.thickness / made.wavelength)
        ratios.append(medium.optical_depth if medium.stack is None else medium.rms_angle(made.wavelength))
    motion = getattr(getattr(made, "medium", None), "motion", None)
    return ratios + ([] if motion is None else [float(motion.mean_square(1.0)) / made.wavelength**2])


WEEKLY = pytest.mark.parametrize("count", [120, pytest.param(SETUPS, marks=pytest.mark.slow)])


@WEEKLY
def test_one_setup_in_any_unit(tmp_path, count):
    for kind, table, rng in drawn(48, count):
        bare = in_python(mapped(table, numbers("um")))
        for make in (in_python, lambda table: in_toml(table, tmp_path)):
            made = make(mapped(table, texts(rng)))
            assert made == bare, kind
            assert made.fingerprint() == bare.fingerprint(), kind
        unit = str(rng.choice(UNITS))
        other = mapped(table, numbers(unit))
        for make in (in_python, lambda table: in_toml(table, tmp_path)):
            if kind in SCALED and unit != "um":
                with pytest.raises(RuleError, match="wavelength must be from .* since the medium is given in"):
                    make(other)
                continue
            again = make(other)
            assert free_of_units(again) == pytest.approx(free_of_units(bare), rel=1e-9), (kind, unit)
            if hasattr(bare, "unitless_fingerprint") and bare.medium.stack is None:  # the seed of its pilots
                assert again.unitless_fingerprint() == bare.unitless_fingerprint(), (kind, unit)


def test_one_unit_that_is_missing_is_refused_by_its_field(tmp_path):
    for n, (kind, table, rng) in enumerate(drawn(49, SETUPS)):
        sizes = list(sizes_in(table))
        bare = sizes[rng.integers(len(sizes))]
        written = mapped(table, texts(rng, bare))
        with pytest.raises(RuleError, match="must be written with its unit, such as") as error:
            in_python(written) if n % 2 else in_toml(written, tmp_path)
        assert bare.field in str(error.value), (kind, error.value)


@pytest.mark.slow
def test_samples_do_not_know_the_unit(tmp_path):
    """The same bits of texts; of bare numbers in another unit, the last bits of single precision."""
    for kind, table, rng in drawn(50, len(PARTS + RECIPES)):
        if kind in (emitter, hidden):  # light alone; a bandwidth, which path sums do not take
            continue
        images = [image(in_python(mapped(table, numbers("um")))), image(in_toml(mapped(table, texts(rng)), tmp_path))]
        np.testing.assert_array_equal(*images, err_msg=kind.__name__)
        if kind not in SCALED:
            other = image(in_python(mapped(table, numbers("mm"))))
            # In layers a last bit of a sine may send one path of a kernel another way.
            error = (1e-4 if kind is preset_layers else 1e-6) * images[0].max()
            np.testing.assert_allclose(other, images[0], rtol=0, atol=error, err_msg=kind.__name__)


def image(made: Any) -> np.ndarray:
    """Return a recipe's first image, or a scene's of mean 1."""
    if hasattr(made, "sample"):
        sample = made.sample(0, "test", 0)
        return sample["image" if "image" in sample else "frames"]
    at_rest = dict.fromkeys({"velocities", "motion"} & type(made.medium).model_fields.keys())
    still = made.replace(medium=made.medium.replace(**at_rest))
    seen = sg.render(still, paths=500, seed=1).intensity
    return seen / seen.mean()
