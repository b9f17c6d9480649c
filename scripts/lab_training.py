"""Networks trained on benches that differ (``lab-mild``) and on one that does not, on ten perturbed benches: paired.

    python scripts/lab_training.py --out runs/lab [--samples 24576] [--epochs 30] [--seeds 3] [--workers 16] [--device cuda]
    python scripts/lab_training.py --out runs/on --work runs/lab --start runs/lab --epochs 12 --rate 3e-4  # both go on
    python scripts/lab_training.py --table runs/lab/scores.npz

Both have the same characters, media, first weights, network (that of the package, residual of width 26), number of samples
and of steps. Ten characters of the benchmark and five of validation are held out. Scores are aligned Pearson correlations
to the sharp object, as it appears on the camera. Media of the test are new; of one bench they are the same for both.
"""  # noqa: E501

import argparse
import multiprocessing
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from perturbed_benches import BENCHES, HELD_OUT, bench

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.recipe_files import changed, recipe_table
from specklegen.models import Training, train
from specklegen.models.judging.evaluation import aligned_to, targets_of
from specklegen.models.learning.examples import Examples, sharing_media
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.metrics import bootstrap, pearson

KINDS = ("clean", "lab-mild")
_PIECE = 64


def recipe_of(kind: str) -> Recipe:
    """Recipe that a kind of network is trained on."""
    table = HELD_OUT if kind == "clean" else changed(HELD_OUT, changed_by(kind))
    return load_recipe("unknown-slab", table)


def changed_by(name: str) -> dict:
    """What a packaged table changes, read as a recipe would that inherits it."""
    both = recipe_table_of(["unknown-slab", name])
    plain = recipe_table("unknown-slab")
    return {key: value for key, value in both.items() if plain.get(key) != value}


def recipe_table_of(parents: list[str]) -> dict:
    """Table of a file that inherits several."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "heir.toml"
        file.write_text(f"inherits = {parents}\n".replace("'", '"'))
        return recipe_table(file)


def piece(task: tuple[str, str, int, int]) -> tuple[np.ndarray, ...]:
    """Inputs, targets and media of some samples of a kind, of a seed and a split."""
    kind, split, seed, first = task
    recipe = sharing_media(recipe_of(kind)) if split == "train" else recipe_of(kind)
    batch = {name: _tensor(value) for name, value in recipe.batch(seed, split, range(first, first + _PIECE)).items()}
    made = network_input(batch, "autocorrelation").half()
    return made.numpy(), batch["object"].float().numpy(), batch["parameters"]["medium"].long().numpy()


def seen(task: tuple[str, int, int]) -> dict:
    """Some test samples of a bench, its images as small as they may be."""
    name, seed, first = task
    return bench(name).batch(seed, "test", range(first, first + _PIECE))


def _tensor(value: object) -> object:
    if isinstance(value, dict):
        return {name: torch.as_tensor(each) for name, each in value.items()}
    return torch.as_tensor(value)


def gathered(parts: list[tuple[np.ndarray, ...]]) -> Examples:
    """Examples of several pieces."""
    return Examples(*(torch.from_numpy(np.concatenate(each)) for each in zip(*parts, strict=True)))


def trained(task: tuple[str, int, int, float | None, str, str, str, float, str | None]) -> str:
    """Train one network; its file."""
    kind, seed, epochs, seconds, device, work, folder, rate, before = task
    torch.set_num_threads(1)
    data, held = (torch.load(f"{work}/{kind}-{split}.pt", weights_only=False) for split in ("train", "validation"))
    settings = Training(network="residual", width=26, learning_rate=rate, mirror=True, epochs=epochs, seed=seed)
    start = None if before is None else Reconstructor.load(f"{before}/{KINDS[0]}-{seed}.pt")
    begun = time.time()
    steps = [0]
    model = train(settings, Examples(*data), Examples(*held), f"{folder}/{kind}-{seed}", device=device,
                  seconds=seconds, start=start, steps=lambda done, _: steps.__setitem__(0, done))  # fmt: skip
    file = f"{folder}/{kind}-{seed}.pt"
    model.save(file, compact=True)
    print(f"{kind} {seed}: {time.time() - begun:.0f} s, {steps[0]} steps", flush=True)
    return file


def scored(task: tuple[list[str], list[dict]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correlations float64[networks, images] to the sharp objects of a bench; medium and character of each image."""
    files, parts = task
    torch.set_num_threads(1)
    models, found = [Reconstructor.load(file) for file in files], []
    batches = [{name: _tensor(value) for name, value in part.items()} for part in parts]
    for model in models:
        each = []
        for batch in batches:
            target = targets_of(batch)["sharp"]
            rows, columns = batch["object"].shape[1:]
            made = aligned_to(model.reconstruct(batch), target, (rows, columns))
            each.append(pearson(made, target[..., :rows, :columns]).double().numpy())
        found.append(np.concatenate(each))
    told = [np.concatenate([part["parameters"][name] for part in parts]).astype(int) for name in ("medium", "label")]
    return np.array(found), told[0], told[1]


