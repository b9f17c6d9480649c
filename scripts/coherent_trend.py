"""What networks of `specklegen train coherent-digits` make of seen and unseen glasses, and of independent waves.

Every network, or several of one protocol and other seeds, is shown digits of the test split behind the glasses of its
training, behind glasses of the test split, and behind glasses of :func:`waves`, a program that shares no code with the
recipe: square pixels on a fine grid, their angular spectrum carried to the glass, a drawn phase, an iris, and the sum
of Fraunhofer. Scores are Pearson
correlations in place, with 95 % intervals over glasses and digits; beside them what the mean of the training objects
scores, and what the same answers score for the objects of other images. Networks of one protocol share a row: their
scores of an image are averaged.

    specklegen train coherent-digits --set media=64 --network unet --input camera --loss pearson --width 20 \
        --epochs 6 --seed 0 --out runs/64-0
    python scripts/coherent_trend.py runs/64-0/best.pt:64:0 runs/1-0/best.pt:1:0 runs/new-0/best.pt:new:0
"""

import argparse

import numpy as np
import torch

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.models import bootstrap
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.metrics import align, pearson

WAVELENGTH, PITCH, FOCUS, WINDOW = 0.633, 72.0, 230e3, 2160.0  # micrometres, of coherent-digits
RMS_PHASE = 2 * np.pi * 0.5 * 0.5 / WAVELENGTH  # of 0.5 micrometres of glass of index 1.5
CORRELATION = np.sqrt(2) * 0.5 * 0.5 / (0.2 / 2.355)  # 1/e length that scatters over 0.2 (full width)
POINTS, CAMERA, OVER = 2048, 128, 3.0  # points over twice the window; pixels of the camera, over a grain


def glass(rng: np.random.Generator) -> np.ndarray:
    """Phases float64[n, n] of a glass on the points of the window, with a Gaussian autocorrelation."""
    count, step = POINTS // 2, 2 * WINDOW / POINTS
    f = np.fft.fftfreq(count, step)
    power = np.exp(-np.square(np.pi * CORRELATION * f))
    white = np.fft.fft2(rng.standard_normal((count, count)))
    drawn = np.fft.ifft2(white * np.sqrt(power * power[:, None])).real
    return RMS_PHASE * drawn / drawn.std()


def arriving(digit: np.ndarray) -> np.ndarray:
    """Field complex128[n, n] of a digit on the points of the window, at the glass."""
    step, half = 2 * WINDOW / POINTS, POINTS // 4
    x = (np.arange(POINTS) - POINTS / 2 + 0.5) * step
    of = np.floor(x / PITCH + digit.shape[0] / 2).astype(int)
    inside = (of >= 0) & (of < digit.shape[0])
    field = np.where(inside & inside[:, None], digit[np.ix_(of.clip(0, 27), of.clip(0, 27))], 0).astype(complex)
    lens = np.exp(-1j * np.pi / (WAVELENGTH * FOCUS) * np.square(x))
    f = np.square(np.fft.fftfreq(POINTS, step) * WAVELENGTH)
    carried = np.exp(2j * np.pi * FOCUS / WAVELENGTH * (np.sqrt(1 - f - f[:, None]) - 1))
    at_glass = np.fft.ifft2(np.fft.fft2(field * lens * lens[:, None]) * carried)
    return at_glass[half:-half, half:-half]


