"""When the stationary sampler is right: a test on pilot paths, not a table.

Over probe pairs with tilts {0, t/2, t} from the first, views {centre, corners} and lateral mismatch kappa
in {0, +-pi/W}, the exact correlation of pilot paths is compared with what the model says:

    C_exact = W^(kappa) E[sqrt(w_1 w_2) e^(-ik dv . r + ik(di_z z1 - dv_z(z_B - L)))] / sqrt(E w_1 E w_2)
    C_model = W^(kappa) K(di)

(w_1 for both where segments are in the near field of a narrow lobe, :mod:`specklegen.paths.far_field`)
with W^ the Fourier transform of the window's intensity and K either that of the axis or the oblique one about the
middle of the beams and of the views. Intensities at these views, those of the outermost beams too, are compared with
the one that the model has everywhere, or with its envelope (:mod:`specklegen.samplers.stationary.envelope`). Of a
hidden object that has none, and whose lobes are one, the middle stands for all: its image is their sum. physics.md 9.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.statistics import BATCHES, batch_sums, jackknife
from specklegen.memory_effects.oblique import face_to_face
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.paths.far_field import SLANT, lobe_loss
from specklegen.paths.kept_angles import advance, depth_between
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.samplers.stationary.envelope import Envelope, fit_envelope
from specklegen.scene.illumination import directions_of_sines, reference_direction
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

FIRST_PATHS, MOST_PATHS = 8192, 65536
ENVELOPE_PATHS = 32768


@dataclass(frozen=True)
class StationaryError:
    """How far the stationary model is from the pilot paths.

    Attributes
    ----------
    correlation, correlation_error : float
        Largest | |C_exact|^2 - |C_model|^2 | and its standard error.
    intensity, intensity_error : float
        Largest |I_v / I - 1| over the views and the outermost beams, I that of the model, and its standard error.
    """

    correlation: float
    correlation_error: float
    intensity: float
    intensity_error: float

    def accepts(self, tolerance: float) -> bool:
        """Both errors, two standard errors included, are within the tolerance."""
        return self.correlated(tolerance) and self.intensity + 2 * self.intensity_error <= tolerance

    def correlated(self, tolerance: float) -> bool:
        """Correlations are within the tolerance, two standard errors included."""
        return self.correlation + 2 * self.correlation_error <= tolerance

    def uncorrelated(self, tolerance: float) -> bool:
        """Correlations are beyond the tolerance by two standard errors."""
        return self.correlation - 2 * self.correlation_error > tolerance

    @property
    def largest(self) -> float:
        """The larger of the two."""
        return max(self.correlation, self.intensity)


def stationary_error(
    scene: Scene, tracer: SlabTracer, tolerance: float, *, oblique: bool = False, envelope: Envelope | None = None,
    most: int = MOST_PATHS,
) -> StationaryError:  # fmt: skip
    """Judge a scene; more pilot paths, at ``most`` so many, while they alone stand between yes and no."""
    paths = FIRST_PATHS
    while True:
        error = pilot_error(scene, tracer, paths, oblique=oblique, envelope=envelope)
        lowest = max(error.correlation - 2 * error.correlation_error, error.intensity - 2 * error.intensity_error)
        if error.accepts(tolerance) or lowest > tolerance or paths >= most:
            return error
        paths *= 8


def pilot_error(
    scene: Scene, tracer: SlabTracer, paths: int, *, oblique: bool = False, envelope: Envelope | None = None
) -> StationaryError:
    """Judge a scene with collimated beams (or an incoherent object) and a far-field grid from ``paths`` paths.

    Parameters
    ----------
    scene
        The scene.
    tracer
        That of its path sums; the pilot is keyed by the scene in wavelengths.
    paths
        Pilot paths.
    oblique
        Judge the model with the oblique kernel; otherwise that of the axis, which is for transmission.
    envelope
        Of the model's intensity; without one it is the same everywhere.
    """
    seed = pilot_seed(scene.unitless_fingerprint())
    pilot = _Bank(scene, tracer, seed, paths)
    # The model's paths walk with the same random numbers, about the axis where its K is that of the axis, so that
    # the comparison carries physics and hardly any noise.
    about = replace(tracer, proposal=replace(tracer.proposal, reference=AXIS))
    model = pilot if oblique else _Bank(scene, about, seed, paths)
    middle = _grid(scene).center_direction if oblique else AXIS
    weight, way = model.weight(middle[:2]), face_to_face(model.bank, scene.slab, model.light, middle)
    norm = model.sums(weight)
    if not norm.any():  # an analyser that nothing passes: both are dark
        return StationaryError(0.0, 0.0, 0.0, 0.0)
    tilts = probe_tilts(scene, model.bank.orders, weight, way)
    models = [model.sums(weight * np.exp(-1j * scene.wavenumber * (way @ tilt))) for tilt in tilts]
    gains, sums = [], []
    for view in probe_views(scene):
        for tilt, modelled in zip(tilts, models, strict=True):
            for kappa, gain in probe_mismatches(scene):
                other = view - tilt - kappa
                if max(np.hypot(*other), np.hypot(*(pilot.light[:2] - tilt))) < 1:
                    # Tilted light keeps its angle to a lobe that is narrower, where the lobe is not in its far field.
                    kept = _kept(scene, np.hypot(*tilt))
                    like = view if kept else other
                    root = np.sqrt(pilot.weight(view) * pilot.weight(like))
                    product = pilot.sums(root * np.exp(1j * pilot.phase(view, other, tilt, kept)))
                    sums.append([product, pilot.intensity(view), pilot.intensity(like), modelled, norm])
                    gains.append(gain)
    n, gain = len(gains), np.array(gains)
    between = None if envelope is None else 0.7
    lights, views = _pairs(_probe_lights(scene, between), _intensity_views(scene, envelope is not None))
    powers = [pilot.intensity(view, light) for light, view in zip(lights, views, strict=True)]
    carried = 1.0 if envelope is None else envelope.intensity(lights, views)
    table = np.moveaxis(np.array(sums), -1, 0).reshape(BATCHES, -1)
    table = np.concatenate([table, np.array([*powers, norm]).T], axis=1)

    def differences(total: np.ndarray) -> np.ndarray:
        exact, one, two, modelled, reference = total[: 5 * n].reshape(n, 5).T
        correlation = np.square(np.abs(exact)) / (one.real * two.real) - np.square(np.abs(modelled / reference))
        return np.concatenate([gain**2 * correlation, total[5 * n : -1].real / (total[-1].real * carried) - 1])

    value, error = jackknife(table, differences)
    # Light of narrow lobes at a view is known to some per cent by so few paths: beams that all light moves with count
    # where they stand out of the noise, or it would turn down every one of them.
    whole = np.array([pilot.is_rigid_shift(light) for light in lights])
    seen = n + np.flatnonzero(~whole | (np.abs(value[n:]) > 3 * error[n:]))
    worst, brightest = np.abs(value[:n]).argmax(), seen[np.abs(value[seen]).argmax()]
    # Beyond the tilts that leave slants and depths as they are, neither the model nor what judges it is better known.
    unknown = max((reach**2 for reach in np.hypot(*tilts.T) if _kept(scene, reach) and reach**2 > SLANT), default=0.0)
    return StationaryError(
        max(float(abs(value[worst])), float(unknown)), float(error[worst]),
        float(abs(value[brightest])), float(error[brightest]),
    )  # fmt: skip


def pilot_envelope(scene: Scene, tracer: SlabTracer, *, oblique: bool = False) -> Envelope | None:
    """The envelope of a scene, from paths that do not judge it; None where some pair has no light."""
    bank = _Bank(scene, tracer, pilot_seed(scene.unitless_fingerprint()), ENVELOPE_PATHS, sample=1)
    middle = np.array([bank.light[:2], _grid(scene).center_direction[:2]]) if oblique else np.zeros((2, 2))
    lights, views = _pairs(_probe_lights(scene, 0.5), _nine_and_four(scene, 1.0))
    powers = [bank.intensity(view, light).real.sum() for light, view in zip(lights, views, strict=True)]
    reference = bank.intensity(middle[1], middle[0]).real.sum()
    if not min(*powers, reference) > 0:
        return None
    return fit_envelope(lights, views, np.array(powers) / reference, middle)


class _Bank:
    """Pilot paths about one direction of light, with their weights at views and their sums over batches."""

    def __init__(self, scene: Scene, tracer: SlabTracer, seed: int, paths: int, sample: int = 0) -> None:
        self.scene, self.light, self.layout = scene, tracer.proposal.reference, tracer.layout
        self.bank = tracer.trace(seed, paths, sample=sample, stream=Stream.PILOT)
        self._paths = paths
        self._weights: dict[bytes, np.ndarray] = {}
        self._intensities: dict[bytes, np.ndarray] = {}

    def weight(self, sines: np.ndarray) -> np.ndarray:
        """Contribution of every connection at one view."""
        key = sines.tobytes()
        if key not in self._weights:
            self._weights[key] = self._contributions(sines, self.light)
        return self._weights[key]

    def intensity(self, sines: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
        """Sums over 64 batches of paths of the contributions at one view, of the bank's light or one of other sines."""
        if light is not None and not np.array_equal(light, self.light[:2]):
            moved = sines - (light - self.light[:2])
            if not self.is_rigid_shift(light) or np.hypot(*moved) >= 1:
                return self.sums(self._contributions(sines, directions_of_sines("light", light)))
            sines = moved
        key = sines.tobytes()
        if key not in self._intensities:
            self._intensities[key] = self.sums(self.weight(sines))
        return self._intensities[key]

    def is_rigid_shift(self, light: np.ndarray) -> bool:
        """Whether a tilt to these sines moves all light by as much: lobes do not stay behind (physics.md 10)."""
        return _kept(self.scene, np.hypot(*(light - self.light[:2])))

    def _contributions(self, sines: np.ndarray, light: np.ndarray) -> np.ndarray:
        return contributions(self.layout.at(light, self._view(sines)), self.bank)

    def phase(self, view: np.ndarray, other: np.ndarray, tilt: np.ndarray, kept: bool) -> np.ndarray:
        """Phase of the exact correlation of (light, view) with (light - tilt, other), less that of the window.

        ``kept`` says whether light keeps its angle to lobes (:mod:`specklegen.paths.kept_angles`).
        """
        one, two = self._view(view), self._view(other)
        light = directions_of_sines("tilt", self.light[:2] - tilt)
        depth = self.bank.exit[:, 2] - (self.scene.slab.thickness if self.scene.side > 0 else 0.0)
        along = (self.light[2] - light[2]) * self.bank.entry[:, 2] - (one[2] - two[2]) * depth
        if kept:
            along = along - advance(self.light, light) * depth_between(self.layout, self.bank)
        lateral = self.bank.exit[:, :2] - self.bank.entry[:, :2]
        return self.scene.wavenumber * (along - lateral @ (view - other))

    def _view(self, sines: np.ndarray) -> np.ndarray:
        return directions_of_sines("view", sines, self.scene.side)

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums over 64 batches of paths, complex128[64]."""
        return batch_sums(values, self.bank.paths, self._paths)


def _kept(scene: Scene, tilt: float) -> bool:
    """Whether light keeps its angle to lobes under a tilt, in sines."""
    return lobe_loss(scene.slab, scene.wavelength, float(tilt)).spurious


def probe_views(scene: Scene) -> np.ndarray:
    """Centre and corners of the grid: float64[5, 2] direction sines."""
    grid = _grid(scene)
    return np.concatenate([grid.center_direction[None], grid.corner_directions])[:, :2]


def _probe_lights(scene: Scene, between: float | None) -> np.ndarray:
    """The middle of the beams, the one farthest from it, and the one farthest from that: float64[n, 2].

    Of a hidden object under an envelope those that lie ``between`` them and the middle, too, for its pixels are
    everywhere. Of one without (None) the middle alone, where its lobes are one: one image adds up all of its beams,
    whose lobes lie on either side of it.
    """
    directions = scene.beams.directions
    middle, sines = reference_direction(directions)[:2], directions[:, :2]
    if not len(sines) or (sines == middle).all():
        return middle[None]
    one = sines[np.square(sines - middle).sum(-1).argmax()]
    other = sines[np.square(sines - one).sum(-1).argmax()]
    found = np.array([middle, one, other])
    if scene.illumination.images:
        return found
    if between is None:
        return found if _kept(scene, float(np.hypot(*(one - middle)))) else middle[None]
    return np.concatenate([found, (1 - between) * middle + between * found[1:]])


def _nine_and_four(scene: Scene, reach: float) -> np.ndarray:
    """Centre, corners and middles of the sides of the grid, and corners half as far off, all times ``reach``."""
    (x, y), (cx, cy) = _grid(scene).sines, _grid(scene).center_direction[:2]
    whole = np.array([(a, b) for a in (x[0], cx, x[-1]) for b in (y[0], cy, y[-1])])
    return np.concatenate([(1 - part) * whole[4] + part * whole[::step] for part, step in ((reach, 1), (reach / 2, 2))])


def _intensity_views(scene: Scene, between: bool) -> np.ndarray:
    """Where intensities are judged: at the probe views, and between those at which an envelope was fitted."""
    views = probe_views(scene)
    return np.concatenate([views, _nine_and_four(scene, 0.7)]) if between else views


def _pairs(lights: np.ndarray, views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every light with every view, float64[n, 2] each."""
    return np.repeat(lights, len(views), axis=0), np.tile(views, (len(lights), 1))


