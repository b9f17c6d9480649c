"""The main job on one screen: a training set of pictures hidden behind fog, streamed, with figures.

    python scripts/demo.py --out demo

leaves in demo/ through-slab.zarr (a data set), through-slab.png and characters.png (objects, camera images,
autocorrelations), tilt-stack.png (speckle that moves and decorrelates under tilt), memory-effect.png and
seeing-through.png (what the packaged network makes of characters behind slabs that it has never seen).
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
from specklegen.models import load_pretrained
from specklegen.models.judging.charts import contact_sheet
from specklegen.models.judging.evaluation import evaluate

SAMPLES = 512


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
    pictures.memory_effect_figure(curves, out / "memory-effect.png")


def stream(recipe, batches: int, workers: int) -> float:
    """Samples a second out of a loader, after the first batch."""
    loader = SpeckleStream(recipe, seed=0, split="train", batch_size=32).loader(num_workers=workers)
    count, begin = 0, 0.0
    for n, batch in enumerate(loader):
        if n == workers:  # every worker has compiled and warmed up
            begin = time.perf_counter()
        count += len(batch["image"]) if n > workers else 0
        if n == batches + workers:
            break
    return count / (time.perf_counter() - begin)


def see_through(out: Path) -> None:
    """Reconstruct characters behind slabs of unknown material; neither slabs nor characters were in training."""
    recipe = load_recipe("unknown-slab", {"objects": {"disjoint": "character"}})
    batch = tensors(recipe.batch(0, "test", range(8)))
    found, cases = evaluate({"network": load_pretrained().reconstruct}, [batch], recipe.profile)
    print(f"  Pearson correlation to the hidden objects: {found.interval('network').mean:.2f} on average")
    contact_sheet(cases, out / "seeing-through.png")


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("demo"))
    parser.add_argument("--samples", type=int, default=SAMPLES)
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)

    print("1. The memory effect: how far speckle keeps its shape under tilt")
    memory_effect(out)

    print("2. A stack of speckle images under tilt, of four random materials")
    stacks = load_recipe("tilt-stack")
    pictures.tilt_strip([stacks.sample(0, "train", n) for n in range(4)], out / "tilt-stack.png")

    print(f"3. A training set: {arguments.samples} photographs seen through fog, into {out / 'through-slab.zarr'}")
    recipe = load_recipe("through-slab", {"objects": {"type": "Photographs", "shape": [28, 28]}})
    begin = time.perf_counter()
    with Progress(arguments.samples) as progress:
        generate(recipe, 0, "train", samples=arguments.samples, folder=out / "through-slab.zarr", progress=progress)
    if progress.rendered:
        took = time.perf_counter() - begin
        print(f"  {progress.rendered} samples in {took:.1f} s, {progress.rendered / took:.0f} a second, start included")
    else:
        print("  all there already: a store is filled up, never started over")

    print("4. The same samples through a DataLoader, rendered on the fly")
    for workers in (0, 2):
        print(f"  {workers} workers: {stream(recipe, 12, workers):.0f} samples a second")

    print("5. Seeing through: the packaged network on eight new slabs")
    see_through(out)

    cache = SpeckleCache(out / "through-slab.zarr")
    pictures.hidden_object_sheet([cache.numpy(n) for n in range(6)], out / "through-slab.png")
    characters = load_recipe("through-slab")
    pictures.hidden_object_sheet([characters.sample(0, "train", n) for n in range(6)], out / "characters.png")
    print("\nLook at:")
    for path in ("through-slab.png", "characters.png", "tilt-stack.png", "memory-effect.png", "seeing-through.png"):
        print(f"  {out / path}")


if __name__ == "__main__":
    main()
