"""Phase retrieval through a slab: how often it succeeds, option by option, within and beyond the memory effect.

    python scripts/phase_retrieval_table.py --out DIR [--media 50] [--restarts 10] [--threads 2] [--quick] [--speed]

Objects of 28 x 28 pixels, 3 pixels a grain (9.3 grains across), optical depth 10, g = 0.9, a camera of 480 x 480
pixels (2.56e4 grains), every image through a medium of its own. The window's width sets the extent over the range.
Writes scores.csv (an image a line), table.md and contact_sheet.png. Success is a Pearson correlation above 0.8 with
the diffraction-limited object on the retrieval's frame of 64 x 64 pixels, aligned over all shifts and the flip.
"""

import argparse
import csv
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, cast

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.stats import binomtest
from torch import Tensor

from specklegen.core.parallel import one_torch_thread
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Glyphs, ObjectFamily, Photographs, Points
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval.apodisation import diffraction_limited, framed, transfer_function
from specklegen.models.retrieval.autocorrelation import autocorrelation, memory_effect_at_lags
from specklegen.models.retrieval.phase_retrieval import BETAS, Retrieval, retrieve
from specklegen.models.retrieval.restarts import lowest_error

FAMILIES: dict[str, ObjectFamily] = {"points": Points(), "glyphs": Glyphs(), "photographs": Photographs()}
EXTENTS = {"points": (0.5, 1.0, 2.0, 3.0), "glyphs": (0.5, 1.0, 2.0), "photographs": (0.5,)}
PIXELS, PER_GRAIN, CAMERA, FRAME = 28, 3.0, 480, 64
LARGEST_LAG = 34.0  # pixels: between the side of an object's frame and its diagonal
SUCCESS = 0.8
ABLATION_MEDIA = 25
PHOTONS, BEAM = 2.0, 160.0  # a pixel of mean brightness; the Gaussian envelope's sigma in pixels
TRANSFER = transfer_function(FRAME, PER_GRAIN)
HEAD = ("family", "extent", "variant", "medium", "consensus", "lowest_error", "best_restart", "sharp", "inside")


class Variant(NamedTuple):
    """One way to retrieve: which autocorrelation, which C_I, whether apodised, and the options."""

    c_i: Callable[[MemoryEffectCorrelation], Callable[[np.ndarray], np.ndarray]] | None
    apodised: bool
    retrieval: Retrieval
    measured: str = "whole"


class Cell(NamedTuple):
    """Objects of one family at one extent, as each kind of measurement sees them."""

    family: str
    extent: float
    objects: Tensor
    autocorrelations: dict[str, Tensor]
    image: Tensor
    correlation: MemoryEffectCorrelation
    pitch: float


def stretched(factor: float):
    """C_I with the memory-effect range taken for ``factor`` times what it is."""
    return lambda correlation: lambda q: correlation(q / factor)


def another_run(correlation: MemoryEffectCorrelation):
    """K from paths that the simulation has not seen."""
    return estimate_correlation(slab(), 100_000, 1)


def slab():
    """The material of every cell."""
    return load_recipe("through-slab").material.extremes()[0]


def variants(restarts: int) -> dict[str, Variant]:
    """Every way that the table compares, by name."""
    full = Retrieval(restarts=restarts, extent=LARGEST_LAG)
    plain = Retrieval(restarts=restarts, shrink_wrap=0.0)
    known = stretched(1.0)
    return {
        "C_I": Variant(known, True, full),
        "plain Katz": Variant(None, False, plain),
        "C_I, another K": Variant(another_run, True, full),
        "C_I, range +20 %": Variant(stretched(1.2), True, full),
        "C_I, range -20 %": Variant(stretched(0.8), True, full),
        "without C_I": Variant(None, True, full),
        "without apodisation": Variant(known, False, full),
        "without shrink-wrap": Variant(known, True, full.replace(shrink_wrap=0.0)),
        "without taper": Variant(known, True, full.replace(extent=None)),
        "1 frame of 160 x 160": Variant(known, True, full, "1 tile"),
        "9 frames of 160 x 160": Variant(known, True, full, "9 tiles"),
        "envelope, shot noise": Variant(known, True, full, "corrected"),
        "envelope not removed": Variant(known, True, full, "envelope kept"),
        "shot noise kept": Variant(known, True, full, "shot noise kept"),
    }


ABLATED = (("points", 2.0), ("glyphs", 0.5), ("glyphs", 2.0), ("photographs", 0.5))
MEASURED_ABLATED = (("glyphs", 1.0),)


def ablation(name: str, variant: Variant) -> bool:
    """Whether a variant shows what one step is good for, on fewer media."""
    return name.startswith("without") or variant.measured != "whole"


