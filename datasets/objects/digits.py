"""Digits: the 1797 handwritten digits of 8 pixels a side that scikit-learn carries (extra ``digits``).

Source: Alpaydin and Kaynak, *Optical recognition of handwritten digits*, UCI repository (1998); its
test part, as scikit-learn ships it.
"""

import hashlib
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.datasets.objects.family import ListedFamily, Source
from specklegen.datasets.objects.pictures import resampled

_COUNT = 1797
_DIGEST = "87ff0c9e40dc7e2c"  # of grey levels and labels, a byte each: the first digits of their SHA-256


class Digits(ListedFamily):
    """One handwritten digit, at a random size and place; splits share no digit.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    size
        (smallest, largest) side of the digit's square, as a fraction of the frame's shorter side.

    Raises
    ------
    ImportError
        From ``image``, where scikit-learn is not installed.
    """

    type: Literal["Digits"] = "Digits"
    size: tuple[Annotated[float, Field(gt=0, le=1)], Annotated[float, Field(gt=0, le=1)]] = (0.6, 1.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.size[0] > self.size[1]:
            reject("Digits.size", "given as (smallest, largest)", self.size)
        return self

    def sources(self) -> tuple[Source, ...]:
        """(number,) of each digit in scikit-learn's order."""
        return tuple((number,) for number in range(_COUNT))

    def labels(self, source: Source) -> dict[str, float]:
        """Label: the digit."""
        return {"label": float(_digits().target[int(source[0])])}

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Digit, smoothly enlarged, somewhere in the frame; float32[h, w]."""
        digit = _digits().images[int(source[0])].astype(np.float32)
        smallest, largest = (max(1, round(size * min(self.shape))) for size in self.size)
        side = int(rng.integers(smallest, largest + 1))
        top, left = (int(rng.integers(n - side + 1)) for n in self.shape)
        frame = np.zeros(self.shape, dtype=np.float32)
        frame[top : top + side, left : left + side] = resampled(digit, (0, 0, 8, 8), (side, side))
        return frame


@lru_cache(maxsize=1)
def _digits() -> Any:
    try:
        from sklearn.datasets import load_digits
    except ImportError:
        raise ImportError('Digits needs scikit-learn: pip install "specklegen-torch[digits]"') from None
    data: Any = load_digits()
    digest = hashlib.sha256(data.images.astype("u1").tobytes() + data.target.astype("u1").tobytes()).hexdigest()[:16]
    if digest != _DIGEST:
        reject("Digits data", f"those of SHA-256 {_DIGEST}...", digest,
               "The digits of this scikit-learn differ: install another version.")
    return data
