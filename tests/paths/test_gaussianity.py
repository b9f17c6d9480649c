"""The certificate: effective contributions and kurtosis of the fields that are really rendered."""

import numpy as np
import pytest
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.coherence.partially_coherent import finite_path_excess
from specklegen.paths.gaussianity import PathMoments

SLAB = sg.Scene(
    wavelength=0.5, medium=sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(g=0.8)),
    illumination=sg.CollimatedBeams.tilts([0.0], width=5000.0), sensor=sg.FarField(directions=[[0.0, 0.0, 1.0]]),
)  # fmt: skip
BOX = sg.Scene(wavelength=1.0,
               medium=sg.Box(lower=[-5.0, -5.0], upper=[5.0, 5.0], mean_free_path=5.0, scatterer=sg.Isotropic()),
               illumination=sg.PlaneWaves.tilts([0.0], dimensions=2), sensor=sg.FarField.angles([1.0]))  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "paths"), [(SLAB, 4), (BOX, 1)])
def test_the_kurtosis_predicted_is_the_kurtosis_rendered(scene, paths):
    stack = sg.render(scene, paths=paths, sampler="paths", reverse=False, realizations=8192, seed=5)
    certificate = stack.report.gaussianity
    assert not certificate.enough
    power = stack.intensity.reshape(64, 128).astype(np.float64)
    kurtosis = np.square(power).mean(axis=1) / np.square(power.mean()) - 2
    # The pilot of a few thousand paths knows the excess to some 10 % where weights vary much.
    assert_mean(kurtosis, certificate.kurtosis_excess, slack=0.15 * certificate.kurtosis_excess)
    refute_mean(kurtosis, 0.0)


def test_moments_by_hand():
    """Two paths of three: one of weights 1 and 2, one of weight 3, one of none."""
    moments = PathMoments.of(np.array([1.0, 2.0, 3.0]), np.array([0, 0, 1]), 3)
    assert moments.relative_variance == pytest.approx(0.5)
    assert moments.concentration == pytest.approx((1 + 4 + 9) / 3 / 4)
    found = moments.gaussianity(100)
    assert found.contributions == pytest.approx(100 / moments.concentration)
    assert found.kurtosis_excess == pytest.approx((2 * 0.5 - 14 / 12) / 100)
    assert found.enough
    assert moments.image_variance == pytest.approx(0.5 + 0.5 + 1 - 14 / 12)
    assert (moments.paths_for(0.1), moments.paths_for(0.1, within_image=True)) == (50, 84)
    assert PathMoments(0.5, 1.5, 4.0).stated() == PathMoments(0.75, 2.25, 4.0)  # by one standard error


def test_explain_says_whether_the_paths_are_enough():
    assert "TOO FEW paths" in sg.plan(BOX, paths=5).explain()
    assert "enough paths to be Gaussian (about" in sg.plan(BOX, paths=100_000).explain()
    assert "Gaussian by construction" in sg.plan(BOX, paths=1000, sampler="covariance").explain()


def test_errors_within_an_image_count_what_connections_of_one_path_share():
    """At no distance between two views is the excess larger than stated; next to each other it is nearly that."""
    medium = sg.Slab(thickness=100.0, mean_free_path=10.0, scatterer=sg.Isotropic())
    scene = sg.Scene(wavelength=0.5, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0], width=1e4),
                     sensor=sg.FarField.grid(shape=(4, 4), pitch=1e-5))  # fmt: skip
    made = sg.plan(scene, paths=1000, sampler="paths")
    beside, near, apart = (finite_path_excess(scene, 1000, shift=shift) for shift in (0.0, 1e-5, 0.3))
    # 6000 pilot paths know a variance to some 5 %; (E w)^2, which the sharper bound takes off, is left in.
    assert made.expected_error**2 == pytest.approx(apart, rel=0.15)
    assert beside < 1.1 * made.image_error**2
    assert near < 1.1 * made.image_error**2
    assert made.image_error**2 < 1.3 * beside
    assert beside > 1.3 * apart  # what was understated
    assert sg.plan(scene, rel_error=0.05, sampler="paths").image_error <= 0.05
