"""The atlas of memory-effect correlations: a distribution, continuous, right within bounds."""

import hashlib

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import j0
from zscore import assert_z, refute_z

from specklegen.core.statistics import jackknife
from specklegen.datasets.recipes.parts.material import Material, known
from specklegen.memory_effects import atlas
from specklegen.memory_effects.atlas import Errors, atlas_correlation, atlas_errors, correlation_for
from specklegen.memory_effects.correlation import (
    MemoryEffectCorrelation,
    axial_tracer,
    contributions,
    estimate_correlation,
    lateral_distance,
)
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein, Isotropic, Mixture, VonMisesFisher


def slab(depth, g, albedo=1.0, thickness=1.0) -> Slab:
    return Slab(thickness=thickness, mean_free_path=thickness / depth, albedo=albedo, scatterer=HenyeyGreenstein(g=g))


def fog(depth, g, albedo=1.0) -> Slab:
    """A slab of von Mises-Fisher lobes; 1 - g = 1 / kappa where narrow."""
    scatterer = VonMisesFisher(concentration=brentq(lambda k: VonMisesFisher(concentration=k).g - g, 1e-3, 1e4))
    return Slab(thickness=1.0, mean_free_path=1 / depth, albedo=albedo, scatterer=scatterer)


def served(medium: Slab, tolerance: float = np.inf) -> MemoryEffectCorrelation:
    kernel = atlas_correlation(medium, tolerance)
    assert kernel is not None
    return kernel


def stated(medium: Slab) -> Errors:
    errors = atlas_errors(medium)
    assert errors is not None
    return errors


def materials(count: int, seed: int, make=slab, low=0.0, high=0.98) -> list[Slab]:
    """Random materials: OD 0.5 ... 60, g 0 ... 0.98, albedo 0.9 ... 1, a third of them without absorption."""
    rng = np.random.default_rng(seed)
    depth, drop = np.exp(rng.uniform(np.log(0.5), np.log(60), count)), rng.uniform(0, 1, count)
    g = np.where(rng.random(count) < 0.5, low + (high - low) * drop, 1 - (1 - low) * ((1 - high) / (1 - low)) ** drop)
    loss = np.where(rng.random(count) < 1 / 3, 0.0, 10 ** rng.uniform(-4, -1, count))
    return [make(*values) for values in zip(depth, g, 1 - loss, strict=True)]


def fresh_sums(medium: Slab, q: np.ndarray, paths: int, rounds: int) -> np.ndarray:
    """Batches float64[64 rounds, len(q) + 1] of E[w J0(q r)] and E[w] per path, from new paths."""
    rows = []
    for n in range(rounds):
        kernel = estimate_correlation(medium, paths, (20, n), threads=1)
        sums = np.column_stack([kernel.weights @ j0(np.outer(kernel.radius, q)), kernel.weights.sum(axis=1)])
        rows.append(sums / (rounds * paths))
    return np.concatenate(rows)


