"""When thin screens may be drawn as Gaussian speckle under a moving envelope, and how far that is from their waves.

Three things are judged, each against the tolerance of intensity correlations:

* the memory effect: K of the view along the beam stands for that of every view and of mismatches of half a grain, which
  Eq. 2 of :mod:`specklegen.theory.phase_screens` gives exactly in the paraxial regime;
* Gaussian statistics: a window of few correlation lengths sends few independent contributions to a view;
* the mirror image of weak screens: one screen's is drawn, that of a stack is left out.
"""

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.samplers.sampler import Request
from specklegen.samplers.screens.correlation import profile, screen_correlation
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.scene.validity import implausible_in
from specklegen.theory.phase_screens import Lobes, lobes, tilt_ways

FACETS = 4.0
"""Excess of contrast^2 over 1, times the window's area over pi xi^2 and f(v) / f(0), at most: tests find 0 to 2."""
_DIM = 0.05  # of the peak: views darker than that are not asked how Gaussian they are
_GAIN = 2 / np.pi  # of a square window at a mismatch of half a grain: the largest of all profiles


def screens_decision(scene: Scene, request: Request) -> tuple[bool, Decision]:
    """Return whether the screens of a scene may be drawn, with their errors in words."""
    part = "screens"
    if scene.thin is None:
        return False, Decision(part, False, "the medium is not a thin screen")
    if scene.sensor.regular_grid is None:
        reject("Scene.sensor", "a regular far-field grid behind thin screens", scene.sensor.type,
               "Use FarField.grid(...).")  # fmt: skip
    deviations = errors(scene)
    reason = "; ".join(f"{what} {value:.2g}" for what, value in deviations.items()) + f", allowed {request.tolerance:g}"
    worst = max(deviations, key=lambda what: deviations[what])
    right = deviations[worst] <= request.tolerance
    if not right and request.asked != part:
        units = "".join(f"Check units: {each}. " for each in implausible_in(scene))
        reject("Scene", f"possible for screens within {request.tolerance:g}", f"{worst} {deviations[worst]:.2g}",
               f"{units}{_REMEDIES[worst]} Or force it by sampler=\"screens\".")  # fmt: skip
    return True, Decision(part, True, f"in closed form; {reason}", doubt=not right)


MEMORY, GAUSSIAN, MIRROR = (
    "intensity correlations off by",
    "contrast^2 above that of Gaussian speckle by at most",
    "neglected correlation with the mirror image, at most",
)
_REMEDIES = {
    MEMORY: "Use views nearer to the beam, smaller tilts, or a wider illuminated area.",
    GAUSSIAN: "Widen the illuminated area: it has few correlation lengths of the screen.",
    MIRROR: "Use stronger screens, or views away from the beam.",
}


def errors(scene: Scene) -> dict[str, float]:
    """Errors of intensity correlations, by name."""
    stack = scene.thin
    assert stack is not None
    terms = lobes(stack, scene.wavelength)
    if not len(terms.shares) or not len(scene.beams.directions):
        return {MEMORY: 0.0}
    facets = scene.beams.window.area / (np.pi * np.square(stack.correlation_lengths).max())
    darkest = float(profile(terms, np.array([_farthest(scene)]))[0]) ** 2
    deviations = {MEMORY: _memory_error(scene, stack, terms), GAUSSIAN: FACETS / (facets * max(darkest, _DIM))}
    return deviations | ({MIRROR: _mirror_error(scene, terms)} if len(stack.screens) > 1 else {})


def _farthest(scene: Scene) -> float:
    """Largest sine between a view and a beam."""
    corners = scene.sensor.corner_directions[:, None, :2]  # type: ignore[union-attr]
    return float(np.hypot(*(corners - scene.beams.directions[:, :2]).reshape(-1, 2).T).max())


def _memory_error(scene: Scene, stack: ScreenStack, terms: Lobes) -> float:
    """Largest | |C_exact|^2 - |C_model|^2 | over probe views, tilts, moves and mismatches of half a grain."""
    correlation, grid = screen_correlation(stack, scene.wavelength), scene.grid
    beams = scene.beams.directions[:, :2]
    middle = beams.mean(axis=0)
    farthest = beams[np.square(beams - middle).sum(-1).argmax()]
    gaps = farthest - beams
    largest = gaps[np.square(gaps).sum(-1).argmax()]
    views = np.concatenate([grid.center_direction[None], grid.corner_directions])[:, :2]
    half = 0.5 * scene.speckle_size
    aside = half * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    worst = 0.0
    for share in (0.0, 0.25, 0.5, 1.0):
        for tilt, moved in ((share * largest, 0.0), *((0.0 * largest, share * move) for move in _moves(scene, stack))):
            way = tilt_ways(stack, tilt) + moved
            still = np.ndim(moved) == 0
            modelled = (
                float(correlation(scene.wavenumber * np.hypot(*tilt)) if still else terms.decorrelation(way)) ** 2
            )
            for view in views:
                exact = abs(terms.correlation(view - farthest + tilt / 2, way)) ** 2
                worst = max(worst, abs(exact - modelled))
                for kappa in aside:
                    aslant = way + tilt_ways(stack, kappa)
                    amplitude = abs(terms.correlation(view - farthest + (tilt + kappa) / 2, aslant))
                    worst = max(worst, _GAIN**2 * abs(amplitude**2 - modelled))
    return worst


def _moves(scene: Scene, stack: ScreenStack) -> list[np.ndarray]:
    """Displacement of every screen between the first beam and the last, float64[M, 2], if it moves."""
    times = scene.beams.times
    return [] if times is None or not len(times) else [stack.moved(np.array([np.ptp(times)]))[0]]


def _mirror_error(scene: Scene, terms: Lobes) -> float:
    """|S_+ - S_-|^2 / f^2 where it is largest, of views whose mirror images about a beam are on the grid too.

    Gaps only lower it: their phases grow with the square of the angle.
    """
    grid = scene.grid
    x, y = grid.sines
    nearest = np.stack([np.clip(scene.beams.directions[:, n], axis[0], axis[-1]) for n, axis in enumerate((x, y))])
    inside = np.hypot(*(scene.beams.directions[:, :2].T - nearest)) <= scene.speckle_size
    if not inside.any():
        return 0.0
    return terms.mirrored
