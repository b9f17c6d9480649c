"""When the stationary sampler is right: a test on pilot paths, not a table.

Over probe pairs with tilts {0, t/2, t} from the first, views {centre, corners} and lateral mismatch kappa
in {0, +-pi/W}, the exact correlation of pilot paths is compared with what the model says:

    C_exact = W^(kappa) E[sqrt(w_1 w_2) e^(-ik dv . r + ik(di_z z1 - dv_z(z_B - L)))] / sqrt(E w_1 E w_2)
    C_model = W^(kappa) K(di)

with W^ the Fourier transform of the window's intensity. physics.md 9.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.fields.ends import AXIS, Optics, full_weights
from specklegen.illumination import directions_of_sines, reference_direction
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid
from specklegen.statistics import BATCHES, jackknife
from specklegen.streams import Stream, pilot_seed
from specklegen.tracing import Proposal, trace

FIRST_PATHS, MOST_PATHS = 8192, 65536


@dataclass(frozen=True)
class StationaryError:
    """How far the stationary model is from the pilot paths.

    Attributes
    ----------
    correlation, correlation_error : float
        Largest | |C_exact|^2 - |C_model|^2 | and its standard error.
    intensity, intensity_error : float
        Largest |I_v / I_axis - 1| over the views, and its standard error.
    """

    correlation: float
    correlation_error: float
    intensity: float
    intensity_error: float

    def accepts(self, tolerance: float) -> bool:
        """Both errors, two standard errors included, are within the tolerance."""
        return (
            self.correlation + 2 * self.correlation_error <= tolerance
            and self.intensity + 2 * self.intensity_error <= tolerance
        )


def stationary_error(scene: Scene, proposal: Proposal, tolerance: float) -> StationaryError:
    """Judge a scene; more pilot paths while they alone stand between yes and no."""
    paths = FIRST_PATHS
    while True:
        error = pilot_error(scene, proposal, paths)
        lowest = max(error.correlation - 2 * error.correlation_error, error.intensity - 2 * error.intensity_error)
        if error.accepts(tolerance) or lowest > tolerance or paths >= MOST_PATHS:
            return error
        paths *= 8


def pilot_error(scene: Scene, proposal: Proposal, paths: int) -> StationaryError:
    """Judge a scene with collimated beams (or an incoherent object) and a far-field grid from ``paths`` paths.

    Parameters
    ----------
    scene
        The scene.
    proposal
        The proposal of its path sampler, threshold included; the pilot is keyed by the scene's fingerprint.
    paths
        Pilot paths.
    """
    seed = pilot_seed(scene.fingerprint())
    pilot = _Bank(scene, proposal, seed, paths)
    # The model's K is that of the axis. The same random numbers walk the same paths about the axis, so that
    # the comparison carries physics and hardly any noise.
    axial = _Bank(scene, replace(proposal, reference=AXIS), seed, paths)
    norm = axial.sums(axial.weight(AXIS[:2]))
    gains, sums = [], []
    for view in _probe_views(scene):
        for tilt in _probe_tilts(scene, axial):
            model = axial.sums(axial.weight(AXIS[:2]) * np.exp(-1j * scene.wavenumber * (axial.lateral @ tilt)))
            for kappa, gain in _probe_mismatches(scene):
                other = view - tilt - kappa
                if np.hypot(*other) < 1:
                    one, two = pilot.weight(view), pilot.weight(other)
                    product = np.sqrt(one * two) * np.exp(1j * pilot.phase(view, other, tilt))
                    sums.append([pilot.sums(product), pilot.sums(one), pilot.sums(two), model, norm])
                    gains.append(gain)
    n, gain = len(gains), np.array(gains)

    def differences(total: np.ndarray) -> np.ndarray:
        exact, one, two, model, reference = total.reshape(n, 5).T
        correlation = np.square(np.abs(exact)) / (one.real * two.real) - np.square(np.abs(model / reference))
        return np.concatenate([gain**2 * correlation, one.real / reference.real - 1])

    value, error = jackknife(np.moveaxis(np.array(sums), -1, 0).reshape(BATCHES, -1), differences)
    worst, brightest = np.abs(value[:n]).argmax(), n + np.abs(value[n:]).argmax()
    return StationaryError(
        float(abs(value[worst])), float(error[worst]), float(abs(value[brightest])), float(error[brightest])
    )


class _Bank:
    """Pilot paths about one direction of light, with their weights at views and their sums over batches."""

    def __init__(self, scene: Scene, proposal: Proposal, seed: int, paths: int) -> None:
        self.scene, self.light = scene, proposal.reference
        self.optics = Optics.of_scene(scene)
        self.bank = trace(scene.slab, proposal, seed, paths, stream=Stream.PILOT)
        self.lateral = self.bank.exit[:, :2] - self.bank.entry[:, :2]
        self._batch = np.minimum(self.bank.paths * BATCHES // paths, BATCHES - 1)
        self._weights: dict[bytes, np.ndarray] = {}

    def weight(self, sines: np.ndarray) -> np.ndarray:
        """Full weight of every connection at one view."""
        key = sines.tobytes()
        if key not in self._weights:
            self._weights[key] = full_weights(self.bank, self.optics, self.light, directions_of_sines("view", sines))
        return self._weights[key]

    def phase(self, view: np.ndarray, other: np.ndarray, tilt: np.ndarray) -> np.ndarray:
        """Phase of the exact correlation of (light, view) with (light - tilt, other), less that of the window."""
        one, two = (directions_of_sines("view", sines) for sines in (view, other))
        light = directions_of_sines("tilt", self.light[:2] - tilt)
        depth = self.bank.exit[:, 2] - self.scene.slab.thickness
        along = (self.light[2] - light[2]) * self.bank.entry[:, 2] - (one[2] - two[2]) * depth
        return self.scene.wavenumber * (along - self.lateral @ (view - other))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Sums over 64 batches of paths, complex128[64]."""
        return np.bincount(self._batch, values.real, BATCHES) + 1j * np.bincount(self._batch, values.imag, BATCHES)


