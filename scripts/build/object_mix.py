"""Pictures of objects of many kinds, that the packaged prior learns from; a function of the numbers of a picture.

Characters of the package's fonts and of all scripts that matplotlib's fonts have, words, strokes, shapes, blobs, points
on and between pixels, gratings, handwritten digits, faces, and grey pictures (noise of power laws, leaves that hide one
another). The test and validation characters of `any-object` are in no picture, nor is a character of another script
that looks like one of them (r above .75 in any of four poses, as it is or made as wide as high); of handwritten digits
the training split alone, without those of these characters. Pixels hold the share of their area that is covered.
Pictures lie with their centroid in the middle of a frame.
"""

import unicodedata
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font
from matplotlib.textpath import TextPath
from scipy.ndimage import gaussian_filter

from specklegen.datasets.objects import Blobs, Digits, Points, Polygons, Strokes
from specklegen.datasets.objects.outlines import CHARACTERS, FONTS, outline
from specklegen.kernels.coverage import fill_coverage

SIDE, FRAME = 28, 36
HELD_OUT = "569BFMTVWt" + "2KPbq"
ALIKE = 0.75
_SHAPE = (SIDE, SIDE)
_OTHERS = (
    "DejaVuSans.ttf", "DejaVuSans.ttf", "DejaVuSans.ttf", "DejaVuSerif.ttf", "DejaVuSerif-Bold.ttf",
    "DejaVuSansMono.ttf", "DejaVuSans-Bold.ttf", "DejaVuSans-BoldOblique.ttf", "DejaVuSansMono-Bold.ttf",
    "DejaVuSerif-Italic.ttf",
    "STIXGeneral.ttf", "STIXGeneralBol.ttf", "STIXGeneralItalic.ttf",
)  # fmt: skip


def centred(picture: np.ndarray) -> np.ndarray:
    """Put a picture on the frame, its centroid as near to the middle as it fits; brightest pixel 1."""
    rows, columns = np.nonzero(picture > 1e-3)
    if not len(rows):
        raise ValueError("a picture without light")
    own = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    frame = np.zeros((FRAME, FRAME), np.float32)
    place = []
    for axis in (0, 1):
        weight = own.sum(1 - axis)
        middle = (weight * np.arange(len(weight))).sum() / weight.sum()
        place.append(int(np.clip(round(FRAME / 2 - middle), 0, FRAME - len(weight))))
    frame[place[0] : place[0] + own.shape[0], place[1] : place[1] + own.shape[1]] = own / own.max()
    return frame


def filled(loops: list[np.ndarray], size: float, angle: float, stretch: float = 1.0, side: int = SIDE) -> np.ndarray:
    """Area of each pixel inside closed loops float[n, 2], turned, their longer side ``size`` pixels."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    placed = [loop * [1, stretch] @ turn.T for loop in loops]
    low = np.min([each.min(0) for each in placed], axis=0)
    extent = np.max([each.max(0) for each in placed], axis=0) - low
    scale = min(size, side - 1e-6) / extent.max()
    placed = [(each - low) * scale + (side - scale * extent) / 2 for each in placed]
    edges = np.concatenate([np.hstack([each, np.roll(each, -1, axis=0)]) for each in placed])
    covered = np.empty((side, side))
    fill_coverage(np.ascontiguousarray(edges.clip(0, side)), covered)
    return covered[::-1]


def loops_of(edges: np.ndarray) -> list[np.ndarray]:
    """Closed loops of an outline's edges float[n, 4], which follow one another within a loop."""
    breaks = np.flatnonzero((edges[1:, :2] != edges[:-1, 2:]).any(1)) + 1
    return [part[:, :2] for part in np.split(edges, breaks)]


@lru_cache(maxsize=20000)
def loops(font: str, character: str) -> tuple[np.ndarray, ...]:
    """Loops of a character of one of matplotlib's fonts; of the package's own outlines where it has them."""
    if font in FONTS and character in CHARACTERS:
        return tuple(loops_of(outline(font, character)))
    file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / font
    path = TextPath((0, 0), character, size=100, prop=FontProperties(fname=str(file)))
    closed = map(np.asarray, path.to_polygons(closed_only=True))
    return tuple(each[:-1] for each in closed if len(each) > 3)


