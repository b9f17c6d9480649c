"""Train the solver that comes with the package: objects of many kinds, slabs of any material, cameras with noise.

    python scripts/train_any_object.py --out runs/any-object --samples 6000 --minutes 30      # processor minutes
    python scripts/train_any_object.py --out runs/any-object --minutes 60                     # goes on to 60 in all

Nothing is rendered: periodograms are drawn from their law, S(f) times a gamma variable (docs/likelihood.md), which
costs a third of a millisecond; nearly all of a sample's 40 ms are phase retrieval's first answers. Objects are those
of `any-object` (its ten test characters and five validation characters are in no sample), slabs those of its material,
extents 0.1 to 3 ranges, 24 to 64 camera pixels, 4 to 1000 photons a pixel or no noise; C_I is stated 15 % wrong for a
third of them. The certificate is fitted to samples that the network was not trained on.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets import load_recipe
from specklegen.models.learning.networks.unrolled import Seen, Unrolled, invariant_loss
from specklegen.models.learning.solver import EXTENT, LAGS, Solver, evidence_of, first_look
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.retrieval.autocorrelation import distances

CAMERA, BATCH, HELD_OUT = 128, 32, 600
POINTS = (2, 3, 4, 5, 6, 8, 11)
MATERIALS = 400
STAGE_WEIGHTS = (0.3, 0.5, 0.5, 1.0)
GOOD = 0.8
LATTICE = np.arange(0, 64, 0.5)  # distances in object pixels at which C_I is kept


def recipe():
    """`any-object` with points of several numbers, and characters as often as all the rest but polygons."""
    objects = load_recipe("any-object").objects.model_dump(mode="json")
    glyphs, _, strokes, polygons, blobs = objects["families"]
    points = [{"type": "Points", "count": count} for count in POINTS]
    objects["families"] = [glyphs, *points, strokes, polygons, blobs]
    objects["weights"] = [5.0, *[0.25] * len(points), 1.5, 2.0, 2.0]
    return load_recipe("any-object", {"objects": objects})


def at(table: Tensor, distance: np.ndarray) -> Tensor:
    """C_I float[B, ...] at distances, from its values on the lattice, float[B, k]."""
    place = torch.from_numpy(distance / (LATTICE[1] - LATTICE[0]))
    low = place.floor().long()
    share = (place - low).to(table)
    return table[:, low] * (1 - share) + table[:, low + 1] * share


def between(frame: int) -> np.ndarray:
    """Distances between the pixels of a frame."""
    steps = np.arange(1 - frame, frame)
    return np.hypot(steps[:, None], steps)


class Drawn:
    """Samples drawn from the law, with what the network sees of them; a function of the seed."""

    def __init__(self, samples: int, frame: int, seed: int = 1) -> None:
        source, rng = recipe(), np.random.default_rng([seed, 5])
        materials = [source.material_of(seed, "train", n) for n in range(MATERIALS)]
        pad = (frame - EXTENT) // 2
        self.parts: list[tuple[SpeckleLikelihood, Seen, Tensor, Tensor]] = []
        for first in range(0, samples, BATCH):
            hidden = np.stack([source.objects.image(seed, "train", first + n) for n in range(BATCH)])
            objects = torch.nn.functional.pad(torch.from_numpy(hidden), (pad, pad, pad, pad))
            extent, wrong = np.exp(rng.uniform(np.log(0.1), np.log(3), BATCH)), np.exp(rng.normal(0, 0.15, BATCH))
            chosen = [materials[n] for n in rng.integers(MATERIALS, size=BATCH)]
            wrong = np.where(rng.random(BATCH) < 0.3, wrong, 1.0)
            reach = extent * np.array([each.half_range for each in chosen]) / EXTENT
            true, stated = (
                torch.from_numpy(np.stack([
                    np.square(each.kernel(scale * LATTICE)) for each, scale in zip(chosen, scales, strict=True)
                ])).float() for scales in (reach, reach * wrong)
            )  # fmt: skip
            step = np.exp(rng.uniform(np.log(24 / EXTENT), np.log(64 / EXTENT), BATCH))
            grain = np.where(rng.random(BATCH) < 0.6, 3.0, np.exp(rng.uniform(np.log(2.2), np.log(4.5), BATCH)))
            photons = np.exp(rng.uniform(np.log(4), np.log(1000), BATCH))
            noise = np.where(rng.random(BATCH) < 0.35, 0.0, 1 / photons)
            looks = float(rng.choice([1, 4, 12], p=[0.75, 0.17, 0.08]))
            blank = torch.ones(BATCH, CAMERA, CAMERA // 2 + 1)
            seen = Periodogram(blank, torch.from_numpy(noise).float(), looks, (CAMERA, CAMERA))
            optics = Optics(torch.from_numpy(step).float(), torch.from_numpy(np.minimum(grain, 3.6 * step)).float())
            likelihood = SpeckleLikelihood(seen, (frame, frame), optics)
            spectrum = likelihood.object_spectrum(objects, at(true, between(frame))) + likelihood.noise[:, None, None]
            likelihood.power = spectrum * torch.from_numpy(rng.gamma(looks, 1 / looks, spectrum.shape)).float()
            shown = first_look(likelihood, at(stated, distances(LAGS)), frame, seed=first)
            self.parts.append((likelihood, shown, at(stated, between(frame)), objects))

    def __len__(self) -> int:
        return len(self.parts)

    def batch(self, n: int, turned: bool = False):
        """What the network takes, and the objects; upside down, which is another sample of the same law."""
        likelihood, seen, c_i, objects = self.parts[n]
        rows = likelihood.rows * torch.tensor([1.0, -1.0])[:, None, None] if turned else likelihood.rows
        if turned:
            lags = torch.roll(seen.lags.flip(-2), 1, -2)
            seen, objects = seen._replace(lags=lags, answers=seen.answers.flip(-2)), objects.flip(-2)

        def deviance(images: Tensor) -> Tensor:
            kept, likelihood.rows = likelihood.rows, rows
            try:
                return likelihood(images, c_i[:, None])
            finally:
                likelihood.rows = kept

        return seen, deviance, objects, likelihood.looks


def train(network: Unrolled, data: Drawn, held_out: Drawn, out: Path, minutes: float, rate: float) -> None:
    """Train for processor minutes, those of earlier runs included; a checkpoint after each pass."""
    torch.manual_seed(0)
    optimizer = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=0.05)
    spent, file = 0.0, out / "checkpoint.pt"
    if file.exists():
        kept = torch.load(file, weights_only=True)
        network.load_state_dict(kept["network"])
        optimizer.load_state_dict(kept["optimizer"])
        spent = float(kept["seconds"])
    start, total = time.process_time() - spent, 60 * minutes
    while (done := (time.process_time() - start) / total) < 1:
        network.train()
        for n in torch.randperm(len(data)).tolist():
            done = min((time.process_time() - start) / total, 1.0)
            for group in optimizer.param_groups:
                group["lr"] = rate * min(1.0, done / 0.02) * (0.5 + 0.5 * np.cos(np.pi * done)) + 1e-5
            seen, deviance, objects, _ = data.batch(n, turned=bool(torch.rand(()) < 0.5))
            losses = [invariant_loss(image, objects).mean() for image in network(seen, deviance)]
            optimizer.zero_grad()
            torch.stack([w * loss for w, loss in zip(STAGE_WEIGHTS, losses, strict=True)]).sum().backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            if done >= 1:
                break
        found = judged(network, held_out)[1].mean()
        print(f"{time.process_time() - start:.0f} CPU s: correlation {found:.4f} on held-out samples", flush=True)
        seconds = torch.tensor(time.process_time() - start)
        torch.save({"network": network.state_dict(), "optimizer": optimizer.state_dict(), "seconds": seconds}, file)


def judged(network: Unrolled, data: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Evidence float[n, e] and correlations float[n] of all samples."""
    network.eval()
    evidence, found = [], []
    for n in range(len(data)):
        seen, deviance, objects, looks = data.batch(n)
        made = [image.detach() for image in network(seen, deviance)]
        evidence.append(evidence_of(made, seen, deviance, looks))
        found.append(1 - invariant_loss(made[-1], objects))
    return torch.cat(evidence).double().numpy(), torch.cat(found).numpy()


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/any-object"))
    options.add_argument("--samples", type=int, default=6000)
    options.add_argument("--minutes", type=float, default=30.0, help="Processor minutes of training, in all.")
    options.add_argument("--learning-rate", type=float, default=2e-3)
    options.add_argument("--width", type=int, default=32)
    given = options.parse_args()
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    network = Unrolled(width=given.width)
    data, held_out = Drawn(given.samples, network.frame), Drawn(HELD_OUT, network.frame, seed=2)
    print(f"{given.samples} samples after {time.process_time():.0f} CPU s", flush=True)
    train(network, data, held_out, given.out, given.minutes, given.learning_rate)
    evidence, found = judged(network, held_out)
    solver = Solver(network, Certificate.fitted(evidence, found > GOOD))
    solver.save(given.out / "any-object.pt")
    print(f"{given.out / 'any-object.pt'}: {(found > GOOD).mean():.2f} above {GOOD}")


if __name__ == "__main__":
    main()
