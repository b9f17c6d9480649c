"""What stands for ``torch.cuda`` where there is no GPU: streams that know what they waited for, graphs that run again.

A stream counts its pieces of work and keeps, for every stream, up to where it has waited (a vector clock): what ran
before what is then a comparison of numbers, whatever a real device would have done by chance. A graph records the
operators between begin and end of its capture, and replays each on the tensors that it had then, after their results
have been spoilt: numbers that the host put in, and what an operator did not write, show.
"""

from contextlib import contextmanager

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves


class Stream:
    """A queue of work."""

    def __init__(self, name):
        self.name, self.clock = name, {name: 0}

    def work(self):
        self.clock[self.name] += 1
        return self.clock[self.name]

    def record_event(self):
        return dict(self.clock)

    def wait_event(self, event):
        for name, tick in event.items():
            self.clock[name] = max(tick, self.clock.get(name, 0))

    def wait_stream(self, other):
        self.wait_event(other.record_event())

    def has_waited(self, other, tick):
        return self.clock.get(other.name, 0) >= tick


class CUDAGraph:
    """Operators in the order in which they were captured."""

    def __init__(self):
        self.calls, self.replays = [], 0

    def replay(self):
        self.replays += 1
        for function, arguments, options, result in self.calls:
            inputs = [v.data_ptr() for v in tree_leaves((arguments, options)) if isinstance(v, torch.Tensor)]
            own = [v for v in tree_leaves(result) if v.data_ptr() not in inputs and v._base is None]
            for value in own:
                value.fill_(torch.nan if value.is_floating_point() or value.is_complex() else 1)
            for old, new in zip(tree_leaves(result), tree_leaves(function(*arguments, **options)), strict=True):
                if old.data_ptr() != new.data_ptr():
                    old.copy_(new)


class _Capture(TorchDispatchMode):
    def __init__(self, graph):
        super().__init__()
        self.graph = graph

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        if function is torch.ops.aten._local_scalar_dense.default:
            raise RuntimeError("operation not permitted when stream is capturing")
        result = function(*args, **(kwargs or {}))
        self.graph.calls.append((function, args, kwargs or {}, result))
        return result


class StandIn:
    """One device: a current stream, others, graphs."""

    CUDAGraph = CUDAGraph

    def __init__(self):
        self.made, self.pools = [Stream("program")], []
        self.current = self.made[0]

    def Stream(self, _device):  # noqa: N802
        self.made.append(Stream(f"side {len(self.made)}"))
        return self.made[-1]

    def current_stream(self, _device):
        return self.current

    @contextmanager
    def stream(self, stream):
        before, self.current = self.current, stream
        try:
            yield
        finally:
            self.current = before

    def graph_pool_handle(self):
        self.pools.append(object())
        return self.pools[-1]

    @contextmanager
    def graph(self, graph, *, pool, stream, capture_error_mode):
        assert (pool, capture_error_mode) == (self.pools[-1], "thread_local")
        assert stream is not self.made[0], "the default stream cannot be captured"
        with self.stream(stream), _Capture(graph):
            yield
