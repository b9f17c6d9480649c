"""A small valid call of every public name, and odd values for each of its arguments in turn.

    python tests/odd_arguments.py [name ...]     # prints whatever raises an error that is not the library's own

A call answers or raises a :class:`~specklegen.core.errors.ToldError` (a broken rule names the field); IndexError,
KeyError, ZeroDivisionError and their like come from inside, and tell a user nothing.
"""

import inspect
import os
import signal
import sys
import time
import warnings
from atexit import register
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cache
from itertools import chain
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, NamedTuple

import numpy as np
import torch

import specklegen as sg
from specklegen import coherence, instrument, materials, measured, models, wavetracing
from specklegen.core.errors import ToldError
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.store.generate import generate

SECONDS = 5  # within which every call answers; none is meant to take one


class Call(NamedTuple):
    """A valid call; arguments that are functions of nothing are made when it is called."""

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    positional: tuple[str, ...] = ()

    def __call__(self, **changes: Any) -> Any:
        given = {name: value() if isinstance(value, Lazy) else value for name, value in self.arguments.items()}
        given |= changes
        first = [given.pop(name) for name in self.positional]
        found = self.function(*first, **given)
        return list(found) if isinstance(found, Iterator) else found


class Lazy(NamedTuple):
    """A value that is made when it is asked for."""

    make: Callable[[], Any]

    def __call__(self) -> Any:
        return self.make()


class Odd:
    """An object that is nothing in particular."""

    def __repr__(self) -> str:
        return "<odd>"


def odd_values() -> list[tuple[str, Any]]:
    """Odd values with their names, made anew: nobody may have changed them."""
    frozen = np.ones((2, 3))
    frozen.flags.writeable = False
    return [
        ("None", None), ("''", ""), ("'x'", "x"), ("'1'", "1"), ("b'1'", b"1"), ("True", True), ("nan", np.nan),
        ("inf", np.inf), ("-inf", -np.inf), ("-1", -1), ("0", 0), ("0.0", 0.0), ("-0.0", -0.0), ("1", 1), ("0.5", 0.5),
        ("2.5", 2.5), ("1e-300", 1e-300), ("1e300", 1e300), ("10**400", 10**400), ("-10**30", -(10**30)),
        ("2**63", 2**63), ("1j", 1j), ("Fraction", Fraction(1, 3)), ("[]", []), ("()", ()), ("{}", {}), ("[1]", [1]),
        ("[[1]]", [[1]]), ("[1, [2]]", [1, [2]]), ("[1, 'x']", [1, "x"]), ("['1']", ["1"]), ("[None]", [None]),
        ("[[]]", [[]]), ("(1, 2, 3)", (1, 2, 3)), ("(0.5, -0.5)", (0.5, -0.5)), ("[nan]", [np.nan]),
        ("set", {1}), ("dict", {"a": 1}), ("int32", np.int32(2)), ("uint8", np.uint8(1)), ("int64 0", np.int64(0)),
        ("float32", np.float32(0.5)), ("float16", np.float16(0.5)), ("complex64", np.complex64(1 + 1j)),
        ("bool_", np.bool_(True)), ("str_", np.str_("x")), ("datetime64", np.datetime64("2020-01-01")),
        ("0-d", np.array(0.5)), ("0-d int", np.array(3)), ("0-d complex", np.array(1j)), ("empty", np.zeros(0)),
        ("empty 2-d", np.zeros((0, 3))), ("empty 2-d 2", np.zeros((3, 0))), ("one", np.ones(1)), ("ones 4", np.ones(4)),
        ("zeros 4", np.zeros(4)), ("nan 2x2", np.full((2, 2), np.nan)), ("ones 2x2", np.ones((2, 2))),
        ("zeros 3x3", np.zeros((3, 3))), ("5-d", np.ones((1, 1, 1, 1, 1))), ("strided", np.ones((6, 6))[::2, ::3]),
        ("reversed", np.arange(4.0)[::-1]), ("object", np.array([1, None], dtype=object)),
        ("object 2", np.array([1.0, 2.0], dtype=object)), ("strings", np.array(["1", "x"])), ("read only", frozen),
        ("ints", np.arange(3)), ("bools", np.array([True, False])), ("complex", np.ones((2, 2)) * 1j),
        ("big-endian", np.ones(4, dtype=">f8")), ("structured", np.zeros(2, dtype=[("a", float)])),
        ("masked", np.ma.masked_array([1.0, 2.0], mask=[True, False])), ("matrix", np.asmatrix(np.ones((2, 2)))),
        ("tensor", torch.ones(3)), ("tensor 0-d", torch.tensor(0.5)), ("tensor nan", torch.full((1, 16, 16), np.nan)),
        ("tensor empty", torch.zeros(0)), ("tensor grad", torch.ones(2, requires_grad=True)),
        ("tensor complex", torch.ones(2, 2, dtype=torch.complex64)), ("tensor half", torch.ones(4, 4).half()),
        ("tensor meta", torch.ones(2, device="meta")), ("range", range(3)), ("generator", (x for x in (1.0, 2.0))),
        ("function", lambda *_: 1.0), ("class", Odd), ("object()", Odd()), ("path", Path("/nonexistent")),
        ("slab", sg.Slab(thickness=1.0, mean_free_path=1.0, scatterer=sg.Isotropic())),
    ]  # fmt: skip


