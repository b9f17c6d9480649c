"""Train the prior that comes with the package: pictures of many kinds, alone and with what was measured of them.

    python scripts/build/train_prior.py --out runs/prior --seconds 6000                  # one CPU core, by the clock
    python scripts/build/train_prior.py --out runs/prior --device cuda --seconds 230     # a GPU and as many cores

Pictures (`object_mix.py`) are drawn in processes of their own, and each is used several times, turned and in mirrors.
Half of a batch is seen as noisy pictures alone. For the other half a measurement is drawn from its law, S(f) times a
gamma variable (docs/likelihood.md): slabs of the material of `any-object`, extents 0.1 to 3 ranges, 24 to 64 camera
pixels, grains of 2.2 to 4.5 pixels, square and Gaussian windows, 1 to 40 looks (40 looks of 43 x 43 grains are
74 000), 4 to 1000 photons a pixel or no noise; C_I is stated 15 % wrong for a third. The net then sees what the
measurement says of its own earlier estimate (:mod:`specklegen.models.learning.feedback`). The end comes by the clock,
weights (a mean over the last steps) and a log are written then and every minute.
"""

import argparse
import json
import multiprocessing
import os
import queue
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from object_mix import FRAME, SIDE, Mix, scripts
from torch import Tensor, nn

from specklegen.datasets import load_recipe
from specklegen.datasets.split import Split
from specklegen.models.learning.feedback import LAGS, Measured
from specklegen.models.learning.model_file import write_model
from specklegen.models.learning.networks.flow import Flow, scaled_loss
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.retrieval.autocorrelation import distances

CAMERA, MATERIALS, BLOCK, DIFFERENT = 128, 300, 512, 64
HIGHEST = 1.6e-3
LATTICE = np.arange(0, 64, 0.5)  # distances in object pixels at which C_I is kept
Run = Callable[..., Tensor]
LOOKS, OFTEN = (1.0, 4.0, 12.0, 40.0), (0.55, 0.2, 0.15, 0.1)


def draw(worker: int, seed: int, known: dict[str, str], out: Any) -> None:
    """Put blocks of pictures, in bytes, into a queue for ever."""
    mix, n = Mix(known), 0
    while True:
        block = np.stack([mix(seed, worker, n * BLOCK + k) for k in range(BLOCK)])
        out.put(np.round(255 * block).astype(np.uint8))
        n += 1


class Pool:
    """Pictures that were drawn so far, on the device."""

    def __init__(self, device: torch.device, workers: int, room: int, seed: int = 1) -> None:
        self.known = scripts()
        context = multiprocessing.get_context("spawn")
        self.queue = context.Queue(maxsize=4 * workers + 4)
        self.processes = [
            context.Process(target=draw, args=(n, seed, self.known, self.queue), daemon=True) for n in range(workers)
        ]
        for process in self.processes:
            process.start()
        self.pictures = torch.empty(room, FRAME, FRAME, dtype=torch.uint8, device=device)
        self.count = self.drawn = 0

    def take(self, patience: float | None = None) -> None:
        """Take what has been drawn; wait for the first block, so long, where that is asked."""
        try:
            while True:
                block = self.queue.get(timeout=patience) if patience else self.queue.get_nowait()
                patience = None
                place = self.drawn % len(self.pictures)
                end = min(place + len(block), len(self.pictures))
                self.pictures[place:end] = torch.from_numpy(block[: end - place]).to(self.pictures.device)
                self.drawn += len(block)
                self.count = min(self.drawn, len(self.pictures))
        except queue.Empty:
            pass

    def batch(self, count: int) -> Tensor:
        """Pictures float[count, FRAME, FRAME], turned and in mirrors at random, moved by a pixel at most."""
        device = self.pictures.device
        found = self.pictures[torch.randint(self.count, (count,), device=device)].float() / 255
        for axis in (-1, -2):
            found = torch.where(torch.rand(count, 1, 1, device=device) < 0.5, found.flip(axis), found)
        moved = torch.randint(-1, 2, (2,)).tolist()
        return torch.roll(found, moved, (-2, -1))

    def close(self) -> None:
        """End the processes."""
        for process in self.processes:
            process.terminate()