def applies(name: str, variant: Variant, family: str, extent: float) -> bool:
    """Whether the table has this variant for a cell: ablations are shown where they matter most."""
    if variant.measured != "whole":
        return (family, extent) in MEASURED_ABLATED
    return not name.startswith("without") or (family, extent) in ABLATED


def recipe(extent: float) -> HiddenObject:
    """Scene whose objects are ``extent`` ranges and 9.3 grains wide, object and camera of one pitch."""
    base = load_recipe("through-slab")
    pitch = extent * base.material.known(slab()).range_sine(0.5) / PIXELS
    changes = {
        "media": 10_000,
        "window": {"width": 0.5 / (PER_GRAIN * pitch)},
        "camera": {"shape": [CAMERA, CAMERA], "pixels_per_grain": PER_GRAIN},
        "field": {"extent_over_range": extent},
        "sampler": "stationary",  # at three ranges its correlations are off by 0.035 and the planner would draw paths
    }
    return cast(HiddenObject, load_recipe("through-slab", changes))


def measured(image: Tensor, family: str, extent: float, medium: int) -> dict[str, Tensor]:
    """Autocorrelations of one image [H, W], by what was measured and corrected."""
    found = {"whole": autocorrelation(image[None], FRAME)}
    if (family, extent) not in MEASURED_ABLATED:
        return found
    side = CAMERA // 3
    tiles = image.reshape(3, side, 3, side).transpose(1, 2).reshape(9, side, side)
    found["1 tile"], found["9 tiles"] = autocorrelation(tiles[:1], FRAME), autocorrelation(tiles, FRAME)
    r2 = (torch.arange(CAMERA, dtype=torch.float64) - CAMERA / 2) ** 2
    beam = torch.exp(-(r2[:, None] + r2) / (2 * BEAM**2))
    rng = np.random.default_rng([6, medium])
    counts = torch.from_numpy(rng.poisson((PHOTONS * beam * image.clamp_min(0)).numpy()) / PHOTONS)[None]
    found["corrected"] = autocorrelation(counts, FRAME, sigma=CAMERA / 8, electrons=PHOTONS)
    found["envelope kept"] = autocorrelation(counts, FRAME, electrons=PHOTONS)
    found["shot noise kept"] = autocorrelation(counts, FRAME, sigma=CAMERA / 8)
    return found


def cells(media: int, split: str) -> Iterator[Cell]:
    """Draw every cell; families of one extent look through the same media."""
    for extent in sorted({e for extents in EXTENTS.values() for e in extents}):
        scene, families = recipe(extent), [f for f in FAMILIES if extent in EXTENTS[f]]
        kept = {family: ([], [], []) for family in families}
        for medium in range(media):
            ready = scene.prepare(0, split, medium)  # type: ignore[arg-type]
            seen = ready.seen
            if len(families) > 1 and ready.imaging.spectra_bytes < 2**27:
                seen = seen.shared()
            for family in families:
                brightness = FAMILIES[family].image(0, split, medium)  # type: ignore[arg-type]
                image = seen.images(torch.from_numpy(brightness)[None])[0, 0].double()
                for store, value in zip(
                    kept[family],
                    (torch.from_numpy(brightness), measured(image, family, extent, medium), image[:160, :160]),
                    strict=True,
                ):
                    store.append(value)
        pitch = ready.parameters["camera_pitch"]
        for family, (objects, found, images) in kept.items():
            stacked = {name: torch.stack([each[name] for each in found]) for name in found[0]}
            correlation = scene.material.known(slab()).correlation
            yield Cell(family, extent, torch.stack(objects), stacked, torch.stack(images), correlation, pitch)


def best_pearson(images: Tensor, target: Tensor) -> Tensor:
    """Pearson correlation after alignment."""
    target = target.expand_as(images)
    return pearson(align(images, target), target)


def inside(images: Tensor, target: Tensor) -> Tensor:
    """Pearson correlation within the object's own frame alone, where an even brightness scores nothing."""
    return pearson(*(x[:, :PIXELS, :PIXELS] for x in (align(images, target), target)))