def table(file: Path) -> str:
    """What the scores say, in Markdown."""
    found = np.load(file)
    scores, media, labels, names = found["scores"], found["media"], found["labels"], found["benches"]
    lines = ["| bench | " + " | ".join(KINDS) + " | paired difference |", "|---|---|---|---|"]
    gain = scores[1].mean(0) - scores[0].mean(0)  # over seeds; [benches, images]
    for n, name in enumerate(names):
        low = bootstrap(gain[n], media[n], labels[n])
        each = " | ".join(f"{scores[k, :, n].mean():.3f}" for k in range(len(KINDS)))
        lines.append(f"| {name} | {each} | {low.mean:+.3f} [{low.low:+.3f}, {low.high:+.3f}] |")
    wrong = bootstrap(gain[1:].mean(0), media[1], labels[1])
    lines.append(f"| mean of the ten | {scores[0, :, 1:].mean():.3f} | {scores[1, :, 1:].mean():.3f} | "
                 f"{wrong.mean:+.3f} [{wrong.low:+.3f}, {wrong.high:+.3f}] |")  # fmt: skip
    seeds = scores.mean(-1)
    lines += ["", "by seed, paired difference: " + "; ".join(
        f"seed {s}: clean {seeds[1, s, 0] - seeds[0, s, 0]:+.3f}, ten {(seeds[1, s, 1:] - seeds[0, s, 1:]).mean():+.3f}"
        for s in range(seeds.shape[1])
    )]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--out", type=Path, default=Path("runs/lab"))
    asked.add_argument("--table", type=Path)
    asked.add_argument("--samples", type=int, default=24576)
    asked.add_argument("--epochs", type=int, default=30)
    asked.add_argument("--seconds", type=float, help="by the clock, of each network: shortens the training")
    asked.add_argument("--seeds", type=int, default=3)
    asked.add_argument("--rate", type=float, default=1e-3, help="learning rate")
    asked.add_argument("--start", type=Path, help="folder of an earlier run: both begin with its clean networks")
    asked.add_argument("--tests", type=int, default=192)
    asked.add_argument("--workers", type=int, default=16)
    asked.add_argument("--device", default="cpu")
    asked.add_argument("--work", type=Path, help="folder for training images; what is there is taken")
    given = asked.parse_args()
    if given.table is not None:
        print(table(given.table))
        return
    work = given.work or given.out
    given.out.mkdir(parents=True, exist_ok=True)
    work.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    begun = time.time()
    for kind in KINDS:
        piece((kind, "train", 0, 0))  # compiles what the workers then have
    for name in BENCHES:
        bench(name).batch(0, "test", range(1))  # and finds the memory effects that they share
    print(f"ready after {time.time() - begun:.0f} s", flush=True)
    fork = multiprocessing.get_context("fork")
    with fork.Pool(given.workers) as pool:
        for kind in KINDS:
            for split, count in (("train", given.samples), ("validation", 384)):
                if (work / f"{kind}-{split}.pt").exists():
                    continue
                tasks = [(kind, split, 0, first) for first in range(0, count, _PIECE)]
                torch.save(tuple(gathered(pool.map(piece, tasks, chunksize=1))), work / f"{kind}-{split}.pt")
        tests = {}
        for name in BENCHES:
            tests[name] = pool.map(seen, [(name, 7, first) for first in range(0, given.tests, _PIECE)], chunksize=1)
    print(f"drawn after {time.time() - begun:.0f} s", flush=True)
    before = None if given.start is None else str(given.start)
    about = given.epochs, given.seconds, given.device, str(work), str(given.out), given.rate, before
    tasks = [(kind, seed, *about) for seed in range(given.seeds) for kind in KINDS]
    with multiprocessing.get_context("spawn").Pool(min(len(tasks), given.workers)) as pool:
        files = pool.map(trained, tasks, chunksize=1)
    print(f"trained after {time.time() - begun:.0f} s", flush=True)
    with fork.Pool(given.workers) as pool:
        told = pool.map(scored, [(files, parts) for parts in tests.values()], chunksize=1)
    scores = np.stack([each for each, _, _ in told], 1)  # of networks, benches, images
    scores = scores.reshape(given.seeds, len(KINDS), len(BENCHES), -1).swapaxes(0, 1)
    media, labels = (np.stack([each[n] for each in told]) for n in (1, 2))
    np.savez_compressed(given.out / "scores.npz", scores=scores, media=media, labels=labels, benches=[*BENCHES])
    print(table(given.out / "scores.npz"))
    print(f"done after {time.time() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
