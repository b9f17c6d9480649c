"""Nothing is begun that would not fit into this machine, or would not end: refused before it is allocated."""

import pytest

from specklegen.core.budgets import MOST_SECONDS, require_time
from specklegen.core.errors import RuleError
from specklegen.core.memory import available_memory, require_memory


def test_what_does_not_fit_is_refused():
    most = available_memory()
    require_memory("Owner", "held", 0.5 * most, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match=r"Owner must be held within .* GiB; got '.* GiB for a thing'. Ask for less."):
        require_memory("Owner", "held", 0.51 * most, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match=r"got 'nan GiB for a thing'|got '.*e\+\d+ GiB for a thing'"):
        require_memory("Owner", "held", 1e40, "a thing", "Ask for less.")
    require_memory("Owner", "held", 0.8 * most, "a thing", "Ask for less.", share=0.9)


def test_what_does_not_end_is_refused():
    require_time("Owner", MOST_SECONDS, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match="Owner must be done within 30 days; got '60 days for a thing'. Ask for less."):
        require_time("Owner", 2 * MOST_SECONDS, "a thing", "Ask for less.")
    with pytest.raises(RuleError):
        require_time("Owner", float("nan"), "a thing", "Ask for less.")
