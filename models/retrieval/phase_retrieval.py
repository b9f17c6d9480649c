"""Phase retrieval: an image from its autocorrelation, whose Fourier transform is the squared modulus of the image's.

Hybrid input-output with a feedback beta that falls from 2 to 0, then error reduction: the modulus is put right in
Fourier space; in space the image g' must be real and not negative, on a support if there is one:

    g  <-  g' where it is allowed,  g - beta g' elsewhere          (error reduction: 0 elsewhere)

Sources: Fienup, Applied Optics 21, 2758 (1982); the schedule of Katz et al., Nature Photonics 8, 784 (2014);
shrink-wrap: Marchesini et al., Physical Review B 68, 140101 (2003), the support becomes where the blurred image
exceeds a share of its maximum. All restarts of an image run as one batch.
"""

from typing import Annotated, NamedTuple

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from specklegen.core.arguments import instance, real_tensor
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks, one_torch_thread
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.values import Positive, PositiveInt, UnitInterval, Value
from specklegen.models.retrieval.autocorrelation import FLOOR, taper
from specklegen.models.retrieval.projections import (
    error_reduction,
    fed_back,
    modulus_error,
    paired,
    shrunk,
    unpaired,
    with_modulus,
)
from specklegen.models.retrieval.restarts import consensus

BETAS = np.arange(40, -1, -1) * 0.05
_BLUR = (3.0, 1.5)  # pixels, of the first and the last shrink-wrap (Marchesini et al.)
_ON_DEVICE = 64  # images at once off the CPU, where one at a time would not fill the machine


class Retrieval(Value):
    """Settings of phase retrieval.

    Parameters
    ----------
    restarts
        Random starts.
    steps
        Iterations at each of the 41 values of beta.
    error_reduction
        Iterations afterwards.
    shrink_wrap
        Share of the blurred image's maximum below which it is cut off; 0 for no support.
    extent
        Extent of the object in pixels: lags fade out between 0.85 and 1.2 times it, and no pair of its points should
        be further apart than that end. None keeps the whole window.
    floor
        Smallest C_I to divide by.

    Examples
    --------
    >>> from specklegen.models import Retrieval
    >>> Retrieval(restarts=4, extent=20.0).steps
    10
    """

    restarts: PositiveInt = 20
    steps: PositiveInt = 10
    error_reduction: Annotated[int, Field(ge=0)] = 40
    shrink_wrap: UnitInterval = 0.1
    extent: Positive | None = None
    floor: Annotated[float, Field(gt=0, le=1)] = FLOOR


class Retrieved(NamedTuple):
    """Result.

    Attributes
    ----------
    image : float32[B, n, n]
        The restarts' consensus, somewhere on the frame and either way up.
    restarts : float32[B, R, n, n]
        All of them.
    error : float32[B, R]
        Relative squared error of each restart's modulus.
    """

    image: Tensor
    restarts: Tensor
    error: Tensor

    __repr__ = short


def fourier_modulus(autocorrelation: Tensor, transfer: Tensor | None = None) -> Tensor:
    """Modulus of the image behind an autocorrelation, float32[..., n, n/2 + 1], its mean square 1.

    Parameters
    ----------
    autocorrelation
        real[..., n, n].
    transfer
        Of :func:`~specklegen.models.retrieval.apodisation.transfer_function`: apodises the modulus by its root, which
        makes the diffraction-limited object the answer.
    """
    columns = autocorrelation.shape[-1] // 2 + 1
    power = torch.fft.rfft2(autocorrelation).real.clamp_min(0)
    if transfer is not None:
        power = power * transfer[:, :columns].to(power)
    twice = torch.full((columns,), 2.0, dtype=power.dtype, device=power.device)
    twice[[0, -1]] = 1.0  # columns of either sign of the frequency
    total = (power * twice).sum((-2, -1), keepdim=True) / autocorrelation.shape[-1] ** 2
    if not (total > 0).all():
        reject("fourier_modulus autocorrelation", "above 0 in total power", float(total.min()),
               "Check that the whole image is speckle.")
    return (power / total).sqrt().float()


