"""Figure 12 of Bar et al. (2019): hidden sources over five tilts of 0.0025 degrees, behind g = 0.9 and g = 0.85.

A slab of 1 mm, optical depth 10, 0.5 um, a field of view of 0.1 degrees (240 x 240 pixels, 6400 grains). Three or six
sources on a lattice of 0.0025 degrees, six by six sites, another constellation a medium; both materials
show the same constellations through the same random numbers. Autocorrelation contrast is the mean of the
autocorrelation at the lags from one source to another, over that at the zero lag.

Draws bar19-fig12.png and prints its table (docs/notes/imaging.md).
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from _command import run
from scipy.stats import binomtest

from specklegen.datasets.objects import Points
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval.apodisation import diffraction_limited, transfer_function
from specklegen.models.retrieval.autocorrelation import autocorrelation, memory_effect_at_lags
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve
from specklegen.models.retrieval.restarts import lowest_error
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.objects import object_imaging, object_media

OUT = Path("docs/images")
WAVELENGTH, STEP = 0.5, float(np.sin(np.deg2rad(0.0025)))
SITES, PIXELS_A_STEP, PER_GRAIN, FRAME = 6, 6, 3.0, 80
MEDIA = {3: 48, 6: 20}
"""Sources to media. Three are retrieved so often that a difference in success takes more media to be seen."""
PITCH = STEP / PIXELS_A_STEP
CAMERA = FarFieldGrid(shape=(240, 240), pitch=PITCH)
ANISOTROPIES = (0.9, 0.85)
TRANSFER = transfer_function(FRAME, PER_GRAIN)


def constellation(count: int, medium: int) -> np.ndarray:
    """Sources on the lattice, float32[31, 31]."""
    sites = Points(shape=(SITES, SITES), count=count).image(0, "test", medium)
    sources = np.zeros((PIXELS_A_STEP * (SITES - 1) + 1,) * 2, np.float32)
    sources[::PIXELS_A_STEP, ::PIXELS_A_STEP] = sites
    return sources


def contrast(lags: torch.Tensor, sources: torch.Tensor) -> torch.Tensor:
    """Mean over the lags from one source to another, over the zero lag, float[B]."""
    shape = (len(lags[0]),) * 2
    pairs = torch.fft.irfft2(torch.fft.rfft2(sources, s=shape).abs().square(), s=shape)
    pairs = pairs.double().round()
    pairs[:, 0, 0] = 0
    return (lags * pairs).sum((1, 2)) / pairs.sum((1, 2)) / lags[:, 0, 0]


def seen(g: float, sources: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Autocorrelations float64[B, n, n] of the images behind one material, and its C_I at the lags, of another run."""
    slab = Slab(thickness=1000.0, mean_free_path=100.0, scatterer=HenyeyGreenstein(g=g))
    imaging = object_imaging(
        estimate_correlation(slab, 100_000, 0), wavelength=WAVELENGTH, object_shape=tuple(sources.shape[1:]),
        object_pitch=PITCH, width=WAVELENGTH / (PER_GRAIN * PITCH), grid=CAMERA,
    )  # fmt: skip
    images = [
        imaging.images_by_points(object_media(imaging, 12, n).drawn, each[None].to(torch.float32))  # type: ignore[arg-type]
        for n, each in enumerate(sources)
    ]
    lags = torch.cat([autocorrelation(image, FRAME) for image in images])
    return lags, memory_effect_at_lags(estimate_correlation(slab, 100_000, 1), WAVELENGTH, PITCH, FRAME)


