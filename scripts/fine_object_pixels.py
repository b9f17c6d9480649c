"""Solver, Katz, and their mean, where objects are finer than a grain: ``python scripts/fine_object_pixels.py``.

Drawn frames are like the measured ones of the benchmark, but of known objects: 320 x 320 pixels of 8 bits, 2.5 pixels
a grain behind a disc or a Gaussian window in turn, a contrast of 5 to 9 %, an envelope of which the polynomial leaves
some in, an object pixel a camera pixel. ``--seed N`` draws others; ``--answers FILE --measured FOLDER`` takes the
measured frames instead, and the answers of ``specklegen benchmark --task "measured frames" --measured FOLDER``.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from specklegen.measured.envelope import fit_envelope
from specklegen.models.judging import frames
from specklegen.models.judging.benchmark import BASELINES
from specklegen.models.judging.evaluation import on_frame
from specklegen.models.judging.tasks import task
from specklegen.models.learning.measurement import measured
from specklegen.models.learning.networks.unrolled import settled
from specklegen.models.learning.reconstructor import centred
from specklegen.models.likelihood.likelihood import SpeckleLikelihood, expected_deviance
from specklegen.models.metrics import align, pearson

SIDE, GRAIN = frames.SIDE, 2.5
MARGIN = frames.OBJECT[0]


def drawn(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Frames float32[n, SIDE, SIDE] over the envelope that is fitted to each, and their objects float32[n, 36, 36]."""
    rng = np.random.default_rng(seed)
    seen, objects = [], []
    for n in range(count):
        bank = frames.printed(frames.SHAPES[n % len(frames.SHAPES)]).numpy()
        hidden = bank[4 * rng.integers(4, 12) + rng.integers(4)].astype(float)  # 16 to 30 pixels
        side = SIDE + MARGIN
        rho = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side))) * GRAIN
        pupil = (rho <= 0.5) if n % 2 else np.exp(-np.square(2 * rho))
        white = rng.normal(size=(side, side)) + 1j * rng.normal(size=(side, side))
        speckle = np.abs(np.fft.ifft2(np.fft.fft2(white) * pupil)) ** 2
        spread = np.fft.fft2(hidden, (side, side))
        image = np.fft.ifft2(np.fft.fft2(speckle) * spread).real[MARGIN:, MARGIN:]
        image = image / image.mean() - 1
        image = 1 + image * min(1.0, rng.uniform(0.05, 0.09) / image.std())
        y, x = np.mgrid[:SIDE, :SIDE] / (SIDE / 2) - 1
        middle, width = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.9, 1.4)
        light = np.exp(-((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / (2 * width**2))
        f = np.fft.fftfreq(2 * SIDE)
        slow = np.exp(-2 * np.pi**2 * rng.uniform(25, 50) ** 2 * (f[:, None] ** 2 + f**2))
        left = np.fft.ifft2(np.fft.fft2(rng.normal(size=(2 * SIDE, 2 * SIDE))) * slow).real[:SIDE, :SIDE]
        image = image * light * (1 + rng.uniform(0.01, 0.025) * left / left.std())
        image = rng.poisson(image / image.max() * 8000) / 8000
        grey = np.round(200 * image)
        seen.append(grey / fit_envelope(grey, np.ones(grey.shape, bool), "drawn").values)
        objects.append(hidden)
    return torch.from_numpy(np.stack(seen)).float(), torch.from_numpy(np.stack(objects)).float()


def brightest_one(images: Tensor) -> Tensor:
    """Images in the middle of a frame of 36 x 36 pixels, their brightest pixels 1."""
    cut = (images.shape[-1] - MARGIN) // 2
    images = centred(images.clamp_min(0))[..., cut : cut + MARGIN, cut : cut + MARGIN]
    return images / images.amax((-2, -1), keepdim=True).clamp_min(1e-6)


def main() -> None:
    """Print scores and deviances."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--answers", type=Path)
    parser.add_argument("--measured", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    of = task("measured frames")
    recipe = of.recipe()
    if asked.measured is None:
        images, objects = drawn(asked.samples, asked.seed)
    else:
        images, objects = frames.images(range(frames.SAMPLES), asked.measured), None
    setup = recipe.batch(0, "test", range(1))["parameters"]
    known = {name: torch.full((len(images),), float(values[0]), dtype=torch.float64) for name, values in setup.items()}
    batch = {"image": images, "object": torch.zeros(len(images), *frames.OBJECT), "parameters": known}
    if asked.answers is None:
        answers = {name: BASELINES[name](recipe)(batch) for name in ("solver", "Katz")}
    else:
        with np.load(asked.answers) as content:
            places = json.loads(str(content["stated"]))["answers"]
            answers = {
                function: torch.from_numpy(np.concatenate([content[f"{n}/{k}"] for k in range(count)]))
                for n, (name, function, count) in enumerate(places) if (name, function) in (
                    (of.name, "solver"), (of.name, "Katz"))
            }  # fmt: skip
    seen, optics, _ = measured(batch, recipe)
    seen = seen._replace(power=seen.power.float(), noise=seen.noise.float())
    likelihood = SpeckleLikelihood(seen, frames.OBJECT, optics)
    solver, katz = (brightest_one(answers[name]) for name in ("solver", "Katz"))
    (solver_near, katz_near), deviances = (x.unbind(1) for x in settled(torch.stack([solver, katz], 1), likelihood))
    some = [katz, katz_near, *(align(each, katz) for each in (solver, solver_near))]
    shown = {
        "solver": answers["solver"], "Katz": answers["Katz"], "solver, settled": solver_near,
        "Katz, settled": katz_near, "mean of these four": torch.stack(some).mean(0),
    }  # fmt: skip
    for name, image in shown.items():
        if objects is None:
            shapes = [n % len(frames.SHAPES) for n in range(len(image))]
            score = frames.scores(on_frame(image), shapes)["pearson"]
            right = f", named rightly {frames.named(on_frame(image), shapes).sum()} of {len(image)}"
        else:
            truth = on_frame(objects, dark=False)
            score, right = pearson(align(on_frame(image), truth), truth).numpy(), ""
        print(f"{name:20s} {score.mean():.3f} ± {score.std() / np.sqrt(len(score)):.3f}{right}", flush=True)
    with torch.no_grad():
        own = likelihood(torch.stack([solver, katz] + ([] if objects is None else [objects]), 1)).mean(0)
    apart = " ".join(f"{each:.3f}" for each in own)
    near = " ".join(f"{each.mean():.3f}" for each in deviances)
    lower = int((deviances[0] < deviances[1]).sum())
    print(f"deviance, expected {expected_deviance(seen.looks):.3f}: of solver, Katz, the object if known {apart}")
    print(f"settled: {near}; the solver's is the lower one in {lower} of {len(images)}")


if __name__ == "__main__":
    main()
