"""The U-Net for stacks of images."""

from torch import Tensor

from specklegen.models.learning.networks.unet import UNet, convolutions


class StackUNet(UNet, name="stack-unet"):
    """U-Net for several images of one object: each is folded alone, then their features are averaged.

    The order of the images does not matter, and a stack may have any number of them.
    """

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 16) -> None:
        super().__init__(side, shape, width)
        self.each = convolutions(width, width)

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of stacks float[B, T, 2, H, W]."""
        each = self.each(self.features(pictures.flatten(0, 1)))
        return self.reconstruct(each.unflatten(0, pictures.shape[:2]).mean(1))
