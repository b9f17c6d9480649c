"""When the stationary sampler is right: a test on pilot paths, not a table.

Over probe pairs with tilts ``{0, t/2, t}`` from the first, views ``{centre, corners}`` and lateral mismatch kappa in
``{0, +-pi/W}``, the exact correlation of pilot paths is compared with what the model says:

    C_exact = W^(kappa) E[sqrt(w_1 w_2) e^(-ik dv . r + ik(di_z z1 - dv_z(z_B - L)))] / sqrt(E w_1 E w_2)
    C_model = W^(kappa) K(di)

(w_1 for both where segments are in the near field of a narrow phase function, :mod:`specklegen.paths.far_field`)
with W^ the Fourier transform of the window's intensity; K is either that of the axis or the oblique one about the
middle of the beams and of the views. Intensities at these views, those of the outermost beams too, are compared with
the one that the model has everywhere, or with its envelope (:mod:`specklegen.samplers.stationary.envelope`). Of a
hidden object that has none, and whose phase functions are one, the middle stands for all: its image is their sum.
physics.md 9.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from specklegen.core.random_streams import pilot_seed
from specklegen.core.statistics import jackknife
from specklegen.memory_effects.camera import camera_nodes
from specklegen.memory_effects.oblique import face_to_face
from specklegen.paths.endpoints import AXIS
from specklegen.paths.far_field import SLANT
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.samplers.stationary.envelope import Envelope, fit_envelope
from specklegen.samplers.stationary.pilot_bank import Pair, PilotBank, keeps_angle
from specklegen.scene.illumination import directions_of_sines, reference_direction
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

GLANCE_PATHS, FIRST_PATHS, MOST_PATHS = 1024, 8192, 65536
ENVELOPE_PATHS = 32768
_CLEAR, _SURE = 4.0, 2.0
"""Standard errors from the tolerance at which the fewest paths decide, and more of them."""


@dataclass(frozen=True)
class StationaryError:
    """Distance of the stationary model from the pilot paths.

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
        pairs = (self.correlation, self.correlation_error), (self.intensity, self.intensity_error)
        return all(deviation + 2 * error <= tolerance for deviation, error in pairs)

    def is_clear(self, tolerance: float, errors: float) -> bool:
        """Return whether it is accepted or not, so many standard errors from the tolerance."""
        deviations = np.array([self.correlation, self.intensity])
        width = errors * np.array([self.correlation_error, self.intensity_error])
        return bool((deviations + width).max() <= tolerance or (deviations - width).max() > tolerance)

    def uncorrelated(self, tolerance: float) -> bool:
        """Correlations are beyond the tolerance by two standard errors."""
        return self.correlation - 2 * self.correlation_error > tolerance

    def uneven(self, tolerance: float) -> bool:
        """Intensities are beyond the tolerance by two standard errors."""
        return self.intensity - 2 * self.intensity_error > tolerance

    @property
    def largest(self) -> float:
        """The larger of the two."""
        return max(self.correlation, self.intensity)


def stationary_error(
    scene: Scene, tracer: SlabTracer, tolerance: float, *, oblique: bool = False, averaged: bool = False,
    envelope: Envelope | None = None, most: int = MOST_PATHS, glance: bool = False, walked: bool = False,
) -> StationaryError:  # fmt: skip
    """Judge a scene; more pilot paths, at ``most`` so many, while they alone stand between yes and no.

    A ``glance`` at few of them is enough where the answer is clear, and how large an error is matters to nobody: most
    scenes are far from the tolerance.
    """
    judged = partial(pilot_error, scene, tracer, oblique=oblique, averaged=averaged, envelope=envelope, walked=walked)
    if glance:
        error = judged(GLANCE_PATHS, every=True)
        if error.is_clear(tolerance, _CLEAR):
            return error
    error = judged(FIRST_PATHS)
    return judged(most) if most > FIRST_PATHS and not error.is_clear(tolerance, _SURE) else error


