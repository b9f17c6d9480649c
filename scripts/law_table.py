"""Law-drawn against rendered training: ``python scripts/law_table.py --seconds 60``.

The same network is trained in three ways, and judged on rendered test images. Half of a budget of processor seconds is
spent on samples, which are rendered, or drawn from the law of images (``specklegen.models.learning.law``); the other
half goes through them again and again. In the third way no more samples are drawn from the law than were rendered, of
the same objects and slabs. What a sample and a step cost is measured first, in turn, and decides how many there are, so
that the rows suffer alike from a busy machine.

Beside them chance: the mean of numbers in training, or another object. Of objects the packaged solver, which knows C_I
and searches the likelihood for few points (the first 64 images). Of numbers of a medium two ways that are not trained
here. "Object known": the mean over 256 slabs of the training split, each weighed by the exact likelihood of the image
and the true object, which no network is told. ``fit_range``: the packaged solver's, which knows neither the object nor
which objects there are, weighed by the recipe's ranges. The networks that tell a range are also asked for those of the
benchmark's waves, whose setup has the same grain on the object's pitch; as they are, and over the envelope that is
fitted to each. Intervals are 95 %, over the classes of the objects (images, where they have none; of waves the slabs)
and seeds.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets import Recipe, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.objects import Points
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import Training, load_solver, train
from specklegen.models.judging import waves
from specklegen.models.judging.baselines import any_object, on_even_light
from specklegen.models.judging.evaluation import aligned_to, on_frame
from specklegen.models.judging.points import light_found, share_found
from specklegen.models.learning.examples import Examples, batches_of, sharing_media
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.law import ByLaw
from specklegen.models.learning.measurement import measured, memory_effect_of
from specklegen.models.learning.range_fit import fit_range, range_of
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.targets import TARGETS, numbers_of
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, memory_effect_between
from specklegen.models.metrics import pearson

BATCH = 64
NETWORKS: dict[str, dict[str, Any]] = {
    "label": {"network": "residual", "width": 26, "learning_rate": 1e-3},
    "object": {"network": "residual", "width": 26, "learning_rate": 1e-3},
    "range": {"network": "lags", "width": 8, "learning_rate": 3e-3},
    "material": {"network": "lags", "width": 8, "learning_rate": 3e-3},
}
"""Target to network; all see the periodogram."""
EPOCHS = 8
"""Of which the best is kept, by as many rendered images of the validation split as a batch has twice."""
SLABS = 256
"""Of the training split, among which a known object's slab is sought."""
RANGE = "memory_effect_range"
FAINTEST = 0.3
"""Brightness of the faintest points, where points are hidden."""


def stored(source: Recipe, samples: range, seed: int, split: str, targets: list[str]) -> dict[str, Examples]:
    """Rendered examples for every target."""
    return collected(batches_of(source, samples, seed, split), targets)


def collected(batches: Iterable[Mapping[str, Any]], targets: list[str]) -> dict[str, Examples]:
    """Examples of batches for every target, of which inputs are kept once."""
    inputs, media, values = [], [], {target: [] for target in targets}
    for batch in batches:
        inputs.append(network_input(batch, "periodogram").half())
        media.append(batch["parameters"]["medium"].long())
        for target in targets:
            values[target].append(TARGETS[target].values(batch))
    seen, which = torch.cat(inputs), torch.cat(media)
    return {target: Examples(seen, torch.cat(each), which) for target, each in values.items()}


def told(model: Reconstructor, judged: Examples, target: str, points: bool) -> dict[str, np.ndarray]:
    """Per image whether it is named rightly, or scores of an object, float64[n]; of numbers (answer, truth) [n, 2]."""
    made = answers(model, judged.inputs, target)
    if target == "object":
        return likeness(made, judged.targets, points)
    if target == "label":
        return {target: (made.argmax(-1) == judged.targets.argmax(-1)).double()[:, 0].numpy()}
    return of_numbers(made[:, 0], judged.targets[:, 0], target)


def of_numbers(made: Tensor, truth: Tensor, target: str) -> dict[str, np.ndarray]:
    """(answer, truth) float64[n, 2] of each number of a medium."""
    pairs = torch.stack([made, truth], -1).double().numpy()
    return {name: pairs[:, n] for n, name in enumerate(TARGETS[target].numbers)}


def likeness(made: Tensor, objects: Tensor, points: bool) -> dict[str, np.ndarray]:
    """Correlation of images float[n, h, w] with objects, and of points which are found, and what light is theirs."""
    moved = aligned_to(made, on_frame(objects, dark=False), (objects.shape[-2], objects.shape[-1]))
    found = {"correlation": pearson(moved, objects).double().numpy()}
    if points:
        pairs = [(image.numpy(), each.numpy()) for image, each in zip(moved, objects, strict=True)]
        found["points within 1.5 pixels"] = np.array([share_found(*pair) for pair in pairs])
        found["light at its place"] = np.array([light_found(*pair) for pair in pairs])
    return found


