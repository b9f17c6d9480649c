"""Refusals: an error of the library that says what rule was broken."""

from collections.abc import Callable

import pytest

from specklegen.core.errors import RuleError


def assert_refused(call: Callable[[], object], words: str) -> None:
    """A RuleError must come of the call, whose message has the ``words``, a regular expression."""
    with pytest.raises(RuleError, match=words):
        call()