ISOTROPIC = sg.Isotropic()
SLAB = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g=0.5))
GRID = sg.FarFieldGrid(shape=[4, 4], pitch=0.005)
MOVING = SLAB.replace(motion=sg.Brownian(diffusion=1.0))
BEAMS = sg.CollimatedBeams.tilts([0.0, 0.01], width=40.0)
SCENE = sg.Scene(wavelength=0.5, medium=SLAB, illumination=BEAMS, sensor=GRID)
SOURCE = sg.IncoherentObject(brightness=np.ones((2, 2)), pitch=0.01, width=40.0)
FILM = sg.Scene(
    wavelength=0.5, medium=MOVING, sensor=GRID,
    illumination=sg.CollimatedBeams(directions=[[0.0, 0.0, 1.0]] * 2, width=40.0, times=[0.0, 0.1]),
)  # fmt: skip
OBJECT = SCENE.replace(illumination=SOURCE)
SCREEN = sg.PhaseScreen(correlation_length=5.0, rms_phase=1.0)
STACK = sg.ScreenStack(screens=(SCREEN, SCREEN), gaps=(10.0,), behind=5.0)
W0 = np.exp(-((np.arange(5.0)[:, None] - np.arange(5.0)) ** 2) / 4)
RING = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
UP = np.array([0.0, 0.0, 1.0])
EMITTER = wavetracing.PointEmitter(position=[0.0, 0.0, -5.0], wavelength=0.1)
PLANE = wavetracing.Plane(center=[0.0, 0.0, 5.0], normal=UP, up=[0.0, 1.0, 0.0], shape=[4, 4], pitch=0.5)
WAVE = wavetracing.PlaneWave(wavelength=0.1, direction=UP)
SQUARE = [RING]
IMAGES = torch.from_numpy(np.random.default_rng(0).exponential(size=(1, 2, 32, 32)))


@cache
def recipe():
    """A recipe that renders at once."""
    return load_recipe("tilt-stack", {"camera": {"shape": [16, 16]}, "samples": {"train": 4}})


@cache
def hidden():
    """Batches of hidden objects."""
    small = load_recipe("through-slab", {"camera": {"shape": [32, 32]}, "material": {"kernel_paths": 300}})
    return [tensors(small.batch(0, "test", [0, 1]))]


@cache
def stored():
    """A small store."""
    folder = Path(mkdtemp(prefix="odd-arguments-"))
    register(rmtree, folder)
    generate(recipe(), samples=4, folder=folder / "a.zarr", processes=1)
    return folder / "a.zarr"


def fresh():
    """A path where nothing is."""
    folder = Path(mkdtemp(prefix="odd-arguments-"))
    register(rmtree, folder)
    return folder / "stack.zarr"


@cache
def curve():
    """A file of a measured curve."""
    file = fresh().with_name("curve.csv")
    file.write_text("tilt,C_I\n0.0,1.0\n0.5,0.6\n1.0,0.1\n")
    return file


@cache
def sphere():
    """A file of an integrating sphere."""
    file = fresh().with_name("sphere.rxt")
    head = [1.33, 1.5, 1.0, 1.0, 2.0, 0.99, 1, *[200.0, 20.0, 20.0, 5.0, 0.97] * 2]
    file.write_text("IAD1\n" + "\n".join(map(str, head)) + "\nr t\n.3 .4\n")
    return file


@cache
def frames():
    """Pairs of frames at four levels of light, and dark frames."""
    light = np.random.default_rng(0).exponential(size=(64, 64))

    def frame(photons, seed):
        camera = instrument.Camera(photons=max(photons, 1e-9), gain=2.5, read_noise=3.0, offset=20.0, bit_depth=12)
        return instrument.expose(camera, light, instrument.NoiseStreams.of(seed))

    return [(frame(n, n), frame(n, n + 1)) for n in (50, 100, 200, 400)], [frame(0, 1), frame(0, 2)]


@cache
def screen():
    """A screen with a square hole, as a mesh and as a geometry."""
    mesh = wavetracing.perforated_screen(4 * RING, [RING])
    return mesh, wavetracing.Geometry(mesh)


@cache
def seen():
    """A periodogram."""
    return models.periodogram(IMAGES, tile=16)


