"""Small and large counts, bad values, memory, and equal results from any number of threads."""

from unittest import mock

import numpy as np

import specklegen as sg
from specklegen.scene.illumination import directions_of_sines

from .row import Row, holds, refused, within
from .scenes import AXIS, REQUIRED, beams, scene, slab, views

NAN = float("nan")
_MACHINE = 16 * 2**30  # bytes that the memory rows pretend to have


def one_path() -> Row:
    """Estimates from a single path have no standard error."""
    found = sg.covariance(scene(slab(1.0)), paths=1, seed=1)
    curve = sg.memory_effect(slab(1.0), wavelength=1.0, tilts=[0.0, 1e-3], paths=1)
    stack = sg.render(scene(slab(1.0)), paths=1, realizations=2)
    return holds(
        "one path", REQUIRED, "shapes kept; standard errors NaN, never 0",
        {"covariance: NaN": bool(np.isnan(found.standard_error).all()) and found.value.shape == (1, 3, 1, 3),
         "its rel_error, which flags it, NaN": bool(np.isnan(found.rel_error)),
         "memory effect: NaN": bool(np.isnan(curve.standard_error).all()) and curve.intensity.shape == (2,),
         "render: finite": stack.field.shape == (2, 1, 3) and bool(np.isfinite(stack.field).all())},
    )  # fmt: skip


def one_pixel() -> Row:
    """One view, one tilt."""
    grid = scene(slab(1.0), sensor=sg.FarField.grid(shape=(1, 1), pitch=1e-3))
    line = scene(slab(1.0), sensor=views([0, 0, 1]))
    shapes = [sg.render(s, paths=100).field.shape for s in (grid, line)] + [sg.covariance(line, paths=64).value.shape]
    curve = sg.memory_effect(slab(1.0), wavelength=1.0, tilts=0.001, paths=640)
    return holds(
        "one pixel, one tilt", REQUIRED, "shapes kept",
        {f"{shapes}": shapes == [(1, 1, 1), (1, 1), (1, 1, 1, 1)], "memory effect (1,)": curve.intensity.shape == (1,)},
    )  # fmt: skip


def none_at_all() -> Row:
    """No tilts, and no views."""
    none = scene(slab(1.0), beams([]))
    blind = scene(slab(1.0), sensor=sg.FarField(directions=np.empty((0, 3))))
    curve = sg.memory_effect(slab(1.0), wavelength=1.0, tilts=[], paths=640)
    return holds(
        "no tilts, no views", REQUIRED, "shapes kept",
        {
            "render (0, 3) and (1, 0)": [sg.render(s, paths=9).field.shape for s in (none, blind)] == [(0, 3), (1, 0)],
            "covariance (0, 3, 0, 3) and (1, 0, 1, 0)": [sg.covariance(s, paths=64).value.shape for s in (none, blind)]
            == [(0, 3, 0, 3), (1, 0, 1, 0)],
            "memory effect (0,)": curve.intensity.shape == curve.standard_error.shape == (0,),
            "mean field (0, 3)": sg.mean_field(none).shape == (0, 3),
            "plans": all(np.isfinite(sg.plan(s).seconds) for s in (none, blind)),
        },
    )  # fmt: skip


def duplicates() -> Row:
    """The same tilt twice."""
    made = scene(slab(2.0), beams([0.01, 0.01]))
    fields = [sg.render(made, paths=2000, sampler=s).field for s in ("paths", "covariance")]
    found = sg.covariance(made, paths=6400, seed=1)
    curve = sg.memory_effect(slab(2.0), wavelength=1.0, tilts=[0.001, 0.001], paths=640)
    smallest = np.linalg.eigvalsh(found.value.reshape(6, 6))[[0, -1]]
    return holds(
        "duplicated tilts", REQUIRED, "equal images; C positive semidefinite",
        {
            "render by paths: to the bit": np.array_equal(*fields[0]),
            # The eigenvectors' null space is rounded, and the field is float32.
            "render by eigenvectors: to 1e-5": np.allclose(*fields[1], rtol=0, atol=1e-5 * np.abs(fields[1]).max()),
            "memory effect: to the bit": curve.intensity[0] == curve.intensity[1],
            "smallest eigenvalue ≥ −1e-12 of the largest": smallest[0] >= -1e-12 * smallest[1],
        },
    )  # fmt: skip


