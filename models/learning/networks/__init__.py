"""Networks that look through fog. A new one is a class of :class:`Network`, in a file of this folder or of a user's.

Those of :data:`NETWORKS` take pictures float[B, 2, H, W] (:mod:`specklegen.models.learning.inputs`) and return logits
float[B, h, w]; the brightness is their sigmoid. The perceptron takes features float[B, F]. :mod:`unrolled` sees the
likelihood, and is held by a :class:`~specklegen.models.learning.solver.Solver`.
"""

import torch
from torch import nn

from specklegen.core.errors import reject
from specklegen.core.shielded import plain_defaults
from specklegen.models.learning.networks.contrast_net import ContrastNet
from specklegen.models.learning.networks.dense import DenseNet
from specklegen.models.learning.networks.lag_net import LagNet
from specklegen.models.learning.networks.network import NETWORKS, Network, network_content
from specklegen.models.learning.networks.perceptron import Perceptron
from specklegen.models.learning.networks.residual import ResidualNet
from specklegen.models.learning.networks.stack_unet import StackUNet
from specklegen.models.learning.networks.unet import UNet

__all__ = [
    "NETWORKS", "ContrastNet", "DenseNet", "LagNet", "Network", "Perceptron", "ResidualNet", "StackUNet",
    "UNet", "build", "network_content", "parameter_count",
]  # fmt: skip


def parameter_count(network: nn.Module) -> int:
    """Numbers that training changes."""
    return sum(p.numel() for p in network.parameters() if p.requires_grad)


def build(name: str, side: int, shape: tuple[int, int], width: int, seed: int, device: str = "cpu") -> nn.Module:
    """Make a network whose first weights are a function of the seed; the global generator is left as it was.

    On the ``device`` "meta" it has no memory. Whatever the program around has set, weights are in single precision.
    """
    if name not in NETWORKS:
        reject("network", f"one of {', '.join(NETWORKS)}", name)
    with torch.random.fork_rng(devices=[]), plain_defaults(device):
        torch.manual_seed(seed)
        return NETWORKS[name](side=side, shape=tuple(shape), width=width)
