"""Rows of docs/measurements.md that read other laboratories' files: ``python scripts/measured_data.py FOLDER``.

FOLDER holds the sets that ``specklegen measured get NAME --out FOLDER/NAME`` fetched; a set that is not there is left
out, and said. ``--solve`` reconstructs the hidden shapes too, in some two minutes, into hidden_shapes.npy. Each row
states what it assumes. Nothing here was tuned on what comes out: windows, borders and bins are those that the page
states, or round numbers that were written down before the first run.
"""

import json
import re
import sys
from collections.abc import Iterator
from glob import escape, glob
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import binary_erosion, gaussian_filter, uniform_filter
from scipy.optimize import brentq, curve_fit, least_squares

from specklegen.core.quadrature import gauss_legendre
from specklegen.measured import public_data, public_data_names, read_curve, read_measurement, read_sphere
from specklegen.models import Optics, align, multiframe_deconvolution
from specklegen.models.metrics import pearson
from specklegen.oracles.adding_doubling import _layer, adding_doubling
from specklegen.theory.diffusing_wave import transmitted_field

SHAPES = ("2", "5", "7", "J", "T", "X", "pi", "◇")
GRITS = (120, 220, 600, 1500)
Row = tuple[str, str]


def hidden_shapes(folder: Path) -> Iterator[Row]:
    """Contrast below the envelope against the grit of the glass, and what one bandwidth makes of it."""
    gauss, fitted = np.zeros((2, len(SHAPES), len(GRITS)))
    for m, shape in enumerate(SHAPES):
        for n, grit in enumerate(GRITS):
            read = read_measurement(_frame(folder, shape, grit), envelope="fit", hot_pixels=False)
            inside = slice(140, -140), slice(140, -140)
            light = read.light[0]
            gauss[m, n] = (light / gaussian_filter(light, 40, mode="nearest"))[inside].std()
            fitted[m, n] = read.images[0][inside].std() / read.images[0][inside].mean()
    for name, found in (("over a Gaussian of 40 pixels", gauss), ("over the fitted envelope", fitted)):
        mean = found.mean(axis=0)
        yield f"contrast at grit 120, 220, 600, 1500, {name}", " ".join(f"{each:.4f}" for each in mean)
    height = np.array([5.0, 3.0, 1.0, 0.5])  # of specklegen.GRITS, micrometres

    def contrast(h: np.ndarray, base: float, share: float) -> np.ndarray:
        return base * (1 + np.square(share * h)) ** -0.25  # Gaussian spectrum, Gaussian heights

    mean = gauss.mean(axis=0)
    (base, share), _ = curve_fit(contrast, height, mean, p0=(0.08, 0.4), sigma=mean)
    said = contrast(height, base, share)
    # (1 + (2 dk (n - 1) h)^2)^(-1/4); n = 1.5 and .65 um: dk = 2 pi width / wavelength^2
    width = share / (2 * 0.5) * 0.65**2 / (2 * np.pi) * 2.355 * 1000
    yield "the same from one bandwidth and the roughness assumed of each grit", (
        f"{' '.join(f'{each:.4f}' for each in said)}, off by {100 * np.abs(said / mean - 1).max():.0f} % at most; "
        f"full width {width:.0f} nm at .65 um"
    )


def _frame(folder: Path, shape: str, grit: int) -> str:
    names = glob(f"{escape(str(folder))}/pic/{shape}（1号）/*/*.tif")
    (file,) = [name for name in names if re.match(rf"{grit}(?!\d)", Path(name).parent.name)]
    return file


def _templates(letter: str) -> Iterator[np.ndarray]:
    """A letter as it is printed, 10 to 36 points high, in each of eight orientations, float64[36, 36]."""
    from matplotlib import font_manager
    from PIL import Image, ImageDraw, ImageFont

    font = font_manager.findfont("DejaVu Sans")
    for size in (10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30, 32, 36):
        picture = Image.new("L", (64, 64))
        ImageDraw.Draw(picture).text((32, 32), letter, 255, font=ImageFont.truetype(font, size), anchor="mm")
        cells = np.asarray(picture, float) / 255
        y, x = np.nonzero(cells > 0.2)
        cells = cells[y.min() : y.max() + 1, x.min() : x.max() + 1]
        if max(cells.shape) <= 34:
            for turned in [np.rot90(side, n) for n in range(4) for side in (cells, cells[:, ::-1])]:
                frame = np.zeros((36, 36))
                frame[: turned.shape[0], : turned.shape[1]] = turned
                yield frame - frame.mean()


