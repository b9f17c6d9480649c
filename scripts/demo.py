"""The package on one screen: objects reconstructed behind slabs, tilt stacks, memory effect, training set, stream.

    python scripts/demo.py --out demo

writes pictures and a data set into demo/; the last lines describe each picture.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch

import specklegen as sg
from specklegen import pictures
from specklegen.cli.output import Progress
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.objects import Glyphs
from specklegen.datasets.objects.outlines import CHARACTERS, outline
from specklegen.datasets.split import Purpose, generator, substream
from specklegen.datasets.store.generate import generate
from specklegen.kernels.coverage import fill_coverage
from specklegen.models import Retrieval, load_pretrained, load_solver, recoverable
from specklegen.models.judging.baselines import Method, katz
from specklegen.models.judging.charts import Note, contact_sheet
from specklegen.models.judging.evaluation import Case, evaluate
from specklegen.models.learning.measurement import measured
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval.apodisation import framed

BEGUN = time.perf_counter()
SAMPLES = 256
OBJECT, SIDE = 28, 48
"""Pixels of an object, and of the frame on which reconstructions are compared with characters."""
PICTURES = {
    "seeing-through.png": "characters behind unseen slabs: camera image, phase retrieval, network, object",
    "characters.png": "hidden characters, their camera images, and the autocorrelations of both",
    "tilt-stack.png": "speckle of four materials under five tilts: it shifts, and decorrelates",
    "memory-effect.png": "correlation of speckle over tilt, for two slabs of equal optical depth",
    "through-slab.png": "the training set: cut-outs of photographs; autocorrelations of image and object are similar",
    "held-out-letters.png": "the hardest test: unseen slabs and unseen characters; red: resembles another "
    "character more; p: the solver's confidence",
}
"""Pictures of the demo, the best results first."""
MEASURES = """number: Pearson correlation r with the hidden object
"x": the character of its font that correlates most with the picture,
rotated by up to 16° and scaled by 0.75 to 1.1. Red: it is not the hidden one
p: confidence of the solver, the probability that r > 0.8"""
"""Legend below the pictures of unseen characters."""
PHOTOGRAPHS = {
    "objects": {"type": "Silhouettes", "shape": [28, 28]},
    "window": {"profile": "disc"},
    "camera": {"shape": [256, 256]},
}
"""Cut-outs of photographs, and a camera that ``specklegen check recoverable`` finds large enough."""


def step(title: str) -> None:
    """Print the title of a step, and the seconds since the start."""
    print(f"{title}  [{time.perf_counter() - BEGUN:.0f} s]", flush=True)


def compile_kernels(recipe) -> None:
    """Compile the kernels before anything is timed; the next run finds them in the user's cache.

    Random walks compile in a second process (``make demo`` did so during the installation), images behind a thin screen
    in this one.
    """
    print("Compiling, once ...", end=" ", flush=True)
    begin = time.perf_counter()
    with subprocess.Popen([sys.executable, Path(__file__).with_name("compile_walks.py")]):
        load_recipe("ground-glass").sample(0, "train", 0)
    recipe.sample(0, "train", 0)  # and what the other process could not cache
    print(f"{time.perf_counter() - begin:.0f} s")


def see_through(changes: dict, out: Path, count: int, certified: bool = False) -> None:
    """Reconstruct characters of the test split, behind slabs of unknown material.

    ``certified`` adds the solver with its confidence, and compares each reconstruction with all characters.
    """
    recipe = load_recipe("unknown-slab", changes)
    batch = tensors(recipe.batch(0, "test", range(count)))
    methods: dict[str, Method] = {
        "phase retrieval": katz(Retrieval(restarts=4)), "network": load_pretrained().reconstruct,
    }  # fmt: skip
    solved = load_solver().solve(*measured(batch, recipe), seed=0) if certified else None
    if solved is not None:
        methods["solver"] = lambda _: solved.image
    found, cases = evaluate(methods, [batch], recipe.profile)
    means = ", ".join(f"{name} {found.interval(name).mean:.2f}" for name in methods)
    print(f"  mean Pearson correlation with the hidden objects: {means}")
    if solved is None:
        contact_sheet(cases, out)
        return
    notes = readings(recipe.objects, cases)
    for name, said in notes.items():
        print(f"  {name}: {sum(note.wrong for note in said)} of {len(said)} resemble another character more")
    sure = solved.probability.numpy()
    pairs = zip(notes["solver"], sure, strict=True)
    notes["solver"] = [
        Note(f"{note.text}  {f'p {share:.2f}' if np.isfinite(share) else 'no p'}", note.wrong) for note, share in pairs
    ]
    good, claimed = np.array([case.scores["solver"] > 0.8 for case in cases]), sure >= 0.5
    print(f"  the solver's confidence p is 0.5 or more for {claimed.sum()} of {len(sure)}; r > 0.8 holds for "
          f"{good[claimed].sum()} of these")  # fmt: skip
    contact_sheet(cases, out, notes, MEASURES)


def readings(family: Glyphs, cases: list[Case]) -> dict[str, list[Note]]:
    """Return the character that each reconstruction of the first test objects resembles most, and if it is wrong.

    Candidates are all characters of the hidden one's font, near its rotation and size, up to shift and 180 degrees.
    """
    found: dict[str, list[Note]] = {name: [] for name in cases[0].reconstructions}
    for n, case in enumerate(cases):
        font, hidden = (str(word) for word in family.source(0, "test", n))
        rng = generator(substream(0, "test", Purpose.OBJECT, n))
        turn, size = rng.uniform(-family.rotation, family.rotation), rng.uniform(*family.size)  # as Glyphs draws them
        poses = [(turn + more, size * scale) for more in (-16, -8, 0, 8, 16) for scale in (0.75, 0.85, 1.0, 1.1)]
        drawn = np.array([[glyph(font, each, *pose) for pose in poses] for each in CHARACTERS])
        for name, picture in case.reconstructions.items():
            read = CHARACTERS[int(likeness(picture, drawn).argmax())]
            same = hidden in (read, HALF_A_TURN.get(read))
            found[name].append(Note(f'"{hidden if same else read}"', not same))
    return found


HALF_A_TURN = {"6": "9", "9": "6", "b": "q", "q": "b"}
"""Characters that a rotation by 180 degrees, which the autocorrelation leaves open, turns into one another."""


def glyph(font: str, character: str, degrees: float, size: float) -> np.ndarray:
    """Draw a rotated character, float[SIDE, SIDE]; ``size`` is its share of the object's frame; y upwards."""
    turn = np.exp(1j * np.deg2rad(degrees))
    ends = outline(font, character).reshape(-1, 2) @ np.array([1, 1j]) * turn
    ends -= ends.real.min() + 1j * ends.imag.min()
    ends *= size * OBJECT / max(ends.real.max(), ends.imag.max())
    covered = np.empty((SIDE, SIDE))
    fill_coverage(np.ascontiguousarray(np.stack([ends.real, ends.imag], 1).reshape(-1, 4)), covered)
    return covered[::-1]


