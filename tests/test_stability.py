"""Every row of the stability report passes, or is refused with its reason: its note and these tests agree."""

import numpy as np
import pytest
from stability import FAST, SLOW
from stability.media import deep
from stability.row import Row, holds, measured, refused, within

from specklegen.core.errors import reject
from specklegen.paths import slab_tracer


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("row", [
    # Weekly: other lobes. Even scattering is here, and g 0.9 in test_deep_absorption.
    pytest.param(row, marks=[pytest.mark.slow] * (row in SLOW or row.__name__ == "deep_anisotropic"))
    for row in (*FAST, *SLOW)
], ids=lambda row: row.__name__)  # fmt: skip
def test_row(row):
    found = row()
    assert found.passed, f"{found.case}: {found.right} expected, {found.ours} found; error {found.error}"


# ---- A row that should fail does -----------------------------------------------------------------------
@pytest.mark.parametrize("row", [
    within("", "", 1.0, 1.0 + 2e-9, 1e-9), within("", "", 1.0, np.nan, 1e-9), measured("", "", 1.0, 1.2, 0.03),
    measured("", "", 1.0, np.nan, 0.03), measured("", "", [1.0, 2.0], [1.0, 2.1], 0.0),
    measured("", "", 1.0, 1.0, np.nan),
    measured("", "", [1e-3, 0.0], [1e-3, 0.0], 1.0),  # all of it noise: no answer would fail
    holds("", "", "", {"yes": True, "no": False}),
    refused("", "", [(lambda: None, ["field"])]),
    refused("", "", [(lambda: reject("Owner.name", "right", 0), ["Owner.field"])]),
])  # fmt: skip
def test_a_wrong_answer_fails(row: Row):
    assert not row.passed
    assert row.verdict == "**FAIL**"


def test_a_deep_row_fails_by_paths_that_are_not_drawn_across(monkeypatch):
    monkeypatch.setattr(slab_tracer, "stretches", lambda *_: False)
    assert not deep("", (30.0,), (0.0,)).passed
