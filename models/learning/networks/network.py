"""The base of every network that training knows: a module that names its inputs and its answers.

A network of a user's own is a class that inherits :class:`Network`, and no more:

    class Linear(Network, name="linear", targets=("object", "label")):
        def __init__(self, side, shape=(28, 28), width=16):
            super().__init__()
            self.shape, self.layer = shape, nn.Linear(2 * side**2, shape[0] * shape[1])

        def forward(self, pictures):
            return self.layer(pictures.flatten(1)).reshape(-1, *self.shape)
"""

from collections.abc import Sequence
from typing import Any, ClassVar

from torch import nn

from specklegen.core.content import content_digest, is_own
from specklegen.core.registry import Registry

PICTURES = ("autocorrelation", "periodogram", "camera")
"""Inputs that are pictures float[B, 2, H, W]."""


def _is_network(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Network) and found is not Network


class Network(nn.Module):
    """A network of (side, shape, width), known by a name from its definition on. Subclass it for one of your own.

    It takes pictures float[B, 2, H, W] (the picture, and the scale), H = W = ``side``, or features float[B, ``side``],
    and returns float[B, h, w] of ``shape`` (h, w): for objects logits, whose sigmoid is the brightness. What ``width``
    means is its own.

    Parameters
    ----------
    name
        By which settings and files know it; by default that of the class.
    inputs
        What it may see, of :data:`specklegen.models.learning.inputs.INPUTS` and ``FEATURES``; by default pictures.
    targets
        What it can tell, of :data:`specklegen.models.learning.targets.TARGETS`; by default objects.
    args, kwargs
        Of the constructor of the subclass: (side, shape, width), or more with defaults.

    Examples
    --------
    >>> from torch import nn
    >>> from specklegen.models import Network, Training
    >>> class Linear(Network, name="linear"):
    ...     def __init__(self, side, shape=(28, 28), width=16):
    ...         super().__init__()
    ...         self.shape, self.layer = shape, nn.Linear(2 * side**2, shape[0] * shape[1])
    ...     def forward(self, pictures):
    ...         return self.layer(pictures.flatten(1)).reshape(-1, *self.shape)
    >>> Training(network="linear").network
    'linear'
    """

    inputs: ClassVar[tuple[str, ...]] = PICTURES
    targets: ClassVar[tuple[str, ...]] = ("object",)

    def __init_subclass__(
        cls, name: str | None = None, inputs: Sequence[str] | None = None, targets: Sequence[str] | None = None,
        **kwargs: Any,
    ) -> None:  # fmt: skip
        super().__init_subclass__(**kwargs)
        cls.inputs = cls.inputs if inputs is None else tuple(inputs)
        cls.targets = cls.targets if targets is None else tuple(targets)
        NETWORKS.add(name or cls.__name__, cls)


NETWORKS: Registry[type[Network]] = Registry("network", _is_network)
"""Every network by its name."""


def network_content(name: str) -> dict[str, str]:
    """Return the facts that a run and a model record of a user's network beside its name: the digest of its source."""
    network = NETWORKS[name]
    return {"network_sha256": content_digest(network)} if is_own(network) else {}
