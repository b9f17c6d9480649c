"""Steps that want one kernel each: registered as torch operators, so that every device has its own form.

The CPU has the Numba kernel or the torch form as it stands, CUDA the torch form compiled by Inductor, "meta" the
shapes alone; other devices run the torch form step by step. All are the same arithmetic.

Derivatives are those of the torch form: where one is asked for, of any order, backward or forward, an operator runs as
that form, whose steps torch differentiates. Counts of photons go in steps and have none: there it is refused.
"""

from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch.autograd import forward_ad

from specklegen.core.errors import reject

_LIBRARY = torch.library.Library("specklegen", "DEF")
KERNELS: dict[str, int] = {}
"""Kernels of each operator on CUDA: one for each reduction that waits for another, and for what follows the last."""
FORMS: dict[str, Callable[..., Any]] = {}
"""Torch form of each operator."""
STEPWISE: dict[str, str] = {}
"""Operators without a derivative, and what has one instead."""


def fused(
    schema: str, shape: Callable[..., Any], cpu: Callable[..., Any] | None = None, kernels: int = 1, stepwise: str = ""
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a torch function as an operator.

    Parameters
    ----------
    schema
        As torch.library wants it, such as ``name(Tensor a, int n) -> Tensor``.
    shape
        Function of the same arguments that returns an empty result, for "meta" and for the compiler.
    cpu
        Form for the CPU, where it is not the torch function itself.
    kernels
        How many it should be on CUDA.
    stepwise
        Of an operator whose value goes in steps, and so has no derivative: what to differentiate instead.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        name = schema.split("(")[0]
        _LIBRARY.define(schema)
        _LIBRARY.impl(name, function, "CompositeExplicitAutograd")
        _LIBRARY.impl(name, cpu or function, "CPU")
        _LIBRARY.impl(name, _compiled(function), "CUDA")
        _LIBRARY.impl(name, shape, "Meta")
        KERNELS[name], FORMS[name] = kernels, function
        if stepwise:
            STEPWISE[name] = stepwise
        operator = getattr(torch.ops.specklegen, name)
        _LIBRARY.impl(name, _differentiated(name, operator.default), "Autograd")
        return operator

    return register


def _differentiated(name: str, operator: Callable[..., Any]) -> Callable[..., Any]:
    """Return what torch runs where it may track derivatives: the torch form if it does, the operator if not."""

    def run(*arguments: Any) -> Any:
        may_be_tracked = torch.is_grad_enabled() or forward_ad._current_level >= 0  # asked first: samples have neither
        if not (may_be_tracked and any(map(tracked, _tensors(arguments)))):
            with torch._C._AutoDispatchBelowAutograd():
                return operator(*arguments)
        if name in STEPWISE:
            reject(f"specklegen::{name}", "given tensors without a derivative", "a tensor that requires one",
                   f"Its value is a step function: differentiate {STEPWISE[name]}.")  # fmt: skip
        return FORMS[name](*arguments)

    return run


def _tensors(arguments: Any) -> Iterator[torch.Tensor]:
    for argument in arguments:
        if isinstance(argument, torch.Tensor):
            yield argument
        elif isinstance(argument, list | tuple):
            yield from _tensors(argument)


def tracked(tensor: torch.Tensor) -> bool:
    """Return whether torch tracks derivatives of a tensor, backward or forward."""
    backward = tensor.requires_grad and torch.is_grad_enabled()
    return backward or (forward_ad._current_level >= 0 and forward_ad.unpack_dual(tensor).tangent is not None)


_SHAPES = 2**10
"""Graphs that one operator may be compiled to: torch's own limit of 8 is less than long use of many recipes needs."""


def _compiled(function: Callable[..., Any], backend: str = "inductor") -> Callable[..., Any]:
    """Return a function compiled at its first call, and once more where a length differs: for any length from then on.

    torch's limit is raised where it is met alone, since that takes as long as several operators.
    """
    kept: list[Callable[..., Any]] = []

    def run(*arguments: Any) -> Any:
        if not kept:
            kept.append(torch.compile(function, fullgraph=True, backend=backend))
        try:
            return kept[0](*arguments)
        except torch._dynamo.exc.FailOnRecompileLimitHit:
            with torch._dynamo.config.patch(recompile_limit=_SHAPES, accumulated_recompile_limit=_SHAPES):
                return kept[0](*arguments)

    return run