def values() -> Iterator[Call]:
    """Every public value, by its fields."""
    for each in (
        sg.Faces(inside=1.4, outside=1.0), BEAMS, SOURCE, sg.PlaneWaves(directions=[[0.0, 0.0, 1.0]]),
        sg.PointSources(points=[[0.0, 0.0, -5.0]]), sg.FocusedBeams(
            points=[[0.0, 0.0, 5.0]], aperture=0.1, waist=5.0, width=200.0
        ), sg.light.CoherentObject(field=np.ones((2, 2)), pitch=10.0, distance=5.0, waist=50.0),
        SLAB, SCENE, STACK, SCREEN, GRID, sg.HenyeyGreenstein(g=0.5),
        sg.Layer(thickness=1.0, mean_free_path=1.0, scatterer=ISOTROPIC), ISOTROPIC,
        sg.Layers(layers=(sg.Layer(thickness=1.0, mean_free_path=1.0, scatterer=ISOTROPIC),)),
        sg.Box(lower=[-1.0, -1.0, 0.0], upper=[1.0, 1.0, 1.0], mean_free_path=1.0, scatterer=ISOTROPIC),
        sg.VoxelGrid(lower=[0.0] * 3, upper=[1.0] * 3, extinction=np.ones((2, 2, 2)), albedo=np.ones((2, 2, 2)),
                     material=np.zeros((2, 2, 2)), scatterers=(ISOTROPIC,)),
        sg.Mie(radius=0.3, wavelength=0.5, refractive_index=1.2), sg.VonMisesFisher(concentration=10.0),
        sg.Polarisers(), sg.Rayleigh(), sg.PercusYevick(ISOTROPIC, 0.2, 0.3, wavelength=0.5),
        sg.Mixture(types=(ISOTROPIC, sg.HenyeyGreenstein(g=0.5)), fractions=(0.5, 0.5)),
        sg.Tabulated(theta=np.linspace(0, np.pi, 5), amplitude=np.ones(5)),
        sg.Brownian(diffusion=1.0), sg.Drift(velocity=[1.0, 0.0, 0.0]), sg.Shear(rate=1.0), FILM.beams,
        sg.GroundGlass(grit=220, index=1.5, unit=1e-6), sg.FarField(directions=[[0.0, 0.0, 1.0]]),
        sg.NearField(points=[[0.0, 0.0, 30.0]]), sg.Imaging(shape=[4, 4], pitch=1.0, aperture=0.1), sg.Pupil(
            stop=0.2, waist=1.0, zernike=(0.0, 0.1), measured=np.ones((2, 2))
        ), instrument.Camera(photons=10.0), laboratory(),
        coherence.AxialDetector(z=[1.0, 2.0], pixel_width=1.0),
        coherence.TransverseDetector(half_width=1.0, n_pixels=4),
        focus(), models.Training(), models.Retrieval(), EMITTER, PLANE, WAVE, wavetracing.Absorber(),
        wavetracing.Building(name="concrete", thickness=0.1), wavetracing.Conductor(), wavetracing.Diffuse(albedo=0.5),
        wavetracing.Smooth(permittivity=2.0),
        wavetracing.CollimatedEmitter(lower=[-1.0, -1.0, -5.0], upper=[1.0, 1.0, -5.0], direction=UP, beam_radius=0.2,
                                      wavelength=0.1),
        wavetracing.Transmitter(position=[0.0, 0.0, -5.0], power=1.0),
    ):  # fmt: skip
        fields = {field.alias or name: getattr(each, name) for name, field in type(each).model_fields.items()}
        yield Call(type(each).__name__, type(each), fields)


@cache
def laboratory():
    """A laboratory."""
    return instrument.LabSetup(wavelength=0.532, object_distance=2e5, object_extent=30.0, aperture=5e3,
                               camera_distance=1e5, pixel_pitch=5.0, pixels=[8, 8], oversampling=2,
                               refractive_index=1.4)  # fmt: skip


@cache
def focus():
    """A cylindrical lens."""
    return coherence.CylindricalFocus(half_aperture=100.0, focal_length=1e4, wavelength=0.5, n_source=8,
                                      detector=coherence.TransverseDetector(half_width=100.0, n_pixels=4))  # fmt: skip


VERB = {"paths": 200, "seed": 0, "threads": 1}
ERROR = {"rel_error": 0.9, "seconds": None}


