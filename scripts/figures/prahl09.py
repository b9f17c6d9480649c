"""Figures of partially coherent light at a cylindrical focus, after [Prahl09].

Draws the pictures and prints the tables of docs/notes/coherence.md. They follow from the paper's equations: its
printed figures and their captions were not at hand.

Run it by itself: python scripts/figures/prahl09.py --out docs/coherence [--quick]
"""

import time
from pathlib import Path
from typing import Literal

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from _command import run, save

from specklegen.coherence.cross_spectral_density import (
    gaussian_schell_model,
    propagate_csd,
    sample_fields,
    spectral_degree_of_coherence,
    spectral_density,
)
from specklegen.coherence.cylindrical_focus import (
    AxialDetector,
    CylindricalFocus,
    TransverseDetector,
    flux_weighted_csd,
)

OUT = Path("docs/coherence")
SIGMAS = (2, 1, 0.6, 0.4, 0.2, 0.1)
COLOURS = dict(zip(SIGMAS, plt.get_cmap("viridis")(np.linspace(0, 0.9, len(SIGMAS))), strict=True))
METHODS: dict[Literal["kl", "copula"], str] = {"kl": "o", "copula": "x"}  # and their markers
PIXELS, ELEMENTS, HALF_WIDTH = 201, 51, 2.5  # lengths in wavelengths
CENTRE = PIXELS // 2

TRANSVERSE = CylindricalFocus(
    half_aperture=100,
    focal_length=200,
    wavelength=1,
    n_source=ELEMENTS,
    detector=TransverseDetector(half_width=HALF_WIDTH, n_pixels=PIXELS),
)
AXIAL = TRANSVERSE.replace(
    detector=AxialDetector(z=np.linspace(-15, 15, PIXELS), pixel_width=2 * HALF_WIDTH / PIXELS)
)


def source(focus, sigma):
    """W0 of a coherence length of ``sigma`` half apertures."""
    return gaussian_schell_model(focus.source_x / focus.half_aperture, sigma)


def measured(focus, sigma):
    """W at the detector by physical optics, through the measurement function."""
    G, dG = focus.physical_optics(), focus.physical_optics(derivative=True)
    return flux_weighted_csd(G, dG, source(focus, sigma), focus.wavenumber)


def profile(W):
    """S / S(0) and mu(0, .)."""
    S = spectral_density(W)
    return S / S[CENTRE], spectral_degree_of_coherence(W, reference=CENTRE)


def expectation(subdivision=8):
    """Mean of the calibrated Monte Carlo: Z / s^2 e^{ik(s - s0)} averaged over pixels and elements."""
    fine = TRANSVERSE.replace(
        n_source=ELEMENTS * subdivision,
        detector=TransverseDetector(half_width=HALF_WIDTH, n_pixels=PIXELS * subdivision),
    )
    x, xs, f = fine.detector.x[:, None], fine.source_x, fine.focal_length
    s, s0 = np.hypot(f, x - xs), np.hypot(f, xs)
    G = np.exp(-0.25j * np.pi) * f**1.5 / s**2 * np.exp(1j * fine.wavenumber * x * (x - 2 * xs) / (s + s0))
    return G.reshape(PIXELS, subdivision, ELEMENTS, subdivision).mean(axis=(1, 3))


