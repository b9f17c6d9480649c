"""The script that compares the engine with the wave solver."""

import numpy as np
import pytest
from scenes import ROOT, script_at

STORED = ROOT / "tests" / "data" / "wave_solver_2d_od2.npz"


@pytest.fixture(scope="module")
def script():
    return script_at("tests/validate_wave_solver.py")


def test_stored_results_agree_with_themselves(script, tmp_path, capsys):
    stored = dict(np.load(STORED))
    table = script.report(stored, stored)
    assert table["total intensity"] == pytest.approx([17.7698, 17.7663, 17.7925, 18.6127], abs=1e-4)
    assert np.array_equal(table["total intensity"], table["wave solver's"])
    assert table["covariance, correlation"] == pytest.approx(1, abs=1e-12)
    for row in ("single views, worst relative error", "mean, relative error", "near field, rms z"):
        assert not table[row].any()
    assert table["backscattering peak of light 0; wave solver's"] == pytest.approx(1.424, abs=5e-4)
    script.main(["--wave", str(STORED), "--against", str(STORED), "--inside", "0", "--out", str(tmp_path)])
    assert "backscattering peak" in capsys.readouterr().out
    assert {p.name for p in tmp_path.iterdir()} == {"covariance.png", "intensity.png", "near-field.png"}


def test_order_of_the_axes(script):
    value = np.random.default_rng(0).normal(size=(4, 3, 4, 3))
    ordered = script.in_oracle_order("near_", value, value)
    for v in range(3):
        for j in range(4):
            assert ordered["near_I_var"][v, j] == value[j, v, j, v]
            assert ordered["near_C"][v, 1, j] == value[0, v, j, 1]


def test_short_run_is_stored_in_the_oracles_form(script, tmp_path):
    waves = script.solve_waves(128, 0, 1)
    stored = np.load(STORED)
    for name in waves.keys() & set(stored.files) - {"I_var_batches"}:  # theirs are 16
        assert waves[name].shape == stored[name].shape, name
    assert {"C", "I_var", "mean", "near_C", "near_I_var", "near_mean_scattered"} <= waves.keys()
    assert all(np.isfinite(row).all() for row in script.report(waves, dict(stored)).values())
