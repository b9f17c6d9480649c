"""How many paths make a pixel, as plans state it, against the images of every connection of other paths."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.instrument.lens import Lens
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.lit_plane import lens_of, lit_plane
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.pixel_light import PixelLight, Rays, pupil_views
from specklegen.paths.tracer import slab_tracer

AXIS, BATCHES = np.array([0.0, 0.0, 1.0]), 20


def scene(scatterer, aperture, focus, free=20.0, faces=None, pupil=None, tilt=0.0, side="transmission"):
    faces = faces or sg.Faces()
    medium = sg.Slab(thickness=40.0, mean_free_path=free, scatterer=scatterer, faces=faces)
    camera = sg.Imaging(shape=(3, 3), pitch=1 / (4 * aperture), aperture=aperture, focus=focus,
                        pupil=pupil or sg.Pupil(), side=side)  # fmt: skip
    return sg.Scene(wavelength=1.0, medium=medium, illumination=sg.CollimatedBeams.tilts([tilt], width=20.0),
                    sensor=camera)  # fmt: skip


def sums(seen, paths):
    """Light of a path at pixels about the middle, its square, squares of connections, and 1: float64[BATCHES, 4]."""
    lens = lens_of(seen)
    tracer, (x, y), k = slab_tracer(lens.pupil_scene, False), lens.grid.sines, seen.wavenumber
    places = np.random.default_rng(0).uniform(-5, 5, (16, 2))
    waves = np.array([np.exp(1j * k * (x * a + y[:, None] * b)) for a, b in places]) * lens.weights()
    waves, found = waves.reshape(len(places), -1), []
    for n in range(BATCHES):
        count = paths // BATCHES
        bank = tracer.trace(7, count, first=n * count, threads=1)
        light = np.zeros(3)
        numbers, powers = [], []
        for start in range(0, len(bank), 128):
            part = bank.select(np.arange(start, min(start + 128, len(bank))))
            once = single_amplitudes(tracer.layout, part.single)
            often = multiple_amplitudes(tracer.layout, part.multiple, bidirectional=False, reverse=False)
            powers.append(np.square(np.abs(waves @ np.concatenate([once, often], axis=1).reshape(waves.shape[1], -1))))
            numbers += [*part.single.paths - n * count, *part.multiple.paths - n * count]
        for each in np.concatenate(powers, axis=1):
            whole = np.bincount(numbers, each, count)
            light += whole.sum(), np.square(whole).sum(), np.square(each).sum()
        found.append([*(light / (len(places) * count)), 1.0])
    return np.array(found)


def moments(total):
    """Relative variance of a path, and E sum_B w_B^2 / (E w)^2."""
    return total[1:3] * total[3] / total[0] ** 2 - [1, 0]


WIDE = {
    "beside the lobe": {"scatterer": sg.HenyeyGreenstein(0.97), "aperture": 0.5, "focus": -10.0, "free": 10.0},
    "far out of focus": {"scatterer": sg.HenyeyGreenstein(0.9), "aperture": 0.6, "focus": 20.0},
    "narrow": {"scatterer": sg.HenyeyGreenstein(0.9), "aperture": 0.2, "focus": -10.0},
    "aslant": {"scatterer": sg.HenyeyGreenstein(0.9), "aperture": 0.2, "focus": -10.0, "tilt": 0.3},
    "reflected": {"scatterer": sg.Isotropic(), "aperture": 0.4, "focus": -10.0, "free": 8.0, "tilt": 0.3,
                  "side": "reflection"},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", WIDE)
def test_the_variance_that_is_stated_is_that_of_a_pixel(case):
    seen = scene(**WIDE[case])
    paths = {"aslant": 10_000, "reflected": 2500}.get(case, 1000)
    found, error = jackknife(sums(seen, paths), moments)
    stated = lit_plane(seen).moments
    stated = np.array([stated.relative_variance, stated.concentration])
    assert_z(found, stated, error, degrees=BATCHES - 1, slack=0.15 * stated)
    refute_z(found, 2 * stated, error, degrees=BATCHES - 1, slack=0.15 * stated)


def test_a_plan_states_the_error_of_an_image_by_its_pixels():
    seen = scene(**WIDE["narrow"])
    made = sg.plan(seen, paths=500)
    assert made.image_error == pytest.approx((made.pixel.image_variance / 500) ** 0.5)
    assert made.pixel == lit_plane(seen).moments


@pytest.mark.parametrize(("faces", "pupil"), [(sg.Faces(), sg.Pupil()), (sg.Faces(inside=1.3), sg.Pupil()),
                                              (sg.Faces(), sg.Pupil(zernike=[0, 0, 0, 0.3]))])  # fmt: skip
def test_areas_of_images_are_those_on_the_plane_in_focus(faces, pupil):
    """(int |h|^2)^2 / int |h|^4 of images that the lens itself makes, pixel by pixel; 65 views across lose 1.5 %."""
    seen = scene(sg.HenyeyGreenstein(0.9), 0.3, -15.0, faces=faces, pupil=pupil)
    lens = lens_of(seen)
    pilot = scene_pilot(lens.pupil_scene, False)
    layout, every = pilot.tracer.layout, pilot.bank.multiple
    bank = every.select(np.flatnonzero(np.hypot(*every.exit[:, :2].T) < 40)[:4])  # whose images the camera below holds
    light = PixelLight(seen, lens, layout, bank, AXIS, bank.weight)
    camera = seen.sensor.replace(shape=(180, 180), pitch=0.75)
    fine = Lens(seen.replace(sensor=camera), camera, camera.pupil_grid(85))
    afar = slab_tracer(fine.pupil_scene, False).layout
    fields = multiple_amplitudes(afar, bank, bidirectional=False, reverse=False).reshape(85, 85, -1)
    powers = np.square(np.abs(fine.image(np.ascontiguousarray(fields.transpose(2, 0, 1)))))
    expected = np.square(powers.sum((1, 2))) / np.square(powers).sum((1, 2)) * 0.75**2
    np.testing.assert_allclose(light.image_areas(np.arange(4), np.zeros((4, 2))), expected, rtol=0.03)
    elsewhere = replace(light, lens=Lens(seen, camera.replace(focus=15.0), lens.grid))
    assert np.abs(elsewhere.image_areas(np.arange(4), np.zeros((4, 2))) / expected - 1).max() > 0.2


def test_rays_land_where_geometry_says():
    """Inside and outside a face each by its own angle, by a finite difference for their slopes."""
    seen = scene(sg.Isotropic(), 0.5, 12.0, faces=sg.Faces(inside=1.4))
    views = pupil_views(seen, lens_of(seen))
    rays, gap = Rays.of(seen, lens_of(seen), views), np.array([3.0, 30.0])
    inside = np.arcsin(np.hypot(*views.vectors[:, :2].T))
    reach = np.tan(inside)[:, None] * gap + 12.0 * np.tan(np.arcsin(1.4 * np.sin(inside)))[:, None]
    np.testing.assert_allclose(np.hypot(*np.moveaxis(rays.aside(gap), -1, 0)), reach, rtol=1e-9)
    step = 1e-6
    more = np.tan(np.arcsin(np.sin(inside) + step)) * 3.0
    more += 12.0 * np.tan(np.arcsin(1.4 * (np.sin(inside) + step)))
    slope = (rays.slopes[:, 0] * 3.0 + rays.slopes[:, 1]) * step
    np.testing.assert_allclose(more - reach[:, 0], slope, rtol=1e-4)
