"""The worked example: characters behind slabs of unknown material. Generate, train, judge, draw.

    python scripts/build/train_through_slab.py --out runs/through-slab                  # all: 15 minutes a network
    python scripts/build/train_through_slab.py --out runs/quick --minutes 1 --samples 2048 --images 32
    python scripts/build/train_through_slab.py --out runs/through-slab --only leakage

Minutes are those of the clock while a network trains, on images that are there. Every part keeps what it has made:
stores fill up, training goes on, and only the tables are made anew. Characters of the test split appear in no training
image, in any font; slabs and media are new in every split.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from specklegen.cli.output import Progress
from specklegen.datasets import SpeckleCache, load_recipe
from specklegen.datasets.store.generate import generate
from specklegen.models.judging import baselines
from specklegen.models.judging.charts import _figure, _save, contact_sheet, training_curves
from specklegen.models.judging.evaluation import best_median_worst, evaluate
from specklegen.models.learning.examples import Examples, batches_of, examples
from specklegen.models.learning.networks import parameter_count
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.training import Training, train
from specklegen.models.metrics import Interval
from specklegen.models.retrieval.phase_retrieval import Retrieval

CLASSES = {"objects": {"disjoint": "character"}}
GROUPED = CLASSES | {"media_group": 8}
"""Eight training objects share a medium: preparing one costs more than an image. Nothing that is tested does."""
HALF_TURNS = "9M"
"""Training characters that are one of the test split (6, W) upside down, which an autocorrelation cannot tell."""
NETWORKS = {
    "residual net": Training(
        network="residual", width=26, learning_rate=1e-3, weight_decay=0.1, mirror=True, epochs=400, patience=400
    ),
    "U-Net": Training(weight_decay=0.05, epochs=60),
    "dense net": Training(network="dense", width=32, learning_rate=2e-3, weight_decay=0.05, epochs=60),
    "U-Net on the image": Training(input="camera", weight_decay=0.05, epochs=60),
}
BY_HEART = Training(
    input="camera", network="dense", width=8, loss="pearson", learning_rate=1e-3, batch_size=32, epochs=60
)
"""Behind one medium an image is linear in the object: a dense net learns that map by heart, which is the leak."""
RANGES = (0.5, 1.0, 2.0, 3.0)
WIDE = 42.0
"""Camera pixels across the objects of these."""
PARTS = ("networks", "unseen", "families", "ranges", "leakage")


def score_curves(curves: Mapping[str, Mapping[float, Interval]], label: str, out: Path) -> Path:
    """Draw a score with its intervals over a number, a line a method."""
    figure, axes = _figure(1, 1, 5.5, 3.8)
    axis = axes[0, 0]
    for method, points in curves.items():
        places = sorted(points)
        middle = np.array([points[x].mean for x in places])
        ends = np.array([[points[x].mean - points[x].low, points[x].high - points[x].mean] for x in places]).T
        axis.errorbar(places, middle, ends, fmt="o-", ms=4, capsize=2, label=method)
    axis.set_xlabel(label)
    axis.set_ylabel("Pearson correlation to the sharp object")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    return _save(figure, out)


def without_half_turns(recipe, seed: int, split: str, samples: int) -> list[int]:
    """Samples of a split that show no held-out character upside down."""
    source = recipe.objects.source
    return [n for n in range(samples) if split != "train" or source(seed, split, n)[-1] not in HALF_TURNS]


class Example:
    """The folder of the example, and what is in it."""

    def __init__(
        self, out: Path, seconds: float, samples: int, images: int, retrieval: Retrieval, networks: Sequence[str]
    ) -> None:
        self.out, self.seconds, self.samples, self.images = out, seconds, samples, images
        self.retrieval, self.networks = retrieval, networks

    def store(self, name: str, recipe, split: str, samples: int, seed: int = 0) -> SpeckleCache:
        """Store of a name, filled up."""
        folder = self.out / "stores" / f"{name}.zarr"
        with Progress(samples) as progress:
            generate(recipe, seed, split, samples=samples, folder=folder, progress=progress)
        return SpeckleCache(folder)

    def shown(self, kind: str) -> Examples:
        """What the networks of the main table learn from: two stores, less the characters that tests turn over."""
        parts = []
        for name, changes, seed, samples in (
            ("train", GROUPED, 2, self.samples), ("train-apart", CLASSES, 0, self.samples // 5),
        ):  # fmt: skip
            recipe = load_recipe("unknown-slab", changes)
            store = self.store(name, recipe, "train", samples, seed)
            kept = torch.tensor(without_half_turns(recipe, seed, "train", samples))
            parts.append(Examples(*(field[kept] for field in examples(store, kind, samples))))
        return Examples(*(torch.cat(fields) for fields in zip(*parts, strict=True)))

    def network(self, name: str, training: Training, data: Callable[[str], Examples], held_out: SpeckleCache):
        """Train a network, or take up what is there."""
        folder = self.out / name.replace(" ", "-").lower()
        if (folder / "best.pt").exists() and torch.load(folder / "checkpoint.pt", weights_only=True)["finished"]:
            return Reconstructor.load(folder / "best.pt")
        shown, tested = data(training.input), examples(held_out, training.input)
        rows: list[Mapping[str, float]] = []

        def progress(row: Mapping[str, float]) -> None:
            rows.append(row)
            print(f"  {name}: {row['seconds']:.0f} s, validation {row['validation_pearson']:.3f}", flush=True)

        model = train(training, shown, tested, folder, seconds=self.seconds, progress=progress)
        training_curves({name: rows}, folder / "curves.png")
        return model

    def trained(self) -> dict[str, Reconstructor]:
        """All networks of the main table."""
        held_out = self.store("validation", load_recipe("unknown-slab", CLASSES), "validation", min(384, self.samples))
        models = {
            name: self.network(name, training, self.shown, held_out)
            for name, training in NETWORKS.items() if name in self.networks
        }  # fmt: skip
        for name, model in models.items():
            print(f"{name}: {parameter_count(model.network)} parameters")
            model.save(self.out / f"{name.replace(' ', '-').lower()}.pt", compact=True)
        return models

    def judge(self, title: str, recipe, models: Mapping[str, Reconstructor], split: str = "test", seed: int = 0):
        """Table and contact sheet of all methods on fresh samples of a recipe, which are kept in a store."""
        objects = torch.stack([torch.from_numpy(recipe.objects.image(0, "train", n)) for n in range(256)])
        methods: dict[str, baselines.Method] = {
            "mean image": baselines.mean_image(objects),
            "Katz": baselines.katz(self.retrieval),
            "Katz, divided": baselines.katz(self.retrieval, recipe=recipe),
            "Katz, divided and apodised": baselines.katz(self.retrieval, recipe=recipe, apodise=True),
        }
        methods |= {name: model.reconstruct for name, model in models.items()}
        store = self.store(title, recipe, split, self.images, seed)
        chosen = without_half_turns(recipe, seed, split, self.images)
        batches = (store.batch(chosen[first : first + 64]) for first in range(0, len(chosen), 64))
        found, cases = evaluate(methods, batches, recipe.profile)
        found.write(self.out / title)
        print(f"\n{title}\n\n{found.markdown()}", flush=True)
        if models:
            contact_sheet(best_median_worst(cases, next(iter(models))), self.out / title / "cases.png")
        return found


def unseen(example: Example) -> None:
    """New media with characters of training; new media with characters of none."""
    recipe, models = load_recipe("unknown-slab", CLASSES), example.trained()
    for title, split, seed in (("unseen-media", "train", 1), ("unseen-media-and-classes", "test", 0)):
        found = example.judge(title, recipe, models, split, seed)
        for name in models:
            gain = found.gain(name, "Katz")
            print(f"{name} over Katz: {gain.mean:+.3f} [{gain.low:+.3f}, {gain.high:+.3f}]")


def families(example: Example) -> None:
    """Objects of kinds that the networks have never seen."""
    for family in ("Points", "Bars"):
        recipe = load_recipe("unknown-slab", {"objects": {"type": family, "shape": [28, 28]}})
        example.judge(family.lower(), recipe, example.trained())


def ranges(example: Example) -> None:
    """Objects half to three memory-effect ranges wide, each behind its own medium; networks trained at half one.

    The window is fitted, so that all are as many grains wide on the camera and only the memory effect differs.
    """
    models = example.trained()
    curves: dict[str, dict] = {}
    for extent in RANGES:
        changes = CLASSES | {
            "media": "new", "window": {"width": "fitted"}, "field": {"extent_over_range": extent, "pixels": WIDE},
        }  # fmt: skip
        found = example.judge(f"range-{extent:g}", load_recipe("beyond-memory-effect", changes), models)
        for method in found.values:
            curves.setdefault(method, {})[extent] = found.interval(method)
    score_curves(curves, "extent of the object / memory-effect range", example.out / "ranges.png")


def leakage(example: Example) -> None:
    """The same network and number of images, through one medium and through many; tested on those media and on new.

    On the camera image, where a medium can be learned by heart: its autocorrelation hardly tells one from another.
    Objects are new in every test, of the same characters, so that only the media differ.
    """
    samples, held_out = min(example.samples, 16384), 256
    print(f"\nleakage, {samples} images\n\n| trained through | those media | new media |\n|---|---|---|")
    for name, media in (("one medium", 1), ("many media", samples // 8)):
        recipe = load_recipe("through-slab", {"media": media})
        total = samples + held_out + example.images
        store = example.store(name.replace(" ", "-"), recipe, "train", total)
        every = examples(store, "camera", samples + held_out)
        shown, chosen = (
            Examples(*(field[part] for field in every)) for part in (slice(samples), slice(samples, samples + held_out))
        )
        folder = example.out / name.replace(" ", "-")
        model = train(BY_HEART, shown, chosen, folder, seconds=example.seconds)
        same = [store.batch(range(samples + held_out, total))]
        fresh = batches_of(load_recipe("through-slab"), example.images, seed=1, split="train")
        found = [evaluate({name: model.reconstruct}, batches)[0].values[name] for batches in (same, fresh)]
        scores = " | ".join(f"{each['sharp']['pearson'].mean():.3f}" for each in found)
        print(f"| {name} | {scores} |", flush=True)


WORK: dict[str, Callable[[Example], object]] = {
    "networks": Example.trained, "unseen": unseen, "families": families, "ranges": ranges, "leakage": leakage,
}  # fmt: skip


def main() -> None:
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/through-slab"))
    parser.add_argument("--minutes", type=float, default=15.0, help="by the clock, for each network")
    parser.add_argument("--samples", type=int, default=30720, help="training images; a fifth more have a medium each")
    parser.add_argument("--images", type=int, default=128, help="images of each test")
    parser.add_argument("--restarts", type=int, default=20, help="of phase retrieval")
    parser.add_argument("--network", choices=NETWORKS, action="append", help="of the main table (default: all)")
    parser.add_argument("--threads", type=int, default=2, help="of torch")
    parser.add_argument("--only", choices=PARTS, action="append", help="parts to run (default: all)")
    chosen = parser.parse_args()
    torch.set_num_threads(chosen.threads)
    retrieval, networks = Retrieval(restarts=chosen.restarts), chosen.network or tuple(NETWORKS)
    example = Example(chosen.out, 60 * chosen.minutes, chosen.samples, chosen.images, retrieval, networks)
    for part in chosen.only or PARTS:
        WORK[part](example)


if __name__ == "__main__":
    main()
