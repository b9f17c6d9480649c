"""A perceptron, for a few features: how the speckle of registered tilts decorrelates, or of exposures has blurred."""

from torch import Tensor, nn

from specklegen.models.learning.networks.network import Network


class Perceptron(
    Network, name="perceptron", inputs=("registered", "registered+power", "exposures"),
    targets=("object", "material", "motion"),
):  # fmt: skip
    """Two hidden layers of 16 * ``width`` units on features float[B, ``side``]."""

    def __init__(self, side: int, shape: tuple[int, int] = (1, 4), width: int = 8) -> None:
        super().__init__()
        self.shape, units = shape, 16 * width
        self.layers = nn.Sequential(nn.Linear(side, units), nn.SiLU(), nn.Linear(units, units), nn.SiLU(),
                                    nn.Linear(units, shape[0] * shape[1]))  # fmt: skip

    def forward(self, features: Tensor) -> Tensor:
        """Return float[B, h, w] of features float[B, ``side``]."""
        return self.layers(features).reshape(-1, *self.shape)
