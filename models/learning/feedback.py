"""Feedback of a measurement on a picture: the gradient of its likelihood, and the amplitudes that fit the lags.

Two hints, both on the object's frame, whatever the camera. The gradient of the exact deviance
(:class:`~specklegen.models.likelihood.likelihood.SpeckleLikelihood`) is right and near-sighted. The picture whose
transform has the phases of the one at hand and the amplitudes of the measured lags is the step of phase retrieval
(Fienup, Applied Optics 21, 2758 (1982)): it sees far, and believes lags as they are, once undivided and once divided
by the memory effect as far as noise allows (:mod:`specklegen.models.retrieval.wiener`).
"""

from typing import NamedTuple, Self

import torch
from torch import Tensor

from specklegen.models.learning.inputs import without_background
from specklegen.models.likelihood.likelihood import SpeckleLikelihood, expected_deviance
from specklegen.models.retrieval import wiener

LAGS = 64
"""Side of the window of lags, in object pixels."""
EXTENT = 28
"""Longest side of an object, in object pixels."""
PICTURES, NUMBERS = 4, 9
"""How many pictures, and numbers, are said of each picture."""
_DARK = 2e-3  # least brightness at which a gradient is taken


class Measured(NamedTuple):
    """Data of feedback, of B measurements.

    Attributes
    ----------
    between : float[B, 2 n - 1, 2 n - 1]
        C_I between the pixels of a frame.
    amplitudes : float[B, 2, LAGS, LAGS // 2 + 1]
        Of a picture of brightness 1 in all, by lags as measured, and divided.
    numbers : float[B, 5]
        Of the measurement.
    """

    likelihood: SpeckleLikelihood
    between: Tensor
    amplitudes: Tensor
    numbers: Tensor

    @classmethod
    def of(cls, likelihood: SpeckleLikelihood, between: Tensor, at_lags: Tensor) -> Self:
        """Make it of a likelihood and C_I, between the pixels of a frame and at every lag float[B, LAGS, LAGS]."""
        lags = likelihood.lags(LAGS)
        peak = lags[:, 0, 0].clamp_min(1e-9)
        lags, variance = lags / peak[:, None, None], likelihood.lag_variance() / peak.square()
        grain = likelihood.grain / likelihood.step
        divided = lags * wiener.weights(lags, at_lags, variance, side=EXTENT, grain=grain, guess="dense")
        both = torch.stack([lags, divided], dim=1).flatten(0, 1)
        both = without_background(torch.fft.fftshift(both, dim=(-2, -1)))
        power = torch.fft.rfft2(torch.fft.ifftshift(both, dim=(-2, -1))).real.clamp_min(0)
        amplitudes = (power / power[:, :1, :1].clamp_min(1e-6)).sqrt().unflatten(0, (-1, 2))
        looks = torch.full_like(variance, float(likelihood.looks))
        numbers = [
            grain.log(), 0.2 * variance.clamp_min(1e-12).log() + 1.5, 0.5 * looks.log(),
            at_lags[:, 0, EXTENT // 2].to(variance), at_lags[:, 0, EXTENT - 1].to(variance),
        ]  # fmt: skip
        return cls(likelihood, between, amplitudes.float(), torch.stack(numbers, dim=1).float())

    def deviance(self, images: Tensor) -> Tensor:
        """Deviance of images float[B, K, n, n], float[B, K]."""
        return self.likelihood(images, self.between[:, None])

    def __call__(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the feedback on images float[B, K, n, n], brightness 0 to 1.

        Returns
        -------
        float[B, K, PICTURES, n, n], float[B, K, NUMBERS], and the deviances float[B, K]
        """
        n = images.shape[-1]
        with torch.enable_grad():
            tried = images.detach().clamp(_DARK, 1).requires_grad_()
            deviance = self.deviance(tried)
            (gradient,) = torch.autograd.grad(deviance.sum(), tried)
        with torch.no_grad():
            deviance = deviance.detach()
            rms = gradient.square().mean((-2, -1)).sqrt().clamp_min(1e-12)
            spectrum = torch.fft.rfft2(images, s=(LAGS, LAGS))[:, :, None]
            total = images.sum((-2, -1))[:, :, None, None, None]
            turned = spectrum / spectrum.abs().clamp_min(1e-9) * total * self.amplitudes[:, None]
            asked = torch.fft.irfft2(turned, s=(LAGS, LAGS))[..., :n, :n].clamp(-1, 2)
            own = 2 * images - 1
            shown = torch.stack([own, -gradient / rms[..., None, None] / 4], dim=2)
            nats = self.likelihood.looks * self.likelihood.frequencies.to(rms)[:, None]
            excess = deviance - expected_deviance(self.likelihood.looks)
            numbers = torch.stack([
                torch.ones_like(excess), (excess * nats.sqrt() / 10).clamp(-3, 3), excess.clamp(-1, 3),
                (rms * nats).log() / 5,
            ], dim=-1)  # fmt: skip
            numbers = torch.cat([numbers, self.numbers[:, None].expand(-1, images.shape[1], -1)], dim=-1)
            return torch.cat([shown, asked], dim=2), numbers, deviance
