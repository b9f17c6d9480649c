"""Steps that want one kernel each: registered as torch operators, so that every device has its own form.

The CPU has the Numba kernel or the torch form as it stands, CUDA the torch form compiled by Inductor, "meta" the
shapes alone; other devices run the torch form step by step. All are the same arithmetic.
"""

from collections.abc import Callable
from typing import Any

import torch

_LIBRARY = torch.library.Library("specklegen", "DEF")
KERNELS: dict[str, int] = {}
"""Kernels of each operator on CUDA: one for each reduction that waits for another, and for what follows the last."""
FORMS: dict[str, Callable[..., Any]] = {}
"""Torch form of each operator."""


def fused(
    schema: str, shape: Callable[..., Any], cpu: Callable[..., Any] | None = None, kernels: int = 1
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
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        name = schema.split("(")[0]
        _LIBRARY.define(schema)
        _LIBRARY.impl(name, function, "CompositeExplicitAutograd")
        _LIBRARY.impl(name, cpu or function, "CPU")
        _LIBRARY.impl(name, _compiled(function), "CUDA")
        _LIBRARY.impl(name, shape, "Meta")
        KERNELS[name], FORMS[name] = kernels, function
        return getattr(torch.ops.specklegen, name)

    return register


_SHAPES = 2**10
"""Shapes that one operator may be compiled for: torch's own limit of 8 is less than the buckets of one recipe."""


def _compiled(function: Callable[..., Any], backend: str = "inductor") -> Callable[..., Any]:
    kept: list[Callable[..., Any]] = []

    def run(*arguments: Any) -> Any:
        if not kept:
            kept.append(torch.compile(function, fullgraph=True, dynamic=False, backend=backend))
        with torch._dynamo.config.patch(recompile_limit=_SHAPES, accumulated_recompile_limit=_SHAPES):
            return kept[0](*arguments)

    return run
