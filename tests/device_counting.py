"""Counting what a batch costs a device: operators (a launch each), bytes they read and write, waits of the host.

And what it costs the host: torch operators that it calls, replays of graphs aside, and calls of our functions.
"""

import sys
from contextlib import contextmanager
from pathlib import Path

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
            elif name in ("index", "index_select"):  # the rows that are picked are read, no others
                inputs = [*inputs[1:], *outputs]
            for value in [*inputs, *outputs]:
                if value.device.type == self.kind:
                    # An expanded tensor is read once.
                    self.bytes += min(value.numel() * value.element_size(), value.untyped_storage().nbytes())
        return result


PACKAGES = tuple(str(Path(__file__).resolve().parents[1] / name) for name in ("specklegen", "datasets", "models"))


class Replays:
    """What stands for CUDA graphs on "meta": a function runs once for each name and shapes, beside all counting."""

    def __init__(self):
        self.kept = {}

    def __call__(self, name, function, inputs):
        key = name, *(value.shape for value in inputs.values())
        if key not in self.kept:
            with torch._C._DisableTorchDispatch():
                self.kept[key] = function(**inputs), {each: value.clone() for each, value in inputs.items()}
        result, places = self.kept[key]
        for each, value in inputs.items():
            places[each].copy_(value)
        return result


class Operators(TorchDispatchMode):
    """Counts all operators that the host calls, those that make no kernel among them."""

    def __init__(self):
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        self.count += 1
        return func(*args, **(kwargs or {}))


@contextmanager
def python_calls():
    """Count calls of Python functions of this library, each step of a generator too, in the list that this gives."""
    calls = [0]

    def seen(frame, event, _):
        if event == "call" and frame.f_code.co_filename.startswith(PACKAGES):
            calls[0] += 1

    before = sys.getprofile()
    sys.setprofile(seen)
    try:
        yield calls
    finally:
        sys.setprofile(before)