class Law:
    """Measurements of pictures, drawn from their law on the device."""

    def __init__(self, device: torch.device, count: int, layouts: int, seed: int = 1, split: Split = "train") -> None:
        rng = np.random.default_rng([seed, 5])
        self.device, self.count, self.rng = device, count, np.random.default_rng([seed, 6])
        recipe = load_recipe("any-object")
        materials = [recipe.material_of(seed, split, n) for n in range(MATERIALS)]
        self.extents = np.exp(rng.uniform(np.log(0.1), np.log(3.0), 2048))
        chosen = rng.integers(MATERIALS, size=len(self.extents))
        wrong = np.where(rng.random(len(chosen)) < 0.3, np.exp(rng.normal(0, 0.15, len(chosen))), 1.0)
        tables = [
            np.stack([
                np.square(materials[k].correlation(extent * off * materials[k].half_range / SIDE * LATTICE))
                for k, extent, off in zip(chosen, self.extents, offs, strict=True)
            ]) for offs in (np.ones_like(wrong), wrong)
        ]  # fmt: skip
        self.true, self.stated = (torch.from_numpy(each).float().to(device) for each in tables)
        steps = np.arange(1 - FRAME, FRAME)
        self.between, self.at_lags = np.hypot(steps[:, None], steps), distances(LAGS)
        other = min(count, DIFFERENT)  # cameras of a layout; making one takes 30 ms
        dark = Periodogram(torch.ones(other, CAMERA, CAMERA // 2 + 1), torch.zeros(other), 1.0, (CAMERA, CAMERA))
        self.layouts: list[SpeckleLikelihood] = []
        for n in range(layouts):
            profile = "gaussian" if n % 4 == 3 else "square"
            step = np.exp(rng.uniform(np.log(24 / SIDE), np.log(64 / SIDE), other))
            grain = np.where(rng.random(other) < 0.5, 3.0, np.exp(rng.uniform(np.log(2.2), np.log(4.5), other)))
            grain = np.minimum(grain, 3.6 * step) / (2.0 if profile == "gaussian" else 1.0)
            optics = Optics(torch.from_numpy(step).float(), torch.from_numpy(grain).float(), profile)
            layout = SpeckleLikelihood(dark, (FRAME, FRAME), optics).to(device)
            for name, value in layout._buffers.items():
                layout._buffers[name] = torch.cat([value] * -(-count // other))[:count]  # pyright: ignore
            self.layouts.append(layout)

    def _at(self, table: Tensor, distance: np.ndarray) -> Tensor:
        place = torch.from_numpy(distance / (LATTICE[1] - LATTICE[0]))
        low = place.floor().long()
        share = (place - low).to(table)
        low = low.to(table.device)
        return table[:, low] * (1 - share) + table[:, low + 1] * share

    def __call__(self, pictures: Tensor) -> Measured:
        """What is measured of pictures float[count, FRAME, FRAME]."""
        chosen = torch.from_numpy(self.rng.integers(len(self.true), size=self.count)).to(self.device)
        photons = np.exp(self.rng.uniform(np.log(4), np.log(1000), self.count))
        level = np.where(self.rng.random(self.count) < 0.35, 0.0, 1 / photons)
        noise = torch.from_numpy(level).float().to(self.device)
        looks = float(self.rng.choice(LOOKS, p=OFTEN))
        layout = self.layouts[self.rng.integers(len(self.layouts))]
        spectrum = layout.object_spectrum(pictures, self._at(self.true[chosen], self.between)) + noise[:, None, None]
        power = spectrum * torch._standard_gamma(torch.full_like(spectrum, looks)) / looks
        likelihood = layout.seeing(power, noise, looks)
        stated = self.stated[chosen]
        return Measured.of(likelihood, self._at(stated, self.between), self._at(stated, self.at_lags))


def estimates(run: Run, noisy: Tensor, times: Tensor, measured: Measured, passes: int) -> tuple[Tensor, Tensor]:
    """Feedback on the net's own estimates, after some of them."""
    with torch.no_grad():
        shown, told, _ = measured(((run(noisy, times) + 1) / 2).clamp(0, 1)[:, None])
        for _ in range(passes - 1):
            found = run(noisy, times, shown[:, 0], told[:, 0])
            shown, told, _ = measured(((found + 1) / 2).clamp(0, 1)[:, None])
    return shown[:, 0], told[:, 0]


def losses_of(run: Run, pictures: Tensor, law: Law) -> tuple[Tensor, Tensor, Tensor]:
    """Losses of pictures alone, and of measured ones, float[B / 2] each, and the times of the latter."""
    half = law.count
    u = 2 * pictures - 1
    t = torch.rand(len(u), device=u.device) ** 1.15  # a little more often where much is open
    noisy = t[:, None, None] * u + (1 - t)[:, None, None] * torch.randn_like(u)
    measured = law(pictures[half:])
    shown, told = estimates(run, noisy[half:], t[half:], measured, int(torch.randint(1, 4, ())))
    shown, told = (torch.cat([torch.zeros_like(each), each]) for each in (shown, told))
    found = scaled_loss(run(noisy, t, shown, told), u, t)
    return found[:half], found[half:], t[half:]


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/prior"))
    options.add_argument("--device", default="cpu")
    options.add_argument("--seconds", type=float, default=6000.0, help="By the clock, preparation included.")
    options.add_argument("--batch", type=int, default=0, help="Pictures of a step; by default 64, and 1024 on a GPU.")
    options.add_argument("--workers", type=int, default=0, help="By default one less than there are cores.")
    options.add_argument("--width", type=int, nargs=2, default=(48, 128), help="Channels of the net.")
    given = options.parse_args()
    start = time.monotonic()
    device = torch.device(given.device)
    gpu = device.type == "cuda"
    batch = given.batch or (1024 if gpu else 64)
    given.out.mkdir(parents=True, exist_ok=True)
    log = (given.out / "log.jsonl").open("a")

    def say(**facts: Any) -> None:
        facts = {"seconds": round(time.monotonic() - start, 1)} | facts
        print(json.dumps(facts), flush=True)
        log.write(json.dumps(facts) + "\n")
        log.flush()

    workers = given.workers or max(1, len(os.sched_getaffinity(0)) - 1)
    pool = Pool(device, workers, 2**21 if gpu else 2**17)
    say(workers=workers, characters=sum(map(len, pool.known.values())))
    torch.manual_seed(0)
    net = Flow(width=given.width[0], inner=given.width[1]).to(device)
    mean = Flow(width=given.width[0], inner=given.width[1]).to(device)
    mean.load_state_dict(net.state_dict())
    if gpu:
        net, mean = (each.to(memory_format=torch.channels_last) for each in (net, mean))  # pyright: ignore
    law = Law(device, batch // 2, 8 if gpu else 16)
    say(parameters=sum(p.numel() for p in net.parameters()), layouts=len(law.layouts))
    pool.take(patience=120)
    while pool.count < (16 * batch if not gpu else 60_000) and time.monotonic() - start < 0.25 * given.seconds:
        pool.take(patience=10)
    optimizer = torch.optim.AdamW(net.parameters(), lr=HIGHEST, weight_decay=0.01, betas=(0.9, 0.98), fused=gpu)
    begin, n, told, saved = time.monotonic() - start, 0, time.monotonic(), time.monotonic()
    sums = torch.zeros(3, device=device)
    bins = torch.zeros(2, 4, device=device)

    def run(*seen: Tensor) -> Tensor:  # the net alone: likelihoods need all digits
        with torch.autocast("cuda", torch.bfloat16, enabled=gpu):
            return net(*seen).float()

    last = given.seconds - (8.0 if gpu else 15.0)
    while (now := time.monotonic() - start) < last:
        done = (now - begin) / (last - begin)
        for group in optimizer.param_groups:
            group["lr"] = HIGHEST * min(1.0, done / 0.03) * (0.5 + 0.5 * np.cos(np.pi * done)) + 1e-6
        alone, seen, times = losses_of(run, pool.batch(batch), law)
        loss = alone.mean() + seen.mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
        keep = min(0.999, (n + 1) / (n + 20))
        with torch.no_grad():
            torch._foreach_lerp_(list(mean.parameters()), list(net.parameters()), 1 - keep)
            sums += torch.stack([alone.mean(), seen.mean(), torch.ones((), device=device)])
            place = (4 * times).long().clamp(0, 3)
            bins[0].scatter_add_(0, place, seen.detach())
            bins[1].scatter_add_(0, place, torch.ones_like(times))
        n += 1
        if n % 20 == 0:
            pool.take()
        if time.monotonic() - told > 10:
            a, b, count = sums.tolist()
            say(steps=n, drawn=pool.drawn, alone=round(a / count, 4), measured=round(b / count, 4),
                by_time=[round(x, 4) for x in (bins[0] / bins[1].clamp_min(1)).tolist()])  # fmt: skip
            sums.zero_()
            bins.zero_()
            told = time.monotonic()
        if time.monotonic() - saved > 60:
            save(given.out / "prior.pt", mean)
            saved = time.monotonic()
    save(given.out / "prior.pt", mean)
    say(steps=n, drawn=pool.drawn, done=True)
    pool.close()


def save(path: Path, net: Flow) -> None:
    """Write the net in half precision."""
    stated = {"name": "flow", "frame": net.frame, "width": net.width, "inner": net.inner}
    write_model(path, stated, {key: value.half() for key, value in net.state_dict().items()})


if __name__ == "__main__":
    main()
