"""Ray sums and the rim integral against a thin soft plate of 6 by 8 wavelengths, lit aslant: its exact field."""

import numpy as np
import pytest
from wavetracing.soft_plate import K, SoftPlate

from specklegen.wavetracing import (
    Conductor,
    Geometry,
    Mesh,
    Plane,
    PlaneWave,
    PointEmitter,
    coherent_rays,
    field_on_plane,
)

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

A, B, FAR = 3.0, 4.0, 1e7
LIGHT = np.array([np.sin(0.6) * np.cos(0.4), np.sin(0.6) * np.sin(0.4), np.cos(0.6)])
CORNERS = np.array([[-A, -B], [A, -B], [A, B], [-A, B]])
PLANES = [Plane(center=z * LIGHT / LIGHT[2], shape=(8, 8), pitch=1.5) for z in (6.0, 20.0)]
TURN = np.deg2rad(np.arange(-175, 176, 10.0))


def around(radius):
    """Points about the middles of three edges, from the plate's one side to its other."""
    out, up = radius * np.cos(TURN), radius * np.sin(TURN)
    sides = [(A + out, 0.3 + 0 * out), (-A - out, -0.3 + 0 * out), (0.2 + 0 * out, B + out)]
    return np.concatenate([np.stack([*side, up], axis=1) for side in sides])


POINTS = np.concatenate([around(2.0), *(plane.points.reshape(-1, 3) for plane in PLANES)])
NEAR = len(around(2.0))


def extrapolated(few, many, values):
    """Values at two numbers of elements, without their error of the order of the elements' area."""
    return values[1] + (values[1] - values[0]) * few**2 / (many**2 - few**2)


@pytest.fixture(scope="module")
def plates():
    return [SoftPlate(A, B, LIGHT, n) for n in (32, 48)]


@pytest.fixture(scope="module")
def exact(plates):
    return extrapolated(32, 48, [plate.field(POINTS) for plate in plates])


def rays(a, diffractions):
    """Field by rays of a source far away at ``POINTS``, of a plate of half-width ``a``."""
    plate = Geometry(Mesh(CORNERS * [a / A, 1] @ np.eye(2, 3), np.array([[0, 1, 2], [0, 2, 3]]), Conductor()))
    lamp = PointEmitter(-FAR * LIGHT, 1.0, power=4 * np.pi)
    return coherent_rays(plate, lamp, POINTS, 1, diffractions) * FAR * np.exp(-1j * K * FAR)


def gap(found, true, part=slice(None)):
    return np.linalg.norm((found - true)[part]) / np.linalg.norm(true[part])


def test_the_plate_itself(plates):
    """Light taken out is light scattered, over all directions; coarser grids go to the same limit."""
    (cosine, weight), turn = np.polynomial.legendre.leggauss(40), 2 * np.pi * np.arange(72) / 72
    sine = np.sqrt(1 - cosine**2)[:, None]
    across = np.stack([sine * np.cos(turn), sine * np.sin(turn)], axis=-1).reshape(-1, 2)
    plates, powers = [SoftPlate(A, B, LIGHT, 24), *plates], []
    for plate in plates[:2]:
        waves = np.exp(-1j * K * across @ plate.middles.reshape(-1, 2).T) @ plate.charges.ravel() / (4 * np.pi)
        powers.append((np.abs(waves) ** 2).reshape(40, 72).sum(axis=1) @ weight * 2 * np.pi / 72)
    taken = [plate.extinguished for plate in plates]
    coarse, fine = extrapolated(24, 32, taken[:2]), extrapolated(32, 48, taken[1:])
    assert extrapolated(24, 32, powers) == pytest.approx(coarse, rel=0.01)
    assert coarse == pytest.approx(fine, rel=0.01)
    assert abs(taken[0] - powers[0]) > 0.02 * fine  # a coarse grid alone is noticed
    assert fine == pytest.approx(2 * 4 * A * B * LIGHT[2], rel=0.02)  # twice what it shades, when large


def test_rays_around_edges(exact):
    """Two wavelengths from the middles of edges, all around them, where corners matter little: 3 %."""
    found = rays(A, 1)
    assert gap(found, exact, slice(NEAR)) < 0.03
    assert gap(rays(A, 0), exact, slice(NEAR)) > 0.2  # without edges
    assert gap(rays(1.03 * A, 1), exact, slice(NEAR)) > 0.05  # edges .09 further out


def test_far_behind_corners_are_missing_and_the_rim_integral_is_nearer(exact):
    """The page's figures: rays without corners lose with distance, Rayleigh-Sommerfeld does not."""
    found, first = rays(A, 2), NEAR
    for plane, most, least, kirchhoff in zip(PLANES, (0.13, 0.21), (0.08, 0.14), (0.07, 0.05), strict=True):
        part = slice(first, first + 64)
        hole = field_on_plane(CORNERS, PlaneWave(wavelength=1.0, direction=LIGHT), plane).values.ravel()
        behind = np.exp(1j * K * POINTS[part] @ LIGHT) - hole
        assert least < gap(found, exact, part) < most
        assert gap(behind, exact[part]) < kirchhoff
        first += 64
