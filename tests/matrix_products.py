"""Which products of matrices a program asks of torch: a row of one has other last bits with other rows beside it.

Not on every processor, so that a comparison of bits shows it on some alone. Products of a batch of matrices (bmm) are
made one by one.
"""

from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode

PRODUCTS = ("mm", "addmm", "mv", "addmv", "dot", "linear")


class MatrixProducts(TorchDispatchMode):
    """Within it, shapes of all factors are collected."""

    def __init__(self) -> None:
        super().__init__()
        self.shapes: set[tuple[Any, ...]] = set()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = func.overloadpacket.__name__
        if name in PRODUCTS:
            factors = (tuple(each.shape) for each in args if isinstance(each, torch.Tensor))
            self.shapes.add((name, *factors))
        return func(*args, **(kwargs or {}))
