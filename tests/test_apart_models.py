"""Training, models and judging on a device that is none of the host's, and under what a program has set."""

import pytest
from apart_runs import STREAMS, ended


@pytest.mark.parametrize("marked", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_on_a_device_apart(marked):
    """Nothing takes the device's memory for the host's."""
    status, said = ended(f"not ({STREAMS})", marked)
    assert status == 0, said[-8000:]
    assert " passed" in said