def scripts() -> dict[str, str]:
    """Characters of other scripts that each of the fonts has, without those that look like held-out ones."""
    fonts = sorted(set(_OTHERS))
    held = [_looks(font, c) for font in ("DejaVuSans.ttf", "DejaVuSerif.ttf", "cmr10.ttf") for c in HELD_OUT]
    judged = []
    for own in np.stack(held, axis=1):  # as it is, and as wide as high
        poses = [own, own[:, ::-1], own[:, :, ::-1], own[:, ::-1, ::-1]]
        judged.append(np.concatenate([_standard(pose) for pose in poses]))
    found: dict[str, str] = {}
    looks: dict[str, bool] = {}
    for font in fonts:
        codes = FT2Font(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / font)).get_charmap()
        kept = []
        for code in sorted(codes):
            character = chr(code)
            if not 0x21 <= code < 0xFB00 or 0x2500 <= code < 0x2C00 or 0xE000 <= code < 0xF900:
                continue
            if unicodedata.category(character) not in ("Lu", "Ll", "Lo", "Nd", "Sm", "So", "Sc"):
                continue
            plain = unicodedata.normalize("NFKD", character)
            if any(part in HELD_OUT for part in plain):
                continue
            if character not in looks:
                looks[character] = bool(loops(font, character)) and all(
                    (table @ each).max() < ALIKE
                    for table, each in zip(judged, _standard(_looks(font, character)), strict=True)
                )
            if looks[character]:
                kept.append(character)
        found[font] = "".join(kept)
    return found


def _looks(font: str, character: str) -> np.ndarray:
    """A character as it is, and made as wide as high, float[2, 16, 16]."""
    own = list(loops(font, character))
    extent = np.ptp(np.concatenate(own), axis=0)
    both = [filled(own, 16, 0.0, stretch, side=16) for stretch in (1.0, float(extent[0] / max(extent[1], 1e-9)))]
    return np.stack([gaussian_filter(each, 0.7) for each in both])


def _standard(looks: np.ndarray) -> np.ndarray:
    flat = looks.reshape(len(looks), -1)
    flat = flat - flat.mean(1, keepdims=True)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)


