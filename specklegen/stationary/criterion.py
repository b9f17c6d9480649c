"""When the stationary sampler is right: a test on pilot paths, not a table.

Over probe pairs with tilts {0, t/2, t} from the first, views {centre, corners} and lateral mismatch kappa
in {0, +-pi/W}, the exact correlation of pilot paths is compared with what the model says:

    C_exact = W^(kappa) E[sqrt(w_1 w_2) e^(-ik dv . r + ik(di_z z1 - dv_z(z_B - L)))] / sqrt(E w_1 E w_2)
    C_model = W^(kappa) K(di)

with W^ the Fourier transform of the window's intensity. design.md 3.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.fields.ends import AXIS, Optics, full_weights
from specklegen.illumination import directions_of_sines, reference_direction
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid
from specklegen.statistics import BATCHES, jackknife
from specklegen.streams import Stream, pilot_seed
from specklegen.tracing import PathBank, Proposal, trace

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
    grid = scene.sensor
    assert isinstance(grid, FarFieldGrid)
    seed = pilot_seed(scene.fingerprint())
    k = scene.wavenumber
    optics = Optics.of_scene(scene)
    bank = trace(scene.medium, proposal, seed, paths, stream=Stream.PILOT)
    # The model's K is that of the axis. The same random numbers walk the same paths about the axis, so that
    # the comparison carries physics and hardly any noise.
    axial = trace(scene.medium, replace(proposal, reference=AXIS), seed, paths, stream=Stream.PILOT)
    axial_weight = _weights(axial, optics, AXIS, AXIS)
    base = proposal.reference
    tilts = _probe_tilts(scene, axial, axial_weight)
    step = 0.5 * scene.speckle_size  # kappa / k for kappa = pi / W
    kappas = np.array([(0, 0), (step, 0), (-step, 0), (0, step), (0, -step)])
    window = np.array([1.0] + 4 * [2 / np.pi])  # sinc(1/2), the square window's W^; larger than the others'
    centres = np.concatenate([grid.center_direction[None], grid.corner_directions])[:, :2]

    rows, labels = [], []
    weight_cache: dict[bytes, np.ndarray] = {}

    def weight(sines: np.ndarray) -> np.ndarray:
        key = sines.tobytes()
        if key not in weight_cache:
            weight_cache[key] = _weights(bank, optics, base, directions_of_sines("view", sines, grid.sign))
        return weight_cache[key]

    lateral = bank.exit[:, :2] - bank.entry[:, :2]
    axial_lateral = axial.exit[:, :2] - axial.entry[:, :2]
    for view in centres:
        for tilt in tilts:
            for n, kappa in enumerate(kappas):
                other = view - tilt - kappa
                if np.hypot(*other) >= 1:
                    continue
                dv = view - other
                one, two = (directions_of_sines("view", s, grid.sign) for s in (view, other))
                light = directions_of_sines("tilt", base[:2] - tilt)
                phase = -k * (lateral @ dv) + k * (
                    (base[2] - light[2]) * bank.entry[:, 2]
                    - (one[2] - two[2]) * (bank.exit[:, 2] - scene.medium.thickness)
                )
                w1, w2 = weight(view), weight(other)
                rows.append(
                    (
                        np.sqrt(w1 * w2) * np.exp(1j * phase),
                        w1,
                        w2,
                        axial_weight * np.exp(-1j * k * (axial_lateral @ tilt)),
                    )
                )
                labels.append(window[n])
    sums = np.array(
        [[_batched(bank, a), _batched(bank, b), _batched(bank, c), _batched(axial, d)] for a, b, c, d in rows]
    )
    norm = _batched(axial, axial_weight)
    gains = np.array(labels)

    def differences(total: np.ndarray) -> np.ndarray:
        pairs, reference = total[:-4].reshape(-1, 4), total[-4]
        exact = np.square(np.abs(pairs[:, 0])) / (pairs[:, 1].real * pairs[:, 2].real)
        model = np.square(np.abs(pairs[:, 3] / reference))
        ratio = pairs[:, 1].real / reference.real - 1
        return np.concatenate([gains**2 * (exact - model), ratio])

    # [pairs, 4, batches] -> [batches, pairs * 4 + 4]
    flat = np.concatenate([sums.reshape(-1, sums.shape[-1]), np.broadcast_to(norm, (4, len(norm)))]).T
    value, error = jackknife(flat, differences)
    n = len(gains)
    worst, brightest = np.abs(value[:n]).argmax(), n + np.abs(value[n:]).argmax()
    return StationaryError(
        float(abs(value[worst])), float(error[worst]), float(abs(value[brightest])), float(error[brightest])
    )


def _probe_tilts(scene: Scene, bank: PathBank, weight: np.ndarray) -> np.ndarray:
    """Tilt differences 0, t/2 and t, t no further than where C_I is within 0.01 of its floor: float64[3, 2]."""
    directions = scene.beams.directions
    sines = directions[:, :2] - reference_direction(directions)[:2]
    if len(sines) == 0:
        return np.zeros((1, 2))
    corner = sines[np.square(sines).sum(-1).argmax()]
    gaps = corner - sines
    largest = gaps[np.square(gaps).sum(-1).argmax()]
    reach = np.hypot(*largest)
    if reach == 0:
        return np.zeros((1, 2))
    along = (bank.exit[:, :2] - bank.entry[:, :2]) @ (largest / reach)
    floor = (weight[bank.orders == 1].sum() / weight.sum()) ** 2
    for share in np.geomspace(1e-3, 1, 40):
        c = np.abs((weight * np.exp(-1j * scene.wavenumber * share * reach * along)).sum() / weight.sum()) ** 2
        if c - floor < 0.01:
            largest = largest * share
            break
    return np.stack([0 * largest, 0.5 * largest, largest])


def _weights(bank: PathBank, optics: Optics, tilt: np.ndarray, view: np.ndarray) -> np.ndarray:
    return full_weights(bank, optics, tilt, view)


def _batched(bank: PathBank, values: np.ndarray) -> np.ndarray:
    """Sums over 64 equal batches of paths."""
    edges = np.linspace(0, bank.count, BATCHES + 1)[:-1]
    batch = np.searchsorted(edges, bank.paths, side="right") - 1
    real = np.bincount(batch, values.real, BATCHES)
    return real + 1j * np.bincount(batch, values.imag, BATCHES) if np.iscomplexobj(values) else real.astype(complex)
