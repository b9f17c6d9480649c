"""A trained network as a user holds it: camera images in, brightness out; one small file."""

import os
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, Self, get_args

import torch
from torch import Tensor, nn

from specklegen.core.arguments import choice, whole_number
from specklegen.core.devices import checked_device
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject
from specklegen.core.shielded import plain_defaults
from specklegen.models.learning.inputs import FEATURES, INPUTS, network_input
from specklegen.models.learning.model_file import read_model, restored, rounded, write_model
from specklegen.models.learning.networks import NETWORKS, build, network_content
from specklegen.models.learning.targets import TARGETS

Pretrained = Literal["unknown-slab", "lab-mild"]
PRETRAINED: tuple[Pretrained, ...] = get_args(Pretrained)
"""Networks that come with the package; cards lie beside them, and in docs/networks.md."""


class Reconstructor:
    """A network with the input that it was trained on.

    Attributes
    ----------
    network : torch.nn.Module
    name : str
        Of the network's class, by which it is built again.
    width, side : int
        Its width, whatever that means to it, and pixels along a side of what it sees.
    shape : (int, int)
        Rows and columns of what it returns.
    device : torch.device
        Where it lies.
    input : str
        "camera" or "autocorrelation".
    target : str
        What it tells: "object", "label", "material", "motion" or "contrast".
    trained_on : dict
        Table of the objects that it was trained on, as in a recipe; empty where that is not known.

    Examples
    --------
    >>> from specklegen.models import load_pretrained
    >>> network = load_pretrained()
    >>> network.input, network.target, network.shape
    ('autocorrelation', 'object', (28, 28))
    """

    def __init__(
        self, network: nn.Module, name: str, input: str, width: int, side: int, shape: tuple[int, int],
        device: torch.device | str = "cpu", trained_on: Mapping[str, Any] | None = None, target: str = "object",
    ) -> None:  # fmt: skip
        self.target = target
        self.network, self.device, self.trained_on = network, torch.device(device), dict(trained_on or {})
        self.name, self.input, self.width, self.side, self.shape = name, input, width, side, tuple(shape)

    def __repr__(self) -> str:
        stated = {name: getattr(self, name) for name in ("name", "input", "target", "side", "shape", "width")}
        return summary(self, **stated, device=str(self.device))

    @plain_defaults()
    def __call__(self, inputs: Tensor) -> Tensor:
        """Answer to prepared inputs float32[B, ...]: brightness 0 to 1, float32[B, h, w], or a row float32[B, 1, K]."""
        self.network.eval()
        with torch.inference_mode():
            answer = TARGETS[self.target].answer(self.network(inputs.to(self.device)).float())
            return centred(answer) if self.target == "object" and self.input != "camera" else answer

    def reconstruct(self, batch: Mapping[str, Any]) -> Tensor:
        """Brightness of the objects in a batch: in place of coherent ones, up to shift and 180-degree flip of others.

        Raises
        ------
        RuleError
            If the batch has no images of hidden objects, or images of another size than in training.
        """
        if self.target != "object":
            reject("reconstruct model", "a model of objects", f"a model of the target {self.target}", "Use `tell`.")
        inputs = network_input(batch, self.input)
        if inputs.shape[-1] != self.side or inputs.shape[-2] != self.side:
            reject("reconstruct images", f"of {self.side} x {self.side} pixels", tuple(inputs.shape[-2:]))
        return self(inputs)

    def tell(self, batch: Mapping[str, Any]) -> Tensor:
        """Return the network's estimate of its target for a batch.

        Returns
        -------
        float32[B, K], or of maps float32[B, E, H, W]
            Probabilities of the classes; of a material log10 of range (radians), thickness and optical depth, and g; of
            motion log10 of tau0, and the share of the light at rest; the contrast of each pixel of every exposure.

        Raises
        ------
        RuleError
            If it shows objects, or the batch is not of its kind.
        """
        if self.target == "object":
            reject("tell model", "a model of another target than objects", "a model of objects", "Use `reconstruct`.")
        inputs = network_input(batch, self.input)
        if inputs.shape[-1] != self.side:
            reject("tell batch", f"of {self.side} numbers along the last axis, as in training", tuple(inputs.shape))
        return TARGETS[self.target].read(self(inputs))

    def save(self, path: str | os.PathLike, compact: bool = False) -> None:
        """Write the model; ``compact`` rounds its weights to eight bits, which makes the file a quarter.

        Parameters
        ----------
        path
            Of the file, which is written whole or not at all.
        compact
            Whether to round to eight bits; False by default.
        """
        stated = {name: getattr(self, name) for name in ("name", "input", "width", "side")}
        stated |= {"shape": list(self.shape), "trained_on": self.trained_on, "target": self.target}
        stated |= network_content(self.name) if self.name in NETWORKS else {}
        kept: dict[str, Tensor] = {}
        for key, weight in self.network.state_dict().items():
            kept |= rounded(key, weight) if compact else {key: weight}
        write_model(Path(path), stated, kept)

    @classmethod
    def load(cls, path: str | os.PathLike, device: torch.device | str = "cpu") -> Self:
        """Read a model.

        Parameters
        ----------
        path
            Of a file that :meth:`save` or a training wrote.
        device
            Torch device to put it on.

        Raises
        ------
        RuleError
            If the file holds something else or is damaged, or there is no such device.
        """
        stated, kept = read_model(Path(path))
        device = checked_device("Reconstructor.device", device)
        weights = restored(kept)
        network = _network_of(stated, weights, str(path)).to(device)
        about = stated.get("trained_on")
        return cls(network, stated["name"], stated["input"], stated["width"], stated["side"], stated["shape"], device,
                   about if isinstance(about, dict) else None, stated.get("target", "object"))  # fmt: skip


