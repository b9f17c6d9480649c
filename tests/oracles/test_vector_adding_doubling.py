"""Adding and doubling of Stokes vectors: printed tables, single scattering, scalar transfer, what is conserved."""

import numpy as np
import pytest
from zscore import assert_z

from specklegen.core.errors import RuleError
from specklegen.core.quadrature import gauss_legendre
from specklegen.oracles import vector_adding_doubling as oracle
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.oracles.vector_adding_doubling import backscattering, projected, rayleigh, vector_adding_doubling

TURNED = np.diag([1.0, 1.0, -1.0, 1.0])
"""What time reversal does to a Stokes vector in the frame (theta, phi)."""


def henyey_greenstein(g):
    return lambda cosine: (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5


def unpolarised(lobe):
    """Phase matrix of particles behind which no light remembers its polarisation."""
    return lambda cosine: lobe(cosine) * np.array([1 + 0 * cosine, *[0 * cosine] * 3])


def mixed(cosine):
    """A phase matrix with every element: of no particle, and as good as one here."""
    share = henyey_greenstein(0.3)(cosine)
    sine = 1 - cosine**2
    return share * np.array([1 + 0 * cosine, -0.3 * sine, 2 * cosine / (1 + cosine**2), 0.2 * sine])


def test_it_is_the_printed_table_of_the_rayleigh_sky():
    """Coulson, Dave and Sekera (1960), as Natraj, Li and Yung (Astrophys. J. 691, 1909 (2009)) corrected them. Depth
    .5, incidence .2, seen at cosine .02 before the slab, in the plane of incidence: I and |Q| to eight digits."""
    found = vector_adding_doubling(0.5, rayleigh, incidence=0.2, views=[0.02], nodes=24).reflected[0, 0, :, 0]
    np.testing.assert_allclose(found, [0.44129802, 0.01753141, 0, 0], atol=1.5e-7)  # THINNEST leaves 3e-8 out
    forgetful = unpolarised(lambda cosine: 0.75 * (1 + cosine**2))
    scalar = vector_adding_doubling(0.5, forgetful, incidence=0.2, views=[0.02], nodes=24)
    assert abs(scalar.reflected[0, 0, 0, 0] - 0.44129802) > 0.005


SPHERES = np.array([[1.0, -0.32071711, 0.71206342, -0.01882245], [1.45529318, -0.20350675, 1.76014119, -0.04725108],
                    [1.05402631, 0.24638948, 1.06682431, 0.00894436], [0.39758994, 0.18605748, 0.39651104, 0.04505815],
                    [0.11659302, 0.07124848, 0.09576412, 0.00958275], [0.02387477, 0.01700757, 0.01765088, 0.00215761],
                    [0.00395010, 0.00302534, 0.00261549, 0.00029195], [0.00053888, 0.00043592, 0.00032713, 0.00003502],
                    [0.00006372, 0.00005326, 0.00003583, 0.00000337], [0.00000667, 0.00000572, 0.00000351, 0.00000029],
                    [0.00000063, 0.00000055, 0.00000031, 0.00000002],
                    [0.00000006, 0.00000005, 0.00000003, 0.0]]).T  # fmt: skip
"""Legendre series of F11, F12, F33, F34 of Mie spheres (radius .2 um, variance .07, index 1.44, at .951 um)."""
# Of cosine, before the slab or behind it: I and Q at azimuth 0 less those at 180 degrees, |U| and |V| at 90.
PRINTED = {
    (0.45802, "reflected"): (0.312367 - 0.0861062, -0.0266875 - 0.0100360, 0.0199176, 3.34282e-5),
    (0.86563, "reflected"): (0.101371 - 0.0544662, -0.0337486 + 0.00681647, 0.00708604, 6.11213e-5),
    (0.45802, "transmitted"): (0.184881 - 0.0597792, 0.00668130 + 0.00317858, 0.0128460, 1.68168e-5),
    (0.86563, "transmitted"): (0.117483 - 0.0504972, -0.0162311 + 0.0170131, 0.00657858, 2.81815e-6),
}


def test_it_is_the_printed_table_of_mie_spheres(monkeypatch):
    """Evans and Stephens, J. Quant. Spectrosc. Radiat. Transfer 46, 413 (1991): depth 1, albedo .99, incidence .2. The
    problem L = 13 of Garcia and Siewert (1989). Their ground sends up light of no azimuth and no polarisation, which
    differences leave out. To the last digits at the sixteen nodes that their table was computed with; those leave out
    some thousandths, and so do too few Fourier terms many."""
    x, w = np.polynomial.legendre.leggauss(16)
    x, w = x[8:], w[8:]

    def matrix(cosine):
        return np.array([np.polynomial.legendre.legval(cosine, series) for series in SPHERES])

    def seen(orders):
        return vector_adding_doubling(1.0, matrix, albedo=0.99, incidence=0.2, views=[x[2], x[5]], nodes=8,
                                      azimuths=[0.0, np.pi, np.pi / 2], orders=orders)  # fmt: skip

    def differences(found, side, cosine):
        at = getattr(found, side)[int(cosine > 0.5), :, :, 0]
        return np.array([*(at[0] - at[1])[:2], *abs(at[2, 2:])])

    better = seen(9)
    monkeypatch.setattr(oracle, "gauss_legendre", lambda nodes: (2 * x - 1, 2 * w))  # noqa: ARG005
    found, few = seen(9), seen(2)
    for (cosine, side), printed in PRINTED.items():
        np.testing.assert_allclose(differences(found, side, cosine), printed, atol=1.5e-6)
        np.testing.assert_allclose(differences(better, side, cosine), printed, atol=2e-3)
        assert np.abs(differences(few, side, cosine) - printed).max() > 5e-3


HALF_SPACE = {"parallel": 1.752, "crossed": 1.120, "helicity kept": 2.0, "helicity flipped": 1.251, "all": 1.537}
"""Enhancements of Rayleigh half spaces: Amic, Luck, Nieuwenhuizen, J. Phys. I France 7, 445 (1997)."""
FIELDS = {"parallel": ([1, 0], [1, 0]), "crossed": ([1, 0], [0, 1]), "helicity kept": ([1, 1j], [1, -1j]),
          "helicity flipped": ([1, 1j], [1, 1j])}  # fmt: skip


def enhancements(depth, **options):
    """How many times as bright as without interference light straight back is, by channel."""
    spins = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
    seen, added = backscattering(depth, rayleigh, **options)
    stokes = {name: [np.einsum("a,iab,b->i", np.conj(e), spins, e).real for e in both] for name, both in FIELDS.items()}
    found = {name: (passed @ added @ light) / (passed @ seen @ light) for name, (light, passed) in stokes.items()}
    return {name: 1 + value for name, value in found.items()} | {"all": 1 + added[0, 0] / seen[0, 0]}


def test_channels_are_enhanced_as_the_literature_has_it():
    """A half space to the last printed digit; slabs of 40 and 120 as random paths found them, whose errors are .001."""
    deep = enhancements(1e4)
    np.testing.assert_allclose([*deep.values()], [HALF_SPACE[name] for name in deep], atol=3.5e-4)
    for depth, by_paths in ((40, [1.742, 1.129, 2.0, 1.262, 1.539]), (120, [1.752, 1.122, 2.0, 1.254, 1.537])):
        assert_z([*enhancements(depth).values()], by_paths, 0.0012)
    assert abs(1 - deep["parallel"] / 2 - 0.125) < 1e-3  # 12.5 % below two
    assert max(abs(a - b) for a, b in zip(deep.values(), enhancements(5).values(), strict=True)) > 0.05


def test_a_slab_between_faces_of_no_step_is_the_slab_alone():
    """And echoes of a real one lose no light."""
    options = {"nodes": 8, "views": [0.7]}
    alone = vector_adding_doubling(2.0, rayleigh, **options)
    between = vector_adding_doubling(2.0, rayleigh, index=1 / (1 + 1e-9), **options)
    np.testing.assert_allclose(between.transmitted, alone.transmitted, rtol=1e-6)
    np.testing.assert_allclose(between.reflected, alone.reflected, rtol=1e-6)
    x, w = gauss_legendre(16)
    index = 1.33
    edge = np.sqrt(1 - index**-2)  # cosines that light gets out at
    cosine = edge + (1 - edge) * (1 + x) / 2
    found = vector_adding_doubling(1.0, rayleigh, views=cosine, nodes=24, index=index)
    out = (1 - edge) * w @ (cosine * (found.transmitted + found.reflected)[:, 0, 0, 0])  # of unpolarised light
    r = ((index - 1) / (index + 1)) ** 2
    straight = (1 - r) ** 2 * np.exp(-1.0) / (1 - r * r * np.exp(-2.0))
    echo = r + (1 - r) ** 2 * r * np.exp(-2.0) / (1 - r * r * np.exp(-2.0))
    assert out == pytest.approx(1 - straight - echo, abs=2e-3)


def test_light_of_one_scattering_is_the_phase_matrix_turned():
    """Against frames found by hand: light at 60 degrees to the axis, seen 90 degrees of azimuth off."""
    depth, sine = 1e-6, np.sqrt(0.75)
    found = vector_adding_doubling(depth, mixed, incidence=0.5, views=[0.6], azimuths=[np.pi / 2], nodes=8,
                                   orders=24).transmitted[0, 0]  # fmt: skip
    before, after = np.array([sine, 0, 0.5]), np.array([0, 0.8, 0.6])
    normal = np.cross(before, after)
    normal /= np.linalg.norm(normal)

    def frame(angle):
        """Stokes vectors from (theta, phi) to the scattering plane, by the angle between them."""
        c, s = np.cos(2 * angle), np.sin(2 * angle)
        return np.array([[1, 0, 0, 0], [0, c, s, 0], [0, -s, c, 0], [0, 0, 0, 1]])

    def angle(direction, theta, phi):
        inside = np.cross(normal, direction)
        return np.arctan2(inside @ phi, inside @ theta)

    first = angle(before, np.array([0.5, 0, -sine]), np.array([0.0, 1, 0]))
    second = angle(after, np.array([0, 0.6, -0.8]), np.array([-1.0, 0, 0]))
    f11, f12, f33, f34 = mixed(before @ after)
    plane = np.array([[f11, f12, 0, 0], [f12, f11, 0, 0], [0, 0, f33, f34], [0, 0, -f34, f33]])
    expected = depth / (4 * 0.6) * frame(-second) @ plane @ frame(first)
    np.testing.assert_allclose(found, expected, atol=2e-5 * expected[0, 0])  # light scattered twice


@pytest.mark.parametrize(("depth", "albedo", "g"), [(2.0, 1.0, 0.5), (6.0, 0.8, 0.3)])
def test_without_polarisation_it_is_scalar_transfer(depth, albedo, g):
    found = vector_adding_doubling(depth, unpolarised(henyey_greenstein(g)), albedo=albedo, nodes=24, orders=1)
    expected = adding_doubling(depth, albedo=albedo, g=g)
    assert found.transmitted[0, 0, 0, 0] == pytest.approx(np.pi * expected.transmitted, rel=1e-5)
    assert found.reflected[0, 0, 0, 0] == pytest.approx(np.pi * expected.reflected, rel=1e-5)


@pytest.mark.parametrize("matrix", [rayleigh, projected(henyey_greenstein(0.4))])
def test_without_absorption_no_light_is_lost(matrix):
    """Of light of any polarisation, 50 degrees off the axis, at all cosines and azimuths together."""
    x, w = gauss_legendre(12)
    cosine, depth, incidence = (1 + x) / 2, 1.5, 0.64
    found = vector_adding_doubling(depth, matrix, incidence=incidence, views=cosine,
                                   azimuths=2 * np.pi * np.arange(5) / 5, nodes=20, orders=3)  # fmt: skip
    radiance = (found.transmitted + found.reflected)[:, :, 0].mean(1)  # [view, Stokes vector of the beam]
    out = (w * cosine) @ radiance / incidence  # 2 pi mu dmu over [0, 1], of pi in
    # Gauss nodes do not follow light along the face: 1e-4 is what 12 of them leave out.
    np.testing.assert_allclose(out, [1 - np.exp(-depth / incidence), 0, 0, 0], atol=2e-4)


def test_light_that_turns_back_meets_the_transposed_slab():
    """Reciprocity, of every element: R(a, b) / b = D R(b, a)^T D / a; of another azimuth it does not hold."""
    options = {"nodes": 12, "azimuths": [0.7, -0.7], "orders": 12}
    one = vector_adding_doubling(1.3, mixed, incidence=0.3, views=[0.8], **options).reflected[0, 0] / 0.3
    both = vector_adding_doubling(1.3, mixed, incidence=0.8, views=[0.3], **options).reflected[0] / 0.8
    other, turned = (TURNED @ each.T @ TURNED for each in both)  # who comes back sees the azimuth the other way round
    np.testing.assert_allclose(one, turned, atol=1e-7 * one[0, 0])
    assert np.abs(one - other).max() > 0.05 * one[0, 0]


POLARISATION = {1.0: (0.735, 0.001), 2.0: (0.548, 0.002), 3.0: (0.395, 0.003), 4.0: (0.263, 0.003), 5.0: (0.168, 0.002),
                7.0: (0.057, 0.002), 10.0: (0.011, 0.002)}  # fmt: skip


def test_rayleigh_slabs_depolarise_as_random_paths_do():
    """Of the transmitted light along the axis: degree of polarisation, and the standard errors of paths."""
    found = [vector_adding_doubling(depth, rayleigh, nodes=12).transmitted[0, 0] for depth in POLARISATION]
    paths, errors = np.array([*POLARISATION.values()]).T
    assert_z([each[1, 1] / each[0, 0] for each in found], paths, errors)
    circular = found[4][3, 3] / found[4][0, 0]
    assert circular == pytest.approx(0.095, abs=5e-4)  # as printed


BAD = [{"optical_depth": 0.0}, {"optical_depth": np.nan}, {"incidence": 0.0}, {"views": [1.1]}]


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_slab_is_refused(bad):
    with pytest.raises(RuleError, match="vector_adding_doubling"):
        vector_adding_doubling(**({"optical_depth": 1.0, "matrix": rayleigh} | bad))
