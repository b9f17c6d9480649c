"""The worked example: characters behind slabs of unknown material. Generate, train, judge, draw.

    python scripts/train_through_slab.py --out runs/through-slab                  # everything: 15 minutes a network
    python scripts/train_through_slab.py --out runs/quick --minutes 1 --samples 2048 --images 32
    python scripts/train_through_slab.py --out runs/through-slab --only leakage

Minutes are of two cores: a network gets 120 processor seconds for each. Every part keeps what it has made: stores fill
up, training goes on, and only the tables are made anew. Characters of the test split appear in no training image, in
any font; slabs and media are new in every split.
"""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

import torch

from specklegen.cli import Progress
from specklegen.datasets import SpeckleCache, load_recipe
from specklegen.datasets.generate import generate
from specklegen.models import baselines
from specklegen.models.charts import contact_sheet, score_curves, training_curves
from specklegen.models.evaluation import best_median_worst, evaluate
from specklegen.models.examples import Examples, batches_of, examples
from specklegen.models.networks import parameter_count
from specklegen.models.phase_retrieval import Retrieval
from specklegen.models.reconstructor import Reconstructor
from specklegen.models.training import Training, train

CLASSES = {"objects": {"disjoint": "character"}}
GROUPED = CLASSES | {"media_group": 8}
"""Eight training objects share a medium: preparing one costs more than an image. Nothing that is tested does."""
NETWORKS = {
    "U-Net": Training(input="autocorrelation", epochs=40),
    "dense net": Training(input="autocorrelation", network="dense", width=32, learning_rate=2e-3, epochs=40),
    "U-Net on the image": Training(input="camera", epochs=40),
}
BY_HEART = Training(
    input="camera", network="dense", width=8, loss="pearson", learning_rate=1e-3, batch_size=32, epochs=60
)
"""Behind one medium an image is linear in the object: a dense net learns that map by heart, which is the leak."""
RANGES = (0.5, 1.0, 2.0, 3.0)
PARTS = ("networks", "unseen", "families", "ranges", "leakage")


class Example:
    """The folder of the example, and what is in it."""

    def __init__(self, out: Path, seconds: float, samples: int, images: int, retrieval: Retrieval) -> None:
        self.out, self.seconds, self.samples, self.images, self.retrieval = out, seconds, samples, images, retrieval

    def store(self, name: str, recipe, split: str, samples: int, seed: int = 0) -> SpeckleCache:
        """Store of a name, filled up."""
        folder = self.out / "stores" / f"{name}.zarr"
        with Progress(samples) as progress:
            generate(recipe, seed, split, samples=samples, folder=folder, progress=progress)
        return SpeckleCache(folder)

    def network(self, name: str, training: Training, data: SpeckleCache, held_out: SpeckleCache) -> Reconstructor:
        """Train a network, or take up what is there."""
        folder = self.out / name.replace(" ", "-").lower()
        if (folder / "best.pt").exists() and torch.load(folder / "checkpoint.pt", weights_only=True)["finished"]:
            return Reconstructor.load(folder / "best.pt")
        shown, tested = (examples(each, training.input) for each in (data, held_out))
        rows: list[Mapping[str, float]] = []

        def progress(row: Mapping[str, float]) -> None:
            rows.append(row)
            print(f"  {name}: {row['seconds']:.0f} s, validation {row['validation_pearson']:.3f}", flush=True)

        model = train(training, shown, tested, folder, seconds=self.seconds, progress=progress)
        training_curves({name: rows}, folder / "curves.png")
        return model

    def trained(self) -> dict[str, Reconstructor]:
        """All networks of the main table."""
        data = self.store("train", load_recipe("unknown-slab", GROUPED), "train", self.samples)
        held_out = self.store("validation", load_recipe("unknown-slab", CLASSES), "validation", min(512, self.samples))
        models = {name: self.network(name, training, data, held_out) for name, training in NETWORKS.items()}
        for name, model in models.items():
            print(f"{name}: {parameter_count(model.network)} parameters")
        models["U-Net"].save(self.out / "unknown-slab.pt", half=True)
        return models

    def judge(self, title: str, recipe, models: Mapping[str, Reconstructor], split: str = "test", seed: int = 0):
        """Table and contact sheet of all methods on fresh samples of a recipe."""
        objects = torch.stack([torch.from_numpy(recipe.objects.image(0, "train", n)) for n in range(256)])
        methods: dict[str, baselines.Method] = {
            "mean image": baselines.mean_image(objects),
            "Katz": baselines.katz(self.retrieval),
            "Katz, C_I": baselines.katz(self.retrieval, recipe=recipe),
        }
        methods |= {name: model.reconstruct for name, model in models.items()}
        batches = batches_of(recipe, self.images, seed, split)
        found, cases = evaluate(methods, batches, recipe.geometry.profile)
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
        for katz in ("Katz", "Katz, C_I"):
            gain = found.gain("U-Net", katz)
            print(f"U-Net over {katz}: {gain.mean:+.3f} [{gain.low:+.3f}, {gain.high:+.3f}]")


