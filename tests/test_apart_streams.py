"""Streams, and what networks are shown of them, on a device that is none of the host's."""

import pytest
from apart_runs import STREAMS, ended


@pytest.mark.parametrize("marked", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_on_a_device_apart(marked):
    """Nothing takes the device's memory for the host's."""
    status, said = ended(STREAMS, marked)
    assert status == 0, said[-8000:]
    assert " passed" in said