def _grid(scene: Scene) -> FarFieldGrid:
    assert isinstance(scene.sensor, FarFieldGrid)
    return scene.sensor


def probe_mismatches(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Mismatches kappa / k in {0, +-pi / (k W)} along either axis, with the window's W^ there.

    W^ is that of a square, 2/pi at pi / W: the largest of all profiles, and so the strictest.
    """
    step = 0.5 * scene.speckle_size
    aside = [np.array(kappa) for kappa in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))]
    return [(np.zeros(2), 1.0), *((kappa, 2 / np.pi) for kappa in aside)]


def probe_tilts(scene: Scene, orders: np.ndarray, weight: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Tilt differences 0, t/2 and t, t no further than where C_I is within 0.01 of its floor: float64[3, 2].

    C_I is the model's: connections of ``orders`` and ``weight`` that lead ``way`` sideways.
    """
    directions = scene.beams.directions
    sines = directions[:, :2] - reference_direction(directions)[:2]
    if len(sines) == 0:
        return np.zeros((1, 2))
    gaps = sines[np.square(sines).sum(-1).argmax()] - sines
    largest = gaps[np.square(gaps).sum(-1).argmax()]
    if not largest.any():
        return np.zeros((1, 2))
    share = weight / weight.sum()
    floor = share[orders == 1].sum() ** 2
    phase = scene.wavenumber * (way @ largest)
    for reach in np.geomspace(1e-3, 1, 40):
        if np.abs(share @ np.exp(-1j * reach * phase)) ** 2 - floor < 0.01:
            largest = largest * reach
            break
    return np.stack([0 * largest, 0.5 * largest, largest])