def answers(model: Reconstructor, inputs: Tensor, target: str) -> Tensor:
    """What a network answers to inputs."""
    with torch.no_grad():
        return TARGETS[target].answer(torch.cat([model.network(x.float()) for x in inputs.split(256)]))


def statistic(values: np.ndarray) -> float:
    """Mean of scores [n], or R^2 of (answer, truth) [n, 2]."""
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
    options.add_argument("--targets", nargs="+", default=["range", "material"])
    options.add_argument("--seconds", type=float, default=60.0, help="Processor seconds of a training.")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--images", type=int, default=384, help="Rendered test images.")
    given = options.parse_args()
    torch.set_num_threads(1)
    recipe = load_recipe(given.recipe)
    if isinstance(recipe, HiddenObject) and isinstance(recipe.objects, Points):
        recipe = load_recipe(given.recipe, {"objects": {"faintest": FAINTEST}})
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    table = Table(recipe, given.targets, given.images)
    for target, ways in untrained(table).items():
        for way, values in ways.items():
            table.add(target, way, values)
    for seed in range(given.seeds):
        train_all(table, given.seconds, seed)
        table.show()


class Table:
    """Test images, and what each way said of them."""

    def __init__(self, recipe: HiddenObject, targets: list[str], images: int) -> None:
        self.recipe, self.targets, self.points = recipe, targets, isinstance(recipe.objects, Points)
        self.batches = [*batches_of(recipe, images, 100, "test")]
        self.judged = collected(self.batches, targets)
        self.checked = stored(recipe, range(2 * BATCH), 101, "validation", targets)
        labels = torch.cat([batch["parameters"]["label"] for batch in self.batches]).numpy()
        self.classes = labels if (labels >= 0).all() else np.arange(images)
        self.law = ByLaw(sharing_media(recipe))  # type: ignore[arg-type]
        self.values: dict[tuple[str, str, str], list[np.ndarray]] = {}

    def add(self, target: str, way: str, scores: Mapping[str, np.ndarray]) -> None:
        """Scores [n], or (answer, truth) [n, 2], of a seed."""
        for name, values in scores.items():
            kept = self.values.setdefault((target, name, way), [])
            kept.append(values)
            print(f"| {target}: {name} | {way}, seed {len(kept) - 1} | {statistic(values):.3f} |", flush=True)

    def show(self) -> None:
        """Print every row with its interval."""
        for (target, name, way), values in self.values.items():
            classes = np.arange(waves.SAMPLES) // 2 if target == "range of waves" else self.classes
            told_of = interval(np.stack(values), classes[: len(values[0])])
            print(f"| {self.recipe.name}, {target}: {name} | {way} | {told_of} |", flush=True)


def train_all(table: Table, seconds: float, seed: int) -> None:
    """Train every target in every way with one seed, and judge."""
    shown, law = table.law.recipe, table.law
    by_law, rendered = costs(law, shown, seed)
    few, many = (range(max(1, round(seconds / 2 / each)) * BATCH) for each in (rendered, by_law))
    images = stored(shown, few, seed, "train", table.targets)
    drawn = stored(law, many, seed, "train", table.targets)  # type: ignore[arg-type]
    for target in table.targets:
        kind = NETWORKS[target] | {"input": "periodogram", "batch_size": BATCH}
        kind |= {"loss": "blurred-invariant"} if table.points and target == "object" else {}
        settings = Training(target=target, epochs=EPOCHS, seed=seed, **kind)
        step = step_of(settings, images[target], table.checked[target])
        steps = max(1, round(seconds / 2 / step / EPOCHS))
        law_ms, rendered_ms, step_ms = (1e3 * each / BATCH for each in (by_law, rendered, step))
        shares = [f"{len(each)} samples {EPOCHS * steps * BATCH / len(each):.1f} times" for each in (few, many)]
        print(f"| {target}, seed {seed} | ms: law {law_ms:.2f}, rendered {rendered_ms:.2f}, step {step_ms:.2f} "
              f"| rendered and law: {' and '.join(shares)} |", flush=True)  # fmt: skip
        ways = {
            "rendered": images[target],
            "law, as many": Examples(*(each[: len(few)] for each in drawn[target])),
            "law": drawn[target],
        }
        for way, data in ways.items():
            with tempfile.TemporaryDirectory() as folder:
                model = train(settings, (Again(data, steps, seed), steps), table.checked[target], folder)
            table.add(target, way, told(model, table.judged[target], target, table.points))
            if target in ("range", "material"):
                table.add("range of waves", f"{target}, {way}", of_waves(model, table, target))


