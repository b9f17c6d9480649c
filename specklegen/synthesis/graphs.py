"""CUDA graphs: a function of tensors of fixed shapes is captured once, and replayed with other numbers in their place.

Written after torch's documentation (notes on CUDA semantics, "CUDA Graphs"). The first replay is compared with what the
function itself gives, to the bit, so that what capture does not carry is found there; what a GPU said of it stands in
docs/notes/devices.md.
"""

import logging
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import torch

_LOG = logging.getLogger(__name__)
_ROWS = 64
"""Least rows of memory that stays."""
_WARM = 3
"""Runs before a capture, in which operators are compiled, transforms planned and work spaces made."""


@dataclass(frozen=True)
class _Captured:
    graph: Any
    function: Callable[..., torch.Tensor]  # which holds the tensors that the graph reads beside its inputs
    inputs: dict[str, torch.Tensor]
    result: torch.Tensor


class Graphs:
    """Captured functions, one for each name and set of shapes, that share their memory.

    A result lies in memory that the next call of the same name and shapes overwrites: use it, or copy it, before.

    Parameters
    ----------
    device
        Where all tensors lie.
    cuda
        What stands for ``torch.cuda``.
    """

    def __init__(self, device: torch.device, cuda: Any = torch.cuda) -> None:
        self.device, self._cuda = device, cuda
        self.kept: dict[Hashable, _Captured] = {}
        self.refused = ""
        """Why nothing is captured or replayed any more."""
        self._stream = self._pool = self._last = None
        self._staged: dict[Hashable, list[dict[str, torch.Tensor]]] = {}

    def __call__(
        self, name: Hashable, function: Callable[..., torch.Tensor], inputs: dict[str, torch.Tensor]
    ) -> torch.Tensor:
        """Return ``function(**inputs)``, replayed where it can be.

        Parameters
        ----------
        name
            Of all that the function depends on but its inputs.
        function
            Of tensors alone, that asks for no number of theirs.
        inputs
            Tensors on the device.
        """
        key = name, *((each, value.shape, value.dtype) for each, value in inputs.items())
        if key not in self.kept and not self.refused:
            try:
                self.kept[key] = self._capture(function, inputs)
            except RuntimeError as error:  # of CUDA, out of memory included; the generator goes on without graphs
                self.refused = f"{name}: {error}".splitlines()[0]
                _LOG.warning("no CUDA graphs from here on: %s", self.refused)
                self.kept.clear()
                self._staged.clear()
        if self.refused:
            return function(**inputs)
        captured = self.kept[key]
        self._follow()
        for each, value in inputs.items():
            captured.inputs[each].copy_(value)
        captured.graph.replay()
        return captured.result

    def stage(
        self, name: Hashable, tables: list[dict[str, torch.Tensor]]
    ) -> tuple[Hashable, list[dict[str, torch.Tensor]]]:
        """Copy tensors to memory that stays, for functions that pick rows of them; return its name and the copies.

        As many rows fit there as the next power of two, so that tensors of other lengths meet the same graphs. The next
        call of the same name and shapes overwrites it.
        """
        if self.refused:
            return name, tables
        room = [{each: (_ROWS << max(0, (len(v) - 1) // _ROWS).bit_length(), *v.shape[1:]) for each, v in table.items()}
                for table in tables]  # fmt: skip
        types = (v.dtype for table in tables for v in table.values())
        key = name, *(tuple(shapes.items()) for shapes in room), *types
        self._follow()
        if key not in self._staged:
            self._staged[key] = [
                {each: value.new_zeros(shapes[each]) for each, value in table.items()}
                for shapes, table in zip(room, tables, strict=True)
            ]
        for table, staged in zip(tables, self._staged[key], strict=True):
            for each, value in table.items():
                staged[each][: len(value)].copy_(value)
        return key, self._staged[key]

    def report(self) -> str:
        """Say what was captured, or why nothing is."""
        return f"refused: {self.refused}" if self.refused else f"{len(self.kept)} captured"

    def _follow(self) -> None:
        """Wait for the stream of the call before, where it was another one: the memory is the same."""
        here = self._cuda.current_stream(self.device)
        if self._last is not None and self._last != here:
            here.wait_stream(self._last)
        self._last = here

    def _capture(self, function: Callable[..., torch.Tensor], inputs: dict[str, torch.Tensor]) -> _Captured:
        self._follow()
        if self._stream is None:
            self._stream, self._pool = self._cuda.Stream(self.device), self._cuda.graph_pool_handle()
        kept = {name: value.clone(memory_format=torch.contiguous_format) for name, value in inputs.items()}
        self._stream.wait_stream(self._cuda.current_stream(self.device))
        with self._cuda.stream(self._stream):
            *_, before, expected = [function(**kept) for _ in range(_WARM)]
        _require_same(before, expected, "its own runs differ")
        graph = self._cuda.CUDAGraph()
        # "thread_local": a thread of the program that pins memory for its own loader must not spoil the capture.
        with self._cuda.graph(graph, pool=self._pool, stream=self._stream, capture_error_mode="thread_local"):
            result = function(**kept)
        result.fill_(torch.nan)
        graph.replay()
        _require_same(result, expected, "the first replay differs from what it replays")
        return _Captured(graph, function, kept, result)


def _require_same(found: torch.Tensor, expected: torch.Tensor, what: str) -> None:
    if not torch.equal(found, expected):
        wrong = found != expected
        share, most = float(wrong.double().mean()), float((found - expected).abs().max() / expected.abs().max())
        raise RuntimeError(f"{what}: {share:.2g} of its numbers, by up to {most:.2g} of the largest")


def each_time(_name: Hashable, function: Callable[..., torch.Tensor], inputs: dict[str, torch.Tensor]) -> torch.Tensor:
    """Call the function: what stands for :class:`Graphs` where there are none."""
    return function(**inputs)