def verbs() -> Iterator[Call]:
    """Public functions of scenes and media."""
    shared = VERB | {"reverse": "auto"}
    yield Call(
        "plan", sg.plan,
        {"scene": SCENE, "paths": 200, "rel_error": None, "sampler": "auto", "reverse": "auto", "mean": False,
         "field_tolerance": 1e-3, "streamed": False, "envelope": True, "realizations": 3, "threads": 1},
    )  # fmt: skip
    drawn = {"sampler": "auto", "field_tolerance": 1e-3}
    for sampler in ("paths", "stationary"):
        yield Call(
            f"render by {sampler}", sg.render,
            {"scene": SCENE, "realizations": 2 if sampler == "stationary" else 1, "mean": False}
            | shared
            | drawn
            | {"sampler": sampler},
        )  # fmt: skip
    yield Call(
        "render of screens", sg.render,
        {"scene": SCENE.replace(medium=STACK), "sampler": "screens", "realizations": 1, "seed": 0, "threads": 1},
    )  # fmt: skip
    yield Call("render to an error", sg.render, {"scene": SCENE, "sampler": "paths", "rel_error": 0.9, "seconds": 0.2})
    yield Call("render a film", sg.render, {"scene": FILM, "realizations": 1} | shared | drawn)
    yield Call("render_to_zarr", lambda **given: sg.render_to_zarr(out=fresh(), **given),
               {"scene": SCENE, "progress": False} | shared)  # fmt: skip
    yield Call("render_partially_coherent", sg.render_partially_coherent,
               {"scene": SCENE, "coherence_length": 10.0, "realizations": 1} | shared | drawn)  # fmt: skip
    yield Call("transmission_matrix", sg.transmission_matrix,
               {"scene": SCENE, "modes": np.eye(2), "mean": False} | shared)  # fmt: skip
    yield Call("Budget", sg.Budget, {"paths": 9, "seed": 0, "threads": 1, "reverse": "auto", "tolerance": 0.02})
    yield Call("mean_field", sg.mean_field, {"scene": SCENE, "most_nodes": 2e8})
    yield Call("reflectance_transmittance", sg.reflectance_transmittance,
               {"medium": SLAB, "angle": 0.1, "angles": np.linspace(0, np.pi / 2, 4)} | VERB)  # fmt: skip
    effect = {"wavelength": 0.5, "tilts": [0.0, 0.01]}
    for mode in ("transmission", "reflection"):
        yield Call(
            f"memory_effect in {mode}", sg.memory_effect,
            {"medium": SLAB, "mode": mode, "view": [0.0, 0.0, 1.0 if mode == "transmission" else -1.0],
             "tolerance": 0.02}
            | effect
            | shared,
        )  # fmt: skip
    polarised = SLAB.replace(polarisation="projector")
    yield Call("memory_effect of polarised light", sg.memory_effect,
               {"medium": polarised, "channel": "co", "azimuth": 0.3, "paths": 100} | effect)  # fmt: skip
    yield Call("mueller_matrix", sg.mueller_matrix,
               {"medium": polarised, "wavelength": 0.5, "mode": "transmission", "view": None, "paths": 100,
                "reverse": "auto", "tolerance": 0.02, "seed": 0})  # fmt: skip
    yield Call("MuellerMatrix.intensity", sg.mueller_matrix(polarised, wavelength=0.5, paths=100).intensity,
               {"light": [1, 0], "seen": [0, 1]})  # fmt: skip
    yield Call("memory_effect of screens", sg.memory_effect, {"medium": STACK} | effect)
    yield Call(
        "memory_effect of faces", sg.memory_effect,
        {"medium": SLAB.replace(faces=sg.Faces(inside=1.4, outside=1.0)), "rel_error": 0.5} | effect,
    )  # fmt: skip
    yield Call("joint_correlation", sg.joint_correlation, {"medium": SLAB, "shifts": [0.0, 1.0]} | effect | VERB)
    moved = {"medium": MOVING, "wavelength": 0.5, "lags": [0.0, 0.01]}
    yield Call("joint_correlation in time", sg.joint_correlation,
               moved | {"tilts": [0.0, 0.01], "shifts": [0.0, 1.0]} | VERB)  # fmt: skip
    for mode in ("transmission", "reflection"):
        yield Call(f"temporal_correlation in {mode}", sg.temporal_correlation,
                   moved | {"tilts": 0.0, "mode": mode, "view": None, "tolerance": 0.02} | shared)  # fmt: skip
    yield Call("Brownian.of_sphere", sg.Brownian.of_sphere,
               {"radius": 0.25, "viscosity": 1e-3, "temperature": 293.0, "unit": 1e-6})  # fmt: skip
    yield Call("Brownian.mean_square", sg.Brownian(diffusion=1.0).mean_square, {"lag": [0.0, 1.0]}, ("lag",))
    yield Call("covariance", sg.covariance,
               {"scene": SCENE, "pairs": [[0, 0, 1, 0]], "orders": "auto", "tolerance": 0.02} | shared)  # fmt: skip
    yield Call("covariance_blocks", sg.covariance_blocks, {"scene": SCENE, "rows": 2, "tolerance": 0.02} | shared)
    yield Call(
        "stack_like", sg.stack_like,
        {"slab": SLAB.replace(scatterer=sg.HenyeyGreenstein(g=0.98)), "wavelength": 0.5, "screens": 2, "paths": 500,
         "seed": 0},
    )  # fmt: skip
    yield Call("render_tiles", sg.render_tiles,
               {"scene": SCENE, "realization": 0, "mean": False} | shared | drawn | {"sampler": "paths"})  # fmt: skip
    yield Call("CollimatedBeams.tilts", sg.CollimatedBeams.tilts, {"angles": [0.0, 0.1], "width": 40.0})
    filmed = {"directions": np.eye(3)[[2, 2]], "width": 40.0, "times": [0.0, 1.0]}
    yield Call("CollimatedBeams", sg.CollimatedBeams, filmed | {"exposure": [0.5, 1.0], "sub_frames": 3})
    yield Call("PlaneWaves.tilts", sg.PlaneWaves.tilts, {"angles": [0.0, 0.1]})
    yield Call("FarField.angles", sg.FarField.angles, {"angles": [0.0, 0.1]})
    yield Call("Tabulated.from_power", sg.Tabulated.from_power,
               {"theta": np.linspace(0, np.pi, 5), "power": np.ones(5)})  # fmt: skip
    for each in (
        ISOTROPIC,
        sg.HenyeyGreenstein(g=0.5),
        sg.VonMisesFisher(concentration=10.0),
        sg.Mie(radius=0.3, wavelength=0.5, refractive_index=1.2),
        sg.Tabulated(theta=np.linspace(0, np.pi, 5), amplitude=np.ones(5)),
    ):
        yield Call(f"{each.type}.amplitude", each.amplitude, {"cos_theta": np.array([0.5])}, ("cos_theta",))
    ones = np.ones((1, 1, 1, 1))
    found = sg.Covariance(ones + 0j, ones, ones + 0j, 0j * ones, 1, False, 0.1, 0)
    yield Call("Covariance.sample", found.sample, {"realizations": 2, "seed": 0})