def draw_source(out, quick):
    """Degree of coherence of sampled sources, Karhunen-Loeve and copula, against the model."""
    n = 64**2 if quick else 256**2
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True)
    x = TRANSVERSE.source_x / TRANSVERSE.half_aperture
    for panel, method in zip(panels, METHODS, strict=True):
        for sigma in (2, 0.6, 0.2, 0.1):
            W0 = source(TRANSVERSE, sigma)
            fields = sample_fields(W0, n, method, seed=0)
            found = fields.T @ fields.conj() / n
            panel.plot(x, W0[ELEMENTS // 2], color=COLOURS[sigma], label=f"$\\sigma_g/a$ = {sigma}")
            panel.plot(x, found[ELEMENTS // 2].real, ".", color=COLOURS[sigma])
        panel.set(title=f"{method}, {n} realizations", xlabel="x'/a")
    panels[0].set_ylabel("$W_0(0, x')$")
    panels[1].legend(fontsize=8)
    save(figure, out / "sampled-sources.png", dpi=72)


def draw_greens_function(out, quick):
    """The Green's function by physical optics, uniform rays and aimed rays."""
    n = 10**5 if quick else 10**6
    columns = {
        "physical optics": TRANSVERSE.physical_optics(measurement=True),
        f"{n:.0e} uniform rays": TRANSVERSE.monte_carlo(n, "uniform", seed=0).value,
        f"{n:.0e} stratified rays": TRANSVERSE.monte_carlo(n, "stratified", seed=0).value,
    }
    figure, panels = plt.subplots(2, 3, figsize=(7.5, 4), sharex=True, sharey=True)
    largest = 2 * np.abs(columns["physical optics"]).max()
    for (modulus, phase), (name, G) in zip(panels.T, columns.items(), strict=True):
        extent = (-1, 1, -HALF_WIDTH, HALF_WIDTH)
        modulus.imshow(np.abs(G), aspect="auto", origin="lower", extent=extent, vmin=0, vmax=largest)
        phase.imshow(np.angle(G), aspect="auto", origin="lower", extent=extent, cmap="twilight")
        modulus.set_title(name, fontsize=8)
        phase.set_xlabel("x'/a")
    panels[0, 0].set_ylabel("|G|, x ($\\lambda$)")
    panels[1, 0].set_ylabel("arg G, x ($\\lambda$)")
    save(figure, out / "greens-function.png", dpi=72)


def draw_profiles(out, quick):
    """S and |mu| across and along the focus, physical optics and Monte Carlo."""
    n = 10**5 if quick else 10**6
    for focus, G, axis, label, name in (
        (TRANSVERSE, TRANSVERSE.monte_carlo(10 * n, "uniform", seed=0), TRANSVERSE.detector.x, "x", "across"),
        (AXIAL, AXIAL.monte_carlo(n, "stratified", seed=0), AXIAL.detector.z, "z", "along"),
    ):
        density, ax_density = plt.subplots(figsize=(5, 3.4))
        degree, ax_degree = plt.subplots(figsize=(5, 3.4))
        for sigma in SIGMAS:
            colour = COLOURS[sigma]
            S, mu = profile(measured(focus, sigma))
            S_traced, mu_traced = profile(propagate_csd(G.value, source(focus, sigma)))
            ax_density.plot(axis, S, color=colour, label=f"$\\sigma_g/a$ = {sigma}")
            ax_density.plot(axis[::4], S_traced[::4], ".", markersize=3, color=colour)
            ax_degree.plot(axis, np.abs(mu), color=colour, label=f"$\\sigma_g/a$ = {sigma}")
            ax_degree.plot(axis[::4], np.abs(mu_traced)[::4], ".", markersize=3, color=colour)
        ax_density.set(xlabel=f"{label} ($\\lambda$)", ylabel="S / S(0)")
        ax_degree.set(xlabel=f"{label} ($\\lambda$)", ylabel="|$\\mu$(0, ·)|", ylim=(0, 1.02))
        for figure, panel, what in ((density, ax_density, "density"), (degree, ax_degree, "degree")):
            panel.legend(fontsize=7)
            save(figure, out / f"{what}-{name}.png", dpi=72)


def profile_rows(focus, axis, places):
    """S and |mu| at some pixels, and the half width at half maximum, for every coherence length."""
    rows = []
    for sigma in SIGMAS:
        S, mu = profile(measured(focus, sigma))
        end = CENTRE + 1 + int(np.argmax(S[CENTRE:] < 0.5))  # side lobes lie beyond the first fall
        half = f"{np.interp(-0.5, -S[CENTRE:end], axis[CENTRE:end]):.4f}" if S.min() < 0.5 else "outside"
        cells = [" ".join(f"{value:.4f}" for value in values[places]) for values in (S, np.abs(mu))]
        rows.append((sigma, *cells, half))
    return rows


def draw_measurement_function(out):
    """Draw what the measurement function changes in S and mu; return the table rows."""
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4))
    x, rows = TRANSVERSE.detector.x, []
    for sigma in SIGMAS:
        S, mu = profile(measured(TRANSVERSE, sigma))
        plain_S, plain_mu = profile(propagate_csd(TRANSVERSE.physical_optics(), source(TRANSVERSE, sigma)))
        root = propagate_csd(TRANSVERSE.physical_optics(measurement=True), source(TRANSVERSE, sigma))
        panels[0].plot(x, S - plain_S, color=COLOURS[sigma], label=f"$\\sigma_g/a$ = {sigma}")
        panels[1].plot(x, np.abs(mu - plain_mu), color=COLOURS[sigma])
        changes = [np.abs(a - b).max() for a, b in ((S, plain_S), (mu, plain_mu))]
        changes += [np.abs(a - b).max() for a, b in zip((S, mu), profile(root), strict=True)]
        rows.append((sigma, *changes))
    panels[0].set(xlabel="x ($\\lambda$)", ylabel="change of S/S(0)")
    panels[1].set(xlabel="x ($\\lambda$)", ylabel="change of $\\mu$(0, x)")
    panels[0].legend(fontsize=7)
    save(figure, out / "measurement-function.png", dpi=72)
    return rows


def error_against_rays(quick):
    """Errors of G and of S for both launches: sampling, rays, CPU seconds, G, G to optics, S at 0.6."""
    mean, optics = expectation(), TRANSVERSE.physical_optics(measurement=True)
    W0 = source(TRANSVERSE, 0.6)
    exact, _ = profile(propagate_csd(mean, W0))
    entries = PIXELS * ELEMENTS  # whole multiples: the same number of aimed rays for every entry
    counts = [entries * 10**power for power in ((0, 1, 2) if quick else (0, 1, 2, 3, 4))]
    rows = []
    for sampling in ("uniform", "stratified"):
        TRANSVERSE.monte_carlo(20_502, sampling, seed=0)  # compile before the clock starts
        for n in counts if sampling == "uniform" else counts[:-1]:
            seeds = range(16 if n <= 100 * entries else 4 if n <= 1000 * entries else 1)
            squared, seconds = [], []
            for seed in seeds:
                started = time.process_time()
                G = TRANSVERSE.monte_carlo(n, sampling, seed=seed, threads=1).value
                seconds.append(time.process_time() - started)
                S, _ = profile(propagate_csd(G, W0))
                of_mean = np.sum(np.abs(G - mean) ** 2) / np.sum(np.abs(mean) ** 2)
                of_optics = np.sum(np.abs(G - optics) ** 2) / np.sum(np.abs(optics) ** 2)
                squared.append((of_mean, of_optics, np.sum((S - exact) ** 2) / (PIXELS - 1)))
            errors = np.sqrt(np.mean(squared, axis=0))
            rows.append((sampling, n, float(np.median(seconds)), *errors))
    return rows


def draw_errors(out, rows):
    """Error of G against rays, and against run time."""
    rays, ax_rays = plt.subplots(figsize=(5, 3.4))
    clock, ax_clock = plt.subplots(figsize=(5, 3.4))
    for sampling, colour, law in (("uniform", "C0", 101.0), ("stratified", "C1", 4.83)):
        part = np.array([row[1:] for row in rows if row[0] == sampling])
        ax_rays.loglog(part[:, 0], part[:, 2], "o", color=colour, label=f"{sampling}")
        ax_rays.loglog(
            part[:, 0], law / np.sqrt(part[:, 0]), color=colour, label=f"{law:g} / $\\sqrt{{N_r}}$"
        )
        ax_clock.loglog(part[:, 1], part[:, 2], "o-", color=colour, label=f"{sampling}, to its mean")
        ax_clock.loglog(part[:, 1], part[:, 3], "x:", color=colour, label=f"{sampling}, to point optics")
        ax_clock.loglog(part[:, 1], part[:, 4], "s--", color=colour, label=f"{sampling}, S at 0.6", alpha=0.5)
    ax_rays.set(xlabel="rays", ylabel="relative error of G")
    ax_clock.set(xlabel="CPU seconds, one thread", ylabel="error")
    for figure, panel, name in ((rays, ax_rays, "rays"), (clock, ax_clock, "time")):
        panel.legend(fontsize=6)
        save(figure, out / f"error-{name}.png", dpi=72)


def draw_realizations(out, quick):
    """Error of S against the number of sampled fields; returns error times its square root."""
    G = TRANSVERSE.physical_optics()
    sizes = np.array([16, 32, 64] if quick else [16, 32, 64, 128]) ** 2
    seeds = range(4 if quick else 16)
    figure, panel = plt.subplots(figsize=(5, 3.4))
    rows = []
    for sigma in (0.6, 0.2):
        S, mu = profile(propagate_csd(G, source(TRANSVERSE, sigma)))
        theory = np.sqrt(np.sum(S**2 * 2 * (1 - np.abs(mu) ** 2)) / (PIXELS - 1))
        panel.loglog(sizes, theory / np.sqrt(sizes), color=COLOURS[sigma])
        constants = []
        for method, marker in METHODS.items():
            errors = []
            for n in sizes:
                squared = []
                for seed in seeds:
                    fields = sample_fields(source(TRANSVERSE, sigma), int(n), method, seed=seed)
                    found = np.mean(np.abs(fields @ G.T) ** 2, axis=0)
                    squared.append(np.sum((found / found[CENTRE] - S) ** 2) / (PIXELS - 1))
                errors.append(np.sqrt(np.mean(squared)))
            panel.loglog(
                sizes, errors, marker, color=COLOURS[sigma], label=f"{method}, $\\sigma_g/a$ = {sigma}"
            )
            constants.append(np.sqrt(np.mean(np.square(errors) * sizes)))
        rows.append((sigma, theory, *constants))
    panel.set(xlabel="realizations", ylabel="rms error of S/S(0)")
    panel.legend(fontsize=7)
    save(figure, out / "error-realizations.png", dpi=72)
    return rows


def table(head, rows):
    """Print a table in Markdown."""
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print(
            "| " + " | ".join(f"{cell:.3g}" if isinstance(cell, float) else f"{cell}" for cell in row) + " |"
        )
    print()


def main(out: Path, quick: bool) -> None:
    """Draw all figures into ``out`` and print the tables; ``quick`` takes fewer rays and fields."""
    out.mkdir(parents=True, exist_ok=True)
    draw_source(out, quick)
    draw_greens_function(out, quick)
    draw_profiles(out, quick)
    for focus, axis, places, name in (
        (TRANSVERSE, TRANSVERSE.detector.x, [110, 120, 130, 140, 160, 180, 200], "x"),
        (AXIAL, AXIAL.detector.z, [110, 120, 140, 160, 180, 200], "z"),
    ):
        head = "sigma_g/a", f"S({name})/S(0)", f"|mu(0,{name})|", f"half width in {name}"
        table(head, profile_rows(focus, axis, places))
    table(("sigma_g/a", "dS", "dmu", "S to sqrt(cos)", "mu to sqrt(cos)"), draw_measurement_function(out))
    errors = error_against_rays(quick)
    draw_errors(out, errors)
    table(
        ("launch", "rays", "CPU s", "rel. error of G", "x sqrt(rays)", "to point optics", "rms error of S"),
        [(*row[:4], float(row[3] * np.sqrt(row[1])), *row[4:]) for row in errors],
    )
    table(("sigma_g/a", "theory", "kl", "copula"), draw_realizations(out, quick))


if __name__ == "__main__":
    run(main, OUT, __doc__)
