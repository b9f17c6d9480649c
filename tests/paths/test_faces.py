"""Slabs whose faces reflect: Fresnel's formulas, energy, reciprocity, closed forms, and the figures of another program.

The table is of an independent Monte Carlo program with standard errors of at most 0.004 (docs/physics.md 11).
"""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.integrate import quad
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.statistics import BATCHES, batch_sums, jackknife
from specklegen.mean.field import ballistic_fraction, mean_field, straight_through
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.paths.analog_walk import transmittance
from specklegen.paths.endpoint_factors import contributions, endpoint_factors, multiple_amplitudes
from specklegen.paths.endpoints import AXIS
from specklegen.paths.faces import both_reflectances, crossing_factors, reflectance
from specklegen.paths.layout import plane_layout
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.slab_tracer import SlabTracer, trace
from specklegen.paths.tracer import plane_tracer
from specklegen.synthesis.spectrum import estimate_spectral_correlation
from specklegen.theory import slab as theory

DEGREES = BATCHES - 1
L = 1000.0


def slab(optical_depth=10.0, g=0.0, index=1.5, albedo=1.0, thickness=L, **faces):
    return sg.Slab(thickness=thickness, mean_free_path=thickness / optical_depth, albedo=albedo,
                   scatterer=sg.HenyeyGreenstein(g=g) if g else sg.Isotropic(),
                   faces=sg.Faces(inside=index, **faces))  # fmt: skip


def direction(x, z=1.0, y=0.0):
    return np.array([x, y, np.sign(z) * np.sqrt(1 - x**2 - y**2)])


# ---- Fresnel --------------------------------------------------------------------------------------------
def literal(mu, inside, outside):
    """R_s and R_p float64[2, ...] by complex amplitudes, as textbooks have them."""
    nu = np.sqrt(1 - (inside / outside) ** 2 * (1 - mu**2) + 0j)
    s = (inside * mu - outside * nu) / (inside * mu + outside * nu)
    p = (outside * mu - inside * nu) / (outside * mu + inside * nu)
    return np.abs([s, p]) ** 2


@pytest.mark.parametrize("index", [1.33, 1.5, 3.0, 0.7, 1 + 1e-6])
def test_reflectance_is_that_of_textbooks(index):
    mu = np.linspace(1e-6, 1, 2001)
    faces = sg.Faces(inside=index)
    np.testing.assert_allclose(both_reflectances(faces, mu), literal(mu, index, 1.0), rtol=1e-9, atol=1e-15)
    assert reflectance(faces, np.array(1.0)) == pytest.approx(((index - 1) / (index + 1)) ** 2, rel=1e-9)
    # From either side of a face the same share crosses: what comes out of it at the other angle.
    out = np.sqrt(np.clip(1 - index**2 * (1 - mu**2), 0, None))
    crossing = out > 1e-3
    back = reflectance(sg.Faces(inside=1.0, outside=index), out[crossing])
    np.testing.assert_allclose(back, reflectance(faces, mu[crossing]), rtol=1e-6, atol=1e-14)


def test_a_wall_adds_the_echoes_of_both_its_faces():
    mu = np.linspace(0.75, 1, 7)
    glass = np.sqrt(1 - (1.33 / 1.52) ** 2 * (1 - mu**2))
    first, second = literal(mu, 1.33, 1.52), literal(glass, 1.52, 1.0)
    through = sum((1 - first) * (first * second) ** n * (1 - second) for n in range(60))
    found = both_reflectances(sg.Faces(inside=1.33, wall=1.52), mu)
    np.testing.assert_allclose(found, 1 - through, rtol=1e-12)
    assert np.array_equal(reflectance(sg.Faces(inside=1.33, wall=1.33), mu), reflectance(sg.Faces(inside=1.33), mu))