def _network_of(stated: Mapping[str, Any], weights: Mapping[str, Tensor], path: str) -> nn.Module:
    """Build the network that a file states, and give it the file's weights.

    A network of a user's own must be known already: a model imports nothing.

    First it is built without memory ("meta"), since a file may state any width: only a network whose weights are those
    that lie in the file is built.
    """
    named = stated.get("name")
    if isinstance(named, str):
        _require_known(named, stated.get("network_sha256"))
    try:
        for name in ("width", "side"):
            whole_number(f"model {name}", stated[name], 1, 2**16)
        rows, columns = (whole_number("model shape", n, 1, 2**16) for n in stated["shape"])
        kind = stated["name"], stated["side"], (rows, columns), stated["width"]
        promised = build(*kind, seed=0, device="meta").state_dict()
        fits = {key: value.shape for key, value in promised.items()} == {k: w.shape for k, w in weights.items()}
        known = stated["input"] in [*INPUTS, *FEATURES] and stated.get("target", "object") in TARGETS
    except (KeyError, TypeError, ValueError, RuntimeError):
        fits = known = False
    if not (fits and known):
        reject("model", "a file with weights of the network that it names", path)
    network = build(*kind, seed=0)
    network.load_state_dict(dict(weights))
    return network


def _require_known(name: str, digest: object) -> None:
    """Refuse a network that is not known here, or whose source has changed since the model was trained."""
    if name not in NETWORKS:
        reject("model network", f"one of {', '.join(NETWORKS)}", name,
               "For your own network, import its module first, or give --network module:Name.")  # fmt: skip
    here = network_content(name).get("network_sha256")
    if digest != here:
        reject("model network", f"{name} with source {here}", digest,
               "The source has changed since training: restore it.")


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


def load_pretrained(device: torch.device | str = "cpu", *, name: Pretrained = "unknown-slab") -> Reconstructor:
    """Return a network that comes with the package, trained on characters behind slabs of unknown material.

    Parameters
    ----------
    device
        Torch device to put it on; "cpu" by default.
    name
        What it was trained on: "unknown-slab", cameras and focus as they are said to be, or "lab-mild", the same
        recipe with blur, motion and stray light (docs/notes/recipes.md compares the two).

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.datasets.loading.stream import tensors
    >>> from specklegen.models import load_pretrained
    >>> batch = tensors(load_recipe("unknown-slab", {"material": {"kernel_paths": 1000}}).batch(0, "test", range(2)))
    >>> load_pretrained().reconstruct(batch).shape
    torch.Size([2, 28, 28])
    """
    choice("load_pretrained name", name, PRETRAINED)
    return Reconstructor.load(str(files("specklegen.models") / "data" / f"{name}.pt"), device)