def of_waves(model: Reconstructor, table: Table, target: str) -> dict[str, np.ndarray]:
    """(answer, truth) [48, 2] of the range of the benchmark's waves, in the object's pixels as the recipe has them."""
    batch = waves.batch(range(waves.SAMPLES))
    pitch = float(table.batches[0]["parameters"]["object_pitch"][0])
    ranges = pitch * batch["object"].shape[-1] / batch["parameters"]["extent_over_range"]
    names = TARGETS[target].numbers
    truth = numbers_of({"parameters": {RANGE: ranges}}, {RANGE: names[RANGE]})[:, 0, 0]

    def asked(seen: Mapping[str, Any]) -> Tensor:
        return answers(model, network_input(seen, "periodogram"), target)[:, 0, [*names].index(RANGE)]

    found = {"as they are": asked(batch), "over their envelope": on_even_light(asked)(batch)}
    return {way: torch.stack([made, truth], -1).double().numpy() for way, made in found.items()}


def untrained(table: Table) -> dict[str, dict[str, dict[str, np.ndarray]]]:
    """What is said without training: by chance, by the likelihood, by the packaged solver; by target and way."""
    asked = {target: TARGETS[target].numbers for target in table.targets if TARGETS[target].numbers}
    if not asked:
        return {"object": of_objects(table)} if "object" in table.targets else {}
    slabs = [table.recipe.material_of(0, "train", number) for number in range(SLABS)]
    drawn = table.batches[0]["parameters"]
    wavelength, pitch = (float(drawn[name][0]) for name in ("wavelength", "object_pitch"))
    told_of = [slab.parameters(wavelength) for slab in slabs]  # type: ignore[union-attr]
    columns = {name: torch.tensor([each[name] for each in told_of], dtype=torch.float64) for name in told_of[0]}
    memory = [memory_effect_between(slab.correlation, wavelength, pitch, table.recipe.objects.shape) for slab in slabs]
    weights = known(table, torch.stack(memory).float())
    found: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for target, names in asked.items():
        prior = numbers_of({"parameters": columns}, names)[:, 0].double()
        truth = table.judged[target].targets[:, 0].double()
        ways = {"chance": prior.mean(0).expand_as(truth), "object known": weights @ prior}
        if target == "range":
            ways["fit_range"] = torch.from_numpy(fitted(table, columns[RANGE].numpy()))[:, None]
        found[target] = {way: of_numbers(made, truth, target) for way, made in ways.items()}
    return found


def of_objects(table: Table) -> dict[str, dict[str, np.ndarray]]:
    """Another object, and the packaged solver, on the first images."""
    first = table.batches[0]
    objects, shown = first["object"].float(), any_object(load_solver(), table.recipe)(first).float()
    ways = {name: likeness(images, objects, table.points)
            for name, images in (("chance", objects.roll(1, 0)), ("solver", shown))}  # fmt: skip
    return ways


def known(table: Table, memory: Tensor) -> Tensor:
    """Weights float64[n, M] of slabs of C_I float[M, ...] by the likelihood of each image and its true object."""
    weights = []
    for batch in table.batches:
        seen, optics, _ = measured(batch, table.recipe)
        law = SpeckleLikelihood(seen, table.recipe.objects.shape, optics)
        weights.append(torch.stack([law.log_likelihood(batch["object"], each) for each in memory], 1))
    return torch.cat(weights).double().softmax(1)


def fitted(table: Table, ranges: np.ndarray) -> np.ndarray:
    """Range of each image by the packaged solver, C_I shaped as that of one slab of the recipe's; over the spread."""
    solver, found, scale = load_solver(), [], TARGETS["range"].numbers[RANGE]
    correlation = table.recipe.material_of(1, "train", 0).correlation
    for batch in table.batches:
        seen, optics, _ = measured(batch, table.recipe)
        pitch, wavelength, camera, width = (
            float(batch["parameters"][name][0]) for name in ("object_pitch", "wavelength", "camera_pitch", "width")
        )
        shape = memory_effect_of(correlation, wavelength, pitch)
        own = Optics(pitch / camera, wavelength / width / camera, optics.profile)
        for n in range(len(seen.power)):
            one = seen._replace(power=seen.power[n : n + 1], noise=seen.noise[n : n + 1])
            tried = fit_range(solver, one, own, [shape]).tried
            at = np.log10(np.array([*tried]) * range_of(shape) * pitch)
            edges = np.concatenate([[-np.inf], (at[1:] + at[:-1]) / 2, [np.inf]])
            weight = np.exp([*tried.values()]) * np.histogram(np.log10(ranges), edges)[0]
            found.append(weight @ at / weight.sum())
    return (np.array(found) - scale.middle) / scale.spread


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
        train(settings.replace(epochs=1), (batches, 24), checked, folder)
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


if __name__ == "__main__":
    main()