# ---- Matched faces, and the way there -------------------------------------------------------------------
def test_matched_faces_are_none():
    plain = sg.Slab(thickness=9.0, mean_free_path=2.0, scatterer=sg.Isotropic())
    same = plain.replace(faces=sg.Faces(inside=1.4, outside=1.4))
    assert "faces" not in plain.canonical_json()
    assert same.faces.matched
    assert plain.replace(faces=sg.Faces()) == plain
    for faces in (sg.Faces(inside=1.33), sg.Faces(wall=1.5)):
        other = plain.replace(faces=faces)
        assert other.fingerprint() != plain.fingerprint()
        assert other.unitless_fingerprint() != plain.unitless_fingerprint()
        assert sg.Slab.from_json(other.canonical_json()) == other
        assert sg.Slab.from_toml(other.to_toml()) == other


@pytest.mark.parametrize("g", [0.0, 0.9])
def test_an_index_near_one_leaves_every_path_where_it_was(g):
    """Reflections are drawn beside the walk's own random numbers: paths of a step of 1e-9 are those of none."""
    one, other = (slab(5.0, g, index, albedo=0.99) for index in (1.0, 1 + 1e-9))
    proposal = plane_proposal(one, AXIS, AXIS[None])
    plain, stepped = (trace(medium, proposal, 3, 400) for medium in (one, other))
    assert np.array_equal(plain.orders, stepped.orders)
    np.testing.assert_allclose(stepped.records, plain.records, rtol=1e-12, atol=1e-9)
    assert not stepped.bounces.any()


# ---- Energy and reciprocity -----------------------------------------------------------------------------

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # 14 give the same to eight digits


def power(medium, side, paths, seed, light=AXIS):
    """Light that leaves on one side over all directions of the escape cone, and what is absorbed, of each path."""
    low = np.sqrt(1 - medium.faces.largest_sine**2)
    t, dt = (NODES + 1) / 2, WEIGHTS / 2
    mu, weight = low + (1 - low) * t**2, 2 * t * dt * (1 - low)
    views = np.array([direction(np.sqrt(1 - m**2), side) for m in mu])
    bank = trace(medium, plane_proposal(medium, light, views), seed, paths)
    layout = plane_layout(medium, 1.0, light[None], views)
    found = sum(
        2 * np.pi * w * np.bincount(bank.paths, contributions(layout.at(light, view), bank), paths)
        for w, view in zip(weight, views, strict=True)
    )
    entered = np.square(np.abs(endpoint_factors(layout, bank, layout.lights, "entry")[0])) * bank.weight
    collisions = np.where(bank.bounces[:, 1] == 0, entered, 0) / medium.albedo  # every vertex once
    return found, (1 - medium.albedo) * np.bincount(bank.paths, collisions, paths)


def scattered(medium):
    """Share of the incident light that enters and collides, in closed form."""
    r, straight = float(reflectance(medium.faces, np.array(1.0))), np.exp(-medium.optical_depth)
    return (1 - r) * (1 - straight) / (1 - r * straight)


@pytest.mark.parametrize(
    ("optical_depth", "g", "index", "albedo", "paths"),
    [(3.0, 0.0, 1.33, 1.0, 4000), (3.0, 0.9, 1.5, 0.9, 3000), (0.5, 0.0, 1.5, 1.0, 12_000), (3.0, 0.0, 0.8, 0.5, 3000)]
    + [
        pytest.param(10.0, g, index, albedo, 40_000, marks=pytest.mark.slow)
        for g in (0.0, 0.9) for index, albedo in ((1.33, 1.0), (1.5, 0.99))
    ],
)  # fmt: skip
def test_energy_closes(optical_depth, g, index, albedo, paths):
    """Surface + reflected + transmitted + absorbed = 1: what collides comes out or stays."""
    medium = slab(optical_depth, g, index, albedo)
    (through, lost), (back, _) = power(medium, 1, paths, 3), power(medium, -1, paths, 4)
    total = (through + lost).mean() + back.mean()
    error = np.hypot((through + lost).std(), back.std()) / np.sqrt(paths)
    assert_z(total, scattered(medium), error, slack=1e-3)
    if optical_depth < 1:  # power: 4 % turned back on the way in, and forgotten
        refute_z(total, scattered(medium) / 0.96, error, slack=1e-3)


