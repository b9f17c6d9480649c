"""The memory effect behind narrow lobes: lateral ways, endpoint factors and waves; and where the first two part.

Left, a slab of optical depth 8, g = 0.98, a mean free path of 20 wavelengths: C_I by ``memory_effect``, by
``covariance`` between tilts (whose endpoint factors look lobes up along fixed directions), and by waves through random
screens (specklegen.oracles.multi_slice). Right, what endpoint factors lose at most, 1 - |A|^4, over the tilt.
"""

import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _command import run

import specklegen as sg
from specklegen.oracles.multi_slice import multi_slice
from specklegen.paths.far_field import NEGLIGIBLE, overlap

OUT = Path("docs/images")
SIZE, PITCH = 512, 0.5  # wavelengths
SLAB = sg.Slab(thickness=160.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(g=0.98))


def by_endpoint_factors(tilts: np.ndarray, paths: int) -> np.ndarray:
    """C_I between tilts of one scene, as path sums have it: float64[T]."""
    directions = np.stack([np.sin(tilts), 0 * tilts, np.cos(tilts)], -1)
    scene = sg.Scene(
        wavelength=1.0, medium=SLAB, illumination=sg.light.CollimatedBeams(directions=directions, width=1e5),
        sensor=sg.sensors.FarField(directions=directions),
    )  # fmt: skip
    n = np.arange(len(tilts))
    crossed, own = (
        sg.statistics.covariance(scene, pairs=np.stack([0 * n if far else n, 0 * n if far else n, n, n], -1),
                                 paths=paths).value
        for far in (True, False)
    )
    return np.square(np.abs(crossed)) / (own[0].real * own.real)


def main(out: Path, quick: bool) -> None:
    """Draw, and print the three curves."""
    warnings.simplefilter("ignore", sg.DoubtWarning)
    bins = [3, 6, 12]
    sines = np.array(bins) / (SIZE * PITCH)
    waves = None if quick else multi_slice(
        SLAB, wavelength=1.0, pitch=PITCH, size=SIZE, bins=bins, realizations=6, reach=0.015
    )  # fmt: skip
    tilts = np.linspace(0, 0.05, 13)
    paths = 2000 if quick else 40_000
    kept = sg.memory_effect(SLAB, wavelength=1.0, tilts=tilts, paths=paths).intensity
    lost = by_endpoint_factors(tilts, paths // 4)

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    left.plot(1e3 * tilts, kept, label="memory_effect: lateral ways")
    left.plot(1e3 * tilts, lost, "--", label="endpoint factors (path sums)")
    if waves is not None:
        error = waves.on_axis.std(axis=0, ddof=1) / np.sqrt(len(waves.on_axis))
        left.errorbar(1e3 * sines, waves.on_axis.mean(axis=0), 2 * error, fmt="ko", ms=4, label="waves (multi-slice)")
        for name, values in (("waves", waves.on_axis.mean(axis=0)), ("lateral", np.interp(sines, tilts, kept)),
                             ("endpoint", np.interp(sines, tilts, lost))):  # fmt: skip
            print(f"{name:10}", values.round(4))
    left.set(xlabel="tilt / mrad", ylabel="$C_I$", ylim=(0, 1.03), title="OD 8, g = 0.98, $\\ell$ = 20 $\\lambda$")
    left.legend(loc="lower left", fontsize=8)

    tilt = np.geomspace(1e-5, 0.5, 80)
    for g in (0.9, 0.98, 0.997):
        lobe = sg.media.HenyeyGreenstein(g=g)
        loss = [1 - overlap(lobe, float(f"{t:.9g}")) ** 4 for t in tilt]
        right.loglog(tilt, np.maximum(loss, 1e-7), label=f"Henyey-Greenstein, g = {g}")
    gaussian = sg.media.VonMisesFisher(concentration=1 / 0.003)
    right.loglog(tilt, [max(1 - overlap(gaussian, float(f"{t:.9g}")) ** 4, 1e-7) for t in tilt], "k:",
                 label="Gaussian lobe of the same g = 0.997")  # fmt: skip
    right.axhline(NEGLIGIBLE, color="grey", lw=0.8)
    right.text(1.2e-5, 1.2 * NEGLIGIBLE, "exact amplitudes below, lateral ways above", fontsize=8, color="grey")
    right.set(xlabel="tilt / rad", ylabel="$C_I$ that endpoint factors lose at most", ylim=(1e-5, 1.5))
    right.legend(loc="lower right", fontsize=8)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "narrow-lobes.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    run(main, OUT, __doc__)
