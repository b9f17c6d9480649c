"""Images a second of streams and of the torch samplers on one device, beside what it can do.

    python scripts/gpu_benchmark.py --device cuda      some minutes; writes nothing unless --json is given
    python scripts/gpu_benchmark.py --device cpu       the same on the CPU, for comparison
    python scripts/gpu_benchmark.py --only streams     batches of recipes (docs/notes/devices.md) and of other tools
    python scripts/gpu_benchmark.py --profile through-slab     where the time of a recipe's batches goes
    python scripts/gpu_benchmark.py --device meta      CPU time of the host for an image, graphs replayed, without a GPU

Limits are measured in the same run: bytes a second of a large copy (read and written), and floating-point operations
a second of a large complex64 matrix product. Beside each rate stand the bytes and operations that one image cannot do
without, and the share of the device's limit that the rate reaches. Every result is compared with the CPU's before it
is timed. Rates are medians of the repeats, on the CPU in seconds of the processor. The first batches compile
their operators, which takes a minute or two on a CUDA device (docs/notes/devices.md).
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

import specklegen as sg
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.synthesis import imaging
from specklegen.synthesis.objects import object_imaging, object_media
from specklegen.synthesis.stacks import stack_sampler

WIDTH = 1e5
MEDIUM = sg.Slab(thickness=2000.0, mean_free_path=200.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))


class Wrong(Exception):
    """A result of the device is not that of the CPU."""


def seconds(function: Callable[[], object], device: torch.device, repeats: int) -> float:
    """Median seconds of a call, finished on the device; on the CPU those of the processor."""
    clock = time.process_time if device.type == "cpu" else time.perf_counter

    def finish() -> None:
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    function()
    finish()
    found = []
    for _ in range(repeats):
        start = clock()
        function()
        finish()
        found.append(clock() - start)
    return float(np.median(found))


def limits(device: torch.device, repeats: int) -> dict[str, float]:
    """Bytes a second of a copy and operations a second of a matrix product."""
    large = device.type == "cuda"
    source = torch.empty(2**28 if large else 2**25, dtype=torch.uint8, device=device)
    target = torch.empty_like(source)
    copy = 2 * source.numel() / seconds(lambda: target.copy_(source), device, repeats)
    n = 4096 if large else 512
    a, b = (torch.randn(n, n, dtype=torch.complex64, device=device) for _ in range(2))
    return {"bytes": copy, "operations": 8 * n**3 / seconds(lambda: a @ b, device, repeats)}


def agreement(found: torch.Tensor, expected: torch.Tensor | np.ndarray, bound: float) -> float:
    """Relative difference of two results; refuses more than the rounding of single precision."""
    expected = torch.as_tensor(expected)
    found = found.cpu().to(expected.dtype)
    error = float(torch.linalg.vector_norm(found - expected) / torch.linalg.vector_norm(expected))
    if error > bound:
        raise Wrong(f"The device's result is off by {error:.2g}, more than rounding ({bound:g}).")
    return error


def stationary(correlation: MemoryEffectCorrelation, device: torch.device, repeats: int) -> dict[str, float]:
    """Stacks of five tilts and 101 x 101 views."""
    scene = sg.Scene(
        wavelength=1.0, medium=MEDIUM,
        illumination=sg.light.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(5), width=WIDTH),
        sensor=sg.sensors.FarField.grid((101, 101), pitch=float(np.deg2rad(0.000125))),
    )  # fmt: skip
    sampler = stack_sampler(scene, correlation, device=device)
    error = agreement(sampler.sample(0), stack_sampler(scene, correlation).sample(0), 1e-4)
    times = 20
    took = seconds(lambda: [sampler.sample(0, r) for r in range(times)], device, repeats) / times
    tilts, rank = sampler.mixing.shape
    cells, views = sampler.y.count * sampler.x.count, int(np.prod(sampler.shape))
    transform = (
        5 * sampler.x.period * sampler.y.period * np.log2(sampler.x.period * sampler.y.period)
        if sampler.fft
        else 8 * sampler.shape[0] * sampler.x.count * (sampler.y.count + sampler.shape[1])
    )
    return {
        "rate": 1 / took, "error": error,
        "bytes": 8.0 * (cells * (rank + 2 * tilts) + views * tilts),
        "operations": float(tilts * (8 * rank * cells + transform)),
    }  # fmt: skip


def hidden_objects(correlation: MemoryEffectCorrelation, device: torch.device, repeats: int) -> dict[str, float]:
    """Images of 28 x 28 objects over half a memory-effect range on 128 x 128 views, a fresh medium each."""
    pitch = 0.5 * correlation.half_range() / (2 * np.pi) / 28
    camera = sg.sensors.FarField.grid((128, 128), pitch=0.5 / WIDTH)
    arguments = {"wavelength": 1.0, "object_shape": (28, 28), "object_pitch": pitch, "width": WIDTH, "grid": camera}
    imaging, plain = object_imaging(correlation, device=device, **arguments), object_imaging(correlation, **arguments)
    picture = np.random.default_rng(0).random((28, 28))
    light = torch.from_numpy(np.where(picture < 0.35, picture / 0.35, 0.0)).to(torch.float32)[None]
    there = light.to(device)
    error = agreement(object_media(imaging, 0).images(there), object_media(plain, 0).images(light), 1e-4)
    times = 20
    took = seconds(lambda: [object_media(imaging, 1, r).images(there) for r in range(times)], device, repeats) / times
    transforms = imaging.rank * (imaging.rank + 1) / 2 + imaging.rank
    return {
        "rate": 1 / took, "error": error,
        "bytes": 8.0 * 128**2 * 4 * transforms,
        "operations": float(transforms * 5 * (256**2) * np.log2(256**2)),
    }  # fmt: skip


STREAMS = (
    "unknown-slab", "through-slab", "tilt-stack", "material-regression", "two-tilts", "dynamic-slab", "brownian-slab",
    "partially-coherent-slab", "through-slab-lab",  # the last estimates K of every medium, on the processor
)  # fmt: skip


def needs(generator: SpeckleGenerator, numbers: list[int]) -> tuple[float, float]:
    """Bytes and operations that one image cannot do without, on average: every array written once and read once."""
    recipe = generator.recipe
    (height, width), frames = recipe.camera_shape, recipe.frames
    made = generator.media(list(dict.fromkeys(recipe.medium_number(n) for n in numbers)))
    found = []
    for group, _ in made.at:
        seen = made.groups[group][1]
        (rows, columns), (h, w), tilts, rank = seen.lags, seen.shape, seen.modes.shape[1], seen.rank
        cells = 0 if recipe.shares_media else seen.envelope[0].numel()  # media that come again are kept
        half = columns // 2 + 1
        pairs = rank * (rank + 1) / 2
        noise = 16 * rank * cells + 16 * rank * rows * columns + 8 * pairs * rows * columns if cells else 0
        sums = 16 * pairs * rows * half + 16 * tilts * pairs * rows * half
        camera = 8 * tilts * (height * rows + half * width) + 8 * tilts * rows * half + 4 * tilts * height * width
        transforms = 5 * rows * columns * np.log2(rows * columns) * (rank + pairs / 2) if cells else 0
        objects = 8 * tilts * pairs * (rows * h * w + rows * w * half) * (h * w > 1) + 8 * tilts * pairs * rows * half
        images = 8 * tilts * height * half * (rows + width)
        found.append((frames * (noise + sums + camera), frames * (transforms + images) + objects))
    mean_bytes, operations = np.mean(found, axis=0)
    return float(mean_bytes), float(operations)


def forever(name: str, batch: int, device: torch.device) -> Iterator[dict[str, Any]]:
    """Batches of a packaged recipe as a training loop sees them, epoch after epoch."""
    loader = SpeckleStream(load_recipe(name), batch_size=batch, device=device).loader()
    while True:
        yield from loader


def stream(name: str, device: torch.device, repeats: int) -> dict[str, float]:
    """Batches of a packaged recipe's stream, as many as a device makes at once and as many more."""
    batch = 256 if device.type == "cuda" else 16
    generator = SpeckleGenerator(load_recipe(name), 0, device=device)
    plain = SpeckleGenerator(load_recipe(name), 0)
    key = next(iter(generator.recipe.layout()))
    error = agreement(generator(range(16))[key].double(), plain(range(16))[key].double(), 1e-4)
    several = 2 * max(1, generator.at_once // batch) if device.type == "cuda" else 1
    batches = forever(name, batch, device)
    took = seconds(lambda: [next(batches) for _ in range(several)], device, repeats) / (several * batch)
    least, operations = needs(generator, list(range(batch)))
    return {"rate": 1 / took, "error": error, "bytes": least, "operations": operations}


def profile(name: str, device: torch.device) -> None:
    """Print where the time of a recipe's batches goes, on the host and on the device, once all is compiled."""
    batches = forever(name, 256 if device.type == "cuda" else 16, device)
    for _ in range(8):
        next(batches)
    with torch.profiler.profile() as found:
        for _ in range(8):
            next(batches)
    for by in ("self_cpu_time_total", "cpu_time_total", *(["self_cuda_time_total"] if device.type == "cuda" else [])):
        print(found.key_averages().table(sort_by=by, row_limit=25, max_name_column_width=60))


def host(name: str, batch: int) -> float:
    """CPU seconds of the host for an image on "meta", which computes nothing, least of three batches.

    Functions that CUDA graphs replay run once; from then on their inputs are copied alone. Ranks, of which "meta" has
    no numbers, are those that the CPU finds.
    """
    recipe = load_recipe(name, {"material": {"kernel_paths": 20_000}} if name == "through-slab" else {})
    media = SpeckleGenerator(recipe, 0).media(list(dict.fromkeys(recipe.medium_number(n) for n in range(batch))))
    ranks = [media.groups[group][1].rank for group, _ in media.at]
    imaging._ranks = lambda modes: (ranks * -(-len(modes.rank) // len(ranks)))[: len(modes.rank)]
    generator, kept = SpeckleGenerator(recipe, 0, device="meta"), {}

    def replayed(name: Any, function: Callable[..., Any], inputs: dict[str, torch.Tensor]) -> Any:
        key = name, *(value.shape for value in inputs.values())
        if key not in kept:
            kept[key] = function(**inputs), {each: value.clone() for each, value in inputs.items()}
        for each, value in inputs.items():
            kept[key][1][each].copy_(value)
        return kept[key][0]

    generator.run = replayed
    generator(range(batch))
    took = []
    for first in range(0, 3 * batch, batch):
        start = time.process_time()
        generator(range(first, first + batch))
        took.append(time.process_time() - start)
    return min(took) / batch


def peers(device: torch.device, repeats: int) -> dict[str, dict[str, float]]:
    """What else one might stream: 128 x 128 images of 28 x 28 objects; the last column says what each leaves out."""
    batch, n = (256, 256) if device.type == "cuda" else (16, 256)
    light = torch.rand(batch, 28, 28, device=device)
    pattern = torch.rand(1, n, n, device=device)

    def convolved(patterns: torch.Tensor) -> torch.Tensor:
        product = torch.fft.rfft2(light, s=(n, n)) * torch.fft.rfft2(patterns)
        return torch.fft.irfft2(product, s=(n, n))[:, 64:192, 64:192]

    def phases(side: int) -> torch.Tensor:
        return torch.polar(torch.ones(()).to(device), 2 * torch.pi * torch.rand(batch, side, side, device=device))

    def screen() -> torch.Tensor:
        return convolved(torch.fft.fft2(phases(72), s=(n, n)).abs().square())

    ways = {
        "one pattern for all, convolved": (lambda: convolved(pattern), "memory effect, materials, new patterns"),
        "thin phase screen": (screen, "memory effect, materials"),
    }
    try:
        from torchoptics import Field  # pyright: ignore[reportMissingImports]
    except ImportError:
        print("pip install torchoptics: its thin phase screen is left out of the table")
    else:

        def library() -> torch.Tensor:
            field = Field(phases(n), wavelength=5e-7, spacing=5e-6).to(device)
            return convolved(field.propagate_to_z(0.05).intensity())

        ways["thin phase screen, torchoptics"] = (library, "memory effect, materials")
    least = {"error": float("nan"), "bytes": 8.0 * n * n * 4, "operations": 15.0 * n * n * 16}
    found = {}
    for what, (function, lacking) in ways.items():
        found[what] = {"rate": batch / seconds(function, device, repeats), "lacking": lacking, **least}
    return found


def naive(correlation: MemoryEffectCorrelation, device: torch.device, repeats: int) -> dict[str, float | str]:
    """What one would write first: a field for every pixel of an object, correlated as K says, transformed and added up.

    The variance of its first images is compared with the sampler's.
    """
    side, cells, views, width = 28, 64, 128, WIDTH
    pitch = 0.5 * correlation.half_range() / (2 * torch.pi) / side
    place = pitch * (torch.arange(side, dtype=torch.float64) - (side - 1) / 2)
    y, x = (axis.flatten() for axis in torch.meshgrid(place, place, indexing="ij"))
    gap = 2 * torch.pi * torch.hypot(y[:, None] - y, x[:, None] - x)
    matrix = torch.from_numpy(correlation(gap.numpy())) + 1e-9 * torch.eye(side**2)
    factor = torch.linalg.cholesky(matrix).to(torch.complex64).to(device)
    distance = width / cells  # half the views of a period, as the camera has two a grain
    across = (torch.arange(cells, dtype=torch.float64) - (cells - 1) / 2) * distance
    wave = lambda sine: torch.exp(2j * torch.pi * sine[:, None] * across).to(torch.complex64).to(device)  # noqa: E731
    up, along = wave(y), wave(x)
    picture = np.random.default_rng(0).random((side, side))
    light = torch.from_numpy(np.where(picture < 0.35, picture / 0.35, 0.0)).to(torch.float32).to(device).flatten()

    def image() -> torch.Tensor:
        white = torch.randn(side**2, cells, cells, dtype=torch.complex64, device=device)
        fields = (factor @ white.flatten(1)).view_as(white) * up[:, :, None] * along[:, None]
        total = torch.zeros(views, views, device=device)
        for part in torch.arange(side**2, device=device).split(64):
            seen = torch.fft.fft2(fields[part], s=(views, views)).abs().square()
            total += (light[part, None, None] * seen).sum(0)
        return total / (light.sum() * cells**2)

    camera = sg.sensors.FarField.grid((views, views), pitch=cells / (views * width))
    imaging = object_imaging(
        correlation, wavelength=1.0, object_shape=(side, side), object_pitch=pitch, width=width, grid=camera
    )
    expected = float(imaging.contrast(light.cpu().double().view(1, side, side)))
    seen = torch.stack([image() for _ in range(12)])
    variances = (seen - 1).square().mean((1, 2)).cpu()  # about their expected value
    error = float((variances.mean() - expected**2) / (variances.std() / len(seen) ** 0.5))
    if abs(error) > 7:  # of Student's t with 11 degrees of freedom: less than once in 1e4
        raise Wrong(f"The naive program's variance is {error:.2g} standard errors from the sampler's.")
    return {"rate": 1 / seconds(image, device, max(1, repeats // 3)), "error": float("nan"),
            "bytes": 0.0, "operations": 0.0, "lacking": "camera, materials"}  # fmt: skip


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--only", choices=["streams", "sums"], help="half of the rows")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the figures there, too")
    parser.add_argument("--profile", metavar="RECIPE", help="only say where the time of its batches goes")
    options = parser.parse_args()
    device = torch.device(options.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        raise SystemExit("No CUDA device is at hand: install a CUDA build of torch, or use --device cpu.")
    if device.type == "meta":
        for name, batch in product(("unknown-slab", "through-slab"), (4096, 256)):
            print(f"{name}, batches of {batch}: {1e6 * host(name, batch):.1f} us of the host for an image", flush=True)
        return None
    if options.profile:
        return profile(options.profile, device)
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else f"CPU, {torch.get_num_threads()} threads"
    able = limits(device, options.repeats)
    print(f"{name}: copy {able['bytes'] / 1e9:.4g} GB/s, complex64 product {able['operations'] / 1e12:.4g} Tflop/s")
    rows: dict[str, Callable[[], dict]] = {}
    correlation = estimate_correlation(MEDIUM, 20_000, 0)
    if options.only != "sums":
        rows |= {f"stream {name}": partial(stream, name, device, options.repeats) for name in STREAMS}
        rows["a field for every pixel"] = partial(naive, correlation, device, options.repeats)
    if options.only != "streams":
        rows["stationary, 5 x 101 x 101 stacks"] = partial(stationary, correlation, device, options.repeats)
        rows["hidden object, 128 x 128 images"] = partial(hidden_objects, correlation, device, options.repeats)
    print(f"{'':<48}{'a second':>10}{'of copy':>10}{'of arithmetic':>15}{'error':>10}{'took':>8}")

    def told(what: str, row: dict, took: float) -> None:
        shares = [row["rate"] * row[limit] / able[limit] for limit in ("bytes", "operations")]
        line = f"{what:<48}{row['rate']:>10.4g}{shares[0]:>10.2%}{shares[1]:>15.2%}{row['error']:>10.1g}{took:>6.0f} s"
        print(line + (f"   without {row['lacking']}" if "lacking" in row else ""), flush=True)

    found, failed = {}, {}
    for what, row in rows.items():  # a device is lent for minutes: one wrong or slow row must not cost the others
        start = time.perf_counter()
        try:
            found[what] = row()
        except (Wrong, RuntimeError) as error:
            failed[what] = error
        else:
            told(what, found[what], time.perf_counter() - start)
    if options.only != "sums":
        for what, row in peers(device, options.repeats).items():
            found[what] = row
            told(what, row, 0.0)
    if options.json:
        options.json.write_text(json.dumps({"device": name, "limits": able, "rows": found}, indent=1) + "\n")
    if failed:
        raise SystemExit("\n".join(f"{what}: {error}" for what, error in failed.items()))


if __name__ == "__main__":
    main()
