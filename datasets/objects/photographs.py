"""Pictures: crops of pictures that scikit-image carries inside its wheel; nothing is downloaded.

scikit-image fetches its newer pictures over the network and carries only the older ones. The list
below names pictures among the files that its wheel holds, and they are read from the
installed package by name, never through the functions that may download. Left out are drawings and
test charts, and the second view of the stereo pair, which shows the scene of the first.
"""

import hashlib
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.extras import extras_named
from specklegen.datasets.objects.family import ListedFamily, Source, place_within
from specklegen.datasets.objects.pictures import read_grey, resampled

_FILES = {
    "astronaut.png": "88431cd9653ccd53",
    "brick.png": "7966caf324f6ba84",
    "camera.png": "b0793d2adda0fa6a",
    "cell.png": "8d23a7fb81f7cc87",
    "chelsea.png": "596aa1e7cb875eb7",
    "clock_motion.png": "f029226b28b642e8",
    "coffee.png": "cc02f8ca188b167c",
    "coins.png": "f8d773fc9cfa6f4d",
    "grass.png": "b6b6022426b38936",
    "gravel.png": "c48615b451bf1e60",
    "hubble_deep_field.jpg": "3a19c5dd8a927a93",
    "ihc.png": "f8dd1aa387ddd1f4",
    "moon.png": "78739619d11f7eb9",
    "motorcycle_left.png": "db18e9c415761740",
    "page.png": "341a6f0a61557662",
    "retina.jpg": "38a07f36f27f095e",
    "rocket.jpg": "c2dd0de7c538df8d",
    "text.png": "bd84aa3a6e3c9887",
}
"""Name of each, and the first 16 digits of the SHA-256 of its bytes: those of scikit-image 0.22 to 0.26 at least."""
PHOTOGRAPHS = tuple(_FILES)

_FINE = 4  # pixels of a crop in one of its silhouette, either way


class Photographs(ListedFamily):
    """A random crop of one picture, turned by quarters and mirrored at random; splits share no picture.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    size
        (smallest, largest) crop, as a fraction of the largest that fits into the picture.
    """

    type: Literal["Photographs"] = "Photographs"
    size: tuple[Annotated[float, Field(ge=0.05, le=1)], Annotated[float, Field(ge=0.05, le=1)]] = (0.3, 1.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.size[0] > self.size[1]:
            reject("Photographs.size", "given as (smallest, largest)", self.size)
        return self

    def sources(self) -> tuple[Source, ...]:
        """(file name,) of each picture."""
        return tuple((name,) for name in PHOTOGRAPHS)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Random crop of a picture; float32[h, w]."""
        return self.crop(source, rng, 1)

    def labels(self, source: Source) -> dict[str, float]:
        """Label: the number of the picture in `PHOTOGRAPHS`."""
        return {"label": float(PHOTOGRAPHS.index(str(source[0])))}

    def crop(self, source: Source, rng: np.random.Generator, fine: int) -> np.ndarray:
        """Random crop, ``fine`` times as many pixels as an object either way; float32[fine h, fine w]."""
        photograph = _photograph(str(source[0]))
        quarters, mirrored = int(rng.integers(4)), bool(rng.integers(2))
        # The crop is taken with the frame's aspect as it will be after turning.
        rows, columns = self.shape if quarters % 2 == 0 else self.shape[::-1]
        scale = rng.uniform(*self.size) * min(photograph.shape[0] / rows, photograph.shape[1] / columns)
        left = place_within(rng, photograph.shape[1] - scale * columns)
        top = place_within(rng, photograph.shape[0] - scale * rows)
        # Rounding must not carry the far corner past the edge.
        right = min(left + scale * columns, photograph.shape[1])
        bottom = min(top + scale * rows, photograph.shape[0])
        crop = np.rot90(resampled(photograph, (left, top, right, bottom), (fine * rows, fine * columns)), quarters)
        return crop[:, ::-1] if mirrored else crop


class Silhouettes(Photographs):
    """The brightest part of a random crop, 5 to 40 % of it, and the rest dark: natural shapes of one brightness.

    Parameters
    ----------
    shape, size
        As of :class:`Photographs`; splits share no picture.
    """

    type: Literal["Silhouettes"] = "Silhouettes"  # type: ignore[assignment]

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Random crop above a threshold; float64[h, w], area covered."""
        crop = self.crop(source, rng, _FINE)
        # Of equally bright pixels, as of burnt-out ones, all are lit or none.
        bright = crop > min(np.quantile(crop, 1 - rng.uniform(0.05, 0.4)), np.nextafter(crop.max(), 0))
        return bright.reshape(self.shape[0], _FINE, self.shape[1], _FINE).mean((1, 3))


@lru_cache(maxsize=len(PHOTOGRAPHS))
def _photograph(name: str) -> np.ndarray:
    with extras_named():
        path = Path(str(files("skimage.data") / name))
    if not path.is_file():
        reject("Photographs file", "in the installed scikit-image", name,
               "This build left its pictures out: install scikit-image from its wheel.")  # fmt: skip
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    if digest != _FILES[name]:
        reject("Photographs file", f"{name} of SHA-256 {_FILES[name]}...", digest,
               "This scikit-image has another picture of that name: install another version.")  # fmt: skip
    return read_grey(path)