def families(example: Example) -> None:
    """Objects of kinds that the networks have never seen."""
    for family in ("Points", "Bars"):
        recipe = load_recipe("unknown-slab", {"objects": {"type": family, "shape": [28, 28]}})
        example.judge(family.lower(), recipe, example.trained())


def ranges(example: Example) -> None:
    """Objects half to three memory-effect ranges wide, and a network trained on them."""
    whole = load_recipe("beyond-memory-effect", GROUPED | {"media": "new"})
    data = example.store("beyond", whole, "train", example.samples)
    recipe = load_recipe("beyond-memory-effect", CLASSES)
    held_out = example.store("beyond-validation", recipe, "validation", min(256, example.samples))
    model = example.network("beyond", NETWORKS["U-Net"], data, held_out)
    curves: dict[str, dict] = {}
    for extent in RANGES:
        changes = CLASSES | {"field": {"extent_over_range": extent}}
        found = example.judge(f"range-{extent:g}", load_recipe("beyond-memory-effect", changes), {"U-Net": model})
        for method in found.values:
            curves.setdefault(method, {})[extent] = found.interval(method)
    score_curves(curves, "extent of the object / memory-effect range", example.out / "ranges.png")


def leakage(example: Example) -> None:
    """The same network and number of images, through one medium and through many; tested on those media and on new.

    On the camera image, where a medium can be learned by heart: its autocorrelation hardly tells one from another.
    Objects are new in every test, of the same characters, so that only the media differ.
    """
    samples, held_out = min(example.samples, 8192), 256
    print(f"\nleakage, {samples} images\n\n| trained through | those media | new media |\n|---|---|---|")
    for name, media in (("one medium", 1), ("many media", samples // 8)):
        recipe = load_recipe("through-slab", {"media": media})
        store = example.store(name.replace(" ", "-"), recipe, "train", samples + held_out + example.images)
        every = examples(store, "camera")
        shown, chosen = (
            Examples(*(field[part] for field in every)) for part in (slice(samples), slice(samples, samples + held_out))
        )
        folder = example.out / name.replace(" ", "-")
        model = train(BY_HEART, shown, chosen, folder, seconds=example.seconds)
        same = [store.batch(range(samples + held_out, len(store)))]
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
    parser.add_argument("--minutes", type=float, default=15.0, help="of two cores, for each network")
    parser.add_argument("--samples", type=int, default=24576, help="training images")
    parser.add_argument("--images", type=int, default=128, help="images of each test")
    parser.add_argument("--restarts", type=int, default=20, help="of phase retrieval")
    parser.add_argument("--only", choices=PARTS, action="append", help="parts to run (default: all)")
    chosen = parser.parse_args()
    example = Example(
        chosen.out, 120 * chosen.minutes, chosen.samples, chosen.images, Retrieval(restarts=chosen.restarts)
    )
    for part in chosen.only or PARTS:
        WORK[part](example)


if __name__ == "__main__":
    main()
