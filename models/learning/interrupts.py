"""Ctrl-C that waits for a good moment."""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Interrupt:
    """Whether the user has asked to stop."""

    asked = False

    def obey(self) -> None:
        """Stop here, if that was asked for."""
        if self.asked:
            raise KeyboardInterrupt


@contextlib.contextmanager
def deferred() -> Iterator[Interrupt]:
    """Note the first Ctrl-C instead of stopping at once; the second one stops. In the main thread only."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    before = signal.getsignal(signal.SIGINT)

    def note(*_: object) -> None:
        interrupt.asked = True
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)
