"""A camera behind four polarisers: by Jones vectors, waves that interpolation keeps, and scenes of one medium."""

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.instrument import Camera, NoiseStreams, PolarisationMosaic, expose

RNG = np.random.default_rng(5)


def behind(field, angle, extinction=None):
    """Intensity of a field complex[2, ...] behind a polariser, by its Jones matrix."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    along, across = c * field[0] + s * field[1], c * field[1] - s * field[0]
    return np.abs(along) ** 2 + (0 if extinction is None else np.abs(across) ** 2 / extinction)


@pytest.mark.parametrize("extinction", [None, 20.0])
def test_a_pixel_sees_what_its_polariser_passes(extinction):
    field = RNG.normal(size=(2, 3, 6, 8)) + 1j * RNG.normal(size=(2, 3, 6, 8))
    mosaic = PolarisationMosaic(extinction=extinction, pattern=(0, 135, 45, 90))
    seen = mosaic.pixels(np.stack([behind(field, angle) for angle in (0, 45, 90, 135)], axis=1))
    for row in range(6):
        for column in range(8):
            angle = mosaic.pattern[2 * (row % 2) + column % 2]
            own = behind(field[..., row, column], angle, extinction)
            np.testing.assert_allclose(seen[:, row, column], own, rtol=1e-12)
    finer = np.stack([behind(field, angle) for angle in (0, 45, 90, 135)], axis=1).repeat(3, 2).repeat(3, 3)
    np.testing.assert_allclose(mosaic.pixels(finer, 3)[:, ::3, ::3], seen, rtol=1e-12)


@pytest.mark.parametrize("extinction", [None, 20.0])
def test_stokes_parameters_that_are_linear_over_the_image_are_found_again(extinction):
    """Inside; at the edge the nearest of an angle stands for it."""
    y, x = np.mgrid[:10, :12] / 10
    stokes = np.stack([5 + x - y, 1 + 2 * x, 0.5 * y - 2 * x])
    light = [(stokes[0] + np.cos(a) * stokes[1] + np.sin(a) * stokes[2]) / 2 for a in np.radians([0, 90, 180, 270])]
    mosaic = PolarisationMosaic(extinction=extinction)
    found = mosaic.stokes(mosaic.pixels(np.stack(light)))
    np.testing.assert_allclose(found[:, 1:-1, 1:-1], stokes[:, 1:-1, 1:-1], atol=1e-12)
    assert np.abs(found - stokes).max() < 0.5
    leaky = PolarisationMosaic(extinction=5.0).stokes(mosaic.pixels(np.stack(light)))
    assert np.abs(leaky - stokes)[1, 1:-1, 1:-1].max() > 0.1  # a wrong extinction is no right answer


def test_a_mosaic_before_a_scene_sees_one_medium():
    """Sums of images at right angles are one and the same, and counts give the degree of polarisation of the light."""
    slab = sg.Slab(thickness=1000.0, mean_free_path=200.0, scatterer=sg.HenyeyGreenstein(0.9), polarisation="projector")
    scene = sg.Scene(wavelength=0.5, medium=slab, illumination=sg.CollimatedBeams.tilts([0.0], width=10_000.0),
                     sensor=sg.FarField.grid((8, 8), 1e-5), polarisers=sg.Polarisers.parallel())  # fmt: skip
    mosaic = PolarisationMosaic()
    images = np.stack([
        sg.render(each, paths=300, seed=1, sampler="paths").intensity[0].astype(np.float64)
        for each in mosaic.scenes(scene)
    ])  # fmt: skip
    np.testing.assert_allclose(images[0] + images[2], images[1] + images[3], rtol=1e-5)
    images /= images[0].mean()
    raw = expose(Camera(photons=1e6, bit_depth=None), mosaic.pixels(images), NoiseStreams.of(1)).astype(np.float64)
    found = mosaic.stokes(raw)
    assert found[1].mean() > 0.8 * found[0].mean()  # forward light keeps its polarisation


REFUSED = {
    "three images": (lambda: PolarisationMosaic().pixels(np.ones((3, 4, 4))), "pixels images must be of shape"),
    "odd rows": (lambda: PolarisationMosaic().pixels(np.ones((4, 3, 4))), "multiples of 2"),
    "half a cell": (lambda: PolarisationMosaic().pixels(np.ones((4, 6, 8)), 2), "multiples of 4"),
    "odd pixels": (lambda: PolarisationMosaic().stokes(np.ones((3, 3))), "stokes pixels"),
    "angles twice": (lambda: PolarisationMosaic(pattern=(0, 0, 45, 90)), "pattern must be a permutation"),
    "no extinction": (lambda: PolarisationMosaic(extinction=1.0), "extinction"),
    "scalar light": (
        lambda: PolarisationMosaic().scenes(sg.Scene(
            wavelength=0.5, medium=sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.Isotropic()),
            illumination=sg.CollimatedBeams.tilts([0.0], width=1000.0), sensor=sg.FarField.grid((2, 2), 1e-4))),
        "scenes scene must be one of polarised light"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused(name):
    call, told = REFUSED[name]
    assert_refused(call, told)
