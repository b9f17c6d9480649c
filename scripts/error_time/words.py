"""What the page says in words: why a curve flattens, why two cross, what stands in the way of an aim."""

from collections.abc import Collection

REMARKS = {
    "transmission-g09-od1": "Almost all light is scattered once or twice and straight on: nothing decorrelates.",
    "transmission-g09-od50": "The plain program pays for each of some 100 collisions a path; thinning keeps about one.",
    "oblique-view": "At 20° the correlation of the axis would put |C|² of these tilts .05 and .10 too high; the "
    "stationary sampler takes the oblique correlation of the direction itself (docs/planning.md).",
    "backscatter": "The closed form includes the cone: S + M + the same M between the reversed directions.",
    "wide-field": "No transform spans 80°: every connection is summed at every view, and the general engine for a "
    "few points gets a third of the 1/(variance × time).",
    "flatland-box": "The wave equation is not transport theory: single views differ by some per cent (1/(kℓ), "
    "docs/validation.md), still below the noise of the most placements run here. Electric-field Monte Carlo has no "
    "reversed paths, and misses the backscattering peak.",
    "thin-box": "At optical depth 0.02 one scattering is nearly all: the closed form is exact for it and instant, and "
    "its error is the light that is scattered more often, which Monte Carlo passes after a while.",
    "near-field": "Every sensor point is also where paths may start.",
    "voxels": "Rays walk through voxels one by one.",
    "hidden-object-within": "Nine beams at once. The object sampler's modes leave out up to 1 % of the light, put back "
    "evenly: a bias of .007 of the tilt covariances, which shows at the largest count.",
    "hidden-object-beyond": "The same, with more modes and a bias of .004; the tilt covariances judged are those "
    "between far pixels.",
    "two-screens": "Nothing is traced here. The sampler's covariance is a closed form and meets the reference, a "
    "quadrature over the exit plane; its reported error is the planner's bound for the whole camera. Fields and waves "
    "scatter as all speckle does, by 1/√fields; waves pay for two transforms of the plane a screen and a tilt.",
}
"""Scene to a remark below its figure."""

CROSSINGS = {
    ("paths", "paths, direct sum"): "with few connections the direct sum costs less than the transforms, whose size is "
    "that of the grid",
    ("paths", "covariance, few points"): "paths bring images: they pay for every view; the general engine pays for "
    "the points alone, but more for a collision and once for its tables",
    ("paths", "covariance, eigen-sampling"): "a matrix of all views costs more a path than their fields do, and its "
    "eigenvectors something once",
}
"""Why two falling curves cross, in either order, where more is known than :data:`GENERAL`."""

GENERAL = "fixed costs against the cost of a path"

STOPS = {
    "single scattering, closed form": "the closed form stops at the light that it leaves out",
    "electric-field Monte Carlo": "electric-field Monte Carlo has no correlations, and no reversed paths",
}
"""Why a method's curve ends level, whatever crosses it."""

OBSTACLES = {
    "path tracing, per scattering event": "each event takes a logarithm, a sine and cosine and its random numbers",
    "render / tracing alone, plan at hand": "the other side of the ratio is the tracing, which has become fast: what "
    "is left is the two ends of kept connections and their spreading by the NUFFT",
    "stationary five-stack 101 x 101": "half of it are the matrix products from cells to views, which keep the core's "
    "arithmetic busy, and a fifth are the normal random numbers, 15 000 a stack",
    "speed of two threads / one, tracing": "two processes that share nothing, in the same repeats, say what two cores "
    "can do here at best",
    "speed of two threads / one, a whole render": "the same; a thread traces and sums a chunk of paths on its own, and "
    "helps others when there is none left",
}
"""Row of ``scripts/benchmark.py`` to what stands in the way where its aim is missed."""


def crossing(one: str, other: str, level: Collection[str]) -> str:
    """Why two curves cross, of which those of the methods in ``level`` end level."""
    stops = [STOPS.get(each, f"{each} ends level") for each in (one, other) if each in level]
    return "; ".join(stops) or CROSSINGS.get((one, other)) or CROSSINGS.get((other, one)) or GENERAL
