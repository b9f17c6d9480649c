"""The scenes, each with the entries of the covariance that are judged and where their right values come from.

Probes of slabs lie where views have moved with the tilt: there a wide beam's covariance has a closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from references.correlation_transfer import field_correlation
from scipy.optimize import brentq

import specklegen as sg
from specklegen.error_time import Probes
from specklegen.oracles.cylinder import Cylinder
from specklegen.scene.illumination import directions_of_sines

WIDTH = 1e5
PITCH = 0.45 / WIDTH  # direction sine; half a grain is the coarsest that resolves the speckle
CAMERA = 41
PERIOD = 1000.0
"""Of the waves through screens; the window is half as wide."""
CYLINDER = Cylinder.resonant(0.02)


@dataclass(frozen=True)
class Case:
    """A scene to be judged.

    Attributes
    ----------
    title : str
    scene : Scene
    probes : Probes
    reference : str
        "transfer" (closed form), "naive" (Algorithm 1 of a slab), "literal" (Algorithm 3 of boxes) or "coherence"
        (transform of the screens' coherences).
    comparisons : tuple of str
        Names of the comparison methods that apply, beside the samplers.
    """

    title: str
    scene: sg.Scene
    probes: Probes
    reference: str
    comparisons: tuple[str, ...]


def nearest(scene: sg.Scene, light: int, first_view: np.ndarray) -> int:
    """Number of the view that has moved from ``first_view`` (of light 0) as far as a light has from light 0."""
    moved = first_view[:-1] + (scene.lights[light] - scene.lights[0])[:-1]
    gaps = np.linalg.norm(scene.views[:, :-1] - moved, axis=-1) + (scene.views[:, -1] * first_view[-1] < 0)
    return int(gaps.argmin())


def transmission(g: float, optical_depth: float, sine: float = 0.0) -> Case:
    """A narrow camera behind a slab, three tilts; looked at askew where ``sine`` is not 0."""
    scene = sg.Scene(
        wavelength=1.0,
        medium=slab(g, optical_depth, 2000.0),
        illumination=sg.light.CollimatedBeams.tilts(np.arcsin(16 * PITCH * np.array([-1, 0, 1])), width=WIDTH),
        sensor=sg.sensors.FarField.grid((CAMERA, CAMERA), PITCH, center=(sine, 0.0)),
    )
    first = directions_of_sines("view", [sine - 16 * PITCH, 0.0])
    probes = Probes.among([(t, nearest(scene, t, first)) for t in range(3)])
    askew = f", seen at {np.rad2deg(np.arcsin(sine)):.0f}°" if sine else ""
    electric = ("electric-field Monte Carlo",) if g == 0 and optical_depth <= 10 else ()
    return Case(
        f"transmission, g = {g:g}, OD {optical_depth:g}{askew}", scene, probes,
        "transfer" if g == 0 and not sine else "naive", ("naive Algorithm 2", *electric),
    )  # fmt: skip


def backscatter() -> Case:
    """Views within a few widths of the cone about -i, reversed paths included."""
    medium, tilt = slab(0.0, 4.0, 400.0), 4e-4
    cone = medium.mean_free_path**-1 / (2 * np.pi)
    sines = np.array([0.0, 0.5, 2.0, 20.0]) * cone
    x = np.concatenate([sines, sines + tilt])
    scene = sg.Scene(
        wavelength=1.0,
        medium=medium,
        illumination=sg.light.CollimatedBeams.tilts(np.arcsin([0.0, tilt]), width=4 * WIDTH),
        sensor=sg.sensors.FarField(directions=directions_of_sines("view", np.stack([x, 0 * x], axis=-1), -1.0)),
    )
    points = [(0, n) for n in range(4)] + [(1, 4 + n) for n in range(4)]
    probes = Probes(np.array(points), np.array([(n, 4 + n) for n in range(4)]))
    return Case("reflection near backscatter, g = 0, OD 4", scene, probes, "transfer", ())


def wide() -> Case:
    """A field of view of 80 degrees, far too wide for a transform."""
    tilt, medium = 2e-3, slab(0.0, 10.0, 200.0)
    across = np.linspace(-0.63, 0.63, 15)
    square = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    chosen = square[[112, 116, 119]]  # the centre, and two on the axis of the tilt
    sines = np.concatenate([square, chosen + [tilt, 0]])
    scene = sg.Scene(
        wavelength=1.0,
        medium=medium,
        illumination=sg.light.CollimatedBeams.tilts(np.arcsin([0.0, tilt]), width=WIDTH),
        sensor=sg.sensors.FarField(directions=directions_of_sines("view", sines)),
    )
    points = [(0, 112), (0, 116), (0, 119), (1, 225), (1, 226), (1, 227)]
    probes = Probes(np.array(points), np.array([(0, 3), (1, 4), (2, 5)]))
    return Case("wide field of view, g = 0, OD 10", scene, probes, "transfer", ("naive Algorithm 2",))


def hidden(ranges: float) -> Case:
    """An incoherent object as large as so many memory-effect ranges, a whole number of camera pixels a pixel."""
    depth, thickness = 10.0, 4000.0
    half = brentq(lambda q: float(field_correlation(q, depth)) ** 2 - 0.5, 0.1, 10.0) / (2 * np.pi * thickness)
    step = max(1, round(ranges * half / 5 / PITCH))
    lit = np.zeros((5, 5))
    lit[[0, 1, 1, 2, 2, 2, 3, 3, 4], [0, 1, 3, 0, 2, 4, 1, 3, 4]] = 1.0
    scene = sg.Scene(
        wavelength=1.0,
        medium=slab(0.0, depth, thickness),
        illumination=sg.light.IncoherentObject(brightness=lit, pitch=step * PITCH, width=WIDTH),
        sensor=sg.sensors.FarField.grid((CAMERA, CAMERA), PITCH),
    )
    first = directions_of_sines("view", scene.lights[0, :2])
    probes = Probes.among([(t, nearest(scene, t, first)) for t in (0, 2, 4, 8)])
    found = 5 * step * PITCH / half
    return Case(
        f"hidden object, {found:.1f} ranges across, g = 0, OD 10", scene, probes, "transfer", ("naive Algorithm 2",)
    )


def flatland_box(optical_depth: float) -> Case:
    """Cylinders in a box of 20 x 20 wavelengths, seen from every side."""
    theta, around = np.linspace(0, np.pi, 721), np.arange(0, 360, 15)
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.media.Box(
            lower=(-10.0, -10.0), upper=(10.0, 10.0), mean_free_path=20.0 / optical_depth,
            scatterer=sg.media.Tabulated(theta=theta, amplitude=CYLINDER.amplitude(theta)),
        ),
        illumination=sg.light.PlaneWaves.tilts(np.deg2rad([0.0, 2.0]), dimensions=2),
        sensor=sg.sensors.FarField.angles(np.deg2rad(np.concatenate([around, around + 2]))),
    )  # fmt: skip
    chosen = np.flatnonzero(np.isin(around, [30, 90, 180, 285]))
    points = [(0, n) for n in chosen] + [(1, len(around) + n) for n in chosen]
    probes = Probes(np.array(points), np.array([(n, 4 + n) for n in range(4)]))
    comparisons = ("naive Algorithm 2", "electric-field Monte Carlo", "wave solver")
    return Case(f"box in flatland, OD {optical_depth:g}", scene, probes, "literal", comparisons)


def near_field() -> Case:
    """Points close behind a box in space."""
    across = np.array([-6.0, -3.0, 0.0, 3.0, 6.0])
    x, y = np.meshgrid(across, across)
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.media.Box(
            lower=(-10.0, -10.0, 0.0), upper=(10.0, 10.0, 20.0), mean_free_path=10.0,
            scatterer=sg.media.HenyeyGreenstein(g=0.5),
        ),
        illumination=sg.light.PlaneWaves.tilts(np.deg2rad([0.0, 1.0])),
        sensor=sg.sensors.NearField(points=np.stack([x, y, 0 * x + 22.0], axis=-1).reshape(-1, 3)),
    )  # fmt: skip
    probes = Probes.among([(0, 12), (0, 6), (1, 12), (1, 6)])
    return Case("near field behind a box, OD 2", scene, probes, "literal", ("naive Algorithm 2",))


def voxels() -> Case:
    """Eight voxels of different densities, one of them empty."""
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.media.VoxelGrid(
            lower=(-10.0, -10.0, 0.0), upper=(10.0, 10.0, 20.0),
            extinction=np.array([[[0.05, 0.2], [0.1, 0.0]], [[0.3, 0.1], [0.02, 0.15]]]),
            scatterers=(sg.media.HenyeyGreenstein(g=0.5),),
        ),
        illumination=sg.light.PlaneWaves.tilts(np.deg2rad([0.0, 2.0])),
        sensor=sg.sensors.FarField(directions=directions_of_sines("view",
                                                                  np.deg2rad([[10, 0], [12, 0], [40, 10], [42, 10]]))),
    )  # fmt: skip
    probes = Probes(np.array([(0, 0), (1, 1), (0, 2), (1, 3)]), np.array([(0, 1), (2, 3)]))
    return Case("grid of voxels", scene, probes, "literal", ("naive Algorithm 2",))


def two_screens() -> Case:
    """Two phase screens some way apart, three tilts; views and tilts lie on the steps of waves with a period."""
    step = 1 / PERIOD
    screen = sg.media.PhaseScreen(rms_phase=3.0, correlation_length=15.0)
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.media.ScreenStack(screens=(screen, screen), gaps=(150.0,)),
        illumination=sg.light.CollimatedBeams.tilts(np.arcsin(16 * step * np.array([-1, 0, 1])), width=PERIOD / 2),
        sensor=sg.sensors.FarField.grid((CAMERA, CAMERA), step),
    )
    first = directions_of_sines("view", [-16 * step, 0.0])
    probes = Probes.among([(t, nearest(scene, t, first)) for t in range(3)])
    return Case("two phase screens", scene, probes, "coherence", ("waves through screens", "screens, drawn fields"))


def slab(g: float, optical_depth: float, thickness: float) -> sg.Slab:
    """A slab that does not absorb."""
    return sg.Slab(thickness=thickness, mean_free_path=thickness / optical_depth,
                   scatterer=sg.media.HenyeyGreenstein(g=g))


_BUILDERS: dict[str, Callable[[], Case]] = {
    "transmission-g0-od1": lambda: transmission(0.0, 1.0),
    "transmission-g0-od10": lambda: transmission(0.0, 10.0),
    "transmission-g0-od50": lambda: transmission(0.0, 50.0),
    "transmission-g09-od1": lambda: transmission(0.9, 1.0),
    "transmission-g09-od10": lambda: transmission(0.9, 10.0),
    "transmission-g09-od50": lambda: transmission(0.9, 50.0),
    "oblique-view": lambda: transmission(0.9, 10.0, float(np.sin(np.deg2rad(20)))),
    "backscatter": backscatter,
    "wide-field": wide,
    "flatland-box": lambda: flatland_box(2.0),
    "thin-box": lambda: flatland_box(0.02),
    "near-field": near_field,
    "voxels": voxels,
    "hidden-object-within": lambda: hidden(0.7),
    "hidden-object-beyond": lambda: hidden(2.8),
    "two-screens": two_screens,
}
SCENES: dict[str, Callable[[], Case]] = {name: cache(build) for name, build in _BUILDERS.items()}
"""Name to scene, in the order of the page."""