def scores(images: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Pearson correlation with the diffraction-limited sources, aligned."""
    return pearson(align(images, target), target)


def mean(values: np.ndarray) -> str:
    """Mean and its standard error."""
    return f"{values.mean():.3f} ± {values.std(ddof=1) / len(values) ** 0.5:.3f}"


def rate(values: np.ndarray) -> str:
    """Share above 0.8 with Wilson's 95 % interval, percent, and the mean."""
    good, n = int((values > 0.8).sum()), len(values)
    low, high = binomtest(good, n).proportion_ci(method="wilson")
    return f"{100 * good / n:.0f} % ({100 * low:.0f}–{100 * high:.0f}), mean {values.mean():.3f}"


def sign_test(high: np.ndarray, low: np.ndarray) -> str:
    """How often the first of a pair that differs is higher, and the chance of that or more if it were a coin's."""
    wins, pairs = int((high > low).sum()), int((high != low).sum())
    chance = binomtest(wins, pairs, alternative="greater").pvalue if pairs else 1.0
    return f"{wins} of {pairs}, p = {chance:.1g}"


def main(out: Path, quick: bool) -> None:
    """Draw bar19-fig12.png into ``out`` and print the table; ``quick`` takes four media."""
    out.mkdir(parents=True, exist_ok=True)
    restarts = 4 if quick else 10
    print("| sources | | g = 0.9 | g = 0.85 | higher for g = 0.9 |\n|---|---|---|---|---|")
    for count, media in MEDIA.items():
        sources = torch.from_numpy(np.stack([constellation(count, n) for n in range(4 if quick else media)]))
        target = diffraction_limited(sources, TRANSFER)
        figures, found = compared(sources, target, restarts)
        for n, name in enumerate(("autocorrelation contrast", "plain Katz", "with C_I")):
            high, low = (found[g][n] for g in ANISOTROPIES)
            shown = rate if n else mean
            success = f"; success alone {sign_test(high > 0.8, low > 0.8)}" if n else ""
            print(f"| {count} | {name} | {shown(high)} | {shown(low)} | {sign_test(high, low)}{success} |", flush=True)
    draw(out / "bar19-fig12.png", target, figures, found)


def compared(sources: torch.Tensor, target: torch.Tensor, restarts: int) -> tuple[dict, dict]:
    """By anisotropy: autocorrelations and both retrieved images; contrast and both correlations, float64[3, B]."""
    plain = Retrieval(restarts=restarts, shrink_wrap=0.0)
    full = Retrieval(restarts=restarts, extent=1.3 * (sources.shape[1] - 1))  # most of the lattice's diagonal
    figures, found = {}, {}
    for g in ANISOTROPIES:
        lags, c_i = seen(g, sources)
        one = retrieve(lags, plain)
        images = (
            lowest_error(one.restarts, one.error),
            retrieve(lags, full, memory_effect=c_i, transfer=TRANSFER).image,
        )
        found[g] = np.stack([contrast(lags, sources).numpy(), *(scores(each, target).numpy() for each in images)])
        figures[g] = (lags, *images)
    return figures, found


def draw(path: Path, target: torch.Tensor, figures: dict, found: dict) -> None:
    """Autocorrelation and retrieved images behind either material, of the medium of median contrast."""
    n = int(found[ANISOTROPIES[0]][0].argsort()[len(target) // 2])
    figure, panels = plt.subplots(2, 4, figsize=(9, 4.8))
    place = torch.roll(target[n], (24, 24), (0, 1))
    for row, g in zip(panels, ANISOTROPIES, strict=True):
        lags, *images = (each[n] for each in figures[g])
        lags = torch.fft.fftshift(lags)
        row[0].imshow(lags, cmap="inferno", vmin=0, vmax=0.4 * float(lags.max()))
        row[0].set_xlabel(f"contrast {found[g][0][n]:.3f}", fontsize=8)
        row[0].set_ylabel(f"g = {g:g}")
        for panel, image, score in zip(row[1:], images, found[g][1:, n], strict=False):
            panel.imshow(align(image, place), cmap="inferno")
            panel.set_xlabel(f"correlation {score:.2f}", fontsize=8)
        row[3].imshow(place, cmap="inferno")
    for panel, title in zip(panels[0], ("autocorrelation", "plain Katz", "with C_I", "sources"), strict=True):
        panel.set_title(title, fontsize=9)
    for panel in panels.flat:
        panel.set(xticks=[], yticks=[])
    figure.tight_layout()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    run(main, OUT, __doc__)
