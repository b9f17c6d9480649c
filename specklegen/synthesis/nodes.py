"""Images of one object on the CPU by nodes: few of its bright pixels, whose speckle tells that of all others.

The intensity of beam j at one view, less the turn that its angle gives, is a sum over products of modes,

    p_j = |sum_r phi_r(j) u_r|^2 = sum_rq phi_r(j) phi_q(j) Re u_r u_q*

Of the R(R+1)/2 functions phi_r phi_q of the pixels far fewer are independent: modes are smooth, and pixels of an object
lie close to each other. So a few pixels n, the nodes, tell all others, whatever the fields are,

    p_j = sum_n w_n(j) p_n

and the image takes a transform of every node and its map O w_n, not of every pair of modes or every bright pixel. Nodes
and weights come from pivoted Cholesky of <p_j p_l> = K_jl^2 + 1 over the bright pixels: the node that is chosen next is
the pixel of which those before tell least. They are enough when no p_j lacks more than :data:`LEFT`, in the mean of its
square over media, that of p_j being 2: what is left out is rounding, in single precision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from specklegen.kernels.bright_points import fill_nodes, fill_tilt_powers
from specklegen.synthesis import optics

if TYPE_CHECKING:
    from specklegen.synthesis.imaging import Box, Imaging

LEFT = 1e-11
"""Mean square over media of what nodes may leave out of the intensity of a bright pixel, whose mean is 1."""
_CHUNK_BYTES = 2**24  # of the powers and spectra of a few nodes: modes are read once for all of them


class Nodes(NamedTuple):
    """Nodes of an object under one tilt.

    Attributes
    ----------
    pixels : int64[P]
        Their numbers.
    lit : int64[n]
        Numbers of the bright pixels.
    weights : float64[P, n]
        What each tells of every bright pixel.
    """

    pixels: torch.Tensor
    lit: torch.Tensor
    weights: torch.Tensor


def nodes_of(modes: torch.Tensor, lit: torch.Tensor, most: int) -> Nodes | None:
    """Nodes of the bright pixels int64[n] of an object of modes real[R, h * w]; None where they are more than most."""
    nodes, factor = np.empty(most, np.int64), np.empty((most, len(lit)))
    count = fill_nodes(modes[:, lit].double().contiguous().numpy(), LEFT, nodes, factor)
    if count > most:
        return None
    chosen, known = torch.from_numpy(nodes[:count]), torch.from_numpy(factor[:count])
    return Nodes(lit[chosen], lit, torch.linalg.solve_triangular(known[:, chosen], known, upper=True))


def node_spectrum(
    imaging: Imaging, drawn: torch.Tensor, light: torch.Tensor, nodes: list[Nodes], box: Box
) -> torch.Tensor:
    """The image at the lags, real[1, T or F, n, m, 2], real and imaginary parts; one of T and F is 1.

    Parameters
    ----------
    imaging
        Of one medium.
    drawn : complex[1, F, N, R, rows, columns]
        Its fields.
    light : real[1, h, w]
        The object, dark outside of the ``box`` and where it has no bright pixels.
    nodes
        Of its bright pixels, for every tilt.
    """
    rows, columns = box
    views = torch.view_as_real(torch.fft.ifft2(drawn[0], s=imaging.lags, norm="forward")).flatten(3)
    frames, real, (n, m) = len(views), imaging.modes.dtype, imaging.lags
    together = max(1, _CHUNK_BYTES // (2 * frames * n * m * imaging.modes.element_size()))
    turns = imaging.object_rows[:, :, rows]
    waves = imaging.object_columns[:, columns]
    powers = torch.empty((frames, together, n * m), dtype=real)
    totals = []
    for modes, (pixels, lit, weights) in zip(imaging.modes[0], nodes, strict=True):
        maps = torch.zeros((len(pixels), light[0].numel()), dtype=real)
        maps[:, lit] = (weights * light.reshape(-1)[lit].double()).to(real)
        maps = maps.unflatten(1, imaging.shape)[:, rows, columns].swapaxes(0, 1)  # [h, P, w]
        roots = modes[:, pixels].mT.contiguous()
        total = torch.zeros((1, frames, n, m // 2 + 1, 2), dtype=real)
        for some, own in zip(roots.split(together), maps.split(together, 1), strict=True):
            seen = powers[:, : len(some)]
            for frame, power in zip(views.numpy(), seen.numpy(), strict=True):
                fill_tilt_powers(some.numpy(), frame, power)
            spectra = torch.fft.rfft2(seen.unflatten(2, (n, m)), norm="forward")
            total += optics.map_lags(own[None, :, None].contiguous(), turns, waves, torch.view_as_real(spectra)[None])
        totals.append(total)
    return torch.cat(totals, 1)