def bound(name: str, method: Callable[..., Any], **given: Any) -> Call:
    """A method with the defaults of its arguments."""
    found = {
        key: each.default
        for key, each in inspect.signature(method).parameters.items()
        if each.default is not each.empty
    }
    return Call(name, method, found | given)


def others() -> Iterator[Call]:
    """Public functions of coherence, instruments, materials, data sets and models."""
    skin = {"name": "skin", "wavelength": 0.633, "lobe": "von-mises-fisher"}
    yield Call("materials.get", materials.get, skin, ("name",))
    yield Call("materials.about", materials.about, {"name": "milk"}, ("name",))
    yield Call("materials.draw", materials.draw, skin | {"seed": 0}, ("name",))
    yield Call(
        "materials.memory_range", materials.memory_range,
        {"name": "intralipid", "wavelength": 0.633, "thickness": 500.0, "outside": (1.0, None), "unit": 1e-6,
         "draws": 1, "paths": 300, "seed": 0, "lobe": None},
        ("name",),
    )  # fmt: skip
    for name, given in {
        "coherent_modes": {"W0": W0, "n_modes": 2, "energy": 0.9},
        "effective_modes": {"W": W0},
        "gaussian_schell_model": {"x": np.arange(5.0), "coherence_length": 2.0, "amplitude": np.ones(5)},
        "intensity_from_modes": {"G": W0, "modes": np.eye(5)[:, :2], "eigenvalues": np.ones(2)},
        "number_of_modes": {"a_over_sigma": 3.0, "energy": 0.9},
        "propagate_csd": {"G": W0, "W0": W0},
        "sample_fields": {"W0": W0, "n": 3, "method": "kl", "seed": 0, "phase_turns": 1.0},
        "separable_coherent_modes": {"W0_y": W0, "W0_x": W0, "n_modes": 2, "energy": 0.9},
        "speckle_contrast": {"W": W0},
        "spectral_degree_of_coherence": {"W": W0, "reference": 1},
        "spectral_density": {"W": W0},
        "flux_weighted_csd": {"G": W0, "dG": W0, "W0": W0, "k": 2.0},
        "effective_source_modes": {
            "brightness": np.ones((3, 3)),
            "pitch": 0.01,
            "wavelength": 0.5,
            "width": 20.0,
            "profile": "square",
        },
        "finite_path_excess": {"scene": OBJECT, "paths": 100, "shift": 0.0, "samples": 200, "threads": 1},
        "gaussian_brightness": {"count": 5, "pitch": 0.01, "wavelength": 0.5, "coherence_length": 10.0},
        "gaussian_schell_object": {"wavelength": 0.5, "coherence_length": 10.0, "width": 40.0, "profile": "square"},
        "source_lattice": {"wavelength": 0.5, "width": 40.0, "profile": "square", "shortest": 5.0, "longest": 20.0},
        "face_beams": {"wavelength": 0.5, "width": 40.0, "count": 2},
        "face_modes": {"amplitudes": np.ones((4, 2))},
        "source_modes": {"source": SOURCE, "wavelength": 0.5, "n_modes": 2, "energy": 0.9},
    }.items():
        yield Call(f"coherence.{name}", getattr(coherence, name), given)
    yield bound("CylindricalFocus.physical_optics", focus().physical_optics)
    yield bound("CylindricalFocus.monte_carlo", focus().monte_carlo, n_rays=8, seed=0)
    image = np.ones((4, 4))
    yield Call(
        "instrument.expose", instrument.expose,
        {"camera": instrument.Camera(photons=10.0), "image": image, "streams": instrument.NoiseStreams.of(7)},
    )  # fmt: skip
    yield Call("instrument.depolarised", instrument.depolarised, {"image": image, "independent": image, "degree": 0.5})
    yield Call("instrument.incoherent_sum", instrument.incoherent_sum,
               {"images": np.ones((2, 4, 4)), "weights": [1.0, 1.0]})  # fmt: skip
    yield Call("fit_camera", sg.fit_camera, {"pairs": Lazy(lambda: frames()[0]), "dark": Lazy(lambda: frames()[1]),
                                             "bit_depth": 12})  # fmt: skip
    yield Call("measured.read_measurement", measured.read_measurement,
               {"source": np.rint(100 * IMAGES[0].numpy()), "dark": 1.0, "flat": None, "envelope": None, "region": None,
                "frames": None, "variable": None, "bit_depth": None, "hot_pixels": True}, ("source",))  # fmt: skip
    data = [measured.Transmittance(0.68, 0.01), measured.BallisticFraction(4.5e-5, 2e-6)]
    yield Call("fit_material", sg.fit_material,
               {"observations": data, "wavelength": 0.5, "known": {"thickness": 1000.0, "g": 0.9},
                "free": ["mean_free_path"]}, ("observations",))  # fmt: skip
    yield Call("fit_setup", sg.fit_setup,
               {"photographs": np.random.default_rng(0).exponential(size=(96, 96)), "envelope": None, "dark": None,
                "pixel_integration": False, "profile": "disc", "target": None, "target_step": 1.0},
               ("photographs",))  # fmt: skip
    yield Call("twin", sg.twin,
               {"photographs": np.random.default_rng(0).exponential(size=(1, 96, 96)), "recipe": None, "images": 8,
                "envelope": None, "dark": None, "pixel_integration": False, "profile": "disc", "seed": 0},
               ("photographs",))  # fmt: skip
    yield Call("advise", sg.advise, {"slab": SLAB, "wavelength": 0.5}, ("slab",))
    yield Call("measured.MemoryCurve", measured.MemoryCurve, {"tilts": [1e-4, 2e-4], "c_i": [0.9, 0.7], "error": 0.01})
    yield Call("measured.TemporalCurve", measured.TemporalCurve,
               {"lags": [1e-4, 1e-3], "g2": [1.9, 1.6], "error": 0.01})  # fmt: skip
    yield Call("measured.read_curve", measured.read_curve, {"path": Lazy(curve), "columns": None}, ("path",))
    yield Call("measured.read_sphere", measured.read_sphere, {"path": Lazy(sphere), "dual_beam": False}, ("path",))
    yield bound("LabSetup.scene", laboratory().scene, medium=SLAB, brightness=np.ones((2, 2)))
    yield Call("load_recipe", load_recipe, {"source": "tilt-stack", "changes": {}})
    yield Call("Recipe.sample", recipe().sample, {"seed": 0, "split": "train", "index": 0}, ("seed", "split", "index"))
    yield Call("Recipe.batch", recipe().batch, {"seed": 0, "split": "train", "indices": [0, 1]},
               ("seed", "split", "indices"))  # fmt: skip
    yield Call(
        "SpeckleStream", SpeckleStream,
        {"recipe": recipe(), "seed": 0, "split": "train", "batch_size": 2, "rank": 0, "world": 1, "drop_last": False,
         "device": "cpu", "graphs": True},
    )  # fmt: skip
    cache = SpeckleCache(stored())
    yield Call("SpeckleCache.shuffled", cache.shuffled, {"batch_size": 2, "seed": 0, "buffer_shards": 1})
    yield Call("SpeckleCache.batch", cache.batch, {"indices": [0, 1]}, ("indices",))
    yield Call("generate", lambda **given: generate(folder=fresh(), **given),
               {"recipe": recipe(), "seed": 0, "split": "train", "samples": 1, "dtype": "float32", "shard_samples": 2,
                "processes": 1, "shard_range": (0, 1)})  # fmt: skip
    yield Call("SpeckleCache", SpeckleCache, {"folder": Lazy(stored), "missing": "raise", "recipe": Lazy(recipe)})
    yield Call(
        "models.periodogram", models.periodogram,
        {"images": IMAGES, "tile": 16, "background": 0.0, "sigma": 2.0, "electrons": 1e3, "read_noise": 0.1},
    )  # fmt: skip
    yield Call("models.expected_deviance", models.expected_deviance, {"looks": 4.0})
    yield Call("models.align", models.align, {"image": IMAGES, "target": IMAGES})
    yield Call("models.scores", models.scores, {"image": IMAGES, "target": IMAGES})
    yield Call(
        "models.bootstrap", models.bootstrap,
        {"values": np.arange(6.0), "media": np.arange(6) % 3, "characters": None, "confidence": 0.9, "resamples": 50,
         "seed": 0},
    )  # fmt: skip
    yield Call("models.measured_memory_effect", models.measured_memory_effect,
               {"distance": [0.0, 1.0, 2.0, 3.0], "values": [1.0, 0.8, 0.4, 0.1]})  # fmt: skip
    yield Call(
        "models.retrieve", models.retrieve,
        {"autocorrelation": IMAGES[0], "retrieval": models.Retrieval(restarts=2, steps=3, error_reduction=1),
         "memory_effect": torch.ones(32, 32), "transfer": None, "seed": 0, "threads": 1},
    )  # fmt: skip
    yield Call("models.Optics", models.Optics,
               {"step": 0.1, "grain": 0.4, "profile": "square", "pixel_integration": False})  # fmt: skip
    yield Call("models.SpeckleLikelihood", models.SpeckleLikelihood,
               {"seen": seen(), "shape": (8, 8), "optics": models.Optics(0.1, 0.4)})  # fmt: skip
    yield Call(
        "models.turn_of", models.turn_of,
        {"images": IMAGES, "objects": IMAGES[:, 0, :8, :8] + 1.0, "optics": models.Optics(1.0, 3.0), "noise": 0.01},
    )  # fmt: skip
    yield Call(
        "models.joint_objects", models.joint_objects,
        {"images": IMAGES[0], "objects": IMAGES[0, :, :8, :8] + 1.0, "optics": models.Optics(1.0, 3.0)},
    )  # fmt: skip
    yield Call(
        "models.multiframe_deconvolution", models.multiframe_deconvolution,
        {"images": IMAGES[0], "optics": models.Optics(1.0, 3.0), "size": 8, "background": 0.0, "sigma": 8.0,
         "starts": 1, "seed": 0},
    )  # fmt: skip
    yield Call(
        "models.recoverable", models.recoverable,
        {"recipe": "through-slab", "compensation": True, "beam": np.inf, "removal": 0.0, "media": 1, "seed": 0},
    )  # fmt: skip
    yield Call("models.judge_photograph", models.judge_photograph,
               {"photographs": IMAGES[0], "dark": 0.0, "camera": instrument.Camera(photons=10.0)})  # fmt: skip
    yield Call("models.retrieve_image", models.retrieve_image,
               {"source": IMAGES[0], "grain": 3.0, "extent": 8.0, "noise": 0.0, "pixel": 1.0, "envelope": None,
                "retrieval": models.Retrieval(restarts=1, steps=1), "seed": 0})  # fmt: skip
    yield Call(
        "models.evaluate", models.evaluate,
        {"methods": {"one": lambda batch: batch["image"]}, "batches": Lazy(hidden), "profile": "square"},
    )  # fmt: skip


