"""Random placements of cylinders: the draw, the sums, and the statistics against stored and closed-form ones."""

import numpy as np
import pytest
from references.mean_wave import coherent_field, foldy_wavenumber
from refusals import assert_refused
from scenes import DATA
from scipy.optimize import brentq
from scipy.spatial.distance import pdist
from scipy.stats import chi2
from zscore import FALSE_ALARM, assert_mean, assert_z, refute_z

from specklegen.oracles import wave_ensemble
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_ensemble import CylinderGas, Moments, ensemble
from specklegen.oracles.wave_solver import LineSources, PlaneLights, directions_of, scatter

THIN = Cylinder.resonant(0.02)
MONOPOLE = Cylinder.resonant(0.02, order=0)
SMALL = CylinderGas(MONOPOLE, (-2.0, -1.0), (2.0, 3.0), 0.5)
LIGHTS = PlaneLights(directions_of(np.array([0.0, 0.4])))
VIEWS = directions_of(np.linspace(0, 6, 5))
ORACLE_BATCHES = 16
STORED = 1e-6  # the stored covariance is complex64, of numbers up to 10


@pytest.fixture(scope="module")
def oracle():
    return np.load(DATA / "wave_solver_2d_od2.npz")


# ---------------------------------------------------------------- placements
@pytest.fixture(scope="module")
def centres():
    return [SMALL.placement(3, n) for n in range(6400)]


def test_numbers_are_poisson(centres):
    numbers = np.array([len(c) for c in centres]).reshape(64, 100)
    assert SMALL.mean_number == 8
    assert_mean(numbers.mean(axis=1), 8)
    assert_mean(numbers.var(axis=1, ddof=1), 8)  # 5 % more or less would be caught: its error is 1.8 %


def test_centres_are_uniform_and_independent(centres):
    """Moments of the places; pairs closer than two radii are a share of 3e-4, and move the last one by that."""
    each = lambda f: np.array([sum(f(c) for c in centres[b::64]) / 100 for b in range(64)])  # noqa: E731
    assert_mean(each(lambda c: c[:, 0].sum()), 0)
    assert_mean(each(lambda c: (c[:, 0] ** 2).sum()), 8 * 4 / 3)
    assert_mean(each(lambda c: (c[:, 1] - 1).sum()), 0)
    assert_mean(each(lambda c: ((c[:, 1] - 1) ** 2).sum()), 8 * 4 / 3)
    assert_mean(each(lambda c: c[:, 0].sum() ** 2), 8 * 4 / 3, slack=3e-4 * 8 * 4 / 3)  # no cross terms
    corners = np.concatenate(centres)
    assert (corners.min(axis=0) > (-2, -1)).all()
    assert (corners.max(axis=0) < (2, 3)).all()


def test_cylinders_keep_clear_of_each_other_and_of_sources():
    crowd = CylinderGas(Cylinder(0.05, 1.5), (0.0, 0.0), (1.0, 1.0), 12.0)
    source = np.array([[0.5, 0.5]])
    free = CylinderGas(Cylinder(1e-9, 1.5), (0.0, 0.0), (1.0, 1.0), 12.0)
    moved = 0
    for n in range(100):
        centres = crowd.placement(0, n, source)
        assert len(centres) == len(free.placement(0, n))  # redrawing leaves the number alone
        assert len(centres) < 2 or pdist(centres).min() > 0.1
        assert np.linalg.norm(centres - source, axis=1).min(initial=1) > 0.05
        moved += not np.array_equal(centres, free.placement(0, n))
    assert moved > 50  # or the lines above prove nothing


def test_bad_input_is_refused():
    assert_refused(lambda: CylinderGas(THIN, (0.0, 0.0), (1.0, 0.0), 1.0), "below upper")
    assert_refused(lambda: CylinderGas(Cylinder(0.2, 1.5), (0.0, 0.0), (1.0, 1.0), 1.0), "tenth of the area")
    assert_refused(lambda: CylinderGas(THIN, (0.0, 0.0), (1.0, 1.0), -1.0), "density must be finite")
    assert_refused(lambda: ensemble(SMALL, LIGHTS, {}, placements=127, seed=0), "two for each of the 64 batches")
    assert_refused(lambda: ensemble(SMALL, LIGHTS, {}, placements=127, seed=0, batches=1), "batches must be at least 2")
    assert_refused(lambda: coherent_field(SMALL, np.array([0.5, 1.5]), placements=128, seed=0), "distances between")


