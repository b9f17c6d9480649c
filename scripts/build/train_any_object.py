"""Train the solver that comes with the package: objects of many kinds, slabs of any material, cameras with noise.

    python scripts/build/train_any_object.py --out runs/any-object --minutes 60            # processor minutes
    python scripts/build/train_any_object.py --out runs/any-object --minutes 60            # goes on where it stopped
    python scripts/build/train_any_object.py --out runs/natural --minutes 45 --from specklegen/models/data/any-object.pt

Nothing is rendered. Of even light, periodograms are drawn from their law, S(f) times a gamma variable
(docs/likelihood.md). Of uneven light, images are drawn: a Gaussian field of the law's spectrum times an envelope that
falls off as a slab's light, a Gaussian beam or a slope do. They go through the functions of inference: the taper that
each asks for, its periodogram, and the likelihood under that taper. The dense net comes first: it needs lags alone, so
that a sample takes one to four milliseconds and no two are the same. Then it is frozen, and the stages are trained on
samples with phase retrieval's answers, which take 75 ms each and are seen several times. Objects are those of
`any-object` (its ten test characters and five validation characters are in no sample) and, two of five, of
`object_mix.py`, slabs those of its material, extents 0.1 to 3 ranges, 24 to 64 camera pixels, 4 to 1000 photons a pixel
or no noise; C_I is stated 15 % wrong for a third of them. With ``--from`` training begins at the weights of a solver,
at a third of the rates, and keeps its net that reads ranges. The certificate is fitted to validation objects, that of
constellations to points of validation.
"""

import argparse
import copy
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from object_mix import Mix
from torch import Tensor, nn

from specklegen.datasets import load_recipe
from specklegen.datasets.split import Split
from specklegen.models.learning.few_points import few_points
from specklegen.models.learning.networks.range_net import EXTENTS, NUMBERS, RangeNet, shares
from specklegen.models.learning.networks.unrolled import Candidates, Seen, Unrolled, invariant_loss
from specklegen.models.learning.solver import EXTENT, LAGS, RESTARTS, Solver, evidence_of, first_look
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.likelihood.spectrum import Transforms, autocorrelation_of, waves
from specklegen.models.retrieval.autocorrelation import distances
from specklegen.models.retrieval.edges import WIDTHS, taper_of, tapered
from specklegen.models.retrieval.phase_retrieval import Retrieval

CAMERA, FRAME, BATCH, HELD_OUT = 128, 36, 32, 600
POINTS = (2, 3, 4, 5, 6, 8, 11)
MATERIALS, LAYOUTS, SAMPLES, CERTIFIED, SPARSE = 400, 64, 7680, 1600, 64
LATER = 10**6  # number of the first batch of these: not one that the dense net has seen
START_SHARE, RANGE_MINUTES = 0.45, 22.0
START_RATE, STAGE_RATE, LATER_RATE = 1e-3, 2e-3, 0.3  # the last: share of both from trained weights on
STAGE_WEIGHTS = (0.5, 0.5, 1.0)
SAVED_EVERY = 60.0
GOOD = 0.8
LOOKS = (1, 4, 12)  # tiles or frames whose power is averaged
LATTICE = np.arange(0, 64, 0.5)  # distances in object pixels at which C_I is kept
NATURAL = 0.6  # share of batches of one look under uneven light
WRAP = 200  # side of the periodic field that images are cut from
MIXED = 0.4  # share of training objects that are pictures of `object_mix`


def recipe(few: bool = False):
    """`any-object` with points of several numbers, and characters as often as all the rest but polygons; or points."""
    objects = load_recipe("any-object").objects.model_dump(mode="json")
    glyphs, _, strokes, polygons, blobs = objects["families"]
    points = [{"type": "Points", "count": count} for count in POINTS]
    if few:
        return load_recipe("any-object", {"objects": {**objects, "families": points}})
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


