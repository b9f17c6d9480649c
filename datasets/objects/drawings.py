"""Drawings: strokes, polygons and blobs, each made from one number, so that there are as many as one likes.

They stand for what a user may hide: lines, cut-outs, textures. The number is the source, and its hash decides the
split. Pixels hold the share of their area that is covered.
"""

from abc import abstractmethod
from typing import Literal

import numpy as np

from specklegen.datasets.objects.family import DrawnFamily, Source
from specklegen.datasets.split import generator
from specklegen.kernels.coverage import fill_coverage

_CHORDS = 16  # of a curve: on 28 pixels they leave it by less than a tenth of one
_FINE = 4  # pixels of a blob's fine grid in one of the object's, either way


class Drawing(DrawnFamily):
    """A family whose picture, place and size included, follows from one number."""

    def propose(self, rng: np.random.Generator) -> Source:
        """(number,)."""
        return (int(rng.integers(2**53)),)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """Draw from the number alone; float[h, w]."""
        return self.drawn(generator([int(n) for n in source]))

    @abstractmethod
    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """One drawing, float[h, w]."""


class Strokes(Drawing):
    """One to four strokes of one pen, straight or curved (cubic Bezier curves); splits share no drawing."""

    type: Literal["Strokes"] = "Strokes"

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Strokes ``1/20`` to ``1/7`` of the frame wide."""
        side = min(self.shape)
        pen = rng.uniform(side / 40, side / 14)
        canvas = np.zeros(self.shape)
        for _ in range(rng.integers(1, 5)):
            knots = rng.uniform(pen, np.array(self.shape) - pen, (4, 2))
            if rng.random() < 0.4:  # straight
                knots[1:3] = knots[0] + np.array([[1], [2]]) / 3 * (knots[3] - knots[0])
            t = np.linspace(0, 1, _CHORDS + 1)[:, None]
            basis = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
            canvas = np.maximum(canvas, np.clip(pen + 0.5 - self._distance(basis @ knots), 0, 1))
        return canvas

    def _distance(self, line: np.ndarray) -> np.ndarray:
        """Distance of every pixel's middle from a chain of points float64[n, 2] = (row, column): float64[h, w]."""
        middles = np.moveaxis(np.indices(self.shape), 0, -1)[:, :, None] + 0.5
        start, along = line[:-1], np.diff(line, axis=0)
        length = np.maximum(np.square(along).sum(-1), 1e-12)
        share = np.clip(((middles - start) * along).sum(-1) / length, 0, 1)
        return np.sqrt(np.square(middles - start - share[..., None] * along).sum(-1).min(-1))


class Polygons(Drawing):
    """One to three polygons or ellipses, put together or cut out of one another; splits share no drawing."""

    type: Literal["Polygons"] = "Polygons"

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Shapes a fifth to all of the frame wide."""
        canvas = self._shape(rng)
        for _ in range(rng.integers(3)):
            other = self._shape(rng)
            canvas = np.maximum(canvas, other) if rng.random() < 0.5 else np.abs(canvas - other)
        return canvas if canvas.max() > 0.5 else self._shape(rng)  # two alike may have cut out everything

    def _shape(self, rng: np.random.Generator) -> np.ndarray:
        corners = int(rng.choice([3, 4, 5, 6, 8, 32]))
        radii = np.ones(corners) if corners == 32 else rng.uniform(0.4, 1.0, corners)
        angles = 2 * np.pi * (np.arange(corners) + rng.uniform()) / corners
        half = min(self.shape) / 2 * np.exp(rng.uniform(np.log(0.2), 0, 2))
        turn = rng.uniform(0, np.pi)
        x, y = half[0] * radii * np.cos(angles), half[1] * radii * np.sin(angles)
        points = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)], -1)
        room = np.maximum(np.array(self.shape[::-1]) - np.ptp(points, axis=0), 0)
        points += rng.uniform(0, 1, 2) * room - points.min(0)
        covered = np.empty(self.shape)
        fill_coverage(np.hstack([points, np.roll(points, -1, axis=0)]), covered)
        return covered


class Blobs(Drawing):
    """Areas where smooth noise is above a threshold: islands, rings and textures; splits share no drawing."""

    type: Literal["Blobs"] = "Blobs"

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Islands that cover 5 to 40 % of the frame, on scales of ``1/16`` to ``1/5`` of it."""
        rows, columns = (_FINE * n for n in self.shape)
        scale = min(rows, columns) * np.exp(rng.uniform(np.log(1 / 16), np.log(1 / 5)))
        waves = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
        noise = np.fft.rfft2(rng.standard_normal((rows, columns)))
        field = np.fft.irfft2(noise * np.exp(-2 * np.square(np.pi * scale / 2 * waves)), s=(rows, columns))
        lit = field > np.quantile(field, 1 - rng.uniform(0.05, 0.4))
        return lit.reshape(self.shape[0], _FINE, self.shape[1], _FINE).mean((1, 3))