# ---------------------------------------------------------------- sums
def test_moments_are_those_of_the_single_fields(monkeypatch):
    monkeypatch.setattr(wave_ensemble, "CHUNK", 3)
    sources = LineSources(np.array([[0.0, 0.0], [0.3, -1.5]]))
    for light in (LIGHTS, sources):
        clear = sources.points if light is sources else None
        measure = {"far": lambda s: s.far_field(VIEWS), "near": lambda s: s.near_field(5 * VIEWS)}
        found = ensemble(SMALL, light, measure, placements=43, seed=2, batches=4)
        for name, sensor in measure.items():
            moments = found[name]
            u = np.array([sensor(scatter(MONOPOLE, SMALL.placement(2, n, clear), light)).T for n in range(40)])
            assert moments.placements == 40
            assert moments.mean == pytest.approx(u.mean(axis=0), rel=1e-12)
            for j in range(2):
                pieces = [np.cov(b[..., 0].T, b[..., j].T)[:5, 5:] for b in u.reshape(4, 10, 5, 2)]
                assert moments.covariance[..., j] == pytest.approx(np.mean(pieces, axis=0), abs=1e-12)
                error = np.std([p.imag for p in pieces], axis=0, ddof=1) / 2
                assert moments.covariance_error[..., j].imag == pytest.approx(error, abs=1e-12)
            powers = np.array([np.var(b, axis=0, ddof=1) for b in u.reshape(4, 10, 5, 2)])
            assert moments.intensity_batches == pytest.approx(powers, rel=1e-11)
            assert moments.intensity_error == pytest.approx(powers.std(axis=0, ddof=1) / 2, rel=1e-11)
            diagonal = np.einsum("vvj->vj", moments.covariance)[:, 0]
            assert moments.intensity[:, 0] == pytest.approx(diagonal.real, rel=1e-11)


def test_workers_do_not_matter():
    measure = {"far": lambda s: s.far_field(VIEWS)}
    one, three = (
        ensemble(SMALL, LIGHTS, measure, placements=256, seed=1, workers=w, progress=w == 3)["far"] for w in (1, 3)
    )
    for name in Moments.__dataclass_fields__:
        assert np.array_equal(getattr(one, name), getattr(three, name)), name


# ---------------------------------------------------------------- physics
def measure_oracle_scene(oracle, placements, seed, *, cylinder=THIN, density=1.0, near=False) -> dict[str, Moments]:
    half = float(oracle["box_half"])
    gas = CylinderGas(cylinder, (-half, -half), (half, half), density * float(oracle["number_density"]))
    lights = PlaneLights(directions_of(np.deg2rad(oracle["light_deg"])))
    views = directions_of(np.deg2rad(oracle["view_deg"]))
    sensors = {"far": lambda s: s.far_field(views)}
    if near:
        sensors["near"] = lambda s: s.near_field(oracle["near_pos"])
    return ensemble(gas, lights, sensors, placements=placements, seed=seed)


def both(ours, theirs, batches):
    """Combined standard error of two independent estimates, and the fewest degrees of freedom (Welch)."""
    spread = ours**2 + theirs**2
    with np.errstate(invalid="ignore", divide="ignore"):
        degrees = spread**2 / (ours**4 / (batches - 1) + theirs**4 / (ORACLE_BATCHES - 1))
    return np.sqrt(spread), float(np.nanmin(degrees))


def parts(x):
    return np.stack([x.real, x.imag])


def assert_totals(far, oracle, scale=1.0):
    """Intensity over all directions, with its own batch error: neighbouring views are correlated."""
    step = 2 * np.pi / len(oracle["view_deg"])
    ours, theirs = far.intensity_batches.sum(axis=1) * step * scale, oracle["I_var_batches"].sum(axis=0).T * step
    errors = (x.std(axis=0, ddof=1) / np.sqrt(len(x)) for x in (ours, theirs))
    error, degrees = both(*errors, len(ours))
    assert_z(ours.mean(axis=0), theirs.mean(axis=0), error, degrees=degrees)


def assert_means(far, oracle):
    """Entry by entry, and along the stored mean, where all views together show an error of the scale."""
    batches, stored = far.mean_batches, oracle["mean"]
    error, degrees = both(parts(far.mean_error), np.stack([oracle["mean_se_re"], oracle["mean_se_im"]]), len(batches))
    assert_z(parts(far.mean), parts(stored), error, degrees=degrees)
    along = np.einsum("vl,bvl->bl", stored.conj(), batches).real / np.sum(np.abs(stored) ** 2, axis=0)
    own = along.std(axis=0, ddof=1) / np.sqrt(len(batches))
    theirs = own * np.sqrt(far.placements / 20_000)  # the stored run's share, for want of its batches
    error, degrees = both(own, theirs, len(batches))
    assert_z(along.mean(axis=0), 1, error, degrees=degrees)


