"""What networks of `specklegen train coherent-digits` make of seen and unseen glasses, and of independent waves.

Every network is shown digits of the test split behind the glasses of its training, behind glasses of the test split,
and behind glasses of :func:`waves`, a program that shares no code with the recipe: square pixels on a fine grid, their
angular spectrum carried to the glass, a drawn phase, an iris, and the sum of Fraunhofer. Scores are Pearson
correlations in place, with 95 % intervals over glasses and digits; beside them what the mean of the training objects
scores, and what the same answers score for the objects of other images.

    specklegen train coherent-digits --network unet --input camera --loss pearson --width 20 --epochs 6 --out runs/64
    specklegen train coherent-digits --set media=1 --network unet --input camera --loss pearson --width 20 --epochs 2 \
        --out runs/1
    python scripts/coherent_trend.py runs/64/best.pt:64 runs/1/best.pt:1 [--images 192]
"""

import argparse

import numpy as np
import torch

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.models import bootstrap
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.metrics import pearson

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


def main(models: list[str], count: int, each: int) -> None:
    """Print a row for each network and kind of glasses."""
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
    print("| glasses of training | tested on | correlation [95 %] | mean object | other objects |")
    print("|---|---|---|---|---|")
    for text in models:
        path, _, media = text.rpartition(":")
        network = Reconstructor.load(path)
        seen = SpeckleGenerator(load_recipe("coherent-digits", {"media": int(media)}), 0, "train", objects="test")
        for name, batch in (("its own glasses", seen(range(count))), ("unseen glasses", unseen),
                            ("independent waves", apart)):  # fmt: skip
            objects = batch["object"]
            answers = network.reconstruct(batch)
            scores = pearson(answers, objects).double().numpy()
            places = batch["parameters"]["medium"].long().numpy()
            if len(np.unique(places)) == 1:  # over digits alone
                places = np.arange(len(scores))
            found = bootstrap(scores, places, labels[: len(scores)])
            mean = float(pearson(train.expand_as(objects), objects).mean())
            other = float(pearson(answers.roll(1, 0), objects).mean())
            row = f"{found.mean:.3f} [{found.low:.3f}, {found.high:.3f}] | {mean:.3f} | {other:.3f} |"
            print(f"| {media} | {name} | {row}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", help="best.pt:MEDIA, the number of glasses that it was trained on")
    parser.add_argument("--images", type=int, default=128)
    parser.add_argument("--each", type=int, default=4, help="of the waves' images, behind one glass")
    asked = parser.parse_args()
    main(asked.models, asked.images, asked.each)
