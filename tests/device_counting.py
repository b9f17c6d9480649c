"""Counting what a batch costs a device: operators (a launch each), bytes they read and write, waits of the host."""

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

from specklegen.synthesis.fused import KERNELS

# Operators that make no kernel: they allocate, or look at memory that is there.
FREE = {"empty", "new_empty", "empty_like", "view", "_unsafe_view", "reshape", "expand", "select", "slice", "unsqueeze",
        "squeeze", "permute", "transpose", "t", "detach", "alias", "unbind", "split", "split_with_sizes", "as_strided",
        "view_as_real", "view_as_complex", "_to_copy_none", "unflatten", "lift_fresh", "real", "unfold",
        "empty_strided", "view_dtype", "_reshape_alias"}  # fmt: skip


class Counting(TorchDispatchMode):
    """Counts operators on one kind of device, and copies from it to the host."""

    def __init__(self, kind):
        super().__init__()
        self.kind, self.launches, self.bytes, self.waits, self.uploads, self.names = kind, 0, 0, 0, 0, {}

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.name().split("::")[1].split(".")[0]
        inputs = [v for v in tree_flatten((args, kwargs or {}))[0] if isinstance(v, torch.Tensor)]
        result = func(*args, **(kwargs or {}))
        outputs = [v for v in tree_flatten(result)[0] if isinstance(v, torch.Tensor)]
        here = lambda values: any(v.device.type == self.kind for v in values)  # noqa: E731
        if name == "_local_scalar_dense" and here(inputs):
            self.waits += 1
        elif name in ("_to_copy", "copy_") and here(inputs) != here(outputs):
            self.waits, self.uploads = self.waits + here(inputs), self.uploads + here(outputs)
        elif name not in FREE and (here(inputs) or here(outputs)):
            self.launches += KERNELS.get(name, 1)
            self.names[name] = self.names.get(name, 0) + 1
            if name == "index_put_":  # the target is written where the values go, no more
                inputs, outputs = [*inputs[1:], inputs[-1]], []
            for value in [*inputs, *outputs]:
                if value.device.type == self.kind:
                    # An expanded tensor is read once.
                    self.bytes += min(value.numel() * value.element_size(), value.untyped_storage().nbytes())
        return result
