"""Return the input channels of every network of pictures: float[B, 2, H, W], the picture and the scale."""

CHANNELS = 2
"""Of every input: the picture, and the scale."""