def pilot_error(
    scene: Scene, tracer: SlabTracer, paths: int, *, oblique: bool = False, averaged: bool = False,
    envelope: Envelope | None = None, every: bool = False, walked: bool = False,
) -> StationaryError:  # fmt: skip
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
    averaged
        Judge the model whose correlation is averaged over the camera's directions.
    envelope
        Of the model's intensity; without one it is the same everywhere.
    every
        Count the intensity of every beam, also of those that are known to their noise alone.
    walked
        Judge the model whose window stands on the entrance face, W^(kappa) K(dv): light walks on from there.
    """
    seed = pilot_seed(scene.unitless_fingerprint())
    pilot = PilotBank(scene, tracer, seed, paths)
    # The model's paths walk with the same random numbers, about the axis where its K is that of the axis, so that
    # the comparison carries physics and hardly any noise.
    own = oblique or np.array_equal(tracer.proposal.reference, AXIS)
    about = replace(tracer, proposal=replace(tracer.proposal, reference=AXIS))
    model = pilot if own else PilotBank(scene, about, seed, paths)
    middle = _grid(scene).center_direction if oblique else AXIS
    weight, way = model.weight(middle[:2]), face_to_face(model.bank, scene.slab, model.light, middle)
    norm = model.sums(weight)
    if not norm.any():  # an analyser that nothing passes: both are dark
        return StationaryError(0.0, 0.0, 0.0, 0.0)
    tilts = probe_tilts(scene, model.bank.orders, weight, way)
    towards = _camera_weights(scene, model) if averaged else [(1.0, weight, way)]

    def of_model(tilt: np.ndarray) -> np.ndarray:
        q = scene.wavenumber * tilt
        return np.sum([share * model.sums(own * np.exp(-1j * (ways @ q))) for share, own, ways in towards], axis=0)

    norms, mismatches = of_model(np.zeros(2)), probe_mismatches(scene)
    models = [[of_model(tilt + kappa) for kappa, _ in mismatches] if walked else [of_model(tilt)] * len(mismatches)
              for tilt in tilts]  # fmt: skip
    # Tilted light keeps its angle to a lobe that is narrower, where the lobe is not in its far field.
    like_lobes = [keeps_angle(scene, np.hypot(*tilt)) for tilt in tilts]
    pairs, gains, modelled = [], [], []
    for view in probe_views(scene):
        for tilt, kept, of_tilt in zip(tilts, like_lobes, models, strict=True):
            for (kappa, gain), of_pair in zip(mismatches, of_tilt, strict=True):
                other = view - tilt - kappa
                if max(np.hypot(*other), np.hypot(*(pilot.light[:2] - tilt))) < 1:
                    pairs.append(Pair(view, other, tilt, kept))
                    gains.append(gain)
                    modelled.append(of_pair)
    n, gain = len(gains), np.array(gains)
    between = None if envelope is None else 0.7
    lights, views = _pairs(_probe_lights(scene, between), _intensity_views(scene, envelope is not None))
    carried = 1.0 if envelope is None else envelope.intensity(lights, views)
    of_models = np.array(modelled).T, np.repeat(norms[:, None], n, axis=1)
    sums = [*pilot.correlations(pairs), *of_models]
    table = np.stack(sums, axis=-1).reshape(len(norm), -1)
    table = np.concatenate([table, pilot.intensities(lights, views), norm[:, None]], axis=1)

    def differences(total: np.ndarray) -> np.ndarray:
        exact, one, two, modelled, reference = total[: 5 * n].reshape(n, 5).T
        intensities = np.sqrt(one.real) * np.sqrt(two.real)  # of light so faint that their product underflows, too
        correlation = np.square(np.abs(exact) / intensities) - np.square(np.abs(modelled / reference))
        return np.concatenate([gain**2 * correlation, total[5 * n : -1].real / (total[-1].real * carried) - 1])

    value, error = jackknife(table, differences)
    # Light of narrow lobes at a view is known to some per cent by so few paths: beams that all light moves with count
    # where they stand out of the noise, or it would turn down every one of them.
    whole = np.array([pilot.is_rigid_shift(light) for light in lights])
    seen = n + np.flatnonzero(every | ~whole | (np.abs(value[n:]) > 3 * error[n:]))
    worst, brightest = np.abs(value[:n]).argmax(), seen[np.abs(value[seen]).argmax()]
    # Beyond the tilts that leave slants and depths as they are, neither the model nor what judges it is better known.
    reaches = np.hypot(*tilts.T)[like_lobes]
    unknown = np.square(reaches[np.square(reaches) > SLANT]).max(initial=0.0)
    return StationaryError(max(float(abs(value[worst])), float(unknown)), float(error[worst]),
                           float(abs(value[brightest])), float(error[brightest]))  # fmt: skip


def _camera_weights(scene: Scene, model: PilotBank) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Share, weights float64[M] and ways about their mean float64[M, 2] of all nodes of a camera, mirror images too."""
    found = []
    for sines, share in zip(*camera_nodes(half_sides(scene)), strict=True):
        signs = [np.array([a, b]) for a in (1, -1)[: 1 + (sines[0] > 0)] for b in (1, -1)[: 1 + (sines[1] > 0)]]
        for sign in signs:
            weight = model.weight(sign * sines)
            way = face_to_face(model.bank, scene.slab, model.light, directions_of_sines("view", sign * sines))
            total = max(weight.sum(), 1e-300)
            found.append((share / len(signs) / total, weight, way - weight @ way / total))
    return found


