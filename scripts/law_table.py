"""Law-drawn against rendered training at equal processor time: ``python scripts/law_table.py --seconds 24``.

The same network is trained twice in the same budget of processor seconds, and judged on rendered test images: on
samples drawn from the law of images (``specklegen.models.learning.law``), each of which is new; and on rendered ones,
for which half of the budget is spent, while the other half goes through them again and again. What a sample and a step
cost is measured first, in turn, and decides how many there are, so that both rows suffer alike from a busy machine.
Intervals are 95 %, over the classes of the objects (images, where they have none) and seeds.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets import Recipe, SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models import Training, train
from specklegen.models.learning.examples import Examples, batches_of, sharing_media, streamed
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.law import ByLaw
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.targets import TARGETS
from specklegen.models.metrics import align, pearson

BATCH = 64
KIND = {"input": "periodogram", "network": "residual", "width": 26, "learning_rate": 1e-3, "batch_size": BATCH}


def stored(source: Recipe, samples: range, seed: int, split: str, targets: list[str]) -> dict[str, Examples]:
    """Rendered examples for every target."""
    parts = []
    for batch in batches_of(source, samples, seed, split):
        values = {target: TARGETS[target].values(batch) for target in targets}
        parts.append((network_input(batch, "periodogram").half(), batch["parameters"]["medium"].long(), values))
    inputs, media = (torch.cat([part[n] for part in parts]) for n in (0, 1))
    return {name: Examples(inputs, torch.cat([part[2][name] for part in parts]), media) for name in targets}


def told(model: Reconstructor, judged: Examples, target: str) -> Tensor:
    """Per image: whether it is named rightly, the correlation, or (answer, truth) of a number; float64[n, ...]."""
    with torch.no_grad():
        made = TARGETS[target].answer(torch.cat([model.network(x.float()) for x in judged.inputs.split(256)]))
    if target == "label":
        return (made.argmax(-1) == judged.targets.argmax(-1)).double()[:, 0]
    if target == "object":
        return pearson(align(made, judged.targets), judged.targets).double()
    return torch.stack([made[:, 0, 0], judged.targets[:, 0, 0]], -1).double()


def statistic(values: np.ndarray) -> float:
    """Mean of scores, or R^2 of (answer, truth)."""
    if values.ndim == 1:
        return float(values.mean())
    answer, truth = values.T
    return float(1 - np.square(answer - truth).mean() / truth.var())


def interval(values: np.ndarray, classes: np.ndarray, draws: int = 1000) -> str:
    """Of scores [seeds, images, ...], seeds and classes drawn anew."""
    rng, names = np.random.default_rng(0), np.unique(classes)
    members = [np.flatnonzero(classes == name) for name in names]
    found = []
    for _ in range(draws):
        at = np.concatenate([members[n] for n in rng.integers(len(names), size=len(names))])
        found.append(np.mean([statistic(values[seed, at]) for seed in rng.integers(len(values), size=len(values))]))
    low, high = np.quantile(found, (0.025, 0.975))
    return f"{np.mean([statistic(each) for each in values]):.3f} [{low:.3f}, {high:.3f}]"


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--recipe", default="characters-of-new-fonts")
    options.add_argument("--targets", nargs="+", default=["label", "range"])
    options.add_argument("--seconds", type=float, default=60.0, help="Processor seconds of a training.")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--images", type=int, default=384, help="Rendered test images.")
    given = options.parse_args()
    torch.set_num_threads(1)
    recipe = load_recipe(given.recipe)
    shown = sharing_media(recipe)
    law = ByLaw(shown)  # type: ignore[arg-type]
    judged = stored(recipe, range(given.images), 100, "test", given.targets)
    checked = stored(recipe, range(64), 101, "validation", given.targets)
    drawn = recipe.batch(100, "test", range(given.images))["parameters"]
    classes = np.asarray(drawn.get("label", np.arange(given.images)))
    scores: dict[tuple[str, str], list[np.ndarray]] = {}
    for seed in range(given.seeds):
        by_law, rendered = costs(law, shown, seed)
        rendering = range(max(1, round(given.seconds / 2 / rendered)) * BATCH)
        images = stored(shown, rendering, seed, "train", given.targets)
        for target in given.targets:
            settings = Training(target=target, epochs=1, seed=seed, **KIND)
            step = step_of(settings, images[target], checked[target])
            passes, new = round(given.seconds / 2 / step), round(given.seconds / (step + by_law))
            law_ms, rendered_ms, step_ms = (1e3 * each / BATCH for each in (by_law, rendered, step))
            print(f"| {target}, seed {seed} | ms: law {law_ms:.2f}, rendered {rendered_ms:.2f}, step {step_ms:.2f} "
                  f"| samples: law {new * BATCH}, rendered {len(rendering)}, "
                  f"{passes * BATCH / len(rendering):.1f} times |", flush=True)  # fmt: skip
            stream = SpeckleStream(_Long(law, new * BATCH), seed=seed, batch_size=BATCH)  # type: ignore[arg-type]
            ways = {"rendered": (Again(images[target], passes, seed), passes),
                    "law": streamed(stream, "periodogram", target=target)}  # fmt: skip
            for way, data in ways.items():
                with tempfile.TemporaryDirectory() as folder:
                    model = train(settings, data, checked[target], folder)
                found = told(model, judged[target], target).numpy()
                scores.setdefault((target, way), []).append(found)
                print(f"| {target}, {way}, seed {seed} | {statistic(found):.3f} |", flush=True)
        for (target, way), found in scores.items():
            words = f"{given.recipe}, {target}, {seed + 1} seeds | {way} | {interval(np.stack(found), classes)}"
            print(f"| {words} |", flush=True)


class Again:
    """Batches of stored examples in any order, and the processor's clock when each was asked for."""

    def __init__(self, examples: Examples, steps: int, seed: int) -> None:
        self.examples, self.steps, self.seed = examples, steps, seed
        self.clock: list[float] = []

    def __call__(self, epoch: int, first: int) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield batches from step ``first`` on."""
        rng, own = np.random.default_rng([self.seed, epoch, 7]), self.examples
        for n in range(self.steps):
            at = torch.from_numpy(rng.integers(len(own.inputs), size=BATCH))
            if n >= first:
                self.clock.append(time.process_time())
                yield own.inputs[at].float(), own.targets[at]


def step_of(settings: Training, examples: Examples, checked: Examples) -> float:
    """Processor seconds of a step."""
    batches = Again(examples, 24, 0)
    with tempfile.TemporaryDirectory() as folder:
        train(settings, (batches, 24), checked, folder)
    return float(np.median(np.diff(batches.clock)[4:]))


def costs(law: ByLaw, shown: Recipe, seed: int) -> tuple[float, float]:
    """Processor seconds of a batch of inputs, drawn and rendered, measured in turn."""
    found = []
    for n in range(4):
        numbers = range(10**6 + n * BATCH, 10**6 + (n + 1) * BATCH)
        begun = time.process_time()
        network_input(tensors(law.batch(seed, "train", numbers)), "periodogram")
        between = time.process_time()
        stored(shown, numbers, seed, "train", [])
        found.append((between - begun, time.process_time() - between))
    by_law, rendered = np.median(found, axis=0)
    return float(by_law), float(rendered)


class _Long:
    """A law whose epoch has as many samples as a training takes."""

    def __init__(self, law: ByLaw, samples: int) -> None:
        self.law, self.samples = law, samples

    def __getattr__(self, name: str) -> object:
        return getattr(self.law, name)

    def length(self, split: str) -> int:  # noqa: ARG002
        """Samples in an epoch."""
        return self.samples

    def fingerprint(self) -> str:
        """Of the law."""
        return self.law.fingerprint()


if __name__ == "__main__":
    main()