def assert_entries(covariance, covariance_error, stored, real, imaginary, batches):
    """Largest |z| over all entries: Bonferroni's bound holds for any correlation among them."""
    error, degrees = both(parts(covariance_error), np.stack([real, imaginary]), batches)
    assert_z(parts(covariance), parts(stored), error, degrees=degrees, slack=STORED)


def assert_rms(value, batches, stored, stored_error):
    """Mean of z^2 against chi-squared with the effective number of entries, from the batches' own correlations."""
    count, size = len(batches), value.size
    error, degrees = both(batches.std(axis=0, ddof=1) / np.sqrt(count), stored_error, count)
    square = np.mean(np.square((value - stored) / error))
    deviates = (batches - batches.mean(axis=0)).reshape(count, -1)
    deviates /= deviates.std(axis=0, ddof=1)
    gram = deviates @ deviates.T / (count - 1)
    independent = size**2 / (np.sum(gram**2) - size**2 / (count - 1))
    mean = degrees / (degrees - 2)  # of t squared; its variance is (d - 1) / (d - 4) times that of a normal z
    independent *= (degrees - 4) / (degrees - 1)
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], independent) / independent
    assert low < square / mean < high, f"mean z^2 = {square:.3f}, allowed {low * mean:.3f} to {high * mean:.3f}"


def assert_far(far, oracle):
    count = len(far.intensity_batches)
    assert_totals(far, oracle)
    assert_means(far, oracle)
    assert_rms(far.intensity, far.intensity_batches, oracle["I_var"], oracle["I_var_se"])
    stored = (oracle["C"], oracle["C_se_re"], oracle["C_se_im"])
    assert_entries(far.covariance, far.covariance_error, *stored, count)


@pytest.mark.slow
def test_oracle_scene(oracle):
    far = measure_oracle_scene(oracle, 1024, seed=11)["far"]
    assert_far(far, oracle)
    for scale in (0.97, 1.03):  # in absolute units: 3 % more or less scattered power is caught
        with pytest.raises(AssertionError, match="z ="):
            assert_totals(far, oracle, scale)


def test_power_against_a_wrong_cross_section(oracle):
    """Off resonance, c_s 3 % smaller, the same number of cylinders."""
    excess = lambda index: Cylinder(THIN.radius, index).cross_section / THIN.cross_section - 0.97  # noqa: E731
    detuned = Cylinder(THIN.radius, brentq(excess, 0.8 * THIN.index, THIN.index))
    far = measure_oracle_scene(oracle, 256, seed=11, cylinder=detuned)["far"]
    with pytest.raises(AssertionError, match="z ="):
        assert_means(far, oracle)


@pytest.mark.slow
def test_oracle_scene_from_fresh_placements(oracle):
    """All of it, near field included, at the stored run's own precision."""
    found = measure_oracle_scene(oracle, 20_000, seed=2019, near=True)
    assert_far(found["far"], oracle)
    near, count = found["near"], len(found["near"].intensity_batches)
    assert_rms(near.intensity, near.intensity_batches, oracle["near_I_var"], oracle["near_I_var_se"])
    stored = (oracle["near_C"], oracle["near_C_se_re"], oracle["near_C_se_im"])
    assert_entries(near.covariance, near.covariance_error, *stored, count)
    error = parts(near.mean_error) * np.sqrt(2)  # the stored run has as many placements, and keeps no error
    assert_z(parts(near.mean), parts(oracle["near_mean_scattered"]), error, degrees=count - 1)


def test_effective_wavenumber():
    """2 Im K = n c_s and Re K = k, up to terms of order (n c_s / k)^2; |exp(iKr)|^2 loses what is scattered."""
    gas = CylinderGas.with_mean_free_path(MONOPOLE, (-9.0, -9.0), (9.0, 9.0), 10.0)
    k, second = MONOPOLE.wavenumber, (0.1 / MONOPOLE.wavenumber) ** 2
    assert foldy_wavenumber(gas) == pytest.approx(k + 0.05j, rel=second)
    assert gas.mean_free_path == pytest.approx(10, rel=1e-14)


def test_mean_field_inside_decays_as_in_the_effective_medium():
    """A short path of A06: decay and phase within noise; a wrong decay is caught."""
    gas = CylinderGas.with_mean_free_path(MONOPOLE, (-8.0, -8.0), (8.0, 8.0), 4.0)
    field = coherent_field(gas, np.arange(1.0, 7.0), placements=256, seed=1)
    decay, error = field.decay()
    assert_z(decay, foldy_wavenumber(gas).imag, error, degrees=63)
    assert_z(*(field.phase()[0], 0), field.phase()[1], degrees=63)
    refute_z(decay, 1 / gas.mean_free_path, error, degrees=63)  # two attenuation factors
