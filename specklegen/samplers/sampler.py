"""What a sampler is to those who choose among them."""

from typing import Literal

Sampler = Literal["auto", "paths", "covariance", "stationary"]
