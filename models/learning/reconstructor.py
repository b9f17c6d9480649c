"""A trained network as a user holds it: camera images in, brightness out; one small file."""

import io
import json
import os
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.datasets.store.files import write_whole
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.networks import build

PRETRAINED = "unknown-slab"
"""Model that comes with the package; its card lies beside it, and in docs/networks.md."""


class Reconstructor:
    """A network with the input that it was trained on.

    Attributes
    ----------
    network : torch.nn.Module
    name, width, side, shape
        How to build the network again.
    input : str
        "camera" or "autocorrelation".
    """

    def __init__(
        self, network: nn.Module, name: str, input: str, width: int, side: int, shape: tuple[int, int],
        device: torch.device | str = "cpu",
    ) -> None:  # fmt: skip
        self.network, self.device = network, torch.device(device)
        self.name, self.input, self.width, self.side, self.shape = name, input, width, side, tuple(shape)

    def __call__(self, inputs: Tensor) -> Tensor:
        """Brightness 0 to 1, float32[B, h, w], of prepared inputs float32[B, ...]."""
        self.network.eval()
        with torch.inference_mode():
            return centred(self.network(inputs.to(self.device)).float().sigmoid())

    def reconstruct(self, batch: Mapping[str, Any]) -> Tensor:
        """Brightness of the objects in a batch of a hidden-object recipe, up to shift and 180-degree flip.

        Raises
        ------
        RuleError
            If the batch has no images of hidden objects, or images of another size than in training.
        """
        inputs = network_input(batch, self.input)
        if inputs.shape[-1] != self.side or inputs.shape[-2] != self.side:
            reject("reconstruct images", f"of {self.side} x {self.side} pixels", tuple(inputs.shape[-2:]))
        return self(inputs)

    def save(self, path: str | os.PathLike, compact: bool = False) -> None:
        """Write the model, whole or not at all; ``compact`` rounds its weights to eight bits: a quarter of the file."""
        weights = self.network.state_dict()
        stated = {name: getattr(self, name) for name in ("name", "input", "width", "side")}
        stated |= {"shape": list(self.shape)}
        kept = {key: _rounded(value) if compact else value for key, value in weights.items()}
        write_torch(Path(path), {"model": json.dumps(stated), "weights": kept})

    @classmethod
    def load(cls, path: str | os.PathLike, device: torch.device | str = "cpu") -> Self:
        """Read a model.

        Raises
        ------
        RuleError
            If the file holds something else.
        """
        if not Path(path).is_file():
            reject("model", "a file", str(path))
        state = torch.load(path, map_location=device, weights_only=True)
        if not isinstance(state, dict) or set(state) != {"model", "weights"}:
            reject("model", "a file that Reconstructor.save wrote", str(path))
        stated = json.loads(state["model"])
        network = build(stated["name"], stated["side"], stated["shape"], stated["width"], seed=0).to(device)
        network.load_state_dict({key: _restored(value) for key, value in state["weights"].items()})
        return cls(network, stated["name"], stated["input"], stated["width"], stated["side"], stated["shape"], device)


def write_torch(file: Path, value: Any) -> None:
    """Write what ``torch.load`` reads, whole or not at all."""
    buffer = io.BytesIO()
    torch.save(value, buffer)
    write_whole(file, buffer.getvalue())


def _rounded(weight: Tensor) -> Tensor | tuple[Tensor, Tensor]:
    """Rows as int8 and their scales; what has no rows as float16."""
    if weight.ndim < 2:
        return weight.half()
    scale = weight.flatten(1).abs().amax(1).clamp_min(torch.finfo(weight.dtype).tiny) / 127
    return (weight / scale.reshape(-1, *[1] * (weight.ndim - 1))).round().to(torch.int8), scale


def _restored(kept: Tensor | tuple[Tensor, Tensor]) -> Tensor:
    if isinstance(kept, Tensor):
        return kept.float()
    rows, scale = kept
    return rows * scale.reshape(-1, *[1] * (rows.ndim - 1))


def centred(images: Tensor) -> Tensor:
    """Shift images [..., H, W] cyclically so that their circular centroid is in the middle.

    A loss that is blind to cyclic shifts lets a network put an object across the frame's edge; here its halves are
    brought together.
    """
    for axis in (-2, -1):
        n = images.shape[axis]
        angle = 2 * torch.pi / n * torch.arange(n, device=images.device)
        profile = images.sum(-1 if axis == -2 else -2)
        turn = torch.atan2(profile @ angle.sin(), profile @ angle.cos()) / (2 * torch.pi)
        first = (turn * n).round().long() - n // 2
        places = (torch.arange(n, device=images.device) + first[..., None]) % n
        places = places[..., :, None] if axis == -2 else places[..., None, :]
        images = images.gather(axis, places.expand_as(images))
    return images


def load_pretrained(device: torch.device | str = "cpu") -> Reconstructor:
    """Return the network that comes with the package, trained on characters behind slabs of unknown material.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.datasets.loading.stream import tensors
    >>> batch = tensors(load_recipe("unknown-slab").batch(0, "test", range(8)))
    >>> load_pretrained().reconstruct(batch).shape
    torch.Size([8, 28, 28])
    """
    return Reconstructor.load(str(files("specklegen.models") / "data" / f"{PRETRAINED}.pt"), device)