def half_sides(scene: Scene) -> np.ndarray:
    """Direction sines (x, y) from the middle of a scene's camera to its sides, float64[2]."""
    return np.array([(sines[-1] - sines[0]) / 2 for sines in _grid(scene).sines])


def pilot_envelope(scene: Scene, tracer: SlabTracer, *, oblique: bool = False) -> Envelope | None:
    """The envelope of a scene, from paths that do not judge it; None where some pair has no light."""
    bank = PilotBank(scene, tracer, pilot_seed(scene.unitless_fingerprint()), ENVELOPE_PATHS, sample=1)
    middle = np.array([bank.light[:2], _grid(scene).center_direction[:2]]) if oblique else np.zeros((2, 2))
    lights, views = _pairs(_probe_lights(scene, 0.5), _nine_and_four(scene, 1.0))
    powers = bank.intensities(np.vstack([lights, middle[:1]]), np.vstack([views, middle[1:]])).sum(axis=0)
    if not powers.min() > 0:
        return None
    return fit_envelope(lights, views, powers[:-1] / powers[-1], middle)


def probe_views(scene: Scene) -> np.ndarray:
    """Centre and corners of the grid: float64[5, 2] direction sines."""
    grid = _grid(scene)
    return np.concatenate([grid.center_direction[None], grid.corner_directions])[:, :2]


def _probe_lights(scene: Scene, between: float | None) -> np.ndarray:
    """The middle of the beams, the one farthest from it, and the one farthest from that: float64[n, 2].

    Of a hidden object under an envelope those that lie ``between`` them and the middle, too, for its pixels are
    everywhere. Of one without (None) the middle alone, where its phase functions are one: one image adds up all of its
    beams, whose light spreads on either side of it.
    """
    directions = scene.beams.directions
    middle, sines = reference_direction(directions)[:2], directions[:, :2]
    if not len(sines) or (sines == middle).all():
        return middle[None]
    one = sines[np.square(sines - middle).sum(-1).argmax()]
    other = sines[np.square(sines - one).sum(-1).argmax()]
    lights = np.array([middle, one, other])
    if scene.illumination.images:
        return lights
    if between is None:
        return lights if keeps_angle(scene, float(np.hypot(*(one - middle)))) else middle[None]
    return np.concatenate([lights, (1 - between) * middle + between * lights[1:]])


def _nine_and_four(scene: Scene, reach: float) -> np.ndarray:
    """Centre, corners and middles of the sides of the grid, and corners half as far off, all times ``reach``."""
    (x, y), (cx, cy) = _grid(scene).sines, _grid(scene).center_direction[:2]
    whole = np.array([(a, b) for a in (x[0], cx, x[-1]) for b in (y[0], cy, y[-1])])
    return np.concatenate([(1 - part) * whole[4] + part * whole[::step] for part, step in ((reach, 1), (reach / 2, 2))])


def _intensity_views(scene: Scene, between: bool) -> np.ndarray:
    """Views at which intensities are judged: the probe views, and between those at which an envelope was fitted."""
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
    """Tilt differences ``{0, t/2, t}``, t no further than where C_I is within 0.01 of its floor: float64[3, 2].

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