def correlation(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """C_I and its standard error."""
    return jackknife(sums, lambda s: (s[:-1] / s[-1]) ** 2)


def wavevectors(kernel: MemoryEffectCorrelation) -> np.ndarray:
    """q from 0 to where C_I is within 0.01 of its floor for good."""
    q = np.linspace(0, 60, 241) * min(kernel.half_range(), 1e6) / 4
    high = np.flatnonzero(np.abs(kernel(q) ** 2 - kernel.single_share**2) > 0.01)
    return q[: high[-1] + 2]


@pytest.mark.parametrize("name", [atlas.HENYEY_GREENSTEIN, atlas.FORWARD, atlas.VON_MISES_FISHER])
def test_layout(name):
    table = atlas.load(name)
    assert np.isfinite(table.table).all()
    assert (table.bounds >= 0).all()
    assert (table.shares > 0).all()
    assert table.shares.sum() == pytest.approx(1, abs=1e-12)
    for axis in table.axes:
        assert (np.diff(axis) > 0).all()
    assert table.absorptions[0] == 0


def test_promised_range_is_inside():
    for depth in (0.5, 60.0):
        for g in (-0.5, 0.0, 0.98):
            assert atlas_errors(slab(depth, g)) is not None
        for g in (0.99, 0.999):
            assert atlas_errors(slab(depth, g)) is not None
            assert atlas_errors(fog(depth, g)) is not None
        assert atlas_errors(fog(depth, 0.05)) is not None


def test_families_without_a_table_are_traced():
    mixed = Mixture(types=(Isotropic(), HenyeyGreenstein(g=0.9)), fractions=(0.5, 0.5))
    assert atlas_errors(Slab(thickness=1.0, mean_free_path=0.2, scatterer=mixed)) is None


OUTSIDE = [(0.39, 0.5), (65, 0.5), (5, 0.9991), (5, -0.61), (60, 0.0, 0.9), (5, 0.5, 0.0), (5, 0.5, 0.01)]


@pytest.mark.parametrize("parameters", OUTSIDE)
def test_outside_is_none(parameters):
    outside = slab(*parameters)
    assert atlas_errors(outside) is None
    assert atlas_correlation(outside, tolerance=np.inf) is None


def test_tolerance_decides():
    medium = slab(3.3, 0.7)
    errors = stated(medium)
    assert atlas_correlation(medium, 1.001 * errors.correlation) is not None
    assert atlas_correlation(medium, 0.999 * errors.correlation) is None
    assert atlas_correlation(medium, 0.0) is None


# What a kernel must be
@pytest.mark.parametrize("medium", materials(12, seed=1))
def test_positive_semidefinite_and_normalised(medium):
    kernel = atlas_correlation(medium, np.inf)
    if kernel is None:
        pytest.skip("outside the table")
    assert kernel(0.0) == pytest.approx(1, abs=1e-14)
    assert (kernel.weights >= 0).all()
    assert (kernel.radius >= 0).all()
    rng = np.random.default_rng(3)
    reach = 1 / np.sqrt(kernel.mean_square_radius)
    for spread in (0.3, 3.0, 30.0, 1e4):
        matrix = kernel.matrix(rng.normal(size=(40, 2)) * spread * reach, 1.0)
        assert np.linalg.eigvalsh(matrix).min() > -1e-13 * 40  # rounding of 40 x 40 entries
    far = kernel(1e5 * reach)
    assert abs(far - kernel.single_share) < 0.02  # no end: K goes to its floor


def test_negative_radii_would_not_pass_but_weights_can():
    """Power: a mixture with a negative weight is not positive semidefinite, and the test above sees it."""
    kernel = MemoryEffectCorrelation(np.array([0.5, 1.0]), np.array([[1.2, -0.2]]), 1, 0.0)
    sines = np.random.default_rng(3).normal(size=(40, 2)) * 3
    difference = np.linalg.norm(sines[:, None] - sines[None], axis=-1)
    matrix = j0(difference[..., None] * kernel.radius) @ kernel.weights[0]
    assert np.linalg.eigvalsh(matrix).min() < -1e-3


@pytest.mark.parametrize(("make", "g", "wide"), [(slab, 0.9851, 0.03), (fog, 0.5, 1e-6)])
def test_no_step_where_tables_meet(make, g, wide):
    """Between the two of Henyey and Greenstein both bounds together, and a step of 2e-4 in g."""
    below, above = served(make(5.0, g - 2e-4)), served(make(5.0, g))
    q = wavevectors(above)
    limit = stated(make(5.0, g - 2e-4)).correlation + stated(make(5.0, g)).correlation + wide
    assert np.abs(below(q) ** 2 - above(q) ** 2).max() < limit


def test_the_digest_is_that_of_the_tables_that_serve():
    """Of a recipe within the first table as ever; others change where another table takes part."""
    first = hashlib.sha256(atlas.file_of(atlas.HENYEY_GREENSTEIN).read_bytes()).hexdigest()
    assert atlas.atlas_digest([slab(5.0, 0.5), slab(5.0, 0.97)]) == first
    others = {atlas.atlas_digest([slab(5.0, 0.5), slab(5.0, 0.99)]), atlas.atlas_digest([fog(5.0, 0.9)]), first}
    assert len(others) == 3


def test_scales_with_thickness():
    small, large = served(slab(7.0, 0.8)), served(slab(7.0, 0.8, thickness=1000.0))
    q = np.linspace(0, 20, 50)
    np.testing.assert_allclose(large(q / 1000), small(q), atol=1e-12)
    np.testing.assert_allclose(large.weights, small.weights, rtol=1e-12)


def test_continuous_across_cells():
    """Steps of 1e-9 in each parameter, at nodes and between: changes of the same order, no jumps."""
    table = atlas.load()
    q = np.linspace(0, 30, 60)
    for i, j in ((3, 4), (11, 9), (1, 1), (21, 15)):
        depth, drop = table.depths[i], table.drops[j]
        loss = atlas.loss_at(table.absorptions[2], depth, drop)
        for depth_step, drop_step, loss_step in np.vstack([np.eye(3), np.ones(3)]) * 1e-9:
            steps = [1 + sign * np.array([depth_step, drop_step, loss_step]) for sign in (-1, 1)]
            below, above = (served(slab(depth * d, 1 - drop * u, np.exp(-loss * a))) for d, u, a in steps)
            np.testing.assert_allclose(below(q), above(q), atol=1e-6)
            assert below.weights.sum() == pytest.approx(above.weights.sum(), rel=1e-6)
            assert below.single_share == pytest.approx(above.single_share, rel=1e-6)


@pytest.mark.parametrize("make", [slab, fog])
def test_single_scattering_is_exact(make):
    """The closed form of the single part, against new paths; a 5 % error of it is caught."""
    medium = make(1.0, 0.5, 0.95)
    kernel = served(medium)
    runs = [estimate_correlation(medium, 20_000, (21, n), threads=1) for n in range(64)]
    shares = np.array([k.single_share * k.weights.sum() / k.paths for k in runs])
    expected, error = kernel.weights[0, 0], shares.std(ddof=1) / 8
    assert_z(shares.mean(), expected, error, degrees=63)
    refute_z(shares.mean(), 1.05 * expected, error, degrees=63)


# Against new paths
def agreement(medium: Slab, paths: int, rounds: int) -> dict[str, float]:
    """Differences of the atlas from new paths, their errors, and how far they lie beyond the bounds stated (z)."""
    kernel, errors = served(medium), stated(medium)
    q = wavevectors(kernel)
    sums = fresh_sums(medium, q, paths, rounds)
    value, error = correlation(sums)
    parts = np.stack([sums[:, -1], np.full(len(sums), 1 / len(sums))], axis=1)
    bright, bright_error = map(float, jackknife(parts, lambda total: np.log(total[0] / total[1])))
    difference = np.abs(kernel(q) ** 2 - value)
    light = abs(float(np.log(kernel.weights.sum())) - bright)
    return {"difference": float(difference.max()), "error": float(error.max()), "bound": errors.correlation,
            "z": float((np.maximum(difference - errors.correlation, 0)[1:] / error[1:]).max()), "light": light,
            "light_error": bright_error, "light_bound": errors.intensity,
            "light_z": max(light - errors.intensity, 0) / bright_error}  # fmt: skip


@pytest.mark.parametrize("medium", [slab(0.5, 0.98), slab(2.1, 0.969), slab(10.0, 0.9), slab(1e-3, 0.0)])
def test_bins_of_estimates_lose_nothing(medium):
    """The histogram of r against the sum over the same paths: thin forward-scattering slabs have tiny r."""
    tracer = axial_tracer(medium)
    bank = tracer.trace(3, 20_000, threads=1)
    kernel = estimate_correlation(medium, 20_000, 3, threads=1)
    radius, weight = lateral_distance(bank), contributions(tracer.layout, bank)
    q = np.geomspace(0.03, 30, 20) / np.sqrt(kernel.mean_square_radius)
    whole = (j0(np.outer(q, radius)) @ weight / weight.sum()) ** 2
    np.testing.assert_allclose(kernel(q) ** 2, whole, atol=2e-3)  # 3 % wide bins; 0.2 where r falls off their end


@pytest.mark.parametrize("medium", [slab(1.3, 0.2), slab(4.5, 0.9), slab(9.0, 0.85, 0.995), slab(12.0, 0.0),
                                    slab(7.0, 0.994), slab(4.0, 0.988, 0.99), slab(4.0, 0.9, 0.9), fog(1.7, 0.3),
                                    fog(4.5, 0.9), fog(9.0, 0.85, 0.995), fog(12.0, 0.1), fog(7.0, 0.994),
                                    fog(3.0, 0.9985)])  # fmt: skip
def test_agrees_with_new_paths(medium):
    """Within the stated bound, and the errors of the new paths."""
    found = agreement(medium, 150_000, 1 if medium.albedo > 0.95 else 5)
    assert found["bound"] <= 0.02
    assert found["z"] < 5.4, found  # Student's t, 63 degrees, 1e-6
    assert found["light_z"] < 5.4, found


def test_agreement_has_power():
    """A g wrong by 0.03 is caught, and light that is off by 2 %."""
    found = agreement(slab(4.0, 0.9, 0.9), 150_000, 5)
    assert (0.02 - found["light"] - found["light_bound"]) / found["light_error"] > 5.4
    wrong, right = served(slab(4.5, 0.87)), slab(4.5, 0.9)
    q = wavevectors(wrong)
    value, error = correlation(fresh_sums(right, q, 150_000, 1))
    assert ((np.abs(wrong(q) ** 2 - value) - 0.01)[1:] / error[1:]).max() > 5.4


# From wherever it is cheapest
def test_a_correlation_says_where_it_is_from():
    inside, outside = slab(4.5, 0.9), slab(0.2, 0.5)
    assert correlation_for(inside).source == "atlas"
    assert correlation_for(outside, paths=3000).source == "estimate"
    assert correlation_for(inside, paths=2000, tolerance=0.0).source == "estimate"


def test_a_material_takes_its_kernel_from_the_atlas():
    material = Material(wavelength=0.5, thickness=1000.0, optical_depth=10.0, g=0.9, kernel="atlas")
    (medium,) = material.extremes()
    served, traced = known(medium, 20_000, material.kernel), known(medium, 20_000)
    assert (served.correlation.source, traced.correlation.source) == ("atlas", "estimate")
    assert served.half_range == pytest.approx(traced.half_range, rel=0.1)
    assert Material(wavelength=0.5, thickness=1.0, optical_depth=1.0, g=0.5).kernel == "estimate"
    with pytest.raises(ValueError, match="Material.kernel must be"):
        Material(wavelength=0.5, thickness=1.0, optical_depth=1.0, g=0.5, kernel="guess")  # type: ignore[arg-type]


def test_stated_errors():
    """One row of weights has no batches: the error is the stated one, and nothing at q = 0."""
    medium = slab(4.5, 0.9)
    kernel, errors = served(medium), stated(medium)
    value, lost, error = kernel.intensity(np.array([0.0, 5.0]))
    assert (value[0], lost[0], error[0]) == (1.0, 0.0, 0.0)
    assert error[1] == errors.correlation / 2
    assert value[1] == pytest.approx(float(kernel(5.0)) ** 2, abs=1e-12)
