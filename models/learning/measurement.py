"""Measurements that a solver takes, of a batch of a hidden-object recipe: periodograms, optics, memory effects."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from specklegen.core.arguments import on_host
from specklegen.core.errors import reject
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.periodogram import Periodogram, periodogram
from specklegen.models.retrieval.autocorrelation import MemoryEffect, memory_effect_of
from specklegen.models.retrieval.camera_noise import Stated, camera_noise
from specklegen.models.retrieval.edges import taper_of
from specklegen.scene.window import Profile

TILE = 160
"""Longest side of a tile in pixels: larger cameras are cut, which makes their periodograms less noisy."""


def seen_by_camera(
    images: torch.Tensor, grain: torch.Tensor, tile: int | None = TILE, camera: Stated = "unknown",
    profile: Profile | None = None, taper: float | None = None,
) -> Periodogram:  # fmt: skip
    """Periodograms of images real[B, F, H, W] with the noise of :func:`camera_noise`; grains float[B], in pixels.

    Each is seen under the taper that its light asks for (:func:`~specklegen.models.retrieval.edges.taper_of`), unless
    one is given.
    """
    shares = taper_of(images) if taper is None else taper
    spectra = periodogram(images, tile=tile, taper=shares)
    noise = camera_noise(images, grain[:, None], camera, profile).mean(1)
    return spectra._replace(noise=noise.to(spectra.noise))


def measured(
    batch: Mapping[str, Any], recipe: HiddenObject, taper: float | None = None
) -> tuple[Periodogram, Optics, list[MemoryEffect]]:
    """Measured values of the samples of a batch, the memory effect of their materials known; taper as above."""
    name = next((name for name in ("image", "frames") if name in batch), None)
    if name is None:
        reject("measured batch", 'a batch with "image" or "frames"', sorted(batch))
    images = torch.as_tensor(np.asarray(on_host(batch[name]), np.float32))
    images = images[:, None] if images.ndim == 3 else images
    drawn = {key: np.asarray(on_host(value), np.float64) for key, value in batch["parameters"].items()}
    step = torch.from_numpy(drawn["object_pitch"] / drawn["camera_pitch"])
    grain = torch.from_numpy(drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"])
    memory = []
    for n in range(len(images)):
        own = {key: float(values[n]) for key, values in drawn.items()}
        correlation = recipe.material.known(recipe.material.slab_of(own)).correlation
        memory.append(memory_effect_of(correlation, own["wavelength"], own["object_pitch"]))
    optics = Optics(step.float(), grain.float(), recipe.profile, recipe.pixel_integration)
    spectra = seen_by_camera(images, grain, camera=recipe.exposure or "none", profile=recipe.profile, taper=taper)
    return spectra, optics, memory