class Drawn(NamedTuple):
    """Samples: likelihood, what the network sees, the C_I that is stated, and the objects float[B, n, n].

    C_I is that between the pixels of the frame, and that at every lag; ``extent`` float[B] that of the frame in ranges.
    """

    likelihood: SpeckleLikelihood
    seen: Seen
    stated: Tensor
    at_lags: Tensor
    objects: Tensor
    extent: Tensor

    def turned(self) -> "Drawn":
        """Upside down in a mirror, which is another sample of the same law."""
        likelihood = self.likelihood.seeing(self.likelihood.power, self.likelihood.noise, self.likelihood.looks)
        likelihood.rows = self.likelihood.rows * torch.tensor([1.0, -1.0])[:, None, None]
        lags = torch.roll(self.seen.lags.flip(-2), 1, -2)
        seen = self.seen._replace(lags=lags, answers=self.seen.answers.flip(-2))
        return self._replace(likelihood=likelihood, seen=seen, objects=self.objects.flip(-2))

    def deviance(self, images: Tensor) -> Tensor:
        """Of images float[B, K, n, n]."""
        return self.likelihood(images, self.stated[:, None])


class Begun(NamedTuple):
    """Samples with what the frozen dense net and phase retrieval make of them."""

    drawn: Drawn
    candidates: Candidates

    @classmethod
    def of(cls, drawn: Drawn, network: Unrolled) -> "Begun":
        """Let the network begin."""
        return cls(drawn, network.candidates(drawn.seen, drawn.deviance))

    def turned(self) -> "Begun":
        """As :meth:`Drawn.turned`."""
        turned = self.candidates._replace(pictures=self.candidates.pictures.flip(-2))
        return Begun(self.drawn.turned(), turned)


def envelopes(rng: np.random.Generator, tiles: int) -> Tensor:
    """Envelopes of uneven light, float[BATCH, tiles, CAMERA, CAMERA], each of mean 1 over its tiles.

    Light falls off as exp(-(r / w)^p) about a place near the middle, times a slope, or is a slope alone. A camera that
    is cut into tiles shows each of them a part: as much unevenness over all tiles as over one.
    """
    across = int(np.ceil(tiles**0.5))
    side = (np.arange(CAMERA) + 0.5) / (CAMERA / 2)
    corner = np.stack(np.divmod(np.arange(tiles), across), axis=1) * 2.0
    places = [(corner[:, axis, None] + side) / across - 1 for axis in (0, 1)]
    y, x = places[0][:, :, None].astype(np.float32), places[1][:, None, :].astype(np.float32)
    made = []
    for _ in range(BATCH):
        kind, angle = rng.integers(4), rng.uniform(0, 2 * np.pi)
        slope = rng.uniform(0.1, 0.85) if kind == 0 else rng.uniform(0, 0.6) * (kind == 1)
        light = 1 + slope * (x * np.cos(angle) + y * np.sin(angle)) / 2**0.5
        if kind:
            wide, power = np.exp(rng.uniform(np.log(0.7), np.log(2.5))), rng.choice([2.0, rng.uniform(1.2, 3)])
            row, column = rng.uniform(-0.5, 0.5, 2)
            light = light * np.exp(-(((y - row) ** 2 + (x - column) ** 2) / wide**2) ** (power / 2))
        made.append(light / light.mean())
    return torch.from_numpy(np.stack(made)).float()


@cache
def pictures() -> Mix:
    """Objects of many more kinds; :func:`object_mix.scripts` takes a while."""
    return Mix()


