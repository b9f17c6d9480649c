"""Images of hidden objects behind forward media and screens, against images that waves draw point by point.

Waves go from slice to slice, or from screen to screen, and know of no paths. Images are asked for the mean intensity of
every pixel of the object over the camera, and for the correlation of an image with itself, moved by the distance of two
pixels: where the memory effect reaches from one to the other, the light of both is one pattern, moved.
"""

from functools import cache

import numpy as np
import pytest
import screen_waves_by_hand as by_hand
from zscore import assert_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.oracles.multi_slice import slice_views
from specklegen.oracles.screen_waves import ScreenWaves

AGREED = 0.02  # of correlations, and of mean intensities: what rendered images and waves may differ by
FORWARD = sg.Slab(thickness=400.0, mean_free_path=80.0, scatterer=sg.HenyeyGreenstein(0.98))
SMOOTH = sg.Slab(thickness=2000.0, mean_free_path=200.0, scatterer=sg.VonMisesFisher(1000.0))


class Row:
    """An object of pixels in a row, one bin of the waves' transform apart, 1 / side in sines, and its images. The
    camera holds the views of all bins up to ``half`` of them. Waves are as wide as their periodic grid; a render has a
    window ``fine / 2`` times as wide and finer views, half a grain apart."""

    def __init__(self, side, lit, brightness, half, *, pitch=0.5, fine=16):
        self.side, self.lit, self.brightness, self.half = side, np.array(lit), np.array(brightness), half
        self.pitch, self.fine = pitch, fine
        self.shifts = np.unique(np.abs(self.lit[:, None] - self.lit))[1:]

    def scene(self, medium, brightness):
        most = np.abs(self.lit).max()
        pixels = np.zeros((1, 2 * most + 1))
        pixels[0, most - self.lit] = brightness  # a pixel sends its light along minus its place
        light = sg.IncoherentObject(brightness=pixels, pitch=1 / self.side, width=self.fine * self.side / 2)
        views = (2 * self.half + 1) * self.fine + 1
        camera = sg.FarField.grid((views, views), 1 / (self.fine * self.side))
        return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=camera)

    def by_waves(self, medium, realizations):
        """What images show (:meth:`shown`), and the mean intensity of each pixel over an area of 1, float64[R, T]."""
        some, bins = np.arange(-self.half, self.half + 1), [(int(n), 0) for n in self.lit]
        found = slice_views(medium, wavelength=1.0, pitch=self.pitch, size=round(self.side / self.pitch), bins=bins,
                            realizations=realizations)  # fmt: skip
        seen = np.ones((len(some), len(some)))
        seen[self.half, self.half + self.lit] = 0.0  # where light lies that was not scattered
        straight = 1 - (np.square(some) + np.square(some)[:, None]) / self.side**2  # cos^2 of the views
        gain = straight / np.sqrt(1 - np.square(self.lit / self.side))[:, None, None] * seen / self.side**2
        powers = [np.square(np.abs(each[:, some][:, :, some])) * gain for each in found]
        images = [np.tensordot(self.brightness, power, axes=1) for power in powers]
        shown = [self.shown(each, seen, 1) for each in images]
        return np.array(shown), np.array(powers).sum((2, 3)) / seen.sum()

    def by_render(self, medium, realizations, **options):
        """The same of rendered images; what the last pixel alone shows is what the others leave of the image."""

        def rendered(brightness):
            scene = self.scene(medium, brightness)
            made = sg.plan(scene, realizations=realizations, threads=1, **options).chosen
            width = scene.illumination.width
            return np.array([each.image for each in made.prepare(1, 1).media(realizations)], float) / width**2

        images = rendered(self.brightness)
        pixels = np.array([rendered(each).mean((-2, -1)) for each in np.eye(len(self.lit))[:-1]]).T
        last = (images.mean((-2, -1)) - pixels @ self.brightness[:-1]) / self.brightness[-1]
        return np.array([self.shown(each, 1 + 0 * each, self.fine) for each in images]), np.column_stack([pixels, last])

    def shown(self, image, seen, fine):
        """Sums over views, for each shift, of an image times itself moved, of either, and of 1: float64[D, 4]."""
        found = []
        for shift in self.shifts * fine:
            one, other, both = image[:, :-shift], image[:, shift:], seen[:, :-shift] * seen[:, shift:]
            found.append([(one * other * both).sum(), (one * both).sum(), (other * both).sum(), both.sum()])
        return np.array(found)


def correlation(shown):
    """<I(v) I(v + d)> / <I(v)> <I(v + d)> - 1 for each shift d, and its error, from realizations float64[R, D, 4]."""
    return jackknife(shown, lambda total: total[:, 0] * total[:, 3] / (total[:, 1] * total[:, 2]) - 1)


