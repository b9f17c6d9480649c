"""Runs that take a second, for the tests of training."""

import json

import numpy as np
import torch

from specklegen.models.learning.examples import Examples
from specklegen.models.learning.training import Training

TINY = {"material": {"kernel_paths": 1000, "kernel": "estimate"}, "camera": {"shape": [32, 32]},
        "objects": {"shape": [12, 12]}, "samples": {"train": 24, "validation": 8}}  # fmt: skip

CHANGES = [
    word for part, fields in TINY.items() for name, value in fields.items()
    for word in ("--set", f"{part}.{name}={json.dumps(value)}")
]  # fmt: skip
"""The same as words of a command."""


def squares(count, seed, media=4):
    """Targets that the input shows outright: what any network learns in a few steps."""
    rng = np.random.default_rng(seed)
    targets = np.zeros((count, 12, 12), np.float32)
    for target, (y, x, h, w) in zip(targets, rng.integers(1, 6, (count, 4)), strict=True):
        target[y : y + h, x : x + w] = 1
    inputs = np.zeros((count, 2, 16, 16), np.float16)
    inputs[:, 0, 2:14, 2:14] = targets
    return Examples(*map(torch.from_numpy, (inputs, targets, np.arange(count) % media)))


DATA, HELD_OUT = squares(70, 0), squares(16, 1)
CLOCKED = {"seconds", "made_per_second", "trained_per_second"}
SETTINGS = Training(width=4, batch_size=16, epochs=3, mirror=True)


def checkpoint(folder):
    return torch.load(folder / "checkpoint.pt", weights_only=True)


def assert_same_run(one, other):
    for part in ("network", "optimiser"):
        pairs = zip(flat(one[part]), flat(other[part]), strict=True)
        assert all(torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b for a, b in pairs)
    for a, b in zip(one["rows"], other["rows"], strict=True):
        assert {k: v for k, v in a.items() if k not in CLOCKED} == {k: v for k, v in b.items() if k not in CLOCKED}


def flat(tree):
    if isinstance(tree, dict):
        return [leaf for value in tree.values() for leaf in flat(value)]
    if isinstance(tree, list | tuple):
        return [leaf for value in tree for leaf in flat(value)]
    return [tree]
