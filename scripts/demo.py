"""The main job on one screen: pictures hidden behind fog, a network that sees through it, a training set, a stream.

    python scripts/demo.py --out demo

leaves pictures and a data set in demo/; the last lines say what each picture shows.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import specklegen as sg
from specklegen import pictures
from specklegen.cli.output import Progress
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.store.generate import generate
from specklegen.models import Retrieval, load_pretrained, recoverable
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.charts import contact_sheet
from specklegen.models.judging.evaluation import evaluate

SAMPLES = 256
PICTURES = {
    "seeing-through.png": "characters behind slabs that the network has never seen: camera, phase retrieval, network",
    "characters.png": "hidden characters, what the camera sees of them, and the autocorrelations of both",
    "tilt-stack.png": "speckle of four materials under five tilts: it moves, and turns into another pattern",
    "memory-effect.png": "how far speckle keeps its shape under tilt, for two fogs of one optical depth",
    "through-slab.png": "the training set: cut-outs of photographs; the autocorrelation of each image is its object's",
    "held-out-letters.png": "the hardest: neither the slabs nor the letters were in the network's training",
}
"""What the demo draws, what works best first."""
PHOTOGRAPHS = {
    "objects": {"type": "Silhouettes", "shape": [28, 28]},
    "window": {"profile": "disc"},
    "camera": {"shape": [256, 256]},
}
"""Cut-outs of photographs on a camera large enough for them, as ``specklegen recoverable`` says."""


def compile_kernels(recipe) -> None:
    """Compile before anything is timed; the next run finds the kernels in the user's cache."""
    print("Compiling, once ...", end=" ", flush=True)
    begin = time.perf_counter()
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=0.9))
    sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-5], paths=4000)
    recipe.sample(0, "train", 0)
    print(f"{time.perf_counter() - begin:.0f} s")


def see_through(changes: dict, out: Path) -> None:
    """Reconstruct eight characters of the test split, behind slabs of unknown material."""
    recipe = load_recipe("unknown-slab", changes)
    batch = tensors(recipe.batch(0, "test", range(8)))
    methods = {"phase retrieval": katz(Retrieval(restarts=4)), "network": load_pretrained().reconstruct}
    found, cases = evaluate(methods, [batch], recipe.profile)
    means = ", ".join(f"{name} {found.interval(name).mean:.2f}" for name in methods)
    print(f"  Pearson correlation to the hidden objects, on average: {means}")
    contact_sheet(cases, out)


def memory_effect(out: Path) -> None:
    """Draw the memory effect of two fogs of the same optical depth."""
    tilts = np.deg2rad(np.linspace(0, 0.04, 33))
    curves = {}
    for g in (0.0, 0.9):
        slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=g))
        begin = time.perf_counter()
        curves[f"g = {g:g}"] = sg.memory_effect(slab, wavelength=0.5, tilts=tilts, paths=200_000, seed=0)
        error = np.nanmax(curves[f"g = {g:g}"].standard_error)
        print(f"  g = {g:g}: 200000 paths in {time.perf_counter() - begin:.2f} s, standard error <= {error:.1g}")
    pictures.memory_effect_figure(curves, out)


def fill(recipe, samples: int, folder: Path) -> None:
    """Fill a store, or fill it up."""
    begin = time.perf_counter()
    with Progress(samples) as progress:
        said = generate(recipe, 0, "train", samples=samples, folder=folder, progress=progress)
    if said["rendered"]:
        took = time.perf_counter() - begin
        print(f"  {said['rendered']} samples in {took:.1f} s, {said['rendered'] / took:.0f} a second, start included")
    else:
        print("  all there already: a store is filled up, never started over")


def stream(recipe, batches: int, workers: int) -> float:
    """Samples a second out of a loader, after the first batch of each worker."""
    loader = SpeckleStream(recipe, seed=0, split="train", batch_size=32).loader(num_workers=workers)
    count, begin = 0, 0.0
    for n, batch in enumerate(loader):
        if n == workers:  # every worker has read its kernels and warmed up
            begin = time.perf_counter()
        count += len(batch["image"]) if n > workers else 0
        if n == batches + workers:
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

    print("1. Seeing through: the packaged network on eight new slabs, characters of its training in them")
    see_through({}, out / "seeing-through.png")
    pictures.hidden_object_sheet([through.sample(0, "train", n) for n in range(6)], out / "characters.png")

    print("2. A stack of speckle images under tilt, of four random materials")
    stacks = load_recipe("tilt-stack")
    pictures.tilt_strip([stacks.sample(0, "train", n) for n in range(4)], out / "tilt-stack.png")

    print("3. The memory effect: how far speckle keeps its shape under tilt")
    memory_effect(out / "memory-effect.png")

    print(f"4. A training set: {arguments.samples} cut-outs of photographs, into {out / 'through-slab.zarr'}")
    print("  can they be seen at all? It " + recoverable(photographs).explain().partition("\n")[0])
    fill(photographs, arguments.samples, out / "through-slab.zarr")
    cache = SpeckleCache(out / "through-slab.zarr")
    shown = [cache.numpy(n) for n in range(min(6, len(cache)))]
    pictures.hidden_object_sheet(shown, out / "through-slab.png")

    print("5. The same samples through a DataLoader, rendered on the fly")
    for workers in (0, 2):
        print(f"  {workers} workers: {stream(photographs, 12, workers):.0f} samples a second")

    print("6. Seeing through once more: letters that the network has never seen either")
    see_through({"objects": {"disjoint": "character"}}, out / "held-out-letters.png")

    print("\nLook at:")
    for name, what in PICTURES.items():
        print(f"  {out / name}: {what}")


if __name__ == "__main__":
    main()
