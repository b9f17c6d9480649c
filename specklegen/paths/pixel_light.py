"""Paths that make a pixel of an image: far fewer than those of a view in the far field, and other ones.

A connection throws the light p that it sends through the pupil on a patch of the plane in focus, along rays s to

    x(s) = a + d tan(theta) + f tan(theta_out)        a from where it entered to its last particle, d below the face

and a pixel in the middle of a window of profile b sees of all N paths, entered anywhere under it,

    mean = sum p_B c_B,    E w^2 / (E w)^2 = N area sum (p_B p_B' c O_BB') / (sum p_B c_B)^2

c_B the share of a patch that the window covers, b^2(x), and O the overlap of two patches of one path, 1 / A of one and
the same. They are taken for Gaussians of the areas A that geometry and diffraction make of the part of the pupil that
is lit (beside a wide pupil a phase function fills little of it),

    A = (int p)^2 / int (p^2 / J) + A_0 [int p / (int p^(1/2))^2] / [the same of the pupil],    J = |dx / ds|

A_0 that of a point in focus; and all are put right by the areas of the images of a few, ``(int |h|^2)^2 / int |h|^4``.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.fft import fft2

from specklegen.core.statistics import effective_count
from specklegen.instrument.lens import Lens
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import endpoint_factors, single_factors
from specklegen.paths.far_field import lobe_width
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.layout import Layout
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.scene import Scene
from specklegen.scene.window import Window

_FEWEST, _MOST = 19, 127  # views over the pupil
_PATCHES = 48  # connections whose images are made
_COARSEST, _FINEST, _FINE = 65, 129, 65  # directions across the pupil for these, and for a point in focus
_BLOCK = 2**18  # views times connections at a time


class PupilViews(NamedTuple):
    """Directions evenly over the pupil, in sines.

    Attributes
    ----------
    vectors : float64[V, 3]
    power : float64[V]
        What each lets through of |u|^2 per steradian: |P|^2 over the cosine, times its share of the disc.
    share : float
        Area in squared sines that each stands for.
    """

    vectors: np.ndarray
    power: np.ndarray
    share: float


def pupil_views(scene: Scene, lens: Lens) -> PupilViews:
    """Views on a sunflower spiral, closer together than the narrowest phase function is wide, within limits."""
    aperture, pupil = lens.camera.aperture, lens.camera.pupil
    width = min(lobe_width(each) for each in scene.volume.scatterers)
    count = int(np.clip(np.pi * (1.5 * aperture / width) ** 2, _FEWEST, _MOST))
    number = np.arange(count) + 0.5
    radius, angle = np.sqrt(number / count), np.pi * (1 + 5**0.5) * number
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    vectors = directions_of_sines("view", aperture * np.stack([x, y], -1), lens.camera.sign)
    share = np.pi * aperture**2 / count
    power = np.square(np.abs(pupil.transmission(x, y))) * share / np.abs(vectors[:, 2])
    lit = power > 0
    return PupilViews(vectors[lit], power[lit], share)


def depths(lens: Lens, layout: Layout, bank: PathBank) -> np.ndarray:
    """float64[M], from the last particles to the face that the lens looks at.

    Through layers that refract, the depth in the index ``faces.inside`` over which light walks as far sideways: the
    larger one of light along the axis and at the rim of the pupil.
    """
    scene = lens.scene
    if layout.ways is None:
        return scene.side * (scene.exit_depth - bank.exit[:, 2])
    rim = np.sqrt(1 - lens.camera.aperture**2)
    ways = [cosine * layout.ways.views.lateral_ways(np.array([sine, 0.0, cosine]), bank.bounces[:, 1], bank.exit[:, 2])
            for sine, cosine in ((0.0, 1.0), (lens.camera.aperture, rim))]  # fmt: skip
    return np.maximum(*ways)


def sideways(layout: Layout, bank: PathBank, light: np.ndarray) -> np.ndarray:
    """float64[M, 2], from where light enters the face to the last particles."""
    if layout.ways is None:
        entering = bank.entry[:, 2:] / light[2]
    else:
        entering = layout.ways.lights.lateral_ways(light, bank.bounces[:, 0], bank.entry[:, 2])[:, None]
    return bank.exit[:, :2] - bank.entry[:, :2] + entering * light[:2]


def tangents(scene: Scene, sine: float) -> tuple[float, float]:
    """Tangents of a ray inside and outside."""
    outside = scene.medium.faces.inside / scene.medium.faces.outside * sine
    return sine / np.sqrt(1 - sine**2), outside / np.sqrt(1 - outside**2)


@dataclass(frozen=True)
class PixelLight:
    """Connections as a lens sees them, under one light.

    Attributes
    ----------
    layout : Layout
        Of the scene as seen from afar.
    light : float64[3]
        Direction of travel.
    entering : float64[M]
        W |A|^2 of the connections.
    """

    scene: Scene
    lens: Lens
    layout: Layout
    bank: PathBank
    light: np.ndarray
    entering: np.ndarray

    def pixel(self, aside: np.ndarray, window: Window | None = None) -> PathMoments:
        """Moments of what a path adds to a pixel.

        Parameters
        ----------
        aside
            float64[M, 2], the last particles: from where their light entered, for a pixel in the middle of a window; or
            where they are, for one in the middle of the image.
        window
            What is lit; None: as much as the image says.
        """
        views = pupil_views(self.scene, self.lens)
        rays, step = Rays.of(self.scene, self.lens, views), max(16, _BLOCK // len(views.vectors))
        patches = [np.empty((6, 0))]
        for start in range(0, len(self.bank), step):
            part = np.arange(start, min(start + step, len(self.bank)))
            gap = depths(self.lens, self.layout, self.bank.select(part))
            places = aside[part] + rays.aside(gap)
            lit = np.ones(places.shape[:2])
            if window is not None:
                lit = np.square(np.abs(window.amplitude(places[..., 0], places[..., 1])))
            patches.append(rays.patches(self.through(views, part), gap, places, lit))
        seen, total, cover, area, x, y = np.concatenate(patches, axis=1)
        mean = seen.sum() / self.bank.count
        if not mean > 0:
            return PathMoments(0.0, 0.0)
        middles = np.stack([x, y], -1)
        # Of connections at equal steps of what they add the images are made, and the areas of all put right by them.
        added = np.cumsum(np.square(total) * cover / area)
        few = np.searchsorted(added, (np.arange(_PATCHES) + 0.5) / _PATCHES * added[-1])
        area = area / np.mean(area[few] / self.image_areas(few, middles[few] - aside[few]))
        if window is None:
            share = seen / seen.sum()
            spread = share @ np.square(middles - share @ middles).sum(axis=1)
            extent = np.pi * spread + share @ area / 2  # of a Gaussian: its power over its peak
        else:
            extent = window.area
        return self._moments(total * np.sqrt(cover * extent) / mean, area, middles)

    def _moments(self, each: np.ndarray, area: np.ndarray, middles: np.ndarray) -> PathMoments:
        """Moments of connections that add ``each`` over the root of its area, and overlap with those of their path."""
        bank, pairs, lag = self.bank, 0.0, 1
        while (same := np.flatnonzero(bank.paths[lag:] == bank.paths[:-lag])).size:
            both = (area[same] + area[same + lag]) / 2
            apart = np.square(middles[same] - middles[same + lag]).sum(axis=1)
            pairs += float((each[same] * each[same + lag] / both * np.exp(-np.pi * apart / both)).sum())
            lag += 1
        own = each / np.sqrt(area)
        concentration = float(np.square(own).sum() / bank.count)
        variance = max(concentration + 2 * pairs / bank.count - 1, 0.0)
        return PathMoments(variance, concentration, float(effective_count(own))).stated()

    def through(self, views: PupilViews, part: np.ndarray) -> np.ndarray:
        """W |A|^2 |B|^2 float64[V, M] of some connections to each view, times what the pupil lets through."""
        seen, some = self.layout.at(self.light, views.vectors), self.bank.select(part)
        out = np.square(np.abs(endpoint_factors(seen, some, seen.views, "exit"))) * self.entering[part]
        once = some.orders == 1
        if once.any():
            out[:, once] *= np.square(np.abs(single_factors(seen, some.select(once))[0]))
        return out * views.power[:, None]

    def image_areas(self, part: np.ndarray, middles: np.ndarray) -> np.ndarray:
        """Areas ``(int |h|^2)^2 / int |h|^4`` float64[M] of the images h of some connections.

        By the transform of what each sends through the pupil; ``middles`` float64[M, 2] from their last particles.
        """
        camera, index = self.lens.camera, self.scene.medium.faces.inside / self.scene.medium.faces.outside
        gap, steep = depths(self.lens, self.layout, self.bank.select(part)), tangents(self.scene, camera.aperture)
        widest = 2 * float(np.abs(gap * steep[0] + camera.focus * steep[1]).max())
        side = int(np.clip(3 * camera.aperture * widest / self.scene.wavelength, _COARSEST, _FINEST))
        own = Lens(self.scene, camera, camera.pupil_grid(side))
        kept = np.abs(own.pupil) > 0
        directions, pupil = own.grid.directions[kept], own.pupil[kept]
        power = np.square(np.abs(pupil)) / np.abs(directions[:, 2])
        amplitude = np.sqrt(self.through(PupilViews(directions, power, own.grid.pitch**2), part))
        square = np.square(directions[:, :2]).sum(axis=1)
        inside, outside = np.sqrt(1 - square), np.sqrt(np.maximum(1 - index**2 * square, 0))
        # cos - 1 = -s^2 / (1 + cos), without cancellation
        turns = directions[:, :2] @ middles.T - (square / (1 + inside))[:, None] * gap
        turns -= (index * camera.focus * square / (1 + outside))[:, None]
        phase = np.angle(pupil)[:, None] + self.scene.wavenumber * turns
        out = np.empty(len(part))
        for n, sent in enumerate((amplitude * np.exp(1j * phase)).T):
            field = np.zeros((2 * side, 2 * side), complex)
            field[:side, :side][kept] = sent
            image = np.square(np.abs(np.asarray(fft2(field))))
            out[n] = image.sum() ** 2 / np.square(image).sum() * (own.period / (2 * side)) ** 2
        return out


@dataclass(frozen=True)
class Rays:
    """Rays of the pupil's views on their way to the plane in focus.

    Attributes
    ----------
    tangents : float64[V, 2]
        tan(theta), and focus tan(theta_out).
    slopes : float64[V, 2]
        Their derivatives by the sine.
    along : float64[V, 2]
        Unit vectors sideways.
    sines : float64[V]
    share : float
        Area in squared sines that each stands for.
    grain : float
        The image of a point in focus.
    own : float
        int p / (int p^(1/2))^2 of the pupil itself.
    """

    tangents: np.ndarray
    slopes: np.ndarray
    along: np.ndarray
    sines: np.ndarray
    share: float
    grain: float
    own: float

    @classmethod
    def of(cls, scene: Scene, lens: Lens, views: PupilViews) -> Self:
        """Rays of some views."""
        sines = np.maximum(np.hypot(*views.vectors[:, :2].T), 1e-12)
        index = scene.medium.faces.inside / scene.medium.faces.outside
        inside, outside = np.sqrt(1 - sines**2), np.sqrt(np.maximum(1 - np.square(index * sines), 1e-12))
        focus, fine = index * lens.camera.focus, Lens(scene, lens.camera, lens.camera.pupil_grid(_FINE))
        return cls(np.stack([sines / inside, focus * sines / outside], -1),
                   np.stack([inside**-3, focus * outside**-3], -1), views.vectors[:, :2] / sines[:, None], sines,
                   views.share, fine.grain_area,
                   float(views.power.sum() / views.share / np.sqrt(views.power).sum() ** 2))  # fmt: skip

    def reach(self, gap: np.ndarray) -> np.ndarray:
        """float64[V, M], how far along themselves rays come from last particles so far below the face."""
        return self.tangents[:, :1] * gap + self.tangents[:, 1:]

    def aside(self, gap: np.ndarray) -> np.ndarray:
        """float64[V, M, 2], the same as vectors."""
        return self.reach(gap)[..., None] * self.along[:, None]

    def patches(self, power: np.ndarray, gap: np.ndarray, places: np.ndarray, lit: np.ndarray) -> np.ndarray:
        """float64[6, M]: light in the middle, all light, share under the window, area, and middle x and y."""
        jacobian = np.abs(self.reach(gap) / self.sines[:, None] * (self.slopes[:, :1] * gap + self.slopes[:, 1:]))
        floor = self.grain * self.own  # the grain over the pupil's solid angle
        total = power.sum(axis=0)
        share = power / np.where(total > 0, total, 1.0)
        dense = np.square(share) / self.share
        geometric = 1 / np.maximum((dense / np.maximum(jacobian, 1e-9 * floor)).sum(axis=0), 1e-300)
        even = 1 / np.square(np.sqrt(share).sum(axis=0) + (total <= 0)) / self.share
        dense /= jacobian + floor
        cover = (dense * lit).sum(axis=0) / np.maximum(dense.sum(axis=0), 1e-300)
        x, y = (share[..., None] * places).sum(axis=0).T
        return np.stack([(power * lit).sum(axis=0), total, cover, geometric + self.grain * even / self.own, x, y])