class Mix:
    """Pictures by number.

    Parameters
    ----------
    known
        Characters of each font that may be shown, of :func:`scripts`; found anew where they are not given.
    """

    def __init__(self, known: dict[str, str] | None = None) -> None:
        self.known = scripts() if known is None else known
        self.own = "".join(c for c in CHARACTERS if c not in HELD_OUT)
        self.digits = Digits(shape=_SHAPE)
        written = self.digits.by_split["train"]
        self.written = [each for each in written if f"{self.digits.labels(each)['label']:.0f}" not in HELD_OUT]
        self.kinds: tuple[tuple[float, Callable[[np.random.Generator], np.ndarray]], ...] = (
            (4.0, self.character), (4.0, self.other_character), (1.0, self.word), (1.5, self.strokes),
            (2.0, self.polygons), (2.0, self.figure), (1.5, self.blobs), (1.0, self.points), (1.5, self.soft_points),
            (1.5, self.grating), (1.0, self.digit), (1.0, self.face), (1.2, self.clouds), (0.8, self.leaves),
        )  # fmt: skip
        weights = np.array([weight for weight, _ in self.kinds])
        self.shares = weights / weights.sum()

    def __call__(self, *number: int) -> np.ndarray:
        """Picture float32[FRAME, FRAME], brightness 0 to 1."""
        rng = np.random.default_rng([9, *number])
        while True:
            picture = self.kinds[rng.choice(len(self.kinds), p=self.shares)][1](rng)
            picture = np.clip(self._shaded(np.asarray(picture, np.float64), rng), 0, None)
            if picture.max() > 0.05 and (picture > 0.2 * picture.max()).sum() >= 2:
                return centred(picture / picture.max())

    def _shaded(self, picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Now and then a slope of brightness over all of it, or a blur."""
        if rng.random() < 0.12:
            y, x = np.indices(picture.shape) / picture.shape[0] - 0.5
            angle = rng.uniform(0, 2 * np.pi)
            picture = picture * np.clip(1 + rng.uniform(0, 1.6) * (x * np.cos(angle) + y * np.sin(angle)), 0.05, None)
        if rng.random() < 0.1:
            picture = gaussian_filter(picture, rng.uniform(0.3, 0.9), mode="constant")
        return picture

    def _size(self, rng: np.random.Generator) -> float:
        return rng.uniform(0.4, 0.95) * SIDE

    def character(self, rng: np.random.Generator) -> np.ndarray:
        """One of the package's characters."""
        font, character = FONTS[rng.integers(len(FONTS))], self.own[rng.integers(len(self.own))]
        return filled(list(loops(font, character)), self._size(rng), np.deg2rad(rng.uniform(-30, 30)))

    def other_character(self, rng: np.random.Generator) -> np.ndarray:
        """One of any script, stretched a little."""
        font = _OTHERS[rng.integers(len(_OTHERS))]
        known = self.known[font]
        own = list(loops(font, known[rng.integers(len(known))]))
        if not own:
            return np.zeros(_SHAPE)
        angle = np.deg2rad(rng.uniform(-30, 30) if rng.random() < 0.8 else rng.uniform(-180, 180))
        return filled(own, self._size(rng), angle, float(np.exp(rng.normal(0, 0.12))))

    def word(self, rng: np.random.Generator) -> np.ndarray:
        """Two or three characters beside one another."""
        font = FONTS[rng.integers(len(FONTS))]
        parts, right = [], 0.0
        for _ in range(rng.integers(2, 4)):
            own = loops(font, self.own[rng.integers(len(self.own))])
            left = min(each[:, 0].min() for each in own)
            parts += [each - [left - right, 0] for each in own]
            right += max(each[:, 0].max() for each in own) - left + rng.uniform(5, 15)
        return filled(parts, rng.uniform(0.7, 1.0) * SIDE, np.deg2rad(rng.uniform(-30, 30)))

    def strokes(self, rng: np.random.Generator) -> np.ndarray:
        """Strokes of one pen."""
        return Strokes(shape=_SHAPE).drawn(rng)

    def polygons(self, rng: np.random.Generator) -> np.ndarray:
        """Polygons put together or cut out."""
        return Polygons(shape=_SHAPE).drawn(rng)

    def blobs(self, rng: np.random.Generator) -> np.ndarray:
        """Islands."""
        return Blobs(shape=_SHAPE).drawn(rng)

    def figure(self, rng: np.random.Generator) -> np.ndarray:
        """A regular figure: a wheel of spokes, a star, a ring, a frame, steps, a sector."""
        kind, turn = rng.integers(6), np.linspace(0, 2 * np.pi, 41)[:-1]
        circle = np.stack([np.cos(turn), np.sin(turn)], 1)
        inner = rng.uniform(0.25, 0.85)
        if kind == 0:  # arms of a wheel
            arms, wide = int(rng.integers(3, 7)), rng.uniform(0.12, 0.4)
            own = []
            for n in range(arms):
                direction = 2 * np.pi * n / arms
                along = np.array([np.cos(direction), np.sin(direction)])
                across = np.array([-along[1], along[0]]) * wide
                own += [across + along, across, np.zeros(2), -across, -across + along]
            own = [np.array(own)]
        elif kind == 1:
            corners = int(rng.integers(3, 9))
            around = np.linspace(0, 2 * np.pi, 2 * corners + 1)[:-1]
            radius = np.where(np.arange(2 * corners) % 2, inner, 1.0)[:, None]
            own = [np.stack([np.cos(around), np.sin(around)], 1) * radius]
        elif kind == 2:
            offset = rng.uniform(-1, 1, 2) * (1 - inner) * rng.uniform(0, 1)
            own = [circle, (inner * circle + offset)[::-1]]
        elif kind == 3:
            corners = int(rng.choice([3, 4, 5, 6]))
            around = np.linspace(0, 2 * np.pi, corners + 1)[:-1]
            shape = np.stack([np.cos(around), np.sin(around)], 1)
            own = [shape, inner * shape[::-1]]
        elif kind == 4:  # edges at right angles
            levels = np.cumsum(rng.uniform(0.2, 1, rng.integers(2, 5)))
            heights = rng.uniform(0.2, 1.5, len(levels))
            top = np.concatenate([[[a, h], [b, h]] for a, b, h in zip([0, *levels[:-1]], levels, heights, strict=True)])
            lowest = -rng.uniform(0, 0.8, 2)
            own = [np.concatenate([top, [[levels[-1], lowest[0]], [0, lowest[1]]]])]
        else:
            part = np.linspace(0, rng.uniform(0.3, 1.8) * np.pi, 30)
            arc = np.stack([np.cos(part), np.sin(part)], 1)
            own = [np.concatenate([arc, rng.choice([0.0, inner]) * arc[::-1]])]
        return filled(own, self._size(rng), rng.uniform(0, 2 * np.pi), float(np.exp(rng.normal(0, 0.3))))

    def points(self, rng: np.random.Generator) -> np.ndarray:
        """Bright pixels."""
        family = Points(shape=_SHAPE, count=int(rng.integers(2, 15)))
        return family.picture(family.propose(rng), rng)

    def soft_points(self, rng: np.random.Generator) -> np.ndarray:
        """Points between pixels, of unequal brightness, as wide as a pixel or as a lens makes them."""
        reach = rng.uniform(0.3, 1) * (SIDE - 6) / 2
        y, x = np.indices(_SHAPE)
        picture, wide = np.zeros(_SHAPE), rng.choice([0.0, rng.uniform(0.4, 1.5)])
        least = rng.choice([1.0, 0.3])
        for _ in range(rng.integers(2, 13)):
            row, column = SIDE / 2 - 0.5 + rng.uniform(-reach, reach, 2)
            if wide:
                spot = np.exp(-(np.square(y - row) + np.square(x - column)) / (2 * wide**2))
            else:  # of the size of a pixel
                spot = np.clip(1 - abs(y - row), 0, None) * np.clip(1 - abs(x - column), 0, None)
            picture += rng.uniform(least, 1) * spot
        picture[picture < 4e-3 * picture.max()] = 0
        return picture

    def grating(self, rng: np.random.Generator) -> np.ndarray:
        """Bars at any angle, sharp or sinusoidal, in a field of one of three shapes."""
        fine = 4
        y, x = (np.indices((SIDE * fine, SIDE * fine)) + 0.5) / fine - SIDE / 2
        angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)], p=[0.3, 0.3, 0.4])
        across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        period, phase = rng.uniform(2.5, 10), rng.uniform(0, 1)
        wave = np.cos(2 * np.pi * (across / period + phase))
        light = (wave > np.cos(np.pi * rng.uniform(0.25, 0.75))).astype(float) if rng.random() < 0.7 else (1 + wave) / 2
        half = rng.uniform(0.3, 0.68, 2) * SIDE / 1.4142
        field = rng.integers(3)
        if field == 0:
            bars = rng.integers(2, 6) * period / 2
            inside = (abs(across) < min(half[0], bars)) & (abs(along) < half[1])
        elif field == 1:
            inside = np.square(across / half[0]) + np.square(along / half[1]) < 1
        else:
            inside = np.exp(-1.5 * (np.square(across / half[0]) + np.square(along / half[1])))
            inside = inside * (np.hypot(x, y) < SIDE / 2)
        return (light * inside).reshape(SIDE, fine, SIDE, fine).mean((1, 3))

    def digit(self, rng: np.random.Generator) -> np.ndarray:
        """A handwritten digit of the training split, of a number that is not held out."""
        return self.digits.picture(self.written[rng.integers(len(self.written))], rng).clip(0)

    def face(self, rng: np.random.Generator) -> np.ndarray:
        """An oval with features, shaded."""
        y, x = (np.indices(_SHAPE) + 0.5) / SIDE * 2 - 1
        angle = rng.normal(0, 0.3)
        x, y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        wide, high = rng.uniform(0.5, 0.75), rng.uniform(0.7, 0.95)

        def spot(column: float, row: float, width: float, height: float) -> np.ndarray:
            return np.exp(-(np.square((x - column) / width) ** 2 + np.square((y - row) / height) ** 2))

        head = 1 / (1 + np.exp(25 * (np.hypot(x / wide, y / high) - 1)))
        face = head * (0.8 + rng.uniform(-0.3, 0.3) * x + rng.uniform(-0.3, 0.3) * y)
        apart, row, eye = rng.uniform(0.3, 0.5) * wide, -rng.uniform(0.1, 0.3) * high, rng.uniform(0.08, 0.16)
        depth = rng.uniform(0.4, 1.0)
        for column in (-apart, apart):
            face = face * (1 - depth * spot(column, row, eye, eye * rng.uniform(0.6, 1)))
        face = face * (1 - rng.uniform(0.1, 0.5) * spot(0, 0.12 * high, 0.07, 0.16))
        face = face * (1 - depth * spot(0, 0.5 * high, rng.uniform(0.15, 0.32), rng.uniform(0.05, 0.12)))
        if rng.random() < 0.5:  # hair
            face = face * np.where(y < -rng.uniform(0.4, 0.7) * high, rng.uniform(0.1, 0.5), 1)
        return face

    def clouds(self, rng: np.random.Generator) -> np.ndarray:
        """Noise of a power law in a field, its contrast drawn."""
        side = 2 * SIDE
        wave = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
        wave[0, 0] = 1 / side
        noise = np.fft.rfft2(rng.standard_normal((side, side))) * wave ** -rng.uniform(1.2, 2.6)
        field = np.fft.irfft2(noise, s=(side, side))[:SIDE, :SIDE]
        field = (field - field.mean()) / max(field.std(), 1e-9)
        light = 1 / (1 + np.exp(-rng.uniform(0.7, 5) * (field - rng.uniform(-1, 0.7))))
        return light * self._field(rng)

    def leaves(self, rng: np.random.Generator) -> np.ndarray:
        """Discs and boxes of any grey that hide one another."""
        y, x = np.indices(_SHAPE)
        picture = np.full(_SHAPE, rng.uniform(0, 1))
        for radius in sorted(1.5 * rng.pareto(1.5, 25) + 1.5, reverse=True):
            row, column, grey = rng.uniform(0, SIDE, 2).tolist() + [rng.uniform(0, 1)]
            away = np.hypot(y - row, x - column) if rng.random() < 0.6 else np.maximum(abs(y - row), abs(x - column))
            cover = np.clip(radius - away + 0.5, 0, 1)
            picture = picture * (1 - cover) + grey * cover
        return picture * self._field(rng)

    def _field(self, rng: np.random.Generator) -> np.ndarray:
        """Where grey pictures have light: everywhere, in an oval, in a box, or in one of the shapes."""
        kind = rng.integers(4)
        if kind == 0:
            return np.ones(_SHAPE)
        if kind == 1:
            turn = np.linspace(0, 2 * np.pi, 41)[:-1]
            oval = np.stack([np.cos(turn), rng.uniform(0.5, 1) * np.sin(turn)], 1)
            return filled([oval], rng.uniform(0.5, 1) * SIDE, rng.uniform(0, np.pi))
        if kind == 2:
            box = np.array([[0, 0], [1, 0], [1, rng.uniform(0.4, 1)], [0, 1]])
            return filled([box], rng.uniform(0.5, 1) * SIDE, rng.uniform(-0.3, 0.3))
        return self.polygons(rng)
