"""The memory-effect correlation about any light i and view v, from the lateral way of each path from face to face.

    K_v(q) = E[w e^(-i q . R)] / E[w],     R = (x_B - x1) + (v_xy / v_z)(f - z_B) + (i_xy / i_z) z1

R leads from where the light of a path enters the slab's face at z = 0 to where its connection leaves through the
face at z = f; f is the thickness in transmission and 0 in reflection; only those two points turn with the tilt and the
view. On the axis this is the kernel of :mod:`specklegen.memory_effects.correlation`. Off it, R has a direction and
a spread along the slope of its own, so K_v is complex and depends on the direction of q. [Bar19] sec. 6 with the z
terms of physics.md 5 to first order in the tilt.
"""

from dataclasses import dataclass, replace

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread, slices
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.paths.analog_walk import axial_light
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.layout import plane_layout
from specklegen.paths.momentum import doppler_shift, momentum_transfer
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.roulette import slab_roulette
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.paths.steps import inside_share, refracting_layers
from specklegen.scene.media import PlaneMedium
from specklegen.scene.polarisation import require_scalar

_AT_ONCE = 2**22  # phasors in memory


@dataclass(frozen=True)
class ObliqueCorrelation:
    """K_v as the connections of its paths.

    Attributes
    ----------
    displacement : float64[M, 2]
        R of each connection.
    weights : float64[M]
        Contribution of each connection.
    owners : int64[M]
        Number of the path of each connection.
    paths : int
        What to divide the sum of the weights by for the intensity per unit area: the paths behind them.
    single_share : float
        Share of single scattering in the intensity.
    transfer : float64[M] or None
        Momentum transfer Y of each connection, where it was asked for.
    doppler : float64[M] or None
        Doppler shift D of each connection, where it was asked for and particles flow.
    """

    displacement: np.ndarray
    weights: np.ndarray
    owners: np.ndarray
    paths: int
    single_share: float = float("nan")
    transfer: np.ndarray | None = None
    doppler: np.ndarray | None = None

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix complex128[T, T] of K_v(k(i_a - i_b)) between beams at direction sines float64[T, 2].

        A sum of outer products, so Hermitian and positive semidefinite for any beams.
        """
        import torch  # here, for plans look at this module and shall stay light

        tilts = len(sines)
        total = torch.zeros((tilts, tilts), dtype=torch.complex128)
        root = np.sqrt(self.weights / max(self.weights.sum(), 1e-300))
        step = max(1, _AT_ONCE // max(tilts, 1))
        with one_torch_thread():
            for part in slices(len(root), step):
                waves = torch.from_numpy(root[part] * np.exp(-1j * wavenumber * (sines @ self.displacement[part].T)))
                total += waves @ waves.conj().T
        return total.numpy()


def face_to_face(bank: PathBank, medium: PlaneMedium, light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """R float64[M, 2] of the connections of a bank for light and view float64[3], unit vectors of travel."""
    exit_face = medium.thickness if view[2] > 0 else 0.0
    entered = bank.entry[:, :2] - bank.entry[:, 2:] * (light[:2] / light[2])
    left = bank.exit[:, :2] + (exit_face - bank.exit[:, 2:]) * (view[:2] / view[2])
    return left - entered


def estimate_oblique_correlation(
    medium: PlaneMedium, light: np.ndarray, view: np.ndarray, paths: int, seed: Seed, *, transfer: bool = False,
    threads: int | None = None,
) -> ObliqueCorrelation:  # fmt: skip
    """Estimate K_v of a slab about a light and a view float64[3] (unit vectors of travel) from ``paths`` paths.

    It does not depend on the wavelength: q R does. ``transfer`` collects what motion needs.
    """
    require_scalar("estimate_oblique_correlation medium", medium)
    if refracting_layers(medium):
        if not (light[2] == view[2] == 1):
            reject("estimate_oblique_correlation light and view", "along the axis for layers that refract",
                   (light, view))  # fmt: skip
        return _of_axial_light(medium, paths, seed, threads)
    layout = plane_layout(medium, 1.0, light[None], view[None])
    tracer = SlabTracer(layout, medium, replace(plane_proposal(medium, light, view), transfer=transfer))
    tracer = slab_roulette(tracer, light, pilot_seed(medium.unitless_fingerprint()))
    bank = tracer.trace(seed, paths, threads=threads)
    weights = contributions(layout, bank)
    total = weights.sum()
    single = float(weights[bank.orders == 1].sum() / total) if total else 0.0
    turned = momentum_transfer(layout, bank) if transfer else None
    shifts = doppler_shift(layout, bank) if transfer and medium.flows else None
    ways = face_to_face(bank, medium, light, view)
    return ObliqueCorrelation(ways, weights, bank.paths, paths, single, turned, shifts)


def _of_axial_light(medium: PlaneMedium, paths: int, seed: Seed, threads: int | None) -> ObliqueCorrelation:
    """K from light that is not aimed (:mod:`specklegen.kernels.analog_walk`): a connection a path."""
    light = axial_light(medium, paths, seed, threads)
    lit, inside = light.weight > 0, inside_share(medium)
    total = light.weight.sum()
    return ObliqueCorrelation(light.displacement[lit], inside * light.weight[lit], np.flatnonzero(lit), paths,
                              float(light.once.sum() / total) if total else 0.0, light.transfer[lit])  # fmt: skip
