"""How good the modes of the light are: the intensity correlation of two tilts in light of finite bandwidth.

Exact: SS S(k1) S(k2) |E[w J0(q r) e^(i(k1 - k2) s)]|^2 over the same paths. Compared with sum mu_n^2 K_n(q)^2
(each mode with the memory effect of its gate, as the samplers do) and with K(q)^2 sum mu_n^2 (one memory
effect for all). Run: python scripts/light_modes_error.py
"""

import numpy as np

from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.synthesis.spectrum import SpectralCorrelation, estimate_spectral_correlation, light_modes

PATHS, THICKNESS = 100_000, 1000.0
MATERIALS = ((10.0, 0.9), (10.0, 0.0), (5.0, 0.7), (20.0, 0.95))
WIDTHS = (0.5, 2.0, 8.0, 20.0)  # of the spectrum, in half widths of |C|^2
TILTS = (0.0, 0.5, 1.0, 2.0)  # in half ranges of |K|^2


def exact(correlation: SpectralCorrelation, width: float, q: float, count: int = 301) -> float:
    """Correlation over a Gaussian spectrum, on a grid of wavenumbers."""
    k = np.linspace(-2.5, 2.5, count) * width
    shares = np.exp(-4 * np.log(2) * (k / width) ** 2)
    shares /= shares.sum()
    power = np.square(np.abs(correlation.joint_correlation(q, k - k[0])))
    place = np.arange(count)
    return float(shares @ power[np.abs(place[:, None] - place)] @ shares)


def main() -> None:
    """Print a table in Markdown."""
    print("| OD, g | bandwidth / half width | modes | contrast |", " | ".join(f"tilt {t:g}" for t in TILTS), "|")
    print("|---|---|---|---|" + "---|" * len(TILTS))
    for depth, g in MATERIALS:
        medium = Slab(thickness=THICKNESS, mean_free_path=THICKNESS / depth, scatterer=HenyeyGreenstein(g=g))
        spectral = estimate_spectral_correlation(medium, PATHS, 1)
        correlation = estimate_correlation(medium, PATHS, 1)
        for share in WIDTHS:
            width = share * spectral.half_width()
            light = light_modes(spectral, width)
            cells = []
            for tilt in TILTS:
                q = tilt * correlation.half_range()
                truth = exact(spectral, width, q)
                modes = sum(
                    s**2 * float(each(q)) ** 2 for s, each in zip(light.shares, light.correlations, strict=True)
                )
                one = light.contrast**2 * float(correlation(q)) ** 2
                cells.append(f"{truth:.3f}: {modes / truth - 1:+.1%}, {one / truth - 1:+.0%}")
            head = f"| {depth:g}, {g:g} | {share:g} | {len(light.shares)} | {light.contrast:.2f} |"
            print(head, " | ".join(cells), "|")


if __name__ == "__main__":
    main()