def solved_shapes(folder: Path, shapes: tuple[str, ...] = SHAPES, grits: tuple[int, ...] = GRITS) -> Iterator[Row]:
    """What the packaged solver makes of the middle 320 x 320 pixels over the fitted envelope; grain 2.5, as stated."""
    from specklegen.datasets import load_recipe
    from specklegen.models import reconstruct_and_assess

    frames, names = [], []
    for shape in shapes:
        for grit in grits:
            image = read_measurement(_frame(folder, shape, grit), envelope="fit", hot_pixels=False).images[0]
            top, left = (side // 2 - 160 for side in image.shape)
            frames.append(image[top : top + 320, left : left + 320])
            names.append(shape)
    setup = load_recipe("ground-glass", {"pixels": {"grain": 2.5, "object_pixel": 1.0, "shape": [320, 320]}})
    found = reconstruct_and_assess(torch.from_numpy(np.stack(frames))[:, None], setup)
    np.save("hidden_shapes.npy", np.stack([each.image for each in found.each]))
    templates = {shape: list(_templates({"pi": "π"}.get(shape, shape))) for shape in SHAPES}
    own, right = [], 0
    for name, each in zip(names, found.each, strict=True):
        scores = _scores(each.image, templates)
        own.append(scores[name])
        right += max(scores, key=lambda shape: scores[shape]) == name
    yield "reconstructions that match the letter printed best among eight; the match; certified; deviances", (
        f"{right} of {len(names)}; mean {np.mean(own):.3f}, {min(own):.2f} to {max(own):.2f}; "
        f"{sum(each.probability is not None for each in found.each)}; "
        f"{min(each.deviance for each in found.each):.3f} to {max(each.deviance for each in found.each):.3f}, "
        f"expected {found.each[0].expected:.3f}"
    )


def together(folder: Path, side: int = 320) -> Iterator[Row]:
    """What frames behind one place of a glass say of all their objects, from these frames alone.

    A frame that stands upright is turned by the quarter after which it is most like one that lies. One whose phases are
    like those of no other frame was taken through another place of the glass, and is left out.
    """
    templates = {shape: list(_templates({"pi": "π"}.get(shape, shape))) for shape in SHAPES}
    for grit in GRITS:
        files = [_frame(folder, shape, grit) for shape in SHAPES]
        read = [read_measurement(file, envelope="fit", hot_pixels=False).images[0] for file in files]
        lying = [_middle(frame, side) for frame in read if frame.shape[0] < frame.shape[1]]
        frames = []
        for frame in read:
            turns = (0,) if frame.shape[0] < frame.shape[1] else (1, -1)
            ways = [_middle(np.rot90(frame, turn), side) for turn in turns]
            frames.append(max(ways, key=lambda way: max(_alike(way, other) for other in lying)))
        near = [max(_alike(one, other) for other in frames if other is not one) for one in frames]
        kept = [n for n, peak in enumerate(near) if peak > 10]
        images, optics = np.stack([frames[n] for n in kept]), Optics(step=1.0, grain=2.5, profile="gaussian")
        found = multiframe_deconvolution(torch.from_numpy(images), optics, 56, sigma=30.0)
        right, own = 0, []
        for n, image in zip(kept, found.image.double().numpy(), strict=True):
            top, left = (min(max(int(c) - 18, 0), 20) for c in _centre(image))
            scores = _scores(image[top : top + 36, left : left + 36], templates)
            own.append(scores[SHAPES[n]])
            right += max(scores, key=lambda shape: scores[shape]) == SHAPES[n]
        names = " ".join(SHAPES[n] for n in kept)
        yield f"grit {grit}, {names} from their frames together: named rightly, match, agreement, explained", (
            f"{right} of {len(kept)}, {np.mean(own):.3f}, {found.agreement:.3f}, {found.explained:.3f}"
        )


def _middle(frame: np.ndarray, side: int) -> np.ndarray:
    top, left = ((n - side) // 2 for n in frame.shape)
    return frame[top : top + side, left : left + side]


def _alike(one: np.ndarray, other: np.ndarray) -> float:
    """Highest correlation of two frames' phases at any shift, over its scatter where they have nothing in common."""
    side = len(one)
    window = np.outer(np.hanning(side), np.hanning(side))
    a, b = (np.fft.fft2((frame / frame.mean() - 1) * window) for frame in (one, other))
    across = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    used = (across > 0.02) & (across < 0.35)
    phases = np.where(used, a * b.conj() / (np.abs(a * b) + 1e-30), 0)
    return float(np.fft.ifft2(phases).real.max() * side**2 / np.sqrt(used.sum()))


def _centre(image: np.ndarray) -> tuple[np.intp, ...]:
    near = gaussian_filter(image, 8, mode="constant")
    return np.unravel_index(near.argmax(), near.shape)


def _scores(image: np.ndarray, templates: dict[str, list[np.ndarray]]) -> dict[str, float]:
    """Match of an image float64[36, 36] with the best template of each shape, at any shift."""
    image = image - image.mean(dtype=np.float64)
    wave = np.fft.fft2(image)
    return {
        shape: max(
            np.fft.ifft2(wave * np.conj(np.fft.fft2(one))).real.max() / np.linalg.norm(image) / np.linalg.norm(one)
            for one in several
        )
        for shape, several in templates.items()
    }


def five_digits(folder: Path) -> Iterator[Row]:
    """Five objects from their five images alone: what hangs on where the search began, and on the grain assumed."""
    files = sorted(glob(f"{escape(str(folder))}/experimental_speckles/*.tif"))
    images = np.concatenate([read_measurement(file, envelope="fit").images for file in files])
    found = {}
    for grain in (3.4, 3.0, 3.8):
        optics = Optics(step=1.0, grain=grain, profile="gaussian")
        found[grain] = multiframe_deconvolution(torch.from_numpy(images), optics, 40)
        one, first = found[grain].image, found[3.4].image
        alike = " ".join(f"{each:.2f}" for each in pearson(align(one, first), first).tolist())
        yield f"five objects, grain {grain}: agreement of searches, power explained, like those of grain 3.4", (
            f"{found[grain].agreement:.3f}, {found[grain].explained:.3f}, {alike}"
        )
    np.save("five_digits.npy", found[3.4].image)


def three_diffusers(folder: Path) -> Iterator[Row]:
    """Grain, autocorrelation, contrast, clipped shares."""
    lags = np.arange(1, 10)
    kept = {}
    for name in ("120", "220", "600", "1500", "ke", "mo"):
        read = read_measurement(folder / "speckle_autocorrelation" / f"{name}.bmp", dark=6.0, envelope="fit")
        image = read.images[0] / read.images[0].mean() - 1
        power = np.abs(np.fft.fft2(image, [2 * side for side in image.shape])) ** 2
        own = np.fft.ifft2(power).real
        share = [(1 - lag / image.shape[1]) for lag in range(10)]
        down = [(1 - lag / image.shape[0]) for lag in range(10)]
        kept[name] = np.stack([own[0, :10] / share, own[:10, 0] / down]).mean(axis=0) / own[0, 0]
        law = np.exp(-(255 - 6) / read.light.mean()) if name.isdigit() else np.nan
        plain = read.light[0]
        yield f"{name}: contrast with the envelope left in", f"{plain.std() / plain.mean():.3f}"
        yield f"{name}: contrast, share clipped, that of an exponential law, order of the envelope", (
            f"{image.std():.3f}, {100 * read.saturated:.2f} %, {100 * law:.2f} %, {read.envelope_order}"
        )
    for name in ("120", "220", "600"):
        (width,), _ = curve_fit(lambda x, s: np.exp(-np.square(x / s)), lags, kept[name][1:], p0=[5.0])
        off = np.sqrt(np.mean((np.exp(-np.square(lags / width)) - kept[name][1:]) ** 2))
        yield f"{name}: full width of the grain, rms off a Gaussian; autocorrelation", (
            f"{2 * np.sqrt(np.log(2)) * width:.2f} pixels, {off:.3f}; {' '.join(f'{v:.3f}' for v in kept[name][1:])}"
        )


def vessel(folder: Path) -> Iterator[Row]:
    """Contrast inside and outside, lag 1, and the photon transfer of pairs of frames."""
    read = read_measurement(folder / "data.mat", variable="im_raw", hot_pixels=False)
    truth = read_measurement(folder / "data.mat", variable="im_gt", hot_pixels=False).light[0] > 0
    frames = read.light
    mean = uniform_filter(frames, (0, 7, 7))
    local = np.sqrt(np.clip(uniform_filter(frames**2, (0, 7, 7)) - mean**2, 0, None)) / mean
    inside, outside = binary_erosion(truth, iterations=5), binary_erosion(~truth, iterations=8, border_value=1)
    contrast = local.mean(axis=0)
    k_out, k_in = contrast[outside].mean(), contrast[inside].mean()
    square = np.square(k_in / k_out)
    ratio = brentq(lambda x: (np.exp(-2 * x) - 1 + 2 * x) / (2 * x**2) - square, 1e-6, 1e4)
    yield "contrast outside, inside, ratio of squares, exposure over correlation time", (
        f"{k_out:.3f}, {k_in:.3f}, {square:.3f}, {ratio:.2f}"
    )
    alike = []
    for where in (outside, inside):
        every = [np.corrcoef(one[where], other[where])[0, 1] for one, other in zip(frames, frames[1:], strict=False)]
        alike.append(np.mean(every))
    yield "correlation of frames at lag 1, outside, inside", f"{alike[0]:.2f}, {alike[1]:.2f}"
    order = contrast[inside | outside]
    ranks = order.argsort().argsort()
    low, high = ranks[inside[inside | outside]], ranks[outside[inside | outside]]
    area = (high.mean() - (len(high) - 1) / 2) / len(low)
    yield "vessel told by contrast alone, area under the curve", f"{area:.3f}"
    # Photon transfer: pixels are binned by the frames that are not in the pair.
    levels = np.array([54.0, 72, 90, 109, 128, 148, 168, 195])
    edges = np.concatenate([[45], (levels[1:] + levels[:-1]) / 2, [205]])
    sums, counts, where = np.zeros(len(levels)), np.zeros(len(levels)), np.zeros(len(levels))
    total = frames.sum(axis=0)
    for one, other in zip(frames[:-1], frames[1:], strict=True):
        rest = (total - one - other) / (len(frames) - 2)
        place = np.digitize(rest, edges) - 1
        good = outside & (place >= 0) & (place < len(levels)) & (np.maximum(one, other) < 255)
        scale = one[good].mean() / other[good].mean()
        half = np.square(one - scale * other)[good] / (1 + scale**2)
        sums += np.bincount(place[good], half, len(levels))
        where += np.bincount(place[good], (one + other)[good] / 2, len(levels))
        counts += np.bincount(place[good], minlength=len(levels))
    noise, level = sums / counts, where / counts
    curve = zip(level, noise, strict=True)
    yield "half the mean square difference of pairs", ", ".join(f"{a:.0f} → {b:.1f}" for a, b in curve)
    fits = np.polyfit(level[:5], noise[:5], 1, w=np.sqrt(counts[:5]) / noise[:5], cov="unscaled")
    slope, start = fits[0]
    # differences of one pixel share frames, and pixels a pattern: errors by leaving out one level at a time
    others = [np.polyfit(np.delete(level[:5], n), np.delete(noise[:5], n), 1) for n in range(5)]
    jack = np.sqrt(4 / 5 * np.var(others, axis=0) * 5)
    black = -start / slope
    jack_black = np.sqrt(4 / 5 * np.var([-b / a for a, b in others]) * 5)
    bend = 100 * (noise[5:] / np.polyval(fits[0], level[5:]) - 1)
    yield "grey a photoelectron, black level without read noise; above 140 the curve is off the line by", (
        f"{slope:.3f} ± {jack[0]:.3f}, {black:.1f} ± {jack_black:.1f}; {', '.join(f'{b:.0f}' for b in bend)} %"
    )


def micelles(folder: Path) -> Iterator[Row]:
    """Mean square displacement from path statistics of the slab, against the authors' diffusion formula."""
    micelle = folder / "examples/data/micelle"
    raw = read_curve(micelle / "twocell" / "icf_raw.txt")
    early = raw.values[raw.at <= 1e-6]
    yield "g2 - 1 from 12.5 ns to 1 us", f"{np.median(early):.3f}, {early.min():.2f} to {early.max():.2f}"
    told = json.loads((micelle / "icf_fit.txt").read_text())
    names = list(told)
    lag, icf = np.array(told["t"]), np.array(next(told[name] for name in names if name != "t"))
    theirs = read_curve(micelle / "msd.txt")
    depths, k = 2.0 / 0.33, 2 * np.pi * 1.33 / 633e-9
    start = icf[0] if icf[0] < 1 else 1.0
    field = np.sqrt(np.clip(icf / start, 1e-12, 1))
    chosen = [np.abs(field - level).argmin() for level in (0.98, 0.9, 0.7, 0.5, 0.35)]
    rest = adding_doubling(depths, albedo=1.0, g=0.0, nodes=32).transmitted
    yield "columns of the fitted curve; its first value", f"{', '.join(names)}; {icf[0]:.4f}"
    out = []
    for n in chosen:
        def transfer(x: float, n: int = n) -> float:
            return adding_doubling(depths, albedo=1.0, g=0.0, nodes=32, motion=x).transmitted / rest - field[n]

        x = brentq(transfer, 1e-9, 2.0, xtol=1e-9)
        formula = brentq(lambda y, n=n: float(transmitted_field(y, depths)) - field[n], 1e-9, 2.0, xtol=1e-9)
        own, other = 6 * x / k**2, np.interp(lag[n], theirs.at, theirs.values)
        out.append(f"{field[n]:.2f}: {own / other:.3f} ({6 * formula / k**2 / other:.3f} by the formula)")
    yield "displacement over theirs, at g1", "; ".join(out)


def anhydrase(folder: Path) -> Iterator[Row]:
    """Cumulants of single scattering, and the radius."""
    curve = read_curve(folder / "test.csv", columns=(0, 1))
    lag, g2 = curve.at * 1e-6, curve.values - 1
    used = (lag > 1e-6) & (lag < 1e-4)  # before the afterpulses, and before aggregates

    def cumulants(t: np.ndarray, beta: float, rate: float, second: float, floor: float) -> np.ndarray:
        return beta * np.exp(-2 * rate * t) * (1 + second * np.square(rate * t) / 2) ** 2 + floor

    (beta, rate, second, _), _ = curve_fit(cumulants, lag[used], g2[used], p0=(0.11, 3e4, 0.1, 0.0))
    q = 4 * np.pi * 1.33 / 817e-9 * np.sin(np.deg2rad(75))
    radius = 1.380649e-23 * 293.15 * q**2 / (6 * np.pi * 1.002e-3 * rate)
    yield "beta, decay, second cumulant, hydrodynamic radius in water at 20 °C", (
        f"{beta:.3f}, {rate:.3g} /s, {second:.2f}, {1e9 * radius:.2f} nm"
    )


def _face(cosine: np.ndarray, inside: float, glass: float) -> np.ndarray:
    """Reflectance of sample, glass and air for light from inside, echoes in the glass added as powers."""

    def fresnel(n: float, m: float, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        there = np.sqrt(np.clip(1 - (n / m) ** 2 * (1 - c**2), 0, None))
        s, p = (n * c - m * there) / (n * c + m * there), (m * c - n * there) / (m * c + n * there)
        return np.where(there > 0, (s**2 + p**2) / 2, 1.0), there

    first, within = fresnel(inside, glass, cosine)
    last, _ = fresnel(glass, 1.0, within)
    return np.where(first < 1, first + (1 - first) ** 2 * last / (1 - first * last), 1.0)


def slab_between_glass(depth: float, albedo: float, g: float, inside: float, glass: float) -> tuple[float, float]:
    """Reflectance and transmittance, straight light included, at normal incidence."""
    x, w = gauss_legendre(32)
    mu, w = np.concatenate([(1 + x) / 2, [1.0, 1.0]]), np.append(w / 2, [0.0, 0.0])
    through, returned, straight = _layer(depth, albedo, g, mu, w, 0.0)
    rho = _face(mu, inside, glass)
    axis, s = rho[-1], straight[-1]
    down = (1 - axis) / (1 - (axis * s) ** 2)
    up = axis * s * down
    n = len(w)
    onward, back = through * w + np.diag(straight), returned * w
    block = np.block([[rho[:, None] * back, rho[:, None] * onward], [rho[:, None] * onward, rho[:, None] * back]])
    source = np.concatenate([
        rho * (returned[:, -2] * down + through[:, -2] * up), rho * (through[:, -2] * down + returned[:, -2] * up)
    ])  # fmt: skip
    inner = np.linalg.solve(np.eye(2 * n) - block, source)
    at_top = back @ inner[:n] + onward @ inner[n:] + returned[:, -2] * down + through[:, -2] * up
    at_bottom = onward @ inner[:n] + back @ inner[n:] + through[:, -2] * down + returned[:, -2] * up
    reflectance = axis + (1 - axis) * s * up + w @ ((1 - rho) * at_top)
    return float(reflectance), float((1 - axis) * s * down + w @ ((1 - rho) * at_bottom))


def spheres(folder: Path) -> Iterator[Row]:
    """Ink, whose faces alone reflect, and a series of Intralipid."""
    ink = read_sphere(folder / "tests/rxt/1_sphere/ink_A.rxt")
    face = float(_face(np.array([1.0]), ink.sample_index, ink.slide_index)[0])
    raw, right = ink.columns["reflection"], ink.corrected()
    straight = right.transmittance / (1 - face) ** 2
    yield "ink: raw reflectance; corrected; first face alone; both faces", (
        f"{' '.join(f'{v:.4f}' for v in raw)}; {' '.join(f'{v:.4f}' for v in right.reflectance)}; {face:.4f}; "
        f"{' '.join(f'{face + (1 - face) ** 2 * face * v**2:.4f}' for v in straight)}"
    )
    il = read_sphere(folder / "tests/rxt/1_sphere/il_A.rxt")
    light = il.corrected()
    depths = np.array([
        brentq(lambda d, c=c: (1 - face) ** 2 * np.exp(-d) / (1 - face**2 * np.exp(-2 * d)) - c, 0.0, 20.0)
        for c in light.collimated
    ])  # fmt: skip
    fits = []
    for depth, reflectance, transmittance in zip(depths, light.reflectance, light.transmittance, strict=True):
        def off(p: np.ndarray, depth: float = depth, r: float = reflectance, t: float = transmittance) -> np.ndarray:
            return np.subtract(slab_between_glass(depth, p[0], p[1], il.sample_index, il.slide_index), (r, t))

        fits.append(least_squares(off, [0.95, 0.7], bounds=([0.3, 0.0], [1.0, 0.95]), diff_step=1e-3).x)
    albedo, g = np.array(fits).T
    yield "Intralipid: optical depth; albedo; g", (
        f"{' '.join(f'{v:.2f}' for v in depths)}; {' '.join(f'{v:.3f}' for v in albedo)}; "
        f"{' '.join(f'{v:.3f}' for v in g)}, {g.mean():.3f} ± {g.std():.3f}"
    )
    phantom = read_sphere(folder / "docs/phantom_with_no_slides.rxt", dual_beam=True)
    yield "phantom: rows, wavelengths, largest R + T", (
        f"{len(phantom.columns['wavelength'])}, {phantom.columns['wavelength'].min():g} to "
        f"{phantom.columns['wavelength'].max():g} nm, "
        f"{(phantom.columns['reflection'] + phantom.columns['transmission']).max():.3f}"
    )


ROWS = {
    "hidden-shapes": hidden_shapes, "five-digits": five_digits, "three-diffusers": three_diffusers, "vessel": vessel,
    "micelles": micelles, "anhydrase": anhydrase, "spheres": spheres,
}  # fmt: skip


def main(folder: Path, names: list[str], solve: bool) -> None:
    """Print the rows of every set that is there."""
    for name in names or public_data_names():
        if public_data(name).broken(folder / name):
            print(f"{name}: not in {folder / name}; `specklegen measured get {name} --out {folder / name}`")
        elif name in ROWS:
            solved = (together, solved_shapes) if solve and name == "hidden-shapes" else ()
            for what, found in (row for rows in (ROWS[name], *solved) for row in rows(folder / name)):
                print(f"{name} | {what} | {found}", flush=True)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--solve"]
    main(Path(words[0]), words[1:], "--solve" in sys.argv)
