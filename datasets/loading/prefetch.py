"""One piece of work ahead, on a stream of its own: the device makes the next batches while it trains on these.

Written after torch's documentation (notes on CUDA semantics, "CUDA streams"), and never run on a GPU.
"""

from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

import torch

T = TypeVar("T")


def ahead(pieces: Iterable[T], device: torch.device, cuda: Any = torch.cuda) -> Iterator[T]:
    """Yield the pieces, each made while the one before is used; on other devices than CUDA as they come.

    A piece may be read on the stream that is current when it is handed out, until the next is asked for: only then is
    more made, after all that this stream was given to do. So memory of pieces that were let go is free to be used
    again, and needs no ``record_stream``, whose blocks come back at times that nobody knows.

    Parameters
    ----------
    pieces
        What makes them as it is iterated over: tensors on the device, in any container.
    device
        Where.
    cuda
        What stands for ``torch.cuda``.
    """
    if device.type != "cuda":
        yield from pieces
        return
    side, work, end = cuda.Stream(device), iter(pieces), object()

    def begun() -> tuple[Any, Any]:
        side.wait_stream(cuda.current_stream(device))
        with cuda.stream(side):
            return next(work, end), side.record_event()

    try:
        piece, ready = begun()
        while piece is not end:
            following = begun()
            cuda.current_stream(device).wait_event(ready)
            yield piece
            piece, ready = following
    finally:
        cuda.current_stream(device).wait_stream(side)  # memory that the work still uses may be let go now