def test_both_ways_through_are_alike():
    """Reciprocity: light along i seen at v, and light along -v seen at -i; in transmission, mirrored about the slab."""
    medium, i, v = slab(4.0, 0.5), direction(0.3), direction(0.0, 1.0, -0.2)
    for side in (1.0, -1.0):
        seen = v * np.array([1, 1, side])
        back, out = (direction(*(-seen[:2])[:1], 1.0, -seen[1]), -i) if side < 0 else (None, None)
        if side > 0:  # turned upside down: -v enters from above, which is mirrored in z
            back, out = direction(-v[0], 1.0, -v[1]), direction(-i[0], 1.0, -i[1])
        one, other = intensity(medium, i, seen, 5), intensity(medium, back, out, 6)
        assert_z(one[0], other[0], np.hypot(one[1], other[1]))


def intensity(medium, light, view, seed, paths=20_000):
    """Intensity at a view and its error."""
    tracer = plane_tracer(medium, 1.0, light[None], view[None], False)
    bank = tracer.trace(seed, paths)
    sums = batch_sums(contributions(tracer.layout, bank), bank.paths, paths).real * BATCHES / paths
    return sums.mean(), sums.std(ddof=1) / np.sqrt(BATCHES)


def test_legs_keep_either_polarisation():
    """What lights and views gain after 0 to 15 reflections; a hundredth of it is caught, as means at each face are."""
    faces, views = sg.Faces(inside=1.5), np.array([direction(sine) for sine in (0.0, 0.3, 0.56, 0.664)])
    r, m = literal(views[:, 2], 1.5, 1.0)[..., None], np.arange(16)
    found, expected = np.square(crossing_factors(faces, views, m)), ((1 - r) * r**m).mean(axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    mean = r.mean(axis=0)
    assert (np.abs((1 - mean) * mean**m / expected - 1)[2:, 1:] > 0.01).all()


@pytest.mark.parametrize(("side", "sine"), [(1.0, 0.25), (-1.0, 0.25), (1.0, 0.66), (-1.0, 0.66)])
def test_single_scattering_is_the_sum_over_its_images(side, sine):
    """All numbers of reflections of either leg, by quadrature over the depth; light falls at 22 or 82 degrees outside.

    Both polarisations are followed apart along a leg, and are alike behind the scattering.
    """
    medium, light = slab(0.4 if sine < 0.5 else 0.1, 0.6, 1.5, albedo=0.8, thickness=1.0), direction(sine)
    view = direction(-0.4 if sine < 0.5 else -0.6, side)
    (r, s), sigma = (literal(abs(v[2]), 1.5, 1.0) for v in (light, view)), medium.extinction
    lobe, total = medium.scatterer, 0.0
    for m in range(16):
        for n in range(16):
            up = (side > 0) == (n % 2 == 0)
            cos = light[:2] @ view[:2] + light[2] * abs(view[2]) * (-1) ** m * (1 if up else -1)

            def way(z, m=m, n=n, up=up):
                into = (z if m % 2 == 0 else 1 - z) + m
                out = (1 - z if up else z) + n
                return np.exp(-sigma * (into / light[2] + out / abs(view[2])))

            depths = quad(way, 0, 1, epsabs=1e-12)[0]
            once = 0.8 * sigma * lobe.amplitude(cos) ** 2 * depths / light[2]
            total += ((1 - r) * r**m).mean() * ((1 - s) * s**n).mean() * once
    tracer = plane_tracer(medium, 1.0, light[None], view[None], False)
    bank = tracer.trace(7, 40_000).single
    found = batch_sums(contributions(tracer.layout, bank), bank.paths, 40_000).real * BATCHES / 40_000
    error, slack = found.std(ddof=1) / np.sqrt(BATCHES), 3e-4 * total
    assert_z(found.mean(), total, error, degrees=DEGREES, slack=slack)
    if side < 0 and sine < 0.5:  # power: without the images behind the far face it is too faint
        plain = contributions(tracer.layout, bank.select(~bank.bounces.any(axis=1))).sum() / 40_000
        refute_z(plain, total, error, degrees=DEGREES, slack=slack)


# ---- Figures of another program -------------------------------------------------------------------------

Q = np.array([0.5, 1.0, 1.491, 2.742])
TABLE = {  # (optical depth, g, index): C_I at Q, half range q with the error of its last digit
    (10, 0.0, 1.0): ([0.909, 0.691, 0.458, 0.108], (1.40, 0.005)),
    (10, 0.0, 1.33): ([0.878, 0.609, 0.357, 0.060], (1.20, 0.005)),
    (10, 0.0, 1.5): ([0.861, 0.567, 0.311, 0.044], (1.11, 0.005)),
    (20, 0.0, 1.33): ([0.899, 0.661, 0.416, 0.079], None),
    (20, 0.0, 1.5): ([0.888, 0.632, 0.380, 0.063], None),
    (10, 0.9, 1.0): ([0.955, 0.863, 0.775, 0.608], (3.9, 0.05)),
    (10, 0.9, 1.33): ([0.820, 0.611, 0.502, 0.378], (1.56, 0.02)),
    (10, 0.9, 1.5): ([0.730, 0.491, 0.388, 0.284], (0.98, 0.01)),
}
ERROR = 0.004


def check_table(case, paths):
    optical_depth, g, index = case
    expected, half = TABLE[case]
    kernel = estimate_correlation(slab(optical_depth, g, index), paths, 1)
    found, _, error = kernel.intensity(Q / L)
    assert_z(found, expected, np.hypot(error, ERROR), degrees=DEGREES)
    if half:
        check_half_range(kernel, *half)
    return found, np.hypot(error, ERROR)


def check_half_range(kernel, half, digit):
    """C_I at the half range of the table is half way to the floor, within both errors and that of its digits."""
    found, _, error = kernel.intensity(np.array([half - digit, half, half + digit]) / L)
    level = 0.5 * (1 + kernel.single_share**2)
    assert_z(found[1], level, np.hypot(np.hypot(error[1], ERROR), np.ptp(found) / 2), degrees=DEGREES)


@pytest.mark.parametrize("case", TABLE, ids=str)
def test_memory_effect_behind_faces(case):
    found, error = check_table(case, 40_000 if case[0] == 10 else 15_000)
    # Power: matched faces are refused.
    matched, _ = TABLE.get((*case[:2], 1.0), (None, None))
    if matched and case[2] > 1:
        refute_z(found, matched, error, degrees=DEGREES)


@pytest.mark.parametrize(("index", "expected", "error"), [(1.0, 1.31, 0.005), (1.33, 2.35, 0.02), (1.5, 3.3, 0.05)])
def test_trapped_light_comes_out_late(index, expected, error):
    """Mean path length over the thickness, of forward scattering at OD 10."""
    found = estimate_spectral_correlation(slab(10.0, 0.9, index), 60_000, 3)
    sums = np.stack([found.weights @ found.excess, found.weights.sum(axis=1)], axis=1)
    value, own = jackknife(sums, lambda total: 1 + total[:1] / total[1:] / L)
    assert_z(value, expected, np.hypot(own, error), degrees=DEGREES)


@pytest.mark.parametrize(
    ("optical_depth", "index", "slack", "paths"),
    [(10, 1.33, 0.015, 40_000), (20, 1.5, 0.004, 20_000)]
    + [pytest.param(20, n, 0.004, 600_000, marks=pytest.mark.slow) for n in (1.0, 1.33, 1.4, 1.5)]
    + [pytest.param(10, n, 0.015, 600_000, marks=pytest.mark.slow) for n in (1.0, 1.33, 1.4, 1.5)],
)
def test_isotropic_scatterers_follow_diffusion(optical_depth, index, slack, paths):
    kernel, q = estimate_correlation(slab(optical_depth, 0.0, index), paths, 2), np.append(Q, 4.0)
    found, _, error = kernel.intensity(q / L)
    expected = theory.memory_effect_at_faces(q, optical_depth, theory.extrapolation_at_faces(index))
    assert_z(found, expected, error, degrees=DEGREES, slack=slack)


ENTERED = [  # (optical depth, g, index, share of the light that entered and goes through)
    (10, 0.0, 1.0, 0.147), (10, 0.0, 1.33, 0.2030), (10, 0.0, 1.5, 0.2335), (20, 0.0, 1.33, 0.1148),
    (20, 0.0, 1.5, 0.1400), (10, 0.9, 1.0, 0.692), (10, 0.9, 1.33, 0.643), (10, 0.9, 1.5, 0.617),
]  # fmt: skip


@pytest.mark.parametrize(("optical_depth", "g", "index", "entered"), ENTERED)
def test_light_that_is_walked_goes_through_as_often(optical_depth, g, index, entered):
    """Without any connection: what turns back at a face does, and what leaves is counted."""
    found, error = transmittance(slab(optical_depth, g, index), 4000, 8)
    assert_z(found, entered, np.hypot(error, 0.004 * entered))
    if index > 1:  # power: half of the way to matched faces
        refute_z(found, entered * (0.75 if g == 0 else 1.1), np.hypot(error, 0.004 * entered))


def test_diffusion_behind_faces_has_its_figures():
    indices = (1.33, 1.4, 1.5)
    h = [theory.extrapolation_at_faces(n) for n in indices]
    np.testing.assert_allclose(h, [1.721, 2.009, 2.462], atol=6e-4)
    back = np.array([theory.internal_reflection(n) for n in indices])
    np.testing.assert_allclose(2 / 3 * (1 + back) / (1 - back), [1.677, 1.966, 2.419], atol=6e-4)
    # 2 % is what diffusion is off by at these depths.
    for optical_depth, g, index, entered in ENTERED:
        if g == 0:
            h = theory.extrapolation_at_faces(index)
            assert (1 + h) / (optical_depth + 2 * h) == pytest.approx(entered, rel=0.02)


# ---- Backscattering -------------------------------------------------------------------------------------
def cone(medium, angles, paths, seed=1):
    """Enhancement by reversed paths at ``angles`` off -i, wavelength 2 pi mean free paths over 500, and its error."""
    wavelength = 2 * np.pi * medium.mean_free_path / 500
    views = np.array([direction(np.sin(a), -1.0) for a in angles])
    tracer = plane_tracer(medium, wavelength, AXIS[None], views, True)
    bank = tracer.trace(seed, paths)
    single = contributions(tracer.layout.at(AXIS, -AXIS), bank.single)
    once = batch_sums(single, bank.single.paths, paths).real
    many = bank.multiple
    both = multiple_amplitudes(tracer.layout, many, bidirectional=True, reverse=True)
    forward, backward = np.split(multiple_amplitudes(tracer.layout, many, bidirectional=True, reverse=False), 2, axis=1)
    coherent = batch_sums(np.square(np.abs(both)), many.paths, paths).real
    incoherent = batch_sums(np.square(np.abs(forward)) + np.square(np.abs(backward)), many.paths, paths).real
    sums = np.concatenate([coherent, incoherent, once[:, None]], axis=1)
    n = len(angles)
    return jackknife(sums, lambda t: (t[:n] + t[-1]) / (t[n:-1] + t[-1]))


@pytest.mark.parametrize(("index", "peak"), [(1.33, 1.930), (1.5, 1.945)])
def test_backscattering_is_enhanced(index, peak):
    """Twice the multiple scattering at -i, OD 40 (here 10, whose difference is below the error)."""
    found, error = cone(slab(40.0, 0.0, index), [0.0], 4000)
    assert_z(found, [peak], np.hypot(error, 0.002), degrees=DEGREES)


@pytest.mark.slow
@pytest.mark.parametrize(("index", "peak", "half"), [(1.0, 1.880, 0.41), (1.33, 1.930, 0.30), (1.5, 1.945, 0.25)])
def test_the_backscattering_cone(index, peak, half):
    """Half width k l theta inside: light that is turned back again comes out farther from where it entered."""
    angles = np.array([0.0, 0.8, 1.0, 1.2]) * np.array([1.0, half, half, half]) / 500
    found, error = cone(slab(40.0, 0.0, index), angles, 15_000)
    assert_z(found[0], peak, np.hypot(error[0], 0.002), degrees=DEGREES)
    share, slope = (found[1:] - 1) / (found[0] - 1), (found[3] - found[1]) / (0.4 * half * (found[0] - 1))
    digits = 0.005 * slope  # of the half width that is compared
    assert_z(share[1], 0.5, np.hypot(np.hypot(error[2], error[0] / 2) / (found[0] - 1), digits), degrees=DEGREES)
    refute_z(share[[0, 2]], 0.5, np.hypot(error[[1, 3]] / (found[0] - 1), digits), degrees=DEGREES)


def test_paths_weighed_both_ways_are_as_bright():
    """The balance heuristic over both ways, as intensities, against paths drawn one way."""
    medium, view = slab(1.0, 0.5, 1.5), direction(0.2, -1.0)
    tracer = SlabTracer(plane_layout(medium, 1.0, AXIS[None], view[None]), medium,
                        plane_proposal(medium, AXIS, view[None], bidirectional=True))  # fmt: skip
    bank = tracer.trace(9, 20_000)
    rest = np.square(np.abs(multiple_amplitudes(tracer.layout, bank.multiple, bidirectional=True, reverse=False)))
    values = np.concatenate([contributions(tracer.layout, bank.single), rest[0]])
    owners = np.concatenate([bank.single.paths, np.tile(bank.multiple.paths, 2)])
    found = batch_sums(values, owners, 20_000).real * BATCHES / 20_000
    one, error = intensity(medium, AXIS, view, 10, 40_000)
    assert_z(found.mean(), one, np.hypot(error, found.std(ddof=1) / np.sqrt(BATCHES)), degrees=DEGREES)


# ---- Samplers, mean, refusals ---------------------------------------------------------------------------
def scene(medium, sensor, tilts=(0.0, 1e-3), width=4000.0):
    beams = sg.CollimatedBeams(directions=[direction(t) for t in tilts], width=width)
    return sg.Scene(wavelength=0.5, medium=medium, illumination=beams, sensor=sensor)


def test_samplers_agree_behind_faces():
    medium = slab(3.0, 0.5, 1.5, thickness=60.0)
    few = scene(medium, sg.FarField(directions=[AXIS]), width=400.0)
    found = sg.covariance(few, paths=30_000)
    kernel = estimate_correlation(medium, 30_000, 4)
    intensity = kernel.weights.sum() / kernel.paths * 400.0**2
    assert_z(found.intensity[0, 0], intensity, found.standard_error[0, 0, 0, 0] * np.sqrt(2), slack=0.01 * intensity)
    fields = sg.render(few, sampler="paths", paths=1500, realizations=96, seed=2).field[:, 0, 0]
    powers = np.square(np.abs(fields))
    assert_z(powers.mean(), intensity, powers.std(ddof=1) / np.sqrt(96), degrees=95)
    curve = sg.memory_effect(medium, wavelength=0.5, tilts=[1e-3], paths=30_000)
    assert_z(kernel.intensity(np.array([2 * np.pi / 0.5 * 1e-3]))[0], curve.intensity, 1.5 * curve.standard_error)


def test_transforms_are_the_direct_sum_behind_faces():
    from specklegen.samplers.path_sums.direct import direct_field, path_phases
    from specklegen.samplers.path_sums.nufft import build_nufft_plan, nufft_field

    where = scene(slab(0.7, 0.5, 1.5, thickness=60.0), sg.FarFieldGrid(shape=(24, 24), pitch=2e-4), width=400.0)
    chosen = sg.plan(where, sampler="paths", paths=3000).chosen
    bank = chosen.tracer.trace(3, 3000)
    assert bank.bounces[:, 1].any()  # images take part
    phases = path_phases(chosen.tracer, bank, 3, 0, False)
    direct = direct_field(chosen.tracer.layout, bank, phases)
    summation = build_nufft_plan(chosen.tracer.layout, chosen.pilot.bank, where.sensor, 1e-4)
    fast = nufft_field(chosen.tracer.layout, bank, phases[0], summation).reshape(direct.shape)
    assert np.linalg.norm(fast - direct) < 3e-4 * np.linalg.norm(direct)
    # Reflections of a connection have phases of their own.
    twins = np.flatnonzero((np.diff(bank.paths) == 0) & (np.diff(bank.orders) == 0))
    assert len(twins)
    assert (np.abs(phases[0][twins] - phases[0][twins + 1]) > 1e-6).all()


def test_the_mean_crosses_both_faces():
    medium = slab(4.0, 0.5, 1.5, thickness=60.0)
    where = scene(medium, sg.FarField(directions=[AXIS, direction(0.1)]), tilts=(0.0, 0.1))
    plain = where.replace(medium=medium.replace(faces=sg.Faces()))
    through = 1 - both_reflectances(medium.faces, np.array([1.0, np.sqrt(0.99)]))
    crossed = np.sqrt(np.square(through).mean(axis=0))
    r = 1 - crossed
    np.testing.assert_allclose(np.diag(mean_field(where)) / np.diag(mean_field(plain)), crossed, rtol=1e-12)
    assert ballistic_fraction(where) == pytest.approx(np.exp(-4) * (1 - r[0]) ** 2)
    assert straight_through(plain.slab) == np.exp(-4)
    assert straight_through(medium) == pytest.approx(np.exp(-4) * (1 - r[0]) ** 2)


@pytest.mark.parametrize("index", [0.7, 1.5, 3.0])
def test_light_near_the_critical_angle(index):
    """Grazing views are faint, finite, and beyond the escape cone refused."""
    faces = sg.Faces(inside=index)
    last = faces.largest_sine * (1 - 1e-9)
    found, _ = intensity(slab(2.0, 0.0, index), AXIS, direction(last), 3, 500)
    axis, _ = intensity(slab(2.0, 0.0, index), AXIS, AXIS, 3, 500)
    assert 0 <= found < 0.05 * axis
    if index > 1:
        with pytest.raises(RuleError, match=r"sines below .*crosses the faces"):
            sg.memory_effect(slab(2.0, index=index), wavelength=1.0, tilts=[np.arcsin(last) + 1e-3])


REFUSED = {
    "points": (
        lambda: sg.Scene(wavelength=1.0, medium=slab(), illumination=sg.PlaneWaves.tilts([0.0]),
                         sensor=sg.NearField(points=[[0.0, 0.0, -5.0]])),
        "Slab.faces must be matched, unless beams light it in space",
    ),
    "beyond the cone": (lambda: scene(slab(), sg.FarField(directions=[direction(0.7)])),
                        r"FarField.directions must be of sines below 0\.6667"),
    "light beyond the cone": (lambda: scene(slab(), sg.FarField(directions=[AXIS]), tilts=(0.68,)),
                              r"CollimatedBeams.directions must be of sines below 0\.6667"),
    "both sides": (lambda: scene(slab(), sg.FarField(directions=[AXIS, -AXIS])),
                   "FarField.directions must be all on one side"),
    "reversed in transmission": (
        lambda: sg.covariance(scene(slab(), sg.FarField(directions=[AXIS])), paths=8, reverse=True),
        'reverse must be False or "auto" in transmission',
    ),
    "no index": (lambda: sg.Faces(inside=40.0), "Faces.inside must be a refractive index between"),
    "pole": (lambda: theory.memory_effect_at_faces(5.0, 10, 1.7), r"at most 0\.4 OD = 4"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_faces_do_not_serve_is_refused(name):
    ask, words = REFUSED[name]
    assert_refused(ask, words)