def waves() -> Iterator[Call]:
    """Public functions of wave tracing."""
    mesh, geometry = screen()
    yield Call("aperture_transform", wavetracing.aperture_transform,
               {"opening": SQUARE, "xi": [[0.1, 0.2]], "amplitude": 1.0, "tolerance": 1e-3})  # fmt: skip
    yield Call("gaussian_mass", wavetracing.gaussian_mass,
               {"polygon": SQUARE, "covariance": np.eye(2), "mean": (0.0, 0.0)})  # fmt: skip
    yield Call("GaussianBeam", wavetracing.GaussianBeam,
               {"origin": [0.0] * 3, "direction": UP, "sigma": np.eye(2), "wavelength": 0.1, "rho": 0.0})  # fmt: skip
    yield Call("bilinear_intensity", wavetracing.bilinear_intensity,
               {"contributions": np.ones((3, 4), complex), "unbiased": True})  # fmt: skip
    field = wavetracing.PlaneField(np.ones((8, 8), complex), 0.05, 0.1)
    yield Call("PlaneField", wavetracing.PlaneField,
               {"values": np.ones((8, 8), complex), "pitch": 0.05, "wavelength": 0.1})  # fmt: skip
    yield Call("illumination_of", wavetracing.illumination_of, {"fields": field, "power": 0.99})
    yield Call("window_losses", wavetracing.window_losses, {"fields": field})
    yield Call("Mask", wavetracing.Mask, {"values": np.ones((2, 3)), "pitch": 0.5, "center": [0.0, 0.0]})
    yield Call("GaussianLaser", wavetracing.GaussianLaser,
               {"position": [0.0] * 3, "direction": UP, "waist": 1.0, "wavelength": 0.1, "power": 1.0})  # fmt: skip
    yield Call("WaveSum", wavetracing.WaveSum,
               {"directions": np.array([UP]), "amplitudes": np.ones(1, complex), "wavelength": 0.1})  # fmt: skip
    yield Call(
        "light_behind", wavetracing.light_behind,
        {"values": np.ones((2, 2), complex), "sensor": sg.FarField.grid((2, 2), 0.01), "wavelength": 0.1},
    )  # fmt: skip
    yield Call(
        "coverage", wavetracing.coverage,
        {"geometry": geometry, "transmitter": wavetracing.Transmitter(position=[0.0, 0.0, -5.0], power=1.0),
         "plane": PLANE, "frequency": 3e9, "method": "wave", "gain": 1.0, "beams": 20, "seed": 0, "max_events": 4,
         "diffraction": "fraunhofer", "threads": 1},
    )  # fmt: skip
    yield Call("Mesh", wavetracing.Mesh,
               {"vertices": mesh.vertices, "faces": mesh.faces, "material": wavetracing.Absorber()})  # fmt: skip
    yield Call("Geometry", wavetracing.Geometry, {"meshes": mesh})
    yield Call("load_mesh (refused)", wavetracing.load_mesh,
               {"path": "/nonexistent.obj", "scale": 1.0, "material": None})  # fmt: skip
    yield Call("perforated_screen", wavetracing.perforated_screen,
               {"outline": 4 * RING, "holes": [RING], "material": None})  # fmt: skip
    yield Call("itu_permittivity", wavetracing.itu_permittivity, {"name": "concrete", "frequency": 3e9})
    yield Call(
        "sample_pattern", wavetracing.sample_pattern,
        {"opening": SQUARE, "count": 3, "seed": 0, "method": "rejection", "amplitude": 1.0, "wavelength": 0.1,
         "threads": 1},
    )  # fmt: skip
    yield Call(
        "sample_slits", wavetracing.sample_slits,
        {"widths": [1.0, 1.0], "centres": [-2.0, 2.0], "phases": [0.0, 0.0], "count": 3, "seed": 0, "wavelength": 0.1,
         "threads": 1},
    )  # fmt: skip
    yield Call(
        "coherent_rays", wavetracing.coherent_rays,
        {"geometry": geometry, "source": EMITTER, "points": [[0.0, 0.0, 5.0]], "reflections": 1, "diffractions": 1,
         "polarisation": "soft"},
    )  # fmt: skip
    yield Call(
        "coherent_paths", wavetracing.coherent_paths,
        {"geometry": geometry, "source": EMITTER, "point": [0.0, 0.0, 5.0], "reflections": 1, "diffractions": 1,
         "polarisation": "soft", "surfaces": "perfect"},
    )  # fmt: skip
    yield Call("picture", wavetracing.picture,
               {"geometry": geometry, "source": EMITTER, "plane": PLANE, "reflections": 0, "diffractions": 0,
                "samples": 1, "threads": 1})  # fmt: skip
    yield Call("impulse_response", wavetracing.impulse_response, {"paths": [], "emitter": None, "receiver": None})
    yield Call("AntennaTable", wavetracing.AntennaTable,
               {"theta": [0.0, np.pi], "phi": [0.0], "values": np.ones((2, 1, 2), complex)})  # fmt: skip
    for method in ("boundary", "spectrum", "utd", "fraunhofer"):
        yield Call(
            f"field_on_plane by {method}", wavetracing.field_on_plane,
            {"opening": SQUARE, "light": WAVE, "plane": PLANE, "method": method, "polarisation": "soft", "padding": 2.0,
             "shift": [0.0] * 3, "rotation": np.eye(3), "threads": 1},
        )  # fmt: skip
    yield Call(
        "trace", wavetracing.trace,
        {"geometry": geometry, "emitter": EMITTER, "planes": PLANE, "beams": 20, "seed": 0, "mode": "wave",
         "diffraction": "fraunhofer", "amplitude": "auto", "max_events": 4, "threads": 1},
    )  # fmt: skip
    wedge = {"n": 1.5, "phi": [1.0], "incidence": [0.5], "distance": [10.0], "k": 6.0}
    yield Call("wedge_coefficients", wavetracing.wedge_coefficients, wedge | {"beta": 1.2})
    yield Call("wedge_field", wavetracing.wedge_field, wedge | {"boundary": "soft", "beta": 1.2})