def bad_values() -> Row:
    """NaN, negative densities, wavelengths of nothing, directions of another length."""
    calls = [
        (lambda: slab(1.0).replace(thickness=NAN), ["Slab.thickness", "finite", "nan"]),
        (lambda: slab(1.0).replace(mean_free_path=-1.0), ["Slab.mean_free_path", "greater than 0", "-1"]),
        (lambda: slab(1.0).replace(mean_free_path=1e-310), ["Slab.mean_free_path", "1e-310"]),
        (lambda: slab(1.0).replace(albedo=1.0001), ["Slab.albedo", "at most 1"]),
        (lambda: sg.VoxelGrid(lower=[0, 0], upper=[1, 1], extinction=[[-1.0]], scatterers=(sg.Isotropic(),)),
         ["VoxelGrid.extinction", "at least 0"]),
        (lambda: sg.VoxelGrid(lower=[0, 0], upper=[1, 1], extinction=[[1.0]], albedo=[[NAN]],
                              scatterers=(sg.Isotropic(),)), ["VoxelGrid.albedo", "finite"]),
        (lambda: scene(slab(1.0), wavelength=0.0), ["Scene.wavelength", "greater than 0"]),
        (lambda: scene(slab(1.0), wavelength=NAN), ["Scene.wavelength", "finite"]),
        (lambda: sg.PlaneWaves(directions=[[0, 0, 2.0]]), ["PlaneWaves.directions", "unit vectors"]),
        (lambda: sg.FarField(directions=[[0, 0, NAN]]), ["FarField.directions", "finite"]),
        (lambda: sg.NearField(points=[[0, 0, np.inf]]), ["NearField.points", "finite"]),
        (lambda: sg.covariance(scene(slab(1.0)), paths=0), ["paths", "at least 1"]),
        (lambda: sg.covariance(scene(slab(1.0)), paths=1.5), ["paths", "whole"]),
        (lambda: sg.render(scene(slab(1.0)), paths=2.5), ["paths", "whole"]),
        (lambda: sg.memory_effect(slab(1.0), wavelength=1.0, tilts=[0.0], paths=2.5), ["paths", "whole"]),
        (lambda: sg.memory_effect(slab(1.0), wavelength=-1.0, tilts=[0.0]), ["wavelength", "above 0"]),
        (lambda: sg.memory_effect(slab(1.0), wavelength=1.0, tilts=[NAN]), ["tilts", "nan"]),
        (lambda: sg.render(scene(slab(1.0)), seed=-1), ["seed", "at least 0"]),
        (lambda: sg.covariance(scene(slab(1.0)), rel_error=NAN), ["rel_error", "between 1e-09 and 1"]),
        (lambda: sg.covariance(scene(slab(1.0)), seconds=NAN), ["seconds", "between 0 and"]),
    ]  # fmt: skip
    return refused("NaN, σ < 0, λ ≤ 0, non-unit directions, bad budgets", REQUIRED, calls)


def stack_memory() -> Row:
    """4096² views of 1000 tilts are 134 GB."""
    made = scene(slab(1.0, thickness=1e3), beams(1e-6 * np.arange(1000), width=1e4),
                 sg.FarField.grid(shape=(4096, 4096), pitch=2e-5), 0.5)  # fmt: skip
    with mock.patch("specklegen.core.memory.available_memory", return_value=_MACHINE):
        return refused("4096² views × 1000 tilts on 16 GiB", REQUIRED,
                       [(lambda: sg.plan(made), ["14.4 GiB", "GiB for 1000 tilts", "fewer tilts"])])  # fmt: skip


def covariance_memory() -> Row:
    """A covariance of 39 GiB."""
    side = int(np.sqrt(39 * 2**30 / 16))
    x = np.linspace(-0.1, 0.1, side)
    sensor = sg.FarField(directions=directions_of_sines("views", np.stack([x, 0 * x], -1)))
    made = scene(slab(1.0), sensor=sensor)
    with mock.patch("specklegen.core.memory.available_memory", return_value=_MACHINE):
        return refused("a covariance of 39 GiB on 16 GiB", REQUIRED,
                      [(lambda: sg.covariance(made, paths=64), ["8.0 GiB", "pairs="])])  # fmt: skip


def same_bits() -> Row:
    """One seed on one, two and three threads."""
    made = scene(slab(2.0, 0.5), beams([0.0, 0.01]))

    def runs(call) -> list[np.ndarray]:
        return [call(threads) for threads in (1, 2, 3)]

    results = {
        "covariance": runs(lambda n: sg.covariance(made, paths=20_000, seed=3, threads=n).value),
        "render by paths": runs(lambda n: sg.render(made, paths=20_000, seed=3, threads=n).field),
        "memory effect": runs(
            lambda n: sg.memory_effect(made.slab, wavelength=1.0, tilts=[1e-3], paths=20_000, threads=n).intensity
        ),
    }
    return holds(
        "same seed, other thread count", REQUIRED, "identical to the bit",
        {name: all(each.tobytes() == found[0].tobytes() for each in found) for name, found in results.items()},
    )  # fmt: skip


def psd() -> Row:
    """Hermitian, and no negative eigenvalue beyond rounding."""
    made = scene(slab(2.0), beams([0.0, 0.01, 0.01]), views([0, 0, 1], [0, 0, 1], [0.01, 0, 1], [0, 0, -1]))
    c = sg.covariance(made, paths=6400, seed=1).value.reshape(12, 12)
    values = np.linalg.eigvalsh(c)
    return holds(
        "C with duplicated lights and views", REQUIRED, "Hermitian, λ_min ≥ −1e-12 λ_max",
        {"Hermitian to the bit": np.array_equal(c, c.conj().T), f"λ_min/λ_max = {values[0] / values[-1]:.1g}":
         values[0] >= -1e-12 * values[-1]},
    )  # fmt: skip


def steepest_mean() -> Row:
    """The mean behind optical depths at which e^{-OD/2} underflows is 0, without a warning."""
    with np.errstate(all="raise", under="ignore"):
        found = sg.mean_field(scene(slab(1e5), sensor=sg.FarField(directions=[AXIS])))
    return within("OD 1e5: mean field", "e^{−OD/2} underflows", 0.0, np.abs(found), 0.0, relative=False)


ROWS = (one_path, one_pixel, none_at_all, duplicates, psd, bad_values, stack_memory, covariance_memory, same_bits,
        steepest_mean)  # fmt: skip
