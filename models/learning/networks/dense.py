"""A dense net to judge the others by."""

from torch import Tensor, nn

from specklegen.models.learning.networks.channels import CHANNELS
from specklegen.models.learning.networks.network import Network


class DenseNet(Network, name="dense", targets=("object", "label")):
    """One hidden layer of 16 * ``width`` units: the least that can be called a network."""

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 16) -> None:
        super().__init__()
        self.shape = shape
        hidden = 16 * width
        self.layers = nn.Sequential(
            nn.Flatten(), nn.Linear(CHANNELS * side**2, hidden), nn.ReLU(), nn.Linear(hidden, shape[0] * shape[1])
        )

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of pictures float[B, 2, H, W]."""
        return self.layers(pictures).reshape(-1, *self.shape)
