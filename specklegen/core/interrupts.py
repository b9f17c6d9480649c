"""Ctrl-C and SIGTERM that wait for a good moment: Slurm sends SIGTERM before it takes a machine away."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

TERMINATED = 128 + signal.SIGTERM
"""Exit status after SIGTERM, as a shell has it: 143."""


class Terminated(SystemExit):
    """SIGTERM, which ends the program with its exit status."""

    def __init__(self) -> None:
        super().__init__(TERMINATED)


def _raise_terminated(*_: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    raise Terminated


@contextlib.contextmanager
def terminable() -> Iterator[None]:
    """Raise :class:`Terminated` at the first SIGTERM; the second one ends the process. In the main thread only."""
    with _handled(_raise_terminated, signal.SIGTERM):
        yield


class Interrupt:
    """Exception by which the program is to stop, or None."""

    asked: type[KeyboardInterrupt | Terminated] | None = None

    def obey(self) -> None:
        """Stop here, if that was asked for."""
        if self.asked is not None:
            raise self.asked from None  # whatever workers say that heard the signal too


@contextlib.contextmanager
def deferred() -> Iterator[Interrupt]:
    """Note the first Ctrl-C or SIGTERM instead of stopping at once; the second one stops. In the main thread only.

    A handler of SIGTERM that the program has set itself is left alone.
    """
    interrupt = Interrupt()

    def note(number: int, _: object) -> None:
        interrupt.asked = Terminated if number == signal.SIGTERM else KeyboardInterrupt
        for each, before in handlers.items():
            signal.signal(each, before)

    own = signal.getsignal(signal.SIGTERM) not in (signal.SIG_DFL, _raise_terminated)
    with _handled(note, signal.SIGINT, *(() if own else (signal.SIGTERM,))) as handlers:
        yield interrupt


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Let the news of a worker's death, which torch raises wherever the program is, wait for the end of the block."""
    news = []
    with _handled(lambda *_: news.append(1), *([signal.SIGCHLD] if hasattr(signal, "SIGCHLD") else [])):
        yield
    if news:
        signal.raise_signal(signal.SIGCHLD)


@contextlib.contextmanager
def _handled(handler: Any, *numbers: signal.Signals) -> Iterator[dict[signal.Signals, Any]]:
    """Set a handler of signals for a block, in the main thread; give those before it."""
    if threading.current_thread() is not threading.main_thread():
        yield {}
        return
    before = {number: old for number in numbers if (old := signal.getsignal(number)) is not None}
    for number in before:
        signal.signal(number, handler)
    try:
        yield before
    finally:
        for number, old in before.items():
            signal.signal(number, old)