def _probe_views(scene: Scene) -> np.ndarray:
    """Centre and corners of the grid: float64[5, 2] direction sines."""
    grid = scene.sensor
    assert isinstance(grid, FarFieldGrid)
    return np.concatenate([grid.center_direction[None], grid.corner_directions])[:, :2]


def _probe_mismatches(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Mismatches kappa / k in {0, +-pi / (k W)} along either axis, with the window's W^ there.

    W^ is that of a square, 2/pi at pi / W: the largest of all profiles, and so the strictest.
    """
    step = 0.5 * scene.speckle_size
    aside = [np.array(kappa) for kappa in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))]
    return [(np.zeros(2), 1.0), *((kappa, 2 / np.pi) for kappa in aside)]


def _probe_tilts(scene: Scene, axial: _Bank) -> np.ndarray:
    """Tilt differences 0, t/2 and t, t no further than where C_I is within 0.01 of its floor: float64[3, 2]."""
    directions = scene.beams.directions
    sines = directions[:, :2] - reference_direction(directions)[:2]
    if len(sines) == 0:
        return np.zeros((1, 2))
    gaps = sines[np.square(sines).sum(-1).argmax()] - sines
    largest = gaps[np.square(gaps).sum(-1).argmax()]
    if not largest.any():
        return np.zeros((1, 2))
    share = axial.weight(AXIS[:2]) / axial.weight(AXIS[:2]).sum()
    floor = share[axial.bank.orders == 1].sum() ** 2
    phase = scene.wavenumber * (axial.lateral @ largest)
    for reach in np.geomspace(1e-3, 1, 40):
        if np.abs(share @ np.exp(-1j * reach * phase)) ** 2 - floor < 0.01:
            largest = largest * reach
            break
    return np.stack([0 * largest, 0.5 * largest, largest])
