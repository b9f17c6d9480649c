"""One network, trained on small objects by several makers, judged on waves and on frames of a laboratory's camera.

    python scripts/why_frames.py --measured FOLDER [--seeds 3] [--images 2048] [--epochs 10]

FOLDER is the clone that `specklegen measured get hidden-shapes` makes. Objects are half a memory-effect range wide. The
residual network of the package, width 26, sees the autocorrelation; all makers' networks have as many steps. Images are
as many, or, of convolution with new patterns, as many as are made in the processor time of ours. Prints a table: scores
of 48 images of the benchmark's task "waves" and matches to the printed shapes of its 32 measured frames, with intervals
over media and seeds.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch

from specklegen.datasets import load_recipe
from specklegen.models import Training, train
from specklegen.models.judging import frames
from specklegen.models.judging.evaluation import aligned_to, targets_of
from specklegen.models.judging.tasks import task
from specklegen.models.learning.examples import Examples, batches_of
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.metrics import bootstrap, pearson

OBJECTS = {"objects": {"type": "Families", "shape": [28, 28], "families": [{"type": "Glyphs"}, {"type": "Polygons"}]}}
FRESH = "convolution, a new pattern each"
MAKERS = {
    "specklegen": {},
    FRESH: {"sampler": "convolution"},
    "convolution, one pattern": {"sampler": "convolution", "media": 1},
}
_VALIDATION = 256


def examples(changes: dict, split: str, seed: int, count: int) -> tuple[Examples, float]:
    """Inputs and objects of samples, and the processor seconds that they took."""
    recipe = load_recipe("unknown-slab", OBJECTS | changes)
    recipe.batch(seed, split, range(1))  # plans
    begun, parts = time.process_time(), []
    for batch in batches_of(recipe, range(count), seed, split):
        parts.append((network_input(batch, "autocorrelation").half(), batch["object"], batch["parameters"]["medium"]))
    return Examples(*(torch.cat(each) for each in zip(*parts, strict=True))), time.process_time() - begun


def trained(data: Examples, held: Examples, seed: int, passes: float) -> Reconstructor:
    """A network after so many passes through as many images as our maker has."""
    settings = Training(network="residual", width=26, learning_rate=1e-3, mirror=True, epochs=max(1, round(passes)),
                        seed=seed)  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        return train(settings, data, held, folder)


def judged(model: Reconstructor, waves: list, measured: list, shapes: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Scores float[48] of waves and float[32] of frames."""
    found = []
    for batch in waves:
        target, (rows, columns) = targets_of(batch)["sharp"], batch["object"].shape[1:]
        made = aligned_to(model.reconstruct(batch), target, (rows, columns))
        found.append(pearson(made, target[..., :rows, :columns]))
    answers = torch.cat([model.reconstruct(batch) for batch in measured])
    return torch.cat(found).double().numpy(), np.asarray(frames.scores(answers, shapes)["pearson"])


def main() -> None:
    """Read the command line, train and print."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--measured", type=Path, required=True)
    asked.add_argument("--seeds", type=int, default=3)
    asked.add_argument("--images", type=int, default=2048)
    asked.add_argument("--epochs", type=int, default=10)
    given = asked.parse_args()
    torch.set_num_threads(1)
    waves = [*task("waves").batches(range(task("waves").samples))]
    measured = [*task("measured frames").batches(range(frames.SAMPLES), measured=given.measured)]
    shapes = [n % len(frames.SHAPES) for n in range(frames.SAMPLES)]
    slabs = np.concatenate([np.asarray(batch["parameters"]["medium"]) for batch in waves])
    media = slabs, np.arange(frames.SAMPLES) // len(frames.SHAPES)
    scores: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for seed in range(given.seeds):
        seconds, took = {}, {}
        for name, changes in MAKERS.items():
            begun = time.process_time()
            held, _ = examples(changes, "validation", seed, _VALIDATION)
            data, seconds[name] = examples(changes, "train", seed, given.images)
            scores.setdefault(name, []).append(judged(trained(data, held, seed, given.epochs), waves, measured, shapes))
            if name == FRESH:
                more = round(given.images * seconds["specklegen"] / seconds[name])
                data, _ = examples(changes, "train", seed, more)
                passes = given.epochs * given.images / more
                scores.setdefault(f"{name}, in our time", []).append(
                    judged(trained(data, held, seed, passes), waves, measured, shapes)
                )
                took["images in our time"] = more
            took[name] = round(time.process_time() - begun)
        told = {name: f"{1e3 * each / given.images:.1f}" for name, each in seconds.items()}
        print(f"seed {seed}: ms an image {told}; {took}", flush=True)
    print("| trained on | waves | measured frames |\n|---|---|---|")
    for name, runs in scores.items():
        cells = []
        for which, of in enumerate(media):
            every = np.concatenate([run[which] for run in runs])
            low = bootstrap(every, np.tile(of, len(runs)), np.repeat(np.arange(len(runs)), len(of)))
            cells.append(f"{low.mean:.3f} [{low.low:.3f}, {low.high:.3f}]")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    ours, others = scores["specklegen"], scores[f"{FRESH}, in our time"]
    for which, (what, of) in enumerate(zip(("waves", "measured frames"), media, strict=True)):
        gain = np.concatenate([a[which] - b[which] for a, b in zip(ours, others, strict=True)])
        low = bootstrap(gain, np.tile(of, len(ours)), np.repeat(np.arange(len(ours)), len(of)))
        print(f"ours less convolution in our time, {what}: {low.mean:+.3f} [{low.low:+.3f}, {low.high:+.3f}]")


if __name__ == "__main__":
    main()
