"""The yardstick that scales the seconds of plans: run once a machine, cached, and without weight in choices."""

import pytest

import specklegen as sg
from specklegen.core import nanoseconds, pace
from specklegen.disk_cache import folder_of


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """A cache of its own, and a process that has run no yardstick."""
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(tmp_path))
    pace.machine_pace.cache_clear()
    yield tmp_path
    pace.machine_pace.cache_clear()


def test_it_is_run_once_and_kept(fresh, monkeypatch):
    runs = []
    monkeypatch.setattr(pace, "measured_pace", lambda: runs.append(1) or 0.3)
    assert pace.machine_pace() == 0.3
    pace.machine_pace.cache_clear()
    assert pace.machine_pace() == 0.3  # of another process
    assert len(runs) == 1
    assert len(list(folder_of("pace").iterdir())) == 1


def test_without_a_cache_it_is_that_of_the_reference(fresh, monkeypatch):
    monkeypatch.setenv("SPECKLEGEN_CACHE", "off")
    monkeypatch.setattr(pace, "measured_pace", lambda: pytest.fail("nothing is measured"))
    assert pace.machine_pace() == 1.0


def test_it_scales_seconds_and_no_choice(monkeypatch):
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    plans = []
    for found in (0.5, 50.0):
        monkeypatch.setattr(pace, "machine_pace", lambda found=found: found)
        plans.append(sg.plan(scene, threads=1))
    assert plans[0].sampler == plans[1].sampler
    assert plans[1].seconds == pytest.approx(100 * plans[0].seconds)
    assert plans[0].seconds == pytest.approx(0.5 * nanoseconds.seconds(plans[0].operations, 1))
    assert plans[1].alternatives == pytest.approx({way: 100 * each for way, each in plans[0].alternatives.items()})


def test_a_yardstick_is_a_number_of_this_machine():
    """Two in a row agree within a factor of two on any machine that is not stopped meanwhile."""
    assert set(pace.loops()) == set(pace.REFERENCE)
    assert 0.02 <= pace.measured_pace() <= 50