class Layout:
    """Geometry of a batch: its likelihood under every taper, and the periodic field that images are cut from."""

    def __init__(self, seen: Periodogram, frame: int, optics: Optics) -> None:
        self.tapers = [SpeckleLikelihood(seen._replace(taper=share), (frame, frame), optics) for share in WIDTHS]
        grain, step = (torch.as_tensor(each) for each in (optics.grain, optics.step))
        reach = int(WRAP / float(grain.min()))
        self.rows, columns = np.arange(-reach, reach + 1), np.arange(reach + 1)
        lags = np.arange(1 - frame, frame)
        self.waves = Transforms(*(waves(each / WRAP, lags, step) for each in (self.rows, columns)))
        v, u = (grain[:, None] * torch.from_numpy(each / WRAP) for each in (self.rows, columns))
        overlap = (1 - v.abs()).clamp_min(0)[:, :, None] * (1 - u.abs()).clamp_min(0)[:, None]
        self.passed = (grain.square()[:, None, None] * overlap).float()
        self.passed[..., 0] *= 2  # irfft2 takes the real part of this column, half of its power

    def fields(self, lags: Tensor, count: int, rng: np.random.Generator) -> Tensor:
        """Gaussian fields float[B, count, CAMERA, CAMERA] whose pixels have the covariance of the law."""
        power = (self.waves(lags).clamp_min(0) * self.passed).sqrt()[:, None]
        drawn = torch.from_numpy(rng.standard_normal((len(lags), count, *power.shape[2:], 2), dtype=np.float32))
        spectrum = torch.zeros(len(lags), count, WRAP, WRAP // 2 + 1, dtype=torch.complex64)
        spectrum[:, :, self.rows % WRAP, : power.shape[-1]] = power * torch.view_as_complex(drawn)
        return torch.fft.irfft2(spectrum, s=(WRAP, WRAP))[..., :CAMERA, :CAMERA] * (WRAP / 2**0.5)

    def under(self, shares: Tensor) -> SpeckleLikelihood:
        """Likelihood of images under the taper of each, of :data:`WIDTHS`."""
        number, each = torch.searchsorted(torch.tensor(WIDTHS, dtype=shares.dtype), shares), torch.arange(len(shares))
        made = copy.copy(self.tapers[0])
        kept = [dict(one.named_buffers()) for one in self.tapers]
        made._buffers = {name: torch.stack([one[name] for one in kept])[number, each] for name in kept[0]}
        return made


class Law:
    """Samples drawn from the law, batch by batch; each batch a function of seed, split and number."""

    def __init__(
        self, frame: int, seed: int, split: Split = "train", layouts: int = LAYOUTS, extents=(0.1, 3.0),
        few: bool = False, looks=(0.75, 0.17, 0.08), natural: float = NATURAL,
    ) -> None:  # fmt: skip
        self.looks, self.natural = looks, natural  # how often LOOKS are drawn, and uneven light
        self.source, self.frame, self.seed, self.split = recipe(few), frame, seed, split
        self.mix = pictures() if split == "train" else None
        self.low, self.high = np.log(extents)
        self.materials = [self.source.material_of(seed, split, n) for n in range(MATERIALS)]
        rng = np.random.default_rng([seed, 5])
        blank = torch.ones(BATCH, CAMERA, CAMERA // 2 + 1)
        dark = Periodogram(blank, torch.zeros(BATCH), 1.0, (CAMERA, CAMERA))
        self.layouts: list[Layout] = []
        for _ in range(layouts):
            step = np.exp(rng.uniform(np.log(24 / EXTENT), np.log(64 / EXTENT), BATCH))
            grain = np.where(rng.random(BATCH) < 0.6, 3.0, np.exp(rng.uniform(np.log(2.2), np.log(4.5), BATCH)))
            optics = Optics(torch.from_numpy(step).float(), torch.from_numpy(np.minimum(grain, 3.6 * step)).float())
            self.layouts.append(Layout(dark, frame, optics))

    def __call__(self, n: int, retrieval: Retrieval | None = RESTARTS) -> Drawn:
        """Return batch n."""
        rng = np.random.default_rng([self.seed, 6, n])
        pad = (self.frame - EXTENT) // 2
        objects = torch.from_numpy(np.stack([self._hidden(BATCH * n + k, pad) for k in range(BATCH)]))
        extent, wrong = np.exp(rng.uniform(self.low, self.high, BATCH)), np.exp(rng.normal(0, 0.15, BATCH))
        wrong = np.where(rng.random(BATCH) < 0.3, wrong, 1.0)
        chosen = [self.materials[k] for k in rng.integers(MATERIALS, size=BATCH)]
        reach = extent * np.array([each.half_range for each in chosen]) / EXTENT
        true, stated = (
            torch.from_numpy(np.stack([
                np.square(each.correlation(scale * LATTICE)) for each, scale in zip(chosen, scales, strict=True)
            ])).float() for scales in (reach, reach * wrong)
        )  # fmt: skip
        photons = np.exp(rng.uniform(np.log(4), np.log(1000), BATCH))
        noise = torch.from_numpy(np.where(rng.random(BATCH) < 0.35, 0.0, 1 / photons)).float()
        looks = float(rng.choice(LOOKS, p=self.looks))
        layout = self.layouts[rng.integers(len(self.layouts))]
        lags = autocorrelation_of(objects) * at(true, between(self.frame))
        if rng.random() < self.natural * (1.0 if looks == 1 else 2 / looks):
            likelihood = self._uneven(layout, lags, noise, int(looks), rng)
        else:
            even = layout.tapers[0]
            spectrum = even.of_lags(lags) + noise[:, None, None]
            power = spectrum * torch.from_numpy(rng.standard_gamma(looks, spectrum.shape, dtype=np.float32) / looks)
            likelihood = even.seeing(power, noise, looks)
        at_lags = at(stated, distances(LAGS))
        seen = first_look(likelihood, at_lags, self.frame, seed=n, retrieval=retrieval)
        told = torch.from_numpy(extent).float()
        return Drawn(likelihood, seen, at(stated, between(self.frame)), at_lags, objects, told)

    def _hidden(self, number: int, pad: int) -> np.ndarray:
        """Object float32[frame, frame]: in training, one of :mod:`object_mix` for every :data:`MIXED` of one."""
        if self.mix and number * 0.618034 % 1 < MIXED:
            return self.mix(self.seed, number)
        return np.pad(self.source.objects.image(self.seed, self.split, number), pad)

    def _uneven(
        self, layout: Layout, lags: Tensor, noise: Tensor, looks: int, rng: np.random.Generator
    ) -> SpeckleLikelihood:
        """Likelihood of images under uneven light, of the taper that they ask for; the widest where cut into tiles."""
        light = envelopes(rng, looks)
        fields = layout.fields(lags, looks, rng)
        drawn = torch.from_numpy(rng.standard_normal(fields.shape, dtype=np.float32))
        seen = light * fields + (noise[:, None, None, None] * light).sqrt() * drawn
        contrast = torch.from_numpy(np.exp(rng.uniform(np.log(0.3), 0, BATCH))).float()  # of speckle, amid other light
        seen = seen + (light - 1) / contrast[:, None, None, None]
        seen = seen - seen.mean((-3, -2, -1), keepdim=True)
        shares = taper_of(1 + seen) if looks == 1 else torch.full((BATCH,), WIDTHS[-1], dtype=torch.float64)
        power = torch.fft.rfft2(tapered(seen, shares)).abs().square().mean(1) / CAMERA**2
        likelihood = layout.under(shares)
        rows = torch.arange(-(len(likelihood.down) // 2), len(likelihood.down) // 2 + 1)
        return likelihood.seeing(power[:, rows % CAMERA][..., : len(likelihood.across)], noise, float(looks))


class Progress:
    """Processor seconds, those of earlier runs included, and what is to be kept."""

    def __init__(self, out: Path, network: Unrolled) -> None:
        self.file, self.network, self.kept = out / "checkpoint.pt", network, {}
        if self.file.exists():
            self.kept = torch.load(self.file, weights_only=True)
            network.load_state_dict(self.kept["network"])
        self.start = time.process_time() - float(self.kept.get("seconds", 0.0))
        self.saved = self.seconds

    @property
    def seconds(self) -> float:
        """Processor seconds so far."""
        return time.process_time() - self.start

    def save(self, phase: str, optimizer: torch.optim.Optimizer, step: int, begin: float = 0.0) -> None:
        """Keep everything that a later run needs."""
        self.kept = {
            "network": self.network.state_dict(), "phase": phase, "optimizer": optimizer.state_dict(), "step": step,
            "begin": begin, "seconds": self.seconds,
        }  # fmt: skip
        torch.save(self.kept, self.file.with_suffix(".part"))
        self.file.with_suffix(".part").replace(self.file)
        self.saved = self.seconds

    def of(self, phase: str, optimizer: torch.optim.Optimizer) -> int:
        """Step at which a phase goes on, its optimizer put back."""
        if self.kept.get("phase") != phase:
            return 0
        optimizer.load_state_dict(self.kept["optimizer"])
        return int(self.kept["step"])


def stepped(optimizer: torch.optim.Optimizer, network: nn.Module, loss: Tensor, rate: float, done: float) -> None:
    """One step at a rate that rises, then falls to zero as a cosine."""
    for group in optimizer.param_groups:
        group["lr"] = float(rate * min(1.0, done / 0.02) * (0.5 + 0.5 * np.cos(np.pi * done)) + 1e-6)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()


def train_start(
    network: Unrolled, law: Law, held_out: list[Drawn], progress: Progress, seconds: float, rate: float = START_RATE
) -> None:
    """Train the dense net on samples that it sees once, up to processor seconds in all."""
    optimizer = torch.optim.AdamW(network.dense.parameters(), lr=rate, weight_decay=0.01)
    n = progress.of("start", optimizer)
    while progress.seconds < seconds:
        both = law(2 * n, retrieval=None), law(2 * n + 1, retrieval=None).turned()
        losses = [invariant_loss(network.dense(each.seen).sigmoid(), each.objects).mean() for each in both]
        stepped(optimizer, network.dense, torch.stack(losses).mean(), rate, min(progress.seconds / seconds, 1.0))
        n += 1
        if progress.seconds > progress.saved + SAVED_EVERY or progress.seconds >= seconds:
            with torch.no_grad():
                found = [1 - invariant_loss(network.dense(each.seen).sigmoid(), each.objects) for each in held_out]
            progress.save("start", optimizer, n)
            told = by_light(held_out, [each.numpy() for each in found])
            print(f"{progress.seconds:.0f} CPU s, {2 * BATCH * n} samples: {told}", flush=True)


def train_stages(
    network: Unrolled, data: list[Begun], held_out: list[Begun], progress: Progress, seconds: float,
    rate: float = STAGE_RATE,
) -> None:  # fmt: skip
    """Train the stages on samples that are there, up to processor seconds in all."""
    optimizer = torch.optim.AdamW(network.priors.parameters(), lr=rate, weight_decay=0.05)
    n, begin = progress.of("stages", optimizer), float(progress.kept.get("begin", progress.seconds))
    generator = torch.Generator().manual_seed(n)
    while progress.seconds < seconds:
        for place in torch.randperm(len(data), generator=generator).tolist():
            sample = data[place].turned() if torch.rand((), generator=generator) < 0.5 else data[place]
            made = network.refined(sample.candidates, sample.drawn.deviance)[1:]
            losses = [invariant_loss(image, sample.drawn.objects).mean() for image in made]
            loss = torch.stack([weight * each for weight, each in zip(STAGE_WEIGHTS, losses, strict=True)]).sum()
            done = min((progress.seconds - begin) / (seconds - begin), 1.0)
            stepped(optimizer, network.priors, loss, rate, done)
            if done >= 1:
                break
        n += 1
        if progress.seconds > progress.saved + SAVED_EVERY or progress.seconds >= seconds:
            progress.save("stages", optimizer, n, begin)
            told = by_light([each.drawn for each in held_out], judged(network, held_out))
            print(f"{progress.seconds:.0f} CPU s, {n} passes: {told}", flush=True)


def train_ranges(out: Path) -> RangeNet:
    """Train the net that reads ranges, for processor minutes of its own, on extents all of which are equally likely."""
    file = out / "ranges.pt"
    torch.manual_seed(0)
    network = RangeNet()
    if file.exists():
        network.load_state_dict(torch.load(file, weights_only=True))
        return network
    often = (0.5, 0.25, 0.25)  # large cameras are cut into tiles
    law = Law(FRAME, seed=3, extents=EXTENTS, looks=often)
    others = Law(FRAME, seed=4, split="validation", layouts=8, extents=EXTENTS, looks=often)
    held_out = [others(n, retrieval=None) for n in range(HELD_OUT // BATCH)]
    optimizer = torch.optim.AdamW(network.parameters(), lr=START_RATE, weight_decay=0.01)
    start, n, done = time.process_time(), 0, 0.0

    def loss(sample: Drawn) -> Tensor:
        told = network(sample.seen.lags[:, 0], sample.seen.scalars[:, :NUMBERS])
        return -(shares(sample.extent) * told).sum(1).mean()

    while (done := (time.process_time() - start) / (60 * RANGE_MINUTES)) < 1:
        both = law(2 * n, retrieval=None), law(2 * n + 1, retrieval=None).turned()
        stepped(optimizer, network, torch.stack([loss(each) for each in both]).mean(), START_RATE, done)
        n += 1
        if n % 500 == 0:
            with torch.no_grad():
                found = torch.stack([loss(each) for each in held_out]).mean()
            spent = time.process_time() - start
            print(f"ranges: {spent:.0f} CPU s, {2 * BATCH * n} samples, loss {found:.4f}", flush=True)
    torch.save(network.state_dict(), file)
    return network


def judged(network: Unrolled, data: list[Begun]) -> list[np.ndarray]:
    """Correlations of all samples, float[BATCH] of each batch."""
    with torch.no_grad():
        made = [network.refined(each.candidates, each.drawn.deviance)[-1] for each in data]
        return [(1 - invariant_loss(x, y.drawn.objects)).numpy() for x, y in zip(made, data, strict=True)]


def by_light(samples: list[Drawn], correlations: list[np.ndarray]) -> str:
    """Mean correlation of images without a taper, and of those under one."""
    found, under = np.concatenate(correlations), np.concatenate([each.likelihood.taper.numpy() for each in samples]) > 0
    return f"{found[~under].mean():.4f}, under a taper {found[under].mean():.4f}"


def evidence(network: Unrolled, law: Law, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Evidence float[n, e] and correlations float[n] of samples that nothing was decided on; kept in a file."""
    if not file.exists():
        network.eval()
        found, right = [], []
        for n in range(CERTIFIED // BATCH):
            drawn = law(LATER + n)
            begun = network.candidates(drawn.seen, drawn.deviance)
            made = [image.detach() for image in network.refined(begun, drawn.deviance)]
            found.append(evidence_of(network, made, begun, drawn.likelihood, drawn.stated, drawn.at_lags))
            right.append(1 - invariant_loss(made[-1], drawn.objects))
        np.savez(file, evidence=torch.cat(found).double().numpy(), correlation=torch.cat(right).numpy())
    with np.load(file) as kept:
        return kept["evidence"], kept["correlation"]


def sparse_evidence(network: Unrolled, law: Law, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Evidence float[n, e] of constellations and their correlations float[n], batch by batch; kept in a file."""
    rows: list[list[float]] = []
    done = 0
    if file.exists():
        with np.load(file) as kept:
            rows, done = kept["rows"].tolist(), int(kept["batches"])
    network.eval()
    for n in range(done, SPARSE // BATCH):
        drawn = law(LATER + n)
        begun = network.candidates(drawn.seen, drawn.deviance)
        last = network.refined(begun, drawn.deviance)[-1].detach()
        rows += [
            [*few.evidence.tolist(), 1 - float(invariant_loss(few.image[None], drawn.objects[k : k + 1]))]
            for k, few in enumerate(few_points(last, begun, drawn.likelihood, drawn.stated, network.answers))
            if few is not None
        ]
        np.savez(file, rows=np.array(rows), batches=n + 1)
    table = np.array(rows)
    return table[:, :-1], table[:, -1]


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/any-object"))
    options.add_argument("--minutes", type=float, default=60.0, help="Processor minutes, of drawing samples too.")
    options.add_argument("--from", dest="begin", type=Path, help="Solver whose weights training begins at.")
    given = options.parse_args()
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    before = Solver.load(given.begin) if given.begin else None
    network, factor = (before.network, LATER_RATE) if before else (Unrolled(FRAME), 1.0)
    progress = Progress(given.out, network)
    law, others = Law(FRAME, seed=1), Law(FRAME, seed=2, split="validation", layouts=8)
    held_out = [others(n) for n in range(HELD_OUT // BATCH)]
    train_start(network, law, held_out, progress, START_SHARE * 60 * given.minutes, factor * START_RATE)
    network.requires_grad_(False)
    network.priors.requires_grad_(True)
    if progress.seconds < 60 * given.minutes:
        begun = [Begun.of(each, network) for each in held_out]
        data = [Begun.of(law(LATER + n), network) for n in range(SAMPLES // BATCH)]
        print(f"{SAMPLES} samples with answers after {progress.seconds:.0f} CPU s", flush=True)
        train_stages(network, data, begun, progress, 60 * given.minutes, factor * STAGE_RATE)
    found, right = evidence(network, others, given.out / "evidence.npz")
    few = Law(FRAME, seed=6, split="validation", layouts=8, few=True)
    told, hit = sparse_evidence(network, few, given.out / "sparse_evidence.npz")
    certificates = [Certificate.fitted(x, y > GOOD) for x, y in ((found, right), (told, hit))]
    ranges = before.ranges if before else train_ranges(given.out)
    solver = Solver(network, certificates[0], ranges, certificates[1])
    solver.save(given.out / "any-object.pt")
    print(f"{given.out / 'any-object.pt'}: {(right > GOOD).mean():.2f} of {len(right)} above {GOOD}")


if __name__ == "__main__":
    main()