def independent(shown):
    """The same of images that are not correlated with themselves, moved: the power of a comparison."""
    some = shown.copy()
    some[:, :, 0] = some[:, :, 1] * some[:, :, 2] / some[:, :, 3]
    return some


def mean(pixels):
    return pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))


def assert_same(waves, render, scale=0.0):
    """Intensities of all pixels within two per cent, correlations of the image with itself within .02. ``scale`` is the
    relative error that all intensities of a render have together."""
    (shown, pixels), (drawn, rendered) = waves, render
    (expected, spread), (found, own) = mean(pixels), mean(rendered)
    error = np.hypot(np.hypot(own, spread) / expected, scale)
    assert_z(found / expected, 1.0, error, degrees=len(pixels) - 1, slack=AGREED)
    (expected, spread), (found, own) = correlation(shown), correlation(drawn)
    assert_z(found, expected, np.hypot(own, spread), degrees=len(pixels) - 1, slack=AGREED)


ROW = Row(100, [-4, 0, 4], [1.0, 0.6, 0.8], 8)  # 80 mrad, more than two ranges


@cache
def waves_of_the_row(realizations=48):
    return ROW.by_waves(FORWARD, realizations)


@pytest.mark.slow
def test_an_object_two_ranges_wide_has_the_images_of_waves():
    """By path sums: behind lobes of a cusp and wide wings the memory effect falls with the angle to the beam."""
    made = sg.plan(ROW.scene(FORWARD, ROW.brightness))
    assert (made.sampler, made.doubts) == ("paths", ())
    assert sg.memory_effect(FORWARD, wavelength=1.0, tilts=[0.04], paths=4000).intensity[0] < 0.65
    drawn = ROW.by_render(FORWARD, 4, paths=4000, sampler=made.sampler)
    assert_same(waves_of_the_row(), drawn)
    with pytest.raises(AssertionError, match="z ="):
        assert_same(waves_of_the_row(), (independent(drawn[0]), drawn[1]))


def test_one_memory_effect_for_all_views_is_told_from_waves():
    with pytest.raises(AssertionError, match="z ="):
        assert_same(waves_of_the_row(24), ROW.by_render(FORWARD, 4, paths=10_000, sampler="stationary"))


SCREENS = sg.ScreenStack(screens=(sg.PhaseScreen(rms_phase=3.0, correlation_length=15.0),) * 2, gaps=(300.0,))


def test_images_behind_screens_are_those_of_waves():
    """An object of 40 mrad, of which the memory effect reaches over a third, behind lobes of 64 mrad."""
    waves = ScreenWaves(SCREENS, 1.0, 160, 1.875)
    row = Row(300, [-6, 0, 6], [1.0, 0.6, 0.8], 10)
    beams = by_hand.scene_of(waves, row.half, [(int(n), 0) for n in row.lit], 150.0)
    powers = np.square(np.abs(by_hand.wave_fields(waves, beams, 120, seed=1)))
    images = np.tensordot(powers, row.brightness, axes=(1, 0))
    found = np.array([row.shown(each, 1 + 0 * each, 1) for each in images]), powers.mean((2, 3))
    pixels = np.zeros((1, 3))

    def rendered(brightness):
        pixels[0] = np.flip(brightness)
        light = sg.IncoherentObject(brightness=pixels, pitch=6 * waves.step, width=150.0)
        scene = beams.replace(illumination=light)
        with pytest.warns(sg.DoubtWarning, match="contrast"):  # means of products do not mind
            return sg.render(scene, realizations=400, seed=2, sampler="screens").intensity.astype(float)

    images = rendered(row.brightness)
    drawn = np.array([row.shown(each, 1 + 0 * each, 1) for each in images])
    single = np.array([rendered(each).mean((-2, -1)) for each in np.eye(3)]).T
    assert_same(found, (drawn, single))
    with pytest.raises(AssertionError, match="z ="):
        assert_same(found, (independent(drawn), single))


@pytest.mark.slow
def test_images_under_an_envelope_are_those_of_waves():
    """An object two ranges wide before a camera of eight, at whose corners some per cent of the light are missing."""
    row = Row(435, [-1, 0, 1], [1.0, 0.6, 0.8], 8, pitch=1.25, fine=40)
    made = sg.plan(row.scene(SMOOTH, row.brightness), realizations=4)
    assert (made.sampler, made.doubts) == ("stationary", ())
    assert made.chosen.maps is not None
    waves = row.by_waves(SMOOTH, 24)
    assert_same(waves, row.by_render(SMOOTH, 4), made.expected_error)
