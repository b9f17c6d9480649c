"""The direct sum on another device, by torch: sensor ends of a block of connections, then one matrix product.

    u(t, v) = sum_m [sqrt(W_m) z_m A_t(m)] B_v(m)                                [Bar19] Eqs. 13, 38

As :func:`specklegen.samplers.path_sums.direct.direct_field`, whose illumination ends it takes from the CPU (there are
few). Phases are found in float64 turns and reduced there; what follows may be single precision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import slices
from specklegen.paths.bank import PathBank
from specklegen.paths.slab_optics import (
    Optics,
    illumination_ends,
    offsets,
    reversal_phases,
    single_amplitudes,
)

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

_CONNECTIONS, _PAIRS = 4096, 2**22  # connections in a block; pairs of a connection and a view at a time


def device_field(
    bank: PathBank,
    optics: Optics,
    phases: np.ndarray,
    views: np.ndarray,
    *,
    device: torch.device | str,
    dtype: torch.dtype | None = None,
    reverse: bool = False,
) -> torch.Tensor:
    """Sum over the connections of a bank on ``device``, complex[T, V], divided by the root of the number of paths.

    Parameters
    ----------
    bank, optics, phases, views, reverse
        See :func:`specklegen.samplers.path_sums.direct.direct_field`, with which it agrees within rounding.
    device, dtype
        Where to sum, and complex64 or complex128 (by default).
    """
    one = bank.orders == 1
    place = {"device": device, "dtype": dtype or torch.complex128}
    field = _sum(bank.select(one), optics, phases[one], views, single=True, **place)
    field *= torch.as_tensor(single_amplitudes(optics, views)).to(field.device, field.real.dtype)
    field += _sum(bank.select(~one), optics, phases[~one], views, single=False, **place)
    if reverse:
        factors = phases[~one] * reversal_phases(bank, optics)
        field += _sum(bank.reversed(), optics, factors, views, single=False, **place)
    return field / max(bank.count, 1) ** 0.5


def _sum(
    bank: PathBank,
    optics: Optics,
    factors: np.ndarray,
    views: np.ndarray,
    *,
    single: bool,
    device: torch.device | str,
    dtype: torch.dtype,
) -> torch.Tensor:
    lights = torch.as_tensor(illumination_ends(bank, optics, factors, single=single)).to(device, dtype)
    field = torch.zeros((len(optics.tilts), len(views)), dtype=dtype, device=device)
    double = lambda a: torch.as_tensor(np.ascontiguousarray(a), dtype=torch.float64).to(device)  # noqa: E731
    exits, directions = double(bank.exit), double(bank.exit_direction)
    sines, turns = double(views), double(offsets(views.copy(), optics.view_reference, optics.wavelength))
    for part in slices(len(views), max(1, _PAIRS // _CONNECTIONS)):
        for some in slices(len(bank), _CONNECTIONS):
            ends = _sensor_ends(exits[some], directions[some], sines[part], turns[part], optics, single, dtype)
            field[:, part] += lights[:, some] @ ends
    return field


def _sensor_ends(
    exits: torch.Tensor,
    directions: torch.Tensor,
    views: torch.Tensor,
    turns: torch.Tensor,
    optics: Optics,
    single: bool,
    dtype: torch.dtype,
) -> torch.Tensor:
    """B_v(m), complex[M, V]."""
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    medium, vz = optics.medium, views[:, 2]
    face = torch.where(vz >= 0, medium.thickness, 0.0)
    # Grazing light leaves nothing: its way out is endless.
    decay = torch.where(vz == 0, -torch.inf, -0.5 * medium.extinction / torch.where(vz == 0, 1.0, vz))
    modulus = torch.exp((face - exits[:, 2:]).to(real) * decay.to(real))
    if not single:
        g = medium.scatterer.g
        base = (1 - g) ** 2 + 2 * g * (1 - directions @ views.T)
        modulus = modulus * ((1 - g * g) / (4 * np.pi)) ** 0.5 * base.to(real) ** -0.75
    phase = exits @ turns.T
    phase = -2 * np.pi * (phase - torch.round(phase)).to(real)
    return torch.polar(modulus, phase)