def scored(cell: Cell, name: str, variant: Variant, threads: int | None) -> tuple[list[tuple], Tensor]:
    """Lines of scores.csv, and the images chosen: the consensus, or for plain Katz the lowest error."""
    objects, lags = cell.objects, cell.autocorrelations[variant.measured]
    if ablation(name, variant):
        objects, lags = objects[:ABLATION_MEDIA], lags[:ABLATION_MEDIA]
    c_i = None
    if variant.c_i is not None:
        c_i = memory_effect_at_lags(variant.c_i(cell.correlation), 0.5, cell.pitch, FRAME)  # type: ignore[arg-type]
    found = retrieve(
        lags, variant.retrieval, memory_effect=c_i,
        transfer=TRANSFER if variant.apodised else None, threads=threads,
    )  # fmt: skip
    lowest = lowest_error(found.restarts, found.error)
    chosen = lowest if name == "plain Katz" else found.image
    with one_torch_thread():
        target, sharp = diffraction_limited(objects, TRANSFER), framed(objects, FRAME)
        every = best_pearson(found.restarts, target[:, None]).amax(1)
        columns = [best_pearson(x, t) for x, t in ((found.image, target), (lowest, target), (chosen, sharp))]
        within = inside(chosen, target)
    scores = torch.stack([columns[0], columns[1], every, columns[2], within], 1).tolist()
    return [(cell.family, cell.extent, name, medium, *row) for medium, row in enumerate(scores)], chosen


def chosen_score(row: tuple) -> float:
    """Pearson correlation of the image that the variant shows."""
    return row[5] if row[2] == "plain Katz" else row[4]


def interval(successes: int, n: int) -> str:
    """Success rate with Wilson's 95 % interval, in percent."""
    low, high = binomtest(successes, n).proportion_ci(method="wilson")
    return f"{100 * successes / n:.0f} ({100 * low:.0f}–{100 * high:.0f})"


def difference(rows: list[tuple], place: tuple, name: str) -> str:
    """Mean difference of a variant's correlations to those of "C_I" on the same media, and its standard error."""
    mine = {row[3]: chosen_score(row) for row in rows if row[:3] == (*place, name)}
    full = {row[3]: chosen_score(row) for row in rows if row[:3] == (*place, "C_I")}
    delta = np.array([mine[medium] - full[medium] for medium in mine])
    if name == "C_I" or len(delta) < 2:
        return ""
    return f" ({delta.mean():+.3f} ± {delta.std(ddof=1) / len(delta) ** 0.5:.3f})"


def report(rows: list[tuple]) -> str:
    """Markdown: success and mean correlation of each cell and variant, then the rules for choosing."""
    places = sorted({row[:2] for row in rows}, key=lambda c: (list(FAMILIES).index(c[0]), c[1]))
    names = list(dict.fromkeys(row[2] for row in rows))
    text = ["| variant | " + " | ".join(f"{f} {e:g}" for f, e in places) + " |", "|---" * (len(places) + 1) + "|"]
    for name in names:
        line = [name]
        for place in places:
            scores = np.array([chosen_score(r) for r in rows if r[:2] == place and r[2] == name])
            good = int((scores > SUCCESS).sum())
            line.append(f"{interval(good, len(scores))}, {scores.mean():.3f}{difference(rows, place, name)}"
                        if len(scores) else "")  # fmt: skip
        text.append("| " + " | ".join(line) + " |")
    text += ["", "| rule | share above 0.8 | mean correlation |", "|---|---|---|"]
    for name in ("C_I", "plain Katz"):
        scores = np.array([row[4:7] for row in rows if row[2] == name])
        for n, rule in enumerate(("consensus", "lowest error", "best restart")):
            text.append(f"| {name}: {rule} | {(scores[:, n] > SUCCESS).mean():.3f} | {scores[:, n].mean():.4f} |")
    return "\n".join(text) + "\n"


def flat_frame(cell: Cell, images: dict[str, Tensor]) -> str:
    """How an evenly bright frame does, and all within the frame alone: how much of the success is the frame's."""
    target = diffraction_limited(cell.objects, TRANSFER)
    even = diffraction_limited(torch.ones_like(cell.objects), TRANSFER)
    scores = best_pearson(even, target)
    rate = interval(int((scores > SUCCESS).sum()), len(scores))
    text = [f"{cell.family} {cell.extent:g}: an even frame scores {rate}, {scores.mean():.3f}. Within the frame:"]
    for name in ("plain Katz", "C_I"):
        text.append(f"{name} {inside(images[name], target).mean():.3f},")
    return " ".join([*text, f"even frame {inside(even, target).mean():.3f}."])


