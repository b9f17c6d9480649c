"""Examples: inputs of a network and its targets, ready in memory."""

import json
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from specklegen.core.parallel import one_torch_thread
from specklegen.datasets import Recipe, SpeckleCache, SpeckleStream
from specklegen.datasets.loading.stream import tensors
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.targets import TARGETS

_CHUNK = 64
_HURRIED = 16  # samples between two looks at the clock
SHARED_BY = 8
"""Neighbouring samples of a training stream that share a medium: preparing one costs more than an image."""


class Examples(NamedTuple):
    """Inputs, targets and media of n samples.

    Attributes
    ----------
    inputs : float16[n, C, H, W] or float16[n, T, C, H, W]
        Of :func:`~specklegen.models.learning.inputs.network_input`; half precision keeps them in memory.
    targets : float32[n, h, w]
        Objects, or what else a network is to tell (:mod:`specklegen.models.learning.targets`).
    media : int64[n]
        Medium of each.
    """

    inputs: Tensor
    targets: Tensor
    media: Tensor


def batches_of(
    source: Recipe | SpeckleCache, samples: int | Sequence[int], seed: int = 0, split: str = "test", each: int = _CHUNK
) -> Iterator[dict]:
    """First ``samples`` samples of a store, or of a split of a recipe, or those of some numbers, as tensors."""
    numbers = range(samples) if isinstance(samples, int) else samples
    for first in range(0, len(numbers), each):
        indices = numbers[first : first + each]
        if isinstance(source, SpeckleCache):
            yield source.batch(indices)
        else:
            with one_torch_thread():
                yield tensors(source.batch(seed, split, indices))


def examples(
    source: Recipe | SpeckleCache, kind: str, samples: int | None = None, seed: int = 0, split: str = "train",
    target: str = "object", until: float | None = None,
) -> Examples:  # fmt: skip
    """Read or render samples and turn them into a network's input, once.

    Parameters
    ----------
    source
        A store, or a recipe.
    kind
        "camera" or "autocorrelation"; of stacks "registered" or "registered+power".
    samples
        How many; by default all of a store, or an epoch of the split.
    seed, split
        Of a recipe.
    target
        A name in :data:`~specklegen.models.learning.targets.TARGETS`.
    until
        Reading of ``time.perf_counter`` after which no further ones are begun, however few there are; None: all.
    """
    values = TARGETS[target].values
    count = samples or (len(source) if isinstance(source, SpeckleCache) else source.length(split))
    parts: list[Examples] = []
    for batch in batches_of(source, count, seed, split, _CHUNK if until is None else _HURRIED):
        parts.append(Examples(network_input(batch, kind).half(), values(batch), batch["parameters"]["medium"].long()))
        if until is not None and time.perf_counter() > until:
            break
    return Examples(*(torch.cat(field) for field in zip(*parts, strict=True)))


def sharing_media(recipe: Recipe, samples: int = SHARED_BY) -> Recipe:
    """Let so many neighbouring samples share a medium, where media are never seen again and the recipe shares none."""
    alone = recipe.media is None and recipe.media_group == 1
    return recipe.replace(media_group=samples).on(recipe.device) if alone and samples > 1 else recipe


class Streamed:
    """Batches of a stream, as a function of (epoch, first step); ``identity`` says what of."""

    def __init__(self, stream: SpeckleStream, kind: str, workers: int = 0, target: str = "object") -> None:
        self.values = TARGETS[target].values
        self.kind, self.loader = kind, stream.loader(num_workers=workers)
        recipe = json.loads(stream.recipe.canonical_json())
        self.identity: dict[str, Any] = stream.identity() | {"batch_size": stream.batch_size, "recipe": recipe}

    def __call__(self, epoch: int, first: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Batches of an epoch from step ``first`` on."""
        self.loader.load_state_dict(self.loader.state_dict() | {"epoch": epoch, "next_batch": first})
        for batch in self.loader:
            yield network_input(batch, self.kind), self.values(batch)


def streamed(stream: SpeckleStream, kind: str, workers: int = 0, target: str = "object") -> tuple[Streamed, int]:
    """Batches that are rendered while the network trains, for ``train``: every epoch is new."""
    return Streamed(stream, kind, workers, target), len(stream)


def mirrored(inputs: Tensor, targets: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
    """Mirror some samples left to right.

    Zero lag stays where it is, in column n/2 of n: column 0, which has no counterpart, stays too. A camera image turns
    about the same column; it is cyclic there by one pixel, which no network has noticed.
    """
    turned = torch.roll(inputs.flip(-1), 1, -1)
    keep = which.reshape(-1, *[1] * (inputs.ndim - 1))
    return torch.where(keep, turned, inputs), torch.where(which[:, None, None], targets.flip(-1), targets)