def likeness(picture: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Largest Pearson correlation of a picture to each character, over shifts and poses float[C, n, SIDE, SIDE]."""
    templates = torch.from_numpy(drawn).float()
    frame = framed(torch.from_numpy(picture)[None].float(), SIDE).expand_as(templates)
    return pearson(align(templates, frame), frame).amax(1).numpy()


def memory_effect(out: Path) -> None:
    """Draw the memory effect of two slabs of equal optical depth."""
    tilts = np.deg2rad(np.linspace(0, 0.04, 33))
    curves = {}
    for g in (0.0, 0.9):
        slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g=g))
        begin = time.perf_counter()
        curves[f"g = {g:g}"] = sg.memory_effect(slab, wavelength=0.5, tilts=tilts, paths=200_000, seed=0)
        error = np.nanmax(curves[f"g = {g:g}"].standard_error)
        print(f"  g = {g:g}: 200000 paths in {time.perf_counter() - begin:.2f} s, standard error <= {error:.1g}")
    pictures.memory_effect_figure(curves, out)


def fill(recipe, samples: int, folder: Path) -> None:
    """Fill a store, or what is missing of it, in this process, which has loaded everything."""
    begin = time.perf_counter()
    with Progress(samples) as progress:
        said = generate(recipe, 0, "train", samples=samples, folder=folder, progress=progress, processes=1)
    if said["rendered"]:
        took = time.perf_counter() - begin
        print(f"  {said['rendered']} samples in {took:.1f} s, {said['rendered'] / took:.0f} per second, start included")
    else:
        print("  complete already: only missing samples are rendered")


def stream(recipe, batches: int) -> float:
    """Return the samples per second of a loader, after its first batch."""
    count, begin = 0, 0.0
    for n, batch in enumerate(SpeckleStream(recipe, seed=0, split="train", batch_size=32).loader()):
        if n == 0:
            begin = time.perf_counter()
            continue
        count += len(batch["image"])
        if n == batches:
            break
    return count / (time.perf_counter() - begin)


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("demo"))
    parser.add_argument("--samples", type=int, default=SAMPLES)
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    through = load_recipe("through-slab")
    photographs = load_recipe("through-slab", PHOTOGRAPHS)
    compile_kernels(through)

    step("1. Reconstruct characters behind eight unseen slabs, with the packaged network")
    see_through({}, out / "seeing-through.png", 8)
    pictures.hidden_object_sheet([through.sample(0, "train", n) for n in range(6)], out / "characters.png")

    step("2. Render speckle of four random materials under five tilts")
    stacks = load_recipe("tilt-stack")
    pictures.tilt_strip([stacks.sample(0, "train", n) for n in range(4)], out / "tilt-stack.png")

    step("3. Compute the memory effect: the correlation of speckle over tilt")
    memory_effect(out / "memory-effect.png")

    step(f"4. Render a training set of {arguments.samples} cut-outs of photographs into {out / 'through-slab.zarr'}")
    print("  reconstruction " + recoverable(photographs).explain().partition("\n")[0])
    fill(photographs, arguments.samples, out / "through-slab.zarr")
    cache = SpeckleCache(out / "through-slab.zarr")
    shown = [cache.numpy(n) for n in range(min(6, len(cache)))]
    pictures.hidden_object_sheet(shown, out / "through-slab.png")

    step("5. Stream the same samples through a DataLoader, rendered on the fly")
    print(f"  {stream(photographs, 12):.0f} samples per second in one process; loader(num_workers=2) uses two more")

    step("6. Reconstruct characters that the network has not seen either")
    see_through({"objects": {"disjoint": "character"}}, out / "held-out-letters.png", 4, certified=True)

    print("\nPictures:")
    for name, what in PICTURES.items():
        print(f"  {out / name}: {what}")


if __name__ == "__main__":
    main()
