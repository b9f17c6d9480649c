"""What a wrong grain costs where object pixels are finer than it: ``python scripts/fine_object_pixels.py``.

Drawn frames are like the measured ones of the benchmark, but of known objects: 320 x 320 pixels of 8 bits, ``--grain``
pixels a grain behind a disc (``--half-gaussian``: or a Gaussian window, in turn), a contrast of 5 to 9 %, an envelope
of which the polynomial leaves some in, an object pixel a camera pixel. They are read with each of ``--assumed`` grains
and a disc; phase retrieval's answer takes the steps down the likelihood that the solver takes last. ``--solve`` asks
the solver too, ``--draw`` the mean of pictures that it draws, as the benchmark does, with those grains: 1 and 8
processor seconds an image. ``--fit`` asks for the grain itself (``fit_grain``), and ``--measured FOLDER`` for that of
the measured frames.
"""

import argparse

import numpy as np
import torch
from torch import Tensor

from specklegen.measured.envelope import fit_envelope
from specklegen.models import Optics, SpeckleLikelihood
from specklegen.models.calibration.grain_fit import fit_grain
from specklegen.models.judging import frames
from specklegen.models.judging.benchmark import BASELINES
from specklegen.models.judging.evaluation import on_frame
from specklegen.models.judging.tasks import task
from specklegen.models.learning.measurement import TILE
from specklegen.models.learning.networks.unrolled import settled
from specklegen.models.learning.reconstructor import centred
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.metrics import align, pearson

SIDE = frames.SIDE
MARGIN = frames.OBJECT[0]
BEYOND = 0.6
"""Frequencies above, in all directions, which hold noise alone behind a disc of 1.8 pixels a grain."""


def drawn(count: int, seed: int, grain: float, gaussian: bool = False) -> tuple[Tensor, Tensor]:
    """Frames float32[n, SIDE, SIDE] over the envelope that is fitted to each, and their objects float32[n, 36, 36]."""
    rng = np.random.default_rng(seed)
    seen, objects = [], []
    for n in range(count):
        bank = frames.printed(frames.SHAPES[n % len(frames.SHAPES)]).numpy()
        hidden = bank[4 * rng.integers(4, 12) + rng.integers(4)].astype(float)  # 16 to 30 pixels
        side = SIDE + MARGIN
        rho = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side))) * grain
        pupil = np.exp(-np.square(2 * rho)) if gaussian and n % 2 == 0 else rho <= 0.5
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


def in_the_middle(images: Tensor) -> Tensor:
    """Images in the middle of a frame of 36 x 36 pixels, their brightest pixels 1."""
    cut = (images.shape[-1] - MARGIN) // 2
    images = centred(images.clamp_min(0))[..., cut : cut + MARGIN, cut : cut + MARGIN]
    return images / images.amax((-2, -1), keepdim=True).clamp_min(1e-6)


def likelihood_of(images: Tensor, grain: float) -> SpeckleLikelihood:
    """Likelihood of objects of 36 x 36 pixels, a pixel of the camera each, behind a disc."""
    seen = periodogram(images[:, None], tile=TILE)
    rows, columns = seen.shape
    far = torch.hypot(torch.fft.fftfreq(rows)[:, None], torch.fft.rfftfreq(columns)) > BEYOND
    seen = seen._replace(noise=seen.power[:, far].mean(1))
    return SpeckleLikelihood(seen, frames.OBJECT, Optics(1.0, grain, "disc"))


def told_grains(name: str, images: Tensor, true: float | None, extent: int = 32) -> None:
    """Print what photographs say of their grain, one a line of eight, and whether their intervals hold the true one."""
    found = fit_grain(images, extent)
    print(f"{name}: median {np.median(found.grain):.2f}, all together {found.tried[found.nats.sum(0).argmin()]:.2f}")
    for eight in np.array_split(found.grain, -(-len(images) // 8)):
        print("  ", " ".join(f"{one:.2f}" for one in eight))
    for told in (2.5,) if true is None else (true, 1.25 * true, 1.4 * true):
        against = found.against(told)
        held = int(((found.low <= told) & (told <= found.high)).sum())
        said = f"{against.min():.0f} to {against.max():.0f} nats against it"
        print(f"   {told:.2f}: held by {held} of {len(images)}; {said}")
    if true is not None:
        apart = np.log(found.grain / true)
        print(f"   ln(grain / true) {apart.mean():+.3f} ± {apart.std(ddof=1):.3f} a photograph", flush=True)


def main() -> None:
    """Print scores over Katz's, and deviances."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--grain", type=float, default=2.5)
    parser.add_argument("--assumed", type=float, nargs="*", default=[2.5, 2.0])
    for option in ("half-gaussian", "solve", "draw", "fit"):
        parser.add_argument(f"--{option}", action="store_true")
    parser.add_argument("--measured")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    if asked.measured is not None:
        told_grains("measured frames", frames.images(range(frames.SAMPLES), asked.measured), None)
        return
    images, objects = drawn(asked.samples, asked.seed, asked.grain, asked.half_gaussian)
    if asked.fit:
        told_grains(f"drawn, grain {asked.grain:g}", images, asked.grain)
        return
    recipe = task("measured frames").recipe()
    setup = recipe.batch(0, "test", range(1))["parameters"]
    truth = on_frame(objects, dark=False)
    first: np.ndarray | None = None

    def tell(name: str, answer: Tensor, more: str = "") -> None:
        nonlocal first
        score = pearson(align(on_frame(answer), truth), truth).numpy()
        first = score if first is None else first
        gain = score - first
        paired = f"over Katz's {gain.mean():+.3f} ± {gain.std(ddof=1) / np.sqrt(len(gain)):.3f}"
        print(f"{name:32s} {score.mean():.3f}, {paired}{more}", flush=True)

    for grain in asked.assumed:
        known = {name: torch.full((len(images),), float(one[0]), dtype=torch.float64) for name, one in setup.items()}
        known["width"] = known["wavelength"] / (grain * known["camera_pitch"])
        batch = {"image": images, "object": torch.zeros(len(images), *frames.OBJECT), "parameters": known}
        katz = in_the_middle(BASELINES["Katz"](recipe)(batch))
        tell(f"Katz, grain {grain:g}", katz)
        likelihood = likelihood_of(images, grain)
        near, deviance = (x[:, 0] for x in settled(katz[:, None], likelihood))
        with torch.no_grad():
            own = f"{float(likelihood(objects[:, None]).mean()):.3f}"
        told = f"; deviance {float(deviance.mean()):.3f}, of the object itself {own}"
        tell(f"Katz, settled, grain {grain:g}", near, told)
        for name in ["solver"] * asked.solve + ["solver, drawn"] * asked.draw:
            tell(f"{name}, grain {grain:g}", BASELINES[name](recipe)(batch))


if __name__ == "__main__":
    main()
