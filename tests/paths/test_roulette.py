"""Thresholds of roulette: the least work for an error, whatever the pilot's seed, and no variance to speak of."""

from dataclasses import replace

import numpy as np
import pytest

import specklegen as sg
from specklegen.core.random_streams import Stream
from specklegen.paths import roulette
from specklegen.paths.endpoint_factors import contributions_of_pairs
from specklegen.paths.roulette import cheapest_threshold, slab_roulette, volume_roulette
from specklegen.paths.tracer import slab_tracer, volume_tracer
from specklegen.paths.volume_tracer import VolumeTracer

LIGHT = sg.CollimatedBeams.tilts([0.0], width=40.0)
CAMERA = sg.FarField.grid((32, 32), 1e-3)


def scene(medium):
    return sg.Scene(wavelength=1.0, medium=medium, illumination=LIGHT, sensor=CAMERA)


def lognormal_paths(spread, seed, count=3000):
    """Contributions float64[1, M], their paths int64[M] and the number of these."""
    g = np.random.default_rng(seed)
    owners = np.repeat(np.arange(count), g.poisson(6, count))
    found = np.exp(spread * g.standard_normal(len(owners)))
    return found[None], owners, count


@pytest.mark.parametrize("spread", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("unit", [1.0, 1e-200])
def test_the_threshold_makes_the_least_work_for_an_error(spread, unit, monkeypatch):
    """Against the product of cost and variance at a thousand thresholds, where what is added counts once."""
    monkeypatch.setattr(roulette, "TIMES", 1.0)
    w, owners, count = lognormal_paths(spread, 1)
    event, whole = 0.2, np.bincount(owners, w[0], count)

    def work(t):
        kept = np.minimum(1, w / t).sum() / count
        return (event * len(owners) / count + kept) * (whole.var() + (w * np.maximum(t - w, 0)).sum() / count)

    thresholds = np.geomspace(1e-3, 1e3, 1000) * w.mean()
    least = min(map(work, thresholds))
    darker = np.concatenate([unit * w, 2 * unit * w])  # a brighter view changes nothing
    found = cheapest_threshold(unit * w[0], unit * w, owners, count, event) / unit
    assert cheapest_threshold(unit * w[0], darker, owners, count, event) / unit == pytest.approx(found, rel=1e-12)
    assert work(found) <= least * (1 + 1e-3)
    assert work(found) < 0.95 * work(3 * found)
    assert work(found) < 0.98 * work(found / 3)


def test_the_roulette_adds_no_more_variance_than_it_may():
    """Of two views, each judged by its own light: the least work would add more, and so does a threshold 1.1 higher."""
    w, owners, count = lognormal_paths(2.0, 1)
    both = np.concatenate([w, w * (np.arange(w.shape[1]) % 7 == 0)])

    def added(t):
        variances = [np.bincount(owners, each, count).var() for each in both]
        more = [(np.square(each) * np.maximum(t / w[0] - 1, 0)).sum() / count for each in both]
        return max(m / v for m, v in zip(more, variances, strict=True))

    found = cheapest_threshold(w[0], both, owners, count, 0.01, 0.1)
    assert added(cheapest_threshold(w[0], both, owners, count, 0.01)) > 0.3
    assert added(found) <= 0.1
    assert added(1.1 * found) > 0.1


@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-300, 1.0])
def test_equal_connections_are_all_kept(light):
    """Those of no weight are not."""
    for count in (5, 1000):
        found = cheapest_threshold(np.full(5, light), np.full((1, 5), light), np.arange(5), count, 0.1)
        assert 0 < found
        assert found <= light or light == 0


HEAVY = sg.Box(lower=[-50.0, -50.0, 0.0], upper=[50.0, 50.0, 100.0], mean_free_path=10.0,
               scatterer=sg.HenyeyGreenstein(0.9))  # fmt: skip


def test_the_threshold_hardly_depends_on_the_seed_of_the_pilot():
    """Of a box beside whose beam paths start that weigh a lot and are dark; ten times the mean of all was of chance."""
    judged = volume_tracer(scene(HEAVY), False)
    assert isinstance(judged, VolumeTracer)
    tracer = replace(judged, threshold=0.0)
    found = np.array([volume_roulette(tracer, seed).threshold for seed in range(4)])
    assert found.max() < 1.6 * found.min()
    judging, lights = replace(tracer, threshold=1e-300), tracer.layout.lights.probed()
    banks = (judging.trace(seed, roulette.VOLUME_PATHS, stream=Stream.PILOT, threads=1) for seed in range(4))
    bare = replace(tracer.layout.probed(), lights=lights)
    means = np.array([contributions_of_pairs(bare, bank).max(axis=(0, 1)).mean() for bank in banks])
    assert means.max() > 3 * means.min()


@pytest.mark.parametrize(("depth", "g"), [(0.5, 0.9), (2.0, 0.9), (10.0, 0.9), (10.0, 0.0)])
def test_thinning_adds_little_to_the_variance_of_a_path(depth, g):
    """At most a quarter, where ten times the mean made it 7 times as large at depth 2 and 120 times at .5."""
    slab = sg.Slab(thickness=2000.0, mean_free_path=2000.0 / depth, scatterer=sg.HenyeyGreenstein(g))
    tracer = slab_tracer(scene(slab).replace(sensor=sg.FarField.grid((5, 5), 1e-6)), False)
    proposal = tracer.proposal

    def variances(threshold):
        bank = replace(tracer, proposal=replace(proposal, threshold=threshold)).trace(3, 40_000, threads=1)
        light = contributions_of_pairs(tracer.layout.at(proposal.reference, proposal.probes), bank)[0].max(axis=0)
        whole = np.bincount(bank.paths, light, bank.count)
        return whole.var() / whole.mean() ** 2, len(bank)

    (judged, some), (every, all_kept) = variances(proposal.threshold), variances(0.0)
    assert judged < 1.25 * every
    assert some < 0.9 * all_kept
    again = slab_roulette(replace(tracer, proposal=replace(proposal, threshold=0.0)), proposal.reference, 7)
    assert again.proposal.threshold == pytest.approx(proposal.threshold, rel=0.3)


def test_single_scattering_of_forward_layers_is_judged_by_its_lobe():
    """As if it were isotropic, it carried most of the variance within this camera."""
    layers = (sg.Layer(thickness=20.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.8)),
              sg.Layer(thickness=60.0, mean_free_path=15.0, scatterer=sg.HenyeyGreenstein(0.9)))  # fmt: skip
    seen = scene(sg.Layers(layers=layers)).replace(sensor=sg.FarField.grid((41, 41), 0.01))
    tracer, views = slab_tracer(seen, False), np.array([0, 840, 846, 866, 1200])

    def variances(threshold):
        judged = replace(tracer, proposal=replace(tracer.proposal, threshold=threshold))
        bank = judged.trace(3, 20_000, threads=1)
        light = contributions_of_pairs(tracer.layout.of_ends(np.array([0]), views), bank)[0]
        whole = np.array([np.bincount(bank.paths, each, bank.count) for each in light])
        return whole.var(axis=1) / whole.mean(axis=1) ** 2, len(bank)

    (judged, some), (every, all_kept) = variances(tracer.proposal.threshold), variances(0.0)
    assert (judged < 1.3 * every).all()
    assert some < 0.5 * all_kept
