"""A recipe without physics for the tests of the transport: cheap, pure, picklable."""

import hashlib
import json
import os
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from specklegen.datasets.sample_schema import ArraySpec

SPLITS = ("train", "validation", "test")


@dataclass(frozen=True)
class FakeRecipe:
    """Camera counts with a bright square, and the float object behind them."""

    name: str = "fake"
    thickness: float = 1000.0
    samples: int = 100
    side: int = 8
    data_version: int = 1
    fails_at: int = -1
    seconds: float = 0.0
    log: str = ""
    ballast: bytes = b""

    def canonical_json(self) -> str:
        medium = {"thickness": self.thickness, "layers": [{"g": 0.9}, {"g": 0.5}]}
        return json.dumps({"medium": medium, "side": self.side}, sort_keys=True, separators=(",", ":"))

    def fingerprint(self) -> str:
        return hashlib.sha256(self.canonical_json().encode()).hexdigest()

    def split_notes(self) -> str:
        return "Nothing is shared."

    def length(self, split: str) -> int:
        return self.samples

    def layout(self) -> Mapping[str, ArraySpec]:
        n, tilt, drawn = self.side, ("tilt", "y", "x"), "what was drawn"
        return {
            "image": ArraySpec(shape=(n, n), dtype="uint16", dims=("y", "x"), units="counts", counts=True,
                               description="camera image"),
            "field": ArraySpec(shape=(2, n, n), dtype="float32", dims=tilt, description="stack"),
            "object": ArraySpec(shape=(3, 5), dtype="float32", dims=("v", "u"), description="hidden object"),
            "level": ArraySpec(shape=(), dtype="float64", units="photons", description="light level"),
            "parameters": ArraySpec(shape=(2,), dtype="float64", dims=("parameter",), description=drawn),
        }  # fmt: skip

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        if index == self.fails_at:
            raise ArithmeticError("no such medium")
        time.sleep(self.seconds)
        if self.log:
            with Path(self.log).open("a") as file:
                file.write(f"{os.getpid()} {index}\n")
        key = np.random.SeedSequence([seed, SPLITS.index(split), index])
        random = np.random.Generator(np.random.Philox(key))
        level = random.exponential(1000 * self.thickness / 1000)
        return {"image": np.minimum(random.poisson(level, (self.side, self.side)), 65535).astype(np.uint16),
                "field": random.normal(size=(2, self.side, self.side)).astype(np.float32),
                "object": (random.random((3, 5)) < 0.3).astype(np.float32), "level": np.float64(level),
                "index": np.int64(index),
                "parameters": {"thickness": self.thickness * (1 + random.random()), "level": level}}  # fmt: skip

    def batch(self, seed: int, split: str, indices: Sequence[int]) -> dict[str, Any]:
        return stack([self.sample(seed, split, index) for index in indices])

    def replace(self, **changes: Any) -> "FakeRecipe":
        return replace(self, **changes)


class Mortal(FakeRecipe):
    """Kills its process, once, or always."""

    def sample(self, seed, split, index):
        if index == 12 and (self.name == "always" or not Path(self.name).exists()):
            Path(self.name).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().sample(seed, split, index)


def stack(samples: list[dict[str, Any]]) -> dict[str, Any]:
    """Stack samples along a new first axis."""
    return {
        key: {name: np.array([s[key][name] for s in samples]) for name in samples[0][key]}
        if key == "parameters"
        else np.stack([sample[key] for sample in samples])
        for key in samples[0]
    }


def assert_same(a: Any, b: Any) -> None:
    """Require two samples or batches to be equal to the bit, tensors or arrays."""
    assert a.keys() == b.keys()
    for key in a:
        if isinstance(a[key], dict):
            assert_same(a[key], b[key])
            continue
        first, second = np.asarray(a[key]), np.asarray(b[key])
        assert first.shape == second.shape, key
        assert first.dtype == second.dtype, key
        assert first.tobytes() == second.tobytes(), key
