"""Rows that take minutes."""

from dataclasses import replace

import numpy as np
from references.correlation_transfer import quadruple
from references.slab import slab_transmission
from scipy.special import expn

import specklegen as sg
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.slab_tracer import trace

from .row import Row, holds, measured, refused, within
from .scenes import AXIS, REQUIRED, scene, slab, views
from .sizes import sideways


def thick_transmission() -> Row:
    """Transmittance at optical depth 300 without absorption, isotropic scatterers."""
    depth, batch, batches = 300.0, 8192, 64
    medium = slab(depth)
    proposal = replace(plane_proposal(medium, AXIS, AXIS), threshold=slab_transmission(depth))
    sums, unfinished = np.zeros(batches), 0
    for n in range(batches):
        bank = trace(medium, proposal, 1, batch, first=n * batch)
        # W |A|², and E2/2 of the way to the exit face: the share that leaves there unscattered.
        power = bank.weight * np.exp(-medium.extinction * bank.entry[:, 2])
        power *= np.where(bank.orders > 1, 1 / (4 * np.pi), 1.0)
        sums[n] = (power * expn(2, medium.extinction * (medium.thickness - bank.exit[:, 2])) / 2).sum() / batch
        unfinished += bank.unfinished
    ours, error = sums.mean(), sums.std(ddof=1) / np.sqrt(batches)
    row = within(f"OD 300, albedo 1: transmittance from {batch * batches} paths, {unfinished} cut",
                 "1.6788/(OD + 1.4208)", slab_transmission(depth), ours, 0.03)  # fmt: skip
    return replace(row, ours=f"{ours:.5g} ± {error:.1g}")


def thickest() -> Row:
    """Optical depth 3000: whole by default, and ended by a smaller max_order with what was cut reported."""
    medium = slab(3e3)
    proposal = plane_proposal(medium, AXIS, AXIS)
    whole = trace(medium, replace(proposal, threshold=1e9), 1, 2000)
    cut = trace(medium, replace(proposal, threshold=1e9, max_order=1000), 1, 2000)
    return holds(
        "OD 3000", REQUIRED, "ends by max_order, the unfinished weight reported",
        {
            f"default {proposal.max_order:.0e}: {whole.events / 2000:.3g} scatterings a path, {whole.unfinished} cut":
            whole.unfinished == 0 and whole.unfinished_weight == 0,
            f"max_order 1000: {cut.unfinished} of 2000 paths cut, weight {cut.unfinished_weight:.3g} reported":
            0 < cut.unfinished < 200 and np.isfinite(cut.unfinished_weight) and cut.unfinished_weight > 0,
        },
    )  # fmt: skip


def too_thick() -> Row:
    """Optical depth 1e4 without absorption: even a pilot would not come to an end."""
    call = (lambda: sg.plan(scene(slab(1e4))), ["Slab.optical_depth", "thinner"])
    return refused("OD 1e4", "4000 is the most", [call])


def slope() -> Row:
    """Standard errors from 1e4 to 1e7 paths fall like N^(-1/2) (scaled down from 1e9, which would take hours)."""
    counts = 10 ** np.arange(4, 8)
    errors = [sg.covariance(scene(slab(1.0)), paths=int(n), seed=1, reverse=False).rel_error for n in counts]
    found = float(np.polyfit(np.log(counts), np.log(errors), 1)[0])
    # 64 batches know a standard error to 9 %: over three decades the slope to 0.02.
    return within("1e4 … 1e7 paths (not 1e9): slope of the standard error", REQUIRED, -0.5, found, 0.05,
                  relative=False)  # fmt: skip


def floor() -> Row:
    """At 1e7 paths the covariance still falls on the transfer equation within its error: sums lose nothing."""
    medium, light = slab(1.0), sg.CollimatedBeams.tilts([0.0], width=1e7)
    made = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=views([0, 0, 1], [0, 0, -1]))
    found = sg.covariance(made, paths=10_000_000, seed=2, reverse=False)
    right = []
    for view in made.views:
        transfer = quadruple(1.0, mean_free_path=100.0, wavelength=1.0, lights=(AXIS, AXIS), views=(view, view))
        right.append(transfer.total.real * light.width**2 / (4 * np.pi))
    return measured("1e7 paths: intensity of a wide beam", "transfer equation × A/4π", right, found.intensity[0],
                    np.einsum("tvtv->tv", found.standard_error)[0])  # fmt: skip


def sideways_thick() -> Row:
    """At optical depth 20."""
    return sideways(20.0, 9.9, 64 * 1000)


ROWS = (thick_transmission, thickest, too_thick, slope, floor, sideways_thick)
