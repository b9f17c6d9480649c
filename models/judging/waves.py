"""Images that none of this package's samplers drew: waves that go from slice to slice through 24 slabs.

They come with the package, in ``models/data/waves.npz``, since they take minutes; ``scripts/build/make_wave_images.py``
makes them and says how. Behind each slab are seen a held-out character and a shape.
"""

import hashlib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np

from specklegen.datasets.loading.stream import tensors

FILE = "data/waves.npz"
SAMPLES = 48
"""Two behind each slab: samples 2 n and 2 n + 1 are seen through one medium, and by the same screens."""
CHANGES = {
    "media": "new", "media_group": 2, "mode_tolerance": 0.001,
    "material": {
        "wavelength": 1.0, "thickness": {"log_uniform": [10.0, 200.0]}, "optical_depth": {"uniform": [4.0, 6.0]},
        "g": None, "scatterer": {"type": "VonMisesFisher", "concentration": {"log_uniform": [258.0, 546.0]}},
    },
    "window": {"width": 128.0}, "camera": {"shape": [96, 96], "pixels_per_grain": 2.0},
    "field": {"pitch": 1 / 256, "extent_over_range": None},
    "objects": {
        "type": "Families", "shape": [28, 28], "families": [
            {"type": "Glyphs", "disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"},
            {"type": "Polygons"},
        ],
    },
}  # fmt: skip
"""Over the recipe ``through-slab``: media, optics and objects of these images, as this package's own sampler draws them
to learn from."""


@cache
def stored() -> Mapping[str, np.ndarray]:
    """Content of the file.

    Returns
    -------
    mapping
        ``counts`` uint16[48, 96, 96] and ``tops`` float64[48]: an image is counts / 65535 * top; ``objects``
        uint8[48, 28, 28], in steps of 1 / 255; parameters float64[48], named "parameters/" and their names.
    """
    with files("specklegen.models").joinpath(FILE).open("rb") as opened, np.load(opened, allow_pickle=False) as content:
        arrays = {name: content[name] for name in sorted(content.files)}
    for array in arrays.values():
        array.setflags(write=False)
    return MappingProxyType(arrays)


def digest() -> str:
    """SHA-256 of the content of the file: names, types, shapes and bytes of its arrays."""
    found = hashlib.sha256()
    for name, array in stored().items():
        found.update(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes())
    return found.hexdigest()


def batch(numbers: Sequence[int]) -> dict[str, Any]:
    """Samples of some numbers, laid out as those of a recipe of hidden objects, as tensors."""
    content, some = stored(), np.asarray(numbers)
    images = content["counts"][some] / np.float32(65535) * content["tops"][some, None, None]
    head = "parameters/"
    return tensors({
        "image": images.astype(np.float32),
        "object": content["objects"][some].astype(np.float32) / np.float32(255),
        "index": some.astype(np.int64),
        "parameters": {name.removeprefix(head): column[some] for name, column in content.items() if head in name},
    })  # fmt: skip
