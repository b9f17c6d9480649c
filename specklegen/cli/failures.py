"""Errors of commands in one line: the only place where an error of the command line becomes a message.

Broken rules, files that cannot be read or written, and limits of the machine are reported in a line, with exit status
2. Any other error is a defect of specklegen and keeps its traceback.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from specklegen.core.errors import DoubtWarning, RuleError, ToldError
from specklegen.core.extras import install_line
from specklegen.core.interrupts import TERMINATED, Terminated, terminable

FAILED = 2
"""Exit status of a command that could not do what it was asked for."""
NOT_WHOLE = 1
"""Exit status of a check that found something missing or damaged."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell has it."""


def _system(error: OSError) -> str:
    files = ": ".join(str(name) for name in (error.filename, error.filename2) if name is not None)
    message = error.strerror or str(error) or type(error).__name__
    return f"{message}: {files}" if files else message


_WORDS: tuple[tuple[type[BaseException], Callable[[Any], str]], ...] = (
    (RuleError, lambda error: error.in_tables),
    (ToldError, str),
    (OSError, _system),
    (MemoryError, lambda error: f"there is not enough memory. {error}".strip()),
    (RecursionError, lambda error: "a file is nested too deeply to be read"),
    (UnicodeError, lambda error: f"a text or a name is not in UTF-8: {error}"),
    (ImportError, lambda error: install_line(error) or str(error)),
)


def told(error: BaseException) -> str | None:
    """Return the message of an error that a user can do something about; None of a defect."""
    return next((words(error) for kind, words in _WORDS if isinstance(error, kind)), None)


def exit_status(stopped: KeyboardInterrupt | Terminated) -> int:
    """Return the exit status after Ctrl-C or SIGTERM."""
    return TERMINATED if isinstance(stopped, Terminated) else INTERRUPTED


@contextmanager
def failures_told() -> Iterator[None]:
    """Turn what stops a command into a line and an exit status, and doubts into lines."""
    formatted = warnings.formatwarning

    def in_a_line(message: Any, category: Any, *where: Any) -> str:
        return f"warning: {message}\n" if issubclass(category, DoubtWarning) else formatted(message, category, *where)

    warnings.formatwarning = in_a_line
    try:
        with terminable():
            yield
    except (KeyboardInterrupt, Terminated) as stopped:
        typer.echo("stopped", err=True)
        raise SystemExit(exit_status(stopped)) from None
    except Exception as error:
        message = told(error)
        if message is None:
            raise
        typer.echo(f"error: {message}", err=True)
        raise SystemExit(FAILED) from None
    finally:
        warnings.formatwarning = formatted