def calls() -> Iterator[Call]:
    """Every call of the table."""
    return chain(values(), verbs(), others(), waves())


class Raw(NamedTuple):
    """An error that is not the library's own, or a call that did not come back."""

    call: str
    argument: str
    value: str
    error: str


def alarm(_signum: int, _frame: Any) -> None:
    """End a call that takes too long."""
    raise TimeoutError(f"no answer in {SECONDS} s")


def raw_error(call: Call, argument: str, value: Any) -> str | None:
    """What a call raises with one argument replaced, unless it is the library's own error."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            call(**{argument: value})
        except ToldError:
            return None
        except Exception as error:  # noqa: BLE001 - that is the question
            return f"{type(error).__name__}: {' '.join(str(error).split())[:150]}"
    return None


def main() -> None:
    """Print every raw error."""
    signal.signal(signal.SIGALRM, alarm)
    os.chdir(fresh().parent)  # what odd paths make lies there
    tried = 0
    for call in calls():
        if sys.argv[1:] and not any(word in call.name for word in sys.argv[1:]):
            continue
        begun = time.perf_counter()
        try:
            call()
        except ToldError as error:
            print(f"INVALID {call.name}: {error}")
        except Exception as error:  # noqa: BLE001
            print(f"BROKEN {call.name}: {type(error).__name__}: {error}")
            continue
        took = time.perf_counter() - begun
        for argument in call.arguments:
            for name, value in odd_values():
                tried += 1
                begun = time.perf_counter()
                signal.alarm(SECONDS)
                error = raw_error(call, argument, value)
                signal.alarm(0)
                if error or time.perf_counter() - begun > 2:
                    print(f"{call.name}({argument}={name}): {error or 'slow'}", flush=True)
        print(f"# {call.name} {took:.3g} s", flush=True)
    print(f"{tried} calls")


if __name__ == "__main__":
    main()
