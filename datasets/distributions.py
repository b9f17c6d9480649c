"""Numbers of a recipe that may vary from medium to medium: constants, ranges and choices.

In TOML: ``g = 0.9``, ``g = {uniform = [0.7, 0.95]}``, ``thickness = {log_uniform = [200, 2000]}``,
``albedo = {choice = [1.0, 0.99]}``.
"""

import math
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.units import NUMBER
from specklegen.core.values import Finite, Positive, Value

if TYPE_CHECKING:
    import torch


class Uniform(Value):
    """Evenly distributed between two ends."""

    uniform: tuple[Finite, Finite]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.uniform[0] > self.uniform[1]:
            reject("Uniform.uniform", "given as (smallest, largest)", self.uniform)
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.uniform

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        return float(rng.uniform(*self.uniform))


class LogUniform(Value):
    """Evenly distributed in the logarithm between two positive ends."""

    log_uniform: tuple[Positive, Positive]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.log_uniform[0] > self.log_uniform[1]:
            reject("LogUniform.log_uniform", "given as (smallest, largest)", self.log_uniform)
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.log_uniform

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        low, high = np.log(self.log_uniform)
        return float(np.clip(np.exp(rng.uniform(low, high)), *self.log_uniform))


class Choice(Value):
    """One of a few values, each as likely."""

    choice: tuple[Finite, ...]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.choice:
            reject("Choice.choice", "at least one value", self.choice)
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.choice), max(self.choice)

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        return float(self.choice[rng.integers(len(self.choice))])


_KINDS = {"uniform": Uniform, "log_uniform": LogUniform, "choice": Choice}


def _read(value: Any) -> Any:
    if isinstance(value, dict):
        kinds = [kind for name, kind in _KINDS.items() if name in value]
        if len(kinds) != 1:
            reject("a drawn number", f"a number or a table with one of {', '.join(_KINDS)}", value)
        return kinds[0](**value)
    if isinstance(value, Uniform | LogUniform | Choice):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        reject("a drawn number", f"a number or a table with one of {', '.join(_KINDS)}", value)
    number = np.inf if abs(value) > sys.float_info.max else real_number("a drawn number", value)
    if not np.isfinite(number):
        raise ValueError("finite")  # the field is named by whoever asked
    return number


def _read_up_to_infinity(value: Any) -> Any:
    # A store writes the word, since JSON has no such number.
    return np.inf if value == "Infinity" or (isinstance(value, float) and value == np.inf) else _read(value)


def is_draw(value: Any) -> bool:
    """Return whether a value is a distribution, or the table of one."""
    table = isinstance(value, Mapping) and bool(_KINDS.keys() & value)
    return table or isinstance(value, Uniform | LogUniform | Choice)


Draw = Annotated[float | Uniform | LogUniform | Choice, BeforeValidator(_read), NUMBER]
"""A finite constant, or a distribution."""

UnboundedDraw = Annotated[float | Uniform | LogUniform | Choice, BeforeValidator(_read_up_to_infinity), NUMBER]
"""The same, where a constant may also be infinite, since that means something: coherent light, a medium at rest."""


def drawn(value: "float | Uniform | LogUniform | Choice", rng: np.random.Generator) -> float:
    """Draw a value; a constant is itself and takes one draw all the same, so that the others stay put."""
    if isinstance(value, float | int):
        rng.random()
        return value
    return value.draw(rng)


def drawn_from(value: "float | Uniform | LogUniform", uniform: "torch.Tensor") -> "torch.Tensor":
    """Return the draw of :func:`drawn` for the uniform numbers float64[B] of a generator, in [0, 1); no choices."""
    import torch

    if isinstance(value, Uniform):
        low, high = value.uniform
        return low + (high - low) * uniform
    if isinstance(value, LogUniform):
        low, high = map(math.log, value.log_uniform)
        return torch.exp(low + (high - low) * uniform).clamp(*value.log_uniform)
    return torch.full_like(uniform, value)


def require_above(field: str, value: "float | Uniform | LogUniform | Choice", low: float) -> None:
    """Refuse a number that may be drawn at or below ``low``."""
    if not ends(value)[0] > low:
        reject(field, f"greater than {low:g}", value)


def ends(value: "float | Uniform | LogUniform | Choice") -> tuple[float, float]:
    """Smallest and largest value that can be drawn."""
    return (value, value) if isinstance(value, float | int) else value.ends
