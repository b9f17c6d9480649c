"""Wide fields: pages ten to forty memory-effect ranges wide, seen a spot of light at a time.

A page is one question: all its exposures (:class:`specklegen.datasets.objects.scan.Scan`), each behind a medium of its
own, with the place of the spot at each. The answer is the page, in its place and the right way up; or, from a function
that knows images alone, an object for each exposure, which is then put where its spot was.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.random_streams import Seed
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.objects.scan import Scan, spot_of
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.judging.evaluation import PERFECT
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.wide_field import COVERED, scanned_object
from specklegen.models.metrics import SCORES

CHANGES = {"objects": {"grid": [3, 62]}, "camera": {"shape": [400, 400]}}
"""Over the recipe ``wide-field``."""
COLUMNS = (14, 23, 38, 62)
"""Columns of places of each page: 10, 16, 25 and 40 ranges."""
SAMPLES = len(COLUMNS)
_PARTS = 16  # exposures that a function of images alone is asked about at once


def digest(recipe: HiddenObject) -> str:
    """SHA-256 of what decides a pixel: the recipe, and how wide its pages are."""
    return hashlib.sha256(json.dumps([recipe.fingerprint(), COLUMNS]).encode()).hexdigest()


def page(recipe: HiddenObject, number: int, seed: Seed, images: bool = True) -> dict[str, Any]:
    """A page and its exposures.

    Returns
    -------
    dict
        ``image`` float32[N, H, W], ``object`` float32[N, h, w], what each spot lights, ``parameters`` float64[N] each,
        ``places`` int64[N, 2], ``spot`` float32[h, w], ``page`` float32[rows, columns] and ``index`` int64[1]. Without
        ``images`` the page and what is known of its spots alone.
    """
    scan = recipe.objects
    assert isinstance(scan, Scan)
    across, columns = scan.grid[1], COLUMNS[number]
    some = [n for n in range(len(scan.places)) if n % across < columns]
    places = scan.places[some]
    wide = scan.page(seed, "test", number)[:, : int(places[:, 1].max()) + scan.shape[1]]
    known = {
        "places": torch.from_numpy(places.astype(np.int64)), "spot": torch.from_numpy(spot_of(scan.shape)).float(),
        "page": torch.from_numpy(wide.copy()), "index": torch.tensor([number]),
    }  # fmt: skip
    if not images:
        return known
    first = number * len(scan.places)
    return tensors(recipe.batch(seed, "test", [first + n for n in some])) | known


def shape_of(places: Tensor, spot: Tensor) -> tuple[int, int]:
    """Shape of a page that a spot lights in some places."""
    rows, columns = (int(first) + side for first, side in zip(places.amax(0), spot.shape, strict=True))
    return rows, columns


def shapes(recipe: HiddenObject) -> dict[int, tuple[int, int]]:
    """Shape of each page by the number of its exposures."""
    scan = recipe.objects
    assert isinstance(scan, Scan)
    down, rows = scan.grid[0], scan.wide[0]
    return {down * columns: (rows, (columns - 1) * scan.step + scan.shape[1]) for columns in COLUMNS}


def told(places: Tensor, spot: Tensor) -> tuple[slice, slice]:
    """Rows and columns of a page that the spots light well enough to be scored; only these are scored."""
    rows, columns = (torch.zeros(side) for side in shape_of(places, spot))
    profile = (spot.square().sum(1), spot.square().sum(0))
    for summed, axis in ((rows, 0), (columns, 1)):
        for first in places[:, axis].unique().tolist():
            summed[first : first + spot.shape[axis]] += profile[axis]
    lit = [(summed >= COVERED**0.5 * summed.max()).nonzero()[:, 0] for summed in (rows, columns)]
    return slice(int(lit[0][0]), int(lit[0][-1]) + 1), slice(int(lit[1][0]), int(lit[1][-1]) + 1)


def together(answer: Tensor, asked: Mapping[str, Any]) -> Tensor:
    """A page real[1, rows, columns] as it is, or objects real[N, h, w], each put where its spot was, as one page.

    The centre of brightness of each is put in the middle of its spot, with the light of its exposure.
    """
    places, spot = asked["places"], asked["spot"]
    shape = shape_of(places, spot)
    if tuple(answer.shape) == (1, *shape):
        return answer.float()
    h, w = spot.shape
    light = asked["parameters"]["light"].float()
    summed, weight = torch.zeros(shape), torch.zeros(shape)
    for (row, column), one, bright in zip(places.tolist(), answer.float(), light.tolist(), strict=True):
        edge = torch.cat([one[0], one[-1], one[:, 0], one[:, -1]]).median()
        frame = torch.zeros(2 * h + one.shape[0], 2 * w + one.shape[1])
        frame[: one.shape[0], : one.shape[1]] = (one - edge).clamp_min(0)
        middle = []
        for axis, side in enumerate(frame.shape):
            turn = -torch.fft.fft(frame.sum(1 - axis))[1].angle() / (2 * np.pi)
            middle.append(int(torch.round(turn * side)) % side)
        part = frame.roll((h // 2 - middle[0], w // 2 - middle[1]), (0, 1))[:h, :w]
        summed[row : row + h, column : column + w] += part / part.sum().clamp_min(1e-9) * bright
        weight[row : row + h, column : column + w] += spot
    return (summed / weight.clamp_min(0.1))[None]


def scores(answers: Sequence[Tensor], pages: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Scores float64[n] by name, of pages real[1, rows, columns] as they stand, nothing moved or turned.

    Of two pages of another width the columns that both have are compared.
    """
    found: dict[str, list[float]] = {name: [] for name in SCORES}
    for answer, one in zip(answers, pages, strict=True):
        rows, columns = told(one["places"], one["spot"])
        columns = slice(columns.start, min(columns.stop, answer.shape[-1]))
        made, true = answer[0, rows, columns].float(), one["page"][rows, columns]
        for name, score in SCORES.items():
            found[name].append(float(score(made, true).clamp(max=PERFECT)))
    return {name: np.array(values) for name, values in found.items()}


def in_parts(function: Callable[[Mapping[str, Any]], Tensor]) -> Callable[[Mapping[str, Any]], Tensor]:
    """A function of images that is asked about a few exposures at a time, since a page has up to 186."""

    def run(batch: Mapping[str, Any]) -> Tensor:
        made = []
        for first in range(0, len(batch["object"]), _PARTS):
            some = slice(first, first + _PARTS)
            part = {name: batch[name][some] for name in ("image", "object", "memory_effect")}
            made.append(function(part | {"parameters": {n: x[some] for n, x in batch["parameters"].items()}}))
        return torch.cat([torch.as_tensor(each) for each in made])

    return run


def scanned(recipe: HiddenObject, seed: int = 0) -> Callable[[Mapping[str, Any]], Tensor]:
    """Ptychography by speckle: one object that suits all exposures (:func:`scanned_object`)."""

    def method(batch: Mapping[str, Any]) -> Tensor:
        drawn = batch["parameters"]
        optics = Optics(drawn["object_pitch"] / drawn["camera_pitch"],
                        drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"], recipe.profile)  # fmt: skip
        h, w = batch["spot"].shape
        apart = np.hypot(np.arange(1 - h, h)[:, None], np.arange(1 - w, w))
        curve = batch["memory_effect"][0].numpy()
        c_i = torch.from_numpy(np.interp(apart, np.arange(len(curve)), curve))
        found = scanned_object(
            batch["image"], batch["spot"], batch["places"], optics, c_i, light=drawn["light"], seed=seed
        )
        return found.image[None]

    return method