def retrieve(
    autocorrelation: Tensor, retrieval: Retrieval | None = None, *, memory_effect: Tensor | None = None,
    transfer: Tensor | None = None, seed: Seed = 0, threads: int | None = None,
) -> Retrieved:  # fmt: skip
    """Retrieve the images behind a batch of autocorrelations; each depends on nothing but its own and the seed.

    Parameters
    ----------
    autocorrelation
        real[B, n, n], of :func:`~specklegen.models.autocorrelation`.
    retrieval
        Restarts, iterations, support, extent; by default ``Retrieval()``.
    memory_effect
        C_I at every lag, real[n, n] or real[B, n, n]: divide by it. By default it is taken for 1 (Katz et al.).
    transfer
        real[n, n], the aperture's transfer function: the measured modulus is apodised by its root. By default it is
        not.
    seed
        Of the random starts.
    threads
        Threads on the CPU, by default all cores that the process may run on; the result does not depend on them.

    Raises
    ------
    RuleError
        If the autocorrelation is not of shape [B, n, n] with an even n, or has no power.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Retrieval, autocorrelation, retrieve
    >>> image = torch.zeros(1, 32, 32)
    >>> image[0, 10:20, 12:16] = 1.0
    >>> found = retrieve(autocorrelation(image[:, None], 32), Retrieval(restarts=2, extent=12.0))
    >>> found.image.shape
    torch.Size([1, 32, 32])
    """
    retrieval = Retrieval() if retrieval is None else instance("retrieve retrieval", retrieval, Retrieval)
    real_tensor("retrieve autocorrelation", autocorrelation)
    shape = tuple(autocorrelation.shape)
    n = shape[-1] if shape else 1
    if len(shape) != 3 or shape[1:] != (n, n) or n % 2:
        reject("retrieve autocorrelation", "of shape [B, n, n], n even", shape)
    if transfer is not None and real_tensor("retrieve transfer", transfer).shape != (n, n):
        reject("retrieve transfer", f"of shape [{n}, {n}], as the autocorrelation", tuple(transfer.shape))
    if memory_effect is not None:
        if real_tensor("retrieve memory_effect", memory_effect).shape not in ((n, n), autocorrelation.shape):
            reject("retrieve memory_effect", f"of shape [{n}, {n}] or [B, {n}, {n}], as the autocorrelation",
                   tuple(memory_effect.shape))  # fmt: skip
        autocorrelation = autocorrelation / memory_effect.to(autocorrelation).clamp_min(retrieval.floor)
    if retrieval.extent is not None:
        kept = taper(n, 0.85 * retrieval.extent, 1.2 * retrieval.extent)
        autocorrelation = autocorrelation * kept.to(autocorrelation)
    modulus = fourier_modulus(autocorrelation, transfer)
    start = random_starts(seed, retrieval.restarts, n).to(modulus)

    def block(part: Tensor) -> Retrieved:
        images = hybrid_input_output(part, start, retrieval)
        error = modulus_error(images, part[:, None])
        return Retrieved(consensus(images, error, part, retrieval.shrink_wrap), images, error)

    with one_torch_thread():
        parts = map_blocks(block, modulus.split(1 if modulus.device.type == "cpu" else _ON_DEVICE), threads)
    return Retrieved(*(torch.cat(field) for field in zip(*parts, strict=True)))


def random_starts(seed: Seed, restarts: int, n: int) -> Tensor:
    """White images of unit energy, float32[R, n, n]; restart r is the same whatever their number."""
    words = seed_words(seed)
    white = [np.random.default_rng([len(words), *words, r]).random((n, n), np.float32) for r in range(restarts)]
    images = torch.from_numpy(np.stack(white))
    return images / images.square().sum((-2, -1), keepdim=True).sqrt()


def hybrid_input_output(modulus: Tensor, start: Tensor, retrieval: Retrieval) -> Tensor:
    """Run every restart of every image: float32[B, R, n, n].

    Parameters
    ----------
    modulus
        float32[B, n, n/2 + 1].
    start
        float32[R, n, n].
    retrieval
        Iterations and support.
    """
    wanted, pairs = modulus[:, None], paired(start)
    image = pairs.expand(len(modulus), *pairs.shape).clone()
    proposed, support = image, torch.ones_like(image)
    first = len(BETAS) // 4  # before, an image has no shape to shrink onto
    widths = np.interp(np.arange(len(BETAS)), [first, len(BETAS) - 1], _BLUR)
    for stage, beta in enumerate(BETAS):
        if retrieval.shrink_wrap and stage >= first:
            support = shrunk(proposed, float(widths[stage]), retrieval.shrink_wrap)
        for _ in range(retrieval.steps):
            proposed = with_modulus(image, wanted)
            image = fed_back(image, proposed, support, float(beta))
    images = error_reduction(proposed.clamp_min(0).mul_(support), wanted, retrieval.error_reduction, support)
    return unpaired(images, len(start))
