"""The shield: samples are made under one state of NumPy, torch and linear algebra, whatever the program around has set.

    with shielded():                            # or @shielded() over a function that is no generator
        ...                                     # here: no autocast, CPU default device, float32 default dtype, ...

A program may train under ``torch.autocast``, build its model under ``torch.device("meta")``, hunt for errors with
``np.seterr(all="raise")``: none of it is an argument of a sample, so none of it may reach one. Some of this state
belongs to a thread and is set and restored there. The rest belongs to the process (:data:`_PROCESS`): it is set when
the first thread comes in and restored when the last one goes out, so that no thread takes it from under another.
What the program itself changes of it while a sample is being made stays as the program left it.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from threading import Lock, local
from typing import Any, NamedTuple, TypeVar

import numpy as np

from specklegen.core.extras import extras_named
from specklegen.core.parallel import one_blas_thread, one_torch_thread

T = TypeVar("T")

FLOAT_ERRORS: Any = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}
"""Default actions of NumPy at floating-point errors, as keywords of ``np.errstate``."""

_HERE = local()  # .inside: whether this thread is under the shield
_LOCK = Lock()  # guards what follows
_INSIDE = 0  # threads
_BEFORE: dict[str, Any] = {}

_TINY = sys.float_info.min


class _Switch(NamedTuple):
    """A setting of the whole process: what it must be, how it is read and how it is written."""

    wanted: Any
    read: Callable[[], Any]
    write: Callable[[Any], object]


@contextmanager
def shielded() -> Iterator[None]:
    """Context, and decorator, in which samples are made: the same state of the libraries in whatever program.

    - NumPy's floating-point errors as NumPy sets them; linear algebra on one thread.
    - torch on one thread, without autocast, gradients and inference mode; default device "cpu", default dtype float32;
      full single precision in products (no TF32, no bfloat16); algorithms not forced to be deterministic, since
      others would be taken on the CPU.
    - Denormal numbers are kept, not flushed to 0.

    A thread that is inside already pays nothing to come in again. Of a generator only the steps may be inside, never
    the code that uses it: see :func:`shielded_steps`.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.core.shielded import shielded
    >>> with np.errstate(all="raise"), shielded():
    ...     float(np.exp(np.float64(-800.0)))
    0.0
    """
    if getattr(_HERE, "inside", False):
        yield
        return
    with ExitStack() as stack:
        _HERE.inside = True
        stack.callback(setattr, _HERE, "inside", False)
        stack.enter_context(np.errstate(**FLOAT_ERRORS))
        stack.enter_context(one_blas_thread())
        if "torch" in sys.modules:  # else its settings are those that it comes with
            _shield_torch(stack)
        stack.enter_context(extras_named())
        yield


@contextmanager
def plain_defaults(device: str = "cpu") -> Iterator[None]:
    """Context, and decorator, of what is no sample: tensors are made on the CPU, or a ``device``, in single precision.

    Of the rest of the shield it has full precision in products; threads, gradients and autocast are the caller's.

    Examples
    --------
    >>> import torch
    >>> from specklegen.core.shielded import plain_defaults
    >>> with torch.device("meta"), plain_defaults():
    ...     torch.zeros(1).device
    device(type='cpu')
    """
    import torch

    with torch.device(device), _process_wide():
        yield


def shielded_steps(steps: Iterable[T]) -> Iterator[T]:
    """Yield what an iterable yields, each step of it made under the shield, the code between them not."""
    iterator, end = iter(steps), object()
    while True:
        with shielded():
            step: Any = next(iterator, end)
        if step is end:
            return
        yield step


def _shield_torch(stack: ExitStack) -> None:
    import torch

    for kind in ("cpu", "cuda", "xpu", "mps"):
        if torch.is_autocast_enabled(kind):
            stack.enter_context(torch.autocast(kind, enabled=False))
    if torch.get_default_device().type != "cpu":
        stack.enter_context(torch.device("cpu"))
    if torch.is_inference_mode_enabled():
        stack.enter_context(torch.inference_mode(False))
    stack.enter_context(torch.no_grad())
    stack.enter_context(one_torch_thread())
    if _TINY / 2 == 0:  # a flag of this thread's processor
        torch.set_flush_denormal(False)
        stack.callback(torch.set_flush_denormal, True)
    stack.enter_context(_process_wide())


def _switches() -> dict[str, _Switch]:
    import torch

    # One switch a backend: torch refuses to read the switch of all, where a program has set it and allow_tf32, too.
    products = {"products on cuda": torch.backends.cuda.matmul, "products on the cpu": torch.backends.mkldnn.matmul}
    of_backends = {
        name: _Switch("ieee", partial(getattr, on, "fp32_precision"), partial(setattr, on, "fp32_precision"))
        for name, on in products.items()
    }
    return {
        "default dtype": _Switch(torch.float32, torch.get_default_dtype, torch.set_default_dtype),
        "deterministic algorithms": _Switch(
            (False, False),
            lambda: (
                torch.are_deterministic_algorithms_enabled(),
                torch.is_deterministic_algorithms_warn_only_enabled(),
            ),
            lambda value: torch.use_deterministic_algorithms(value[0], warn_only=value[1]),
        ),
    } | of_backends


_PROCESS: dict[str, _Switch] = {}
"""Settings of the process, by name; filled when torch is there."""


@contextmanager
def _process_wide() -> Iterator[None]:
    global _INSIDE
    with _LOCK:
        if not _PROCESS:
            _PROCESS.update(_switches())
        for name, switch in _PROCESS.items():
            now = switch.read()
            if now != switch.wanted:
                _BEFORE[name] = now
                switch.write(switch.wanted)
        _INSIDE += 1
    try:
        yield
    finally:
        with _LOCK:
            _INSIDE -= 1
            for name in [*_BEFORE] if not _INSIDE else []:
                before, switch = _BEFORE.pop(name), _PROCESS[name]
                if switch.read() == switch.wanted:
                    switch.write(before)


def _forget_other_threads() -> None:
    """Forget the other threads in a forked process: only the one that forked lives on, they will not come out."""
    global _LOCK, _INSIDE
    _LOCK, inside = Lock(), getattr(_HERE, "inside", False)
    _INSIDE = int(inside and bool(_INSIDE))
    if not _INSIDE:
        for name in [*_BEFORE]:
            _PROCESS[name].write(_BEFORE.pop(name))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_other_threads)