def seen(fields: np.ndarray) -> np.ndarray:
    """Intensity float64[CAMERA, CAMERA] in the far field of the window."""
    x = (np.arange(POINTS // 2) - POINTS / 4 + 0.5) * 2 * WINDOW / POINTS
    sines = (np.arange(CAMERA) - CAMERA // 2) * WAVELENGTH / WINDOW / OVER
    turns = np.exp(-2j * np.pi / WAVELENGTH * sines[:, None] * x)
    return np.square(np.abs(turns @ fields @ turns.T))


def waves(objects: np.ndarray, each: int) -> tuple[np.ndarray, np.ndarray]:
    """Images [n, CAMERA, CAMERA] of objects [n, h, w], ``each`` of them behind a glass, and numbers of the glasses."""
    glasses = np.arange(len(objects)) // each
    made = []
    for n, (digit, number) in enumerate(zip(objects, glasses, strict=True)):
        if n % each == 0:
            turn = np.exp(1j * glass(np.random.default_rng([7, number])))
        made.append(seen(arriving(digit.astype(float)) * turn))
    return np.stack(made), glasses


def scored(network: Reconstructor, batch: dict) -> tuple[np.ndarray, float]:
    """Scores float64[n] of a network, and the mean of what it makes of an image for the object of another.

    In place; those of networks on the autocorrelation, which has no place, best shifted and turned.
    """
    answers, objects = network.reconstruct(batch), batch["object"]
    ours, others = (
        pearson(each if network.input == "camera" else align(each, objects), objects)
        for each in (answers, answers.roll(1, 0))
    )
    return ours.double().numpy(), float(others.mean())


def glasses_of(batch: dict) -> np.ndarray:
    """Numbers of the glasses of a batch; of new ones for every image, that of the image."""
    return np.asarray(batch["parameters"].get("medium", torch.arange(len(batch["object"])))).astype(int)


def main(models: list[str], count: int, each: int) -> None:
    """Print a row for every protocol of training and kind of glasses, over the seeds of its networks."""
    fresh = load_recipe("coherent-digits")
    unseen = SpeckleGenerator(fresh, 0, "test")(range(count))
    labels = unseen["parameters"]["label"].numpy().astype(int)
    train = torch.stack([torch.from_numpy(fresh.objects.image(0, "train", n)) for n in range(512)]).mean(0)
    some = count // 2 // each * each
    images, glasses = waves(unseen["object"][:some].numpy(), each)
    drawn = {key: value[:some] for key, value in unseen["parameters"].items()}
    apart = {
        "image": torch.from_numpy(images).float(), "object": unseen["object"][:some],
        "parameters": drawn | {"medium": torch.from_numpy(glasses).double()},
    }  # fmt: skip
    protocols: dict[str, list[tuple[Reconstructor, int]]] = {}
    for text in models:
        path, media, seed = text.rsplit(":", 2)
        protocols.setdefault(media, []).append((Reconstructor.load(path), int(seed)))
    print("| glasses of training | tested on | correlation [95 %] | each seed | mean object | other objects |")
    print("|---|---|---|---|---|---|")
    for media, networks in protocols.items():
        recipe = load_recipe("coherent-digits", {"media": media if media == "new" else int(media)})
        own = [SpeckleGenerator(recipe, seed, "train", objects="test")(range(count)) for _, seed in networks]
        for name, batches in (("its own glasses", own), ("unseen glasses", [unseen] * len(networks)),
                              ("independent waves", [apart] * len(networks))):  # fmt: skip
            found = [scored(network, batch) for (network, _), batch in zip(networks, batches, strict=True)]
            scores = np.array([scores for scores, _ in found])
            places = np.array([glasses_of(batch) for batch in batches])
            if name == "its own glasses":  # each seed has glasses of its own
                places += np.arange(len(networks))[:, None] * (places.max() + 1)
                characters = np.concatenate([batch["parameters"]["label"].numpy().astype(int) for batch in batches])
            else:  # all look at the same images
                scores, places = scores.mean(axis=0, keepdims=True), places[:1]
                characters = labels[: scores.size]
            if len(np.unique(places)) == 1:  # over digits alone
                places = np.arange(scores.size)
            interval = bootstrap(scores.ravel(), places.ravel(), characters)
            seeds = ", ".join(f"{scores.mean():.3f}" for scores, _ in found)
            objects = batches[0]["object"]
            mean = float(pearson(train.expand_as(objects), objects).mean())
            other = np.mean([other for _, other in found])
            row = f"{interval.mean:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
            print(f"| {media} | {name} | {row} | {seeds} | {mean:.3f} | {other:.3f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", help="best.pt:MEDIA:SEED, glasses of its training or new, and its seed")
    parser.add_argument("--images", type=int, default=128)
    parser.add_argument("--each", type=int, default=4, help="of the waves' images, behind one glass")
    asked = parser.parse_args()
    main(asked.models, asked.images, asked.each)
