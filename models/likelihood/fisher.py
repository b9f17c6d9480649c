"""Fisher information: how well any method can tell an object from its image, at best.

Periodograms are independent gamma variables of n looks about their means S, so that the information on numbers theta_k
that the object depends on is (Whittle 1953; Kay, *Fundamentals of Statistical Signal Processing*, 1993, section 3.9)

    F_kl = n sum_f (d log S / d theta_k) (d log S / d theta_l)

over the frequencies that count; what the unknown brightness takes is taken off (Schur's complement). No unbiased
estimate of theta has a smaller covariance than the inverse of F. Where the object is known to lie on a surface, theta
are the coordinates along its tangent (Gorman and Hero, IEEE Trans. Inf. Theory 36, 1285 (1990)).
"""

import torch
from torch import Tensor

from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.likelihood.spectrum import Transforms, autocorrelation_of


def fisher_information(
    likelihood: SpeckleLikelihood, objects: Tensor, directions: Tensor, memory_effect: Tensor | None = None
) -> Tensor:
    """Information on the coordinates along directions, float64[B, K, K]; the brightness of the image is unknown.

    Parameters
    ----------
    likelihood
        Of B images; what was measured of them counts through their brightness alone.
    objects
        Brightness real[B, h, w], at least 0.
    directions
        What is added to an object for one unit of each coordinate, real[B, K, h, w].
    memory_effect
        As for :meth:`SpeckleLikelihood.object_spectrum`.
    """
    with torch.no_grad():
        whole = likelihood.spectrum(objects, memory_effect)
        lit = whole - likelihood.noise[:, None, None]
        alone = likelihood.object_spectrum(objects, memory_effect)
        lags = lag_slopes(objects.to(whole), directions.to(whole))
        if memory_effect is not None:
            lags = lags * (memory_effect[:, None] if memory_effect.ndim == 3 else memory_effect).to(whole)
        slopes = transformed(likelihood, lags) * (lit / alone / whole)[:, None]
        slopes = slopes.flatten(2).double() * likelihood.used.flatten(1)[:, None]
        bright = (lit / whole).flatten(1).double() * likelihood.used.flatten(1)
        crossed = slopes @ bright[..., None]
        taken = crossed @ crossed.mT / bright.square().sum(1)[:, None, None]
        share = likelihood.counted[:, 0].double()[:, None, None]
        return likelihood.looks * share * (slopes @ slopes.mT - taken)


def lag_slopes(objects: Tensor, directions: Tensor) -> Tensor:
    """Derivatives of the autocorrelation of objects real[B, h, w] over their sum, real[B, K, 2 h - 1, 2 w - 1]."""
    h, w = objects.shape[-2:]
    total = objects.sum((-2, -1))[:, None, None, None]
    padded = (2 * h, 2 * w)
    here, along = (torch.fft.rfft2(x, s=padded) for x in (objects[:, None] / total, directions / total))
    both = torch.fft.irfft2(2 * (here.conj() * along).real, s=padded)
    both = torch.fft.fftshift(both, dim=(-2, -1))[..., 1:, 1:]
    return both - 2 * autocorrelation_of(objects)[:, None] * (directions / total).sum((-2, -1), keepdim=True)


def transformed(likelihood: SpeckleLikelihood, lags: Tensor) -> Tensor:
    """S of what pairs of pixels add, float[B, K, F, G], of either sign: derivatives are no spectra."""
    return Transforms(likelihood.rows, likelihood.columns)(lags)


def least_error(information: Tensor, directions: Tensor) -> Tensor:
    """Smallest sum of squared errors of all pixels, float64[B], of an object known to lie along the directions.

    Parameters
    ----------
    information
        float64[B, K, K].
    directions
        real[B, K, h, w], linearly independent.
    """
    flat = directions.flatten(2).double()
    return torch.linalg.solve(information, flat @ flat.mT).diagonal(dim1=1, dim2=2).sum(1)