def draw_row(panels, cell: Cell, plain: Tensor, full: Tensor) -> None:
    """Camera, autocorrelation, target, plain and C_I of the median case."""
    target = diffraction_limited(cell.objects, TRANSFER)
    scores = best_pearson(full, target)
    n = int(scores.argsort()[len(scores) // 2])
    place = torch.roll(target[n], (18, 18), (0, 1))
    lags = torch.fft.fftshift(cell.autocorrelations["whole"][n])
    pictures = [cell.image[n], lags, place, *(align(x[n], place) for x in (plain, full))]
    notes = ["", "", "", f"{best_pearson(plain[n], place):.2f}", f"{scores[n]:.2f}"]
    for panel, picture, note in zip(panels, pictures, notes, strict=True):
        panel.imshow(picture, cmap="inferno", vmin=0 if note or picture is place else None)
        panel.set_xticks([]), panel.set_yticks([])
        panel.set_xlabel(note, fontsize=8)
    panels[0].set_ylabel(f"{cell.family}\n{cell.extent:g} ranges", fontsize=8)


def numpy_loop(modulus: np.ndarray, start: np.ndarray, retrieval: Retrieval) -> np.ndarray:
    """Hybrid input-output of one start of one image, as written in the literature."""
    image = start
    for beta in BETAS:
        for _ in range(retrieval.steps):
            spectrum = np.fft.fft2(image)
            proposed = np.fft.ifft2(modulus * np.exp(1j * np.angle(spectrum))).real
            image = np.where(proposed > 0, proposed, image - beta * proposed)
    for _ in range(retrieval.error_reduction):
        spectrum = np.fft.fft2(np.maximum(proposed, 0))
        proposed = np.fft.ifft2(modulus * np.exp(1j * np.angle(spectrum))).real
    return np.maximum(proposed, 0)


def speed(threads: int | None, side: int = 128, restarts: int = 20, images: int = 4) -> str:
    """Images a minute on a large grid, and the ratio of CPU times to the plain loop."""
    rng = np.random.default_rng(0)
    objects = torch.from_numpy(np.stack([Glyphs().image(0, "test", n) for n in range(images)])).double()
    lags = torch.fft.irfft2(torch.fft.rfft2(framed(objects, side)).abs().square(), s=(side, side))
    lines = []
    for name, wrap in (("with shrink-wrap", 0.1), ("without", 0.0)):
        options = Retrieval(restarts=restarts, shrink_wrap=wrap)
        wall, cpu = time.perf_counter(), time.process_time()
        retrieve(lags, options, threads=threads)
        wall, cpu = (time.perf_counter() - wall) / images, (time.process_time() - cpu) / images
        lines.append(f"{name}: {60 / wall:.0f} images a minute by the clock, {cpu:.2f} CPU s an image")
    begin = time.process_time()
    numpy_loop(np.sqrt(np.abs(np.fft.fft2(lags[0].numpy()))), rng.random((side, side)), options)
    loop = (time.process_time() - begin) * restarts
    return "; ".join([*lines, f"plain NumPy loop: {loop:.1f} CPU s, {loop / cpu:.1f} times as much"])


def main() -> None:
    """Read the command line, run, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--media", type=int, default=50)
    parser.add_argument("--restarts", type=int, default=10)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--split", default="test", help="train: the data that the method was developed on")
    parser.add_argument("--quick", action="store_true", help="two media, four restarts")
    parser.add_argument("--speed", action="store_true", help="only the speed")
    chosen = parser.parse_args()
    if chosen.speed:
        print(speed(chosen.threads))
        return
    media, restarts = (2, 4) if chosen.quick else (chosen.media, chosen.restarts)
    chosen.out.mkdir(parents=True, exist_ok=True)
    ways, rows, notes = variants(restarts), [], []
    figure, panels = plt.subplots(sum(map(len, EXTENTS.values())), 5, figsize=(7, 11))
    places = [(family, extent) for family in EXTENTS for extent in EXTENTS[family]]
    with (chosen.out / "scores.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEAD)
        drawn = list(cells(media, chosen.split))
        images: dict[tuple[str, float], dict[str, Tensor]] = {(cell.family, cell.extent): {} for cell in drawn}
        for name, variant in ways.items():
            for cell in drawn:
                if applies(name, variant, cell.family, cell.extent):
                    new, images[cell.family, cell.extent][name] = scored(cell, name, variant, chosen.threads)
                    rows += new
                    writer.writerows([*row[:4], *(f"{score:.5f}" for score in row[4:])] for row in new)
                    file.flush()
    for cell in drawn:
        found = images[cell.family, cell.extent]
        draw_row(panels[places.index((cell.family, cell.extent))], cell, found["plain Katz"], found["C_I"])
        if cell.family == "photographs":
            notes.append(flat_frame(cell, found))
    titles = "camera (a ninth)", "autocorrelation", "target", "plain Katz", "C_I"
    for panel, title in zip(panels[0], titles, strict=True):
        panel.set_title(title, fontsize=9)
    figure.tight_layout()
    figure.savefig(chosen.out / "contact_sheet.png", dpi=90)
    text = report(rows) + "\n" + "\n".join(notes) + "\n"
    (chosen.out / "table.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
