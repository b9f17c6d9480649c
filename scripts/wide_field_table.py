"""Pages many memory-effect ranges wide, lit a spot at a time: how well they are found, by whom; by chance.

    python scripts/wide_field_table.py --columns 14 --pages 3          # ten ranges; 70 processor seconds a page
    python scripts/wide_field_table.py --columns 62 --pages 1          # forty

Every page is of the recipe ``wide-field``: characters held out, a new medium of one material for each exposure. r is
the Pearson correlation on the covered pixels, as it stands: nothing is moved or turned, since spots have places. By
chance: with each other page of the table, and, of one page, with four of other numbers.
"""

import argparse
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from specklegen.core.parallel import one_torch_thread
from specklegen.datasets import load_recipe
from specklegen.datasets.objects.scan import Scan, spot_of
from specklegen.models import Optics, Retrieval, memory_effect_between, retrieve
from specklegen.models.likelihood import wide_field
from specklegen.models.likelihood.wide_field import scanned_object
from specklegen.models.retrieval.autocorrelation import taper

SPLIT = "test"
WAYS = ("each exposure by phase retrieval, put in the middle of its spot", "all lit at once, camera without end",
        "reflections alone", "scanned_object", "scanned_object, 100 electrons a pixel")  # fmt: skip


def correlation(found: Tensor, true: Tensor, covered: Tensor) -> float:
    """Pearson correlation on the covered pixels."""
    return float(np.corrcoef(found[covered].numpy(), true[covered].numpy())[0, 1])


def exposures(columns: int, seed: int, number: int) -> tuple[Tensor, Scan, Tensor, Tensor, Optics, Tensor]:
    """Images, scan, page, light, optics and C_I of a page."""
    recipe = load_recipe("wide-field", {"objects": {"grid": [3, columns]}})
    scan = recipe.objects
    assert isinstance(scan, Scan)
    count = len(scan.places)
    batch = recipe.batch(seed, SPLIT, range(number * count, (number + 1) * count))
    drawn = {name: torch.from_numpy(np.asarray(x)) for name, x in batch["parameters"].items()}
    optics = Optics(drawn["object_pitch"] / drawn["camera_pitch"],
                    drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"])  # fmt: skip
    correlation = recipe.material_of(seed, SPLIT, 0).correlation
    c_i = memory_effect_between(correlation, recipe.wavelength, float(drawn["object_pitch"][0]), scan.shape)
    page = torch.from_numpy(scan.page(seed, SPLIT, number))
    return torch.from_numpy(batch["image"]), scan, page, drawn["light"], optics, c_i


def one_by_one(found: wide_field.Scanned, moduli: Tensor, light: Tensor) -> Tensor:
    """Every exposure by itself, by phase retrieval from its modulus, its centre of brightness in its spot's."""
    m, (h, w) = moduli.shape[-2], found.spot.shape
    parts = torch.zeros(len(moduli), h, w)
    for n, modulus in enumerate(moduli):
        lags = torch.fft.irfft2(modulus.square(), s=(m, m))
        image = retrieve(lags[None], Retrieval(restarts=10, extent=float(max(h, w)))).image[0].clamp_min(0)
        turned = [torch.fft.fft(image.sum(1 - axis))[1].angle() for axis in (0, 1)]  # of a cyclic mean
        middle = [int(round(float(-turn) / (2 * np.pi) * m)) % m for turn in turned]
        image = image.roll((h // 2 - middle[0], w // 2 - middle[1]), (0, 1))[:h, :w]
        parts[n] = image / image.sum().clamp_min(1e-9) * light[n]
    summed = torch.zeros(found.wide).index_put_((found.rows, found.columns), parts, accumulate=True)
    weight = torch.zeros(found.wide).index_put_(
        (found.rows, found.columns), found.spot.expand(len(parts), h, w), accumulate=True
    )
    return summed / weight.clamp_min(0.1)


def at_once(page: Tensor, c_i: Tensor) -> Tensor:
    """The page from the lags that one image has of it when the camera has no end: C_I times its autocorrelation."""
    m = 2 * max(page.shape)
    power = torch.fft.rfft2(page, s=(m, m)).abs().square()
    lags, near = torch.fft.irfft2(power, s=(m, m)), torch.zeros(m, m)
    h, w = ((n + 1) // 2 for n in c_i.shape)
    near[torch.arange(1 - h, h)[:, None] % m, torch.arange(1 - w, w) % m] = c_i.float()
    image = retrieve((lags * near * taper(m, 0.9 * h, h).float())[None], Retrieval(restarts=10)).image[0]
    spread = torch.zeros(page.shape)
    best, size = -1.0, page.shape
    for flipped in (image, image.flip((0, 1))):  # the best of all places: no spot tells where it is
        for row in range(0, m, 2):
            for column in range(0, m, 2):
                there = flipped.roll((row, column), (0, 1))[: size[0], : size[1]]
                r = float(torch.corrcoef(torch.stack([there.flatten(), page.flatten()]))[0, 1])
                if r > best:
                    best, spread = r, there
    return spread


def scores(columns: int, seed: int, pages: int) -> Iterator[tuple[dict[str, float], list[float]]]:
    """Of every page: r by way, and r of what was found with four other pages."""
    for number in range(pages):
        images, scan, page, light, optics, c_i = exposures(columns, seed, number)
        spot, places = torch.from_numpy(spot_of(scan.shape)), torch.from_numpy(scan.places)
        found = scanned_object(images, spot, places, optics, c_i, light=light)
        noisy = torch.from_numpy(np.random.default_rng([seed, number]).poisson(100 * images.numpy()) / 100)
        dim = scanned_object(noisy, spot, places, optics, c_i, light=light, electrons=100.0)
        seen = wide_field.Seen.of(images, spot, places, optics, c_i, light)
        covered = found.covered
        start = torch.from_numpy(np.random.default_rng([1, 0, 0]).random(seen.scan.wide, np.float32))
        told = dict(zip(WAYS, (
            one_by_one(seen.scan, seen.moduli, seen.light), at_once(page, c_i),
            wide_field.reflected(seen.scan, seen.moduli, start), found.image, dim.image,
        ), strict=True))  # fmt: skip
        others = [torch.from_numpy(scan.page(seed, SPLIT, pages + n)) for n in range(4)]
        yield ({name: correlation(image, page, covered) for name, image in told.items()},
               [correlation(found.image, other, covered) for other in others])  # fmt: skip


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--columns", type=int, default=14)
    asked.add_argument("--pages", type=int, default=3)
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    found, chance = [], []
    for number, (each, others) in enumerate(scores(given.columns, given.seed, given.pages)):
        print(number, {name: round(r, 3) for name, r in each.items()}, flush=True)
        found.append(each)
        chance += others
    print("| way | r, mean | least |\n|---|---|---|")
    for name in WAYS:
        values = [each[name] for each in found]
        print(f"| {name} | {np.mean(values):.3f} | {min(values):.3f} |")
    print(f"| another page | {np.mean(chance):.3f} | {min(chance):.3f} |")


if __name__ == "__main__":
    with one_torch_thread():
        main()
