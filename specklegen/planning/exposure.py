"""How many instants make up an exposure of speckle that moves: as few as its contrast allows.

n instants at the midpoints of n parts of an exposure T, added up, have a squared contrast K^2 that is too high by an
amount of order 1 / n^2 (:mod:`specklegen.theory.speckle_contrast`). n follows from g1, that of a pilot's classes of
momentum transfer at a few lights and views,

    K^2 = sum_ab p_a p_b F(2 (Y_a + Y_b) x(T))

or of screens in closed form; nothing is taken off afterwards. It depends on the medium, the direction of the beams and
T alone, so that a film with one exposure more keeps those before.
"""

from collections.abc import Callable

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import momentum_classes, momentum_transfer
from specklegen.paths.pilot import PILOT_PATHS
from specklegen.paths.tracer import scene_tracer
from specklegen.samplers.screens.film import frame_correlation
from specklegen.scene.illumination import MOST_SUB_FRAMES
from specklegen.scene.motion import fastest, reduced_time
from specklegen.scene.scene import Scene
from specklegen.theory.speckle_contrast import class_field, contrast_squared, sub_frame_contrast_squared, sub_frames

_Correlation = Callable[[np.ndarray], np.ndarray]


def with_sub_frames(scene: Scene, tolerance: float) -> tuple[Scene, list[Decision]]:
    """The scene with a number of sub-frames for every exposure, and what is to be said of them.

    Raises
    ------
    RuleError
        Where an exposure takes too many of them for the tolerance.
    """
    light = scene.illumination
    if getattr(light, "exposure", None) is None or not len(light.vectors):  # beams alone have any
        return scene, []
    fields, exposure = field_correlations(scene), np.asarray(light.exposure)
    chosen = light.sub_frames is None
    if chosen:
        counts = {time: max(_enough(field, time, tolerance) for field in fields) for time in {*exposure.tolist()}}
        light = light.replace(sub_frames=[counts[time] for time in exposure.tolist()])
    above = _excess(fields, exposure, light.instants)
    allowed = f"allowed {tolerance:g}" if chosen else "as asked"
    said = (
        f"{_range(light.instants)} instants an exposure, {light.instants.sum()} in all, whose squared contrast is at "
        f"most {above:.2g} of itself above that of the exposure, {allowed}"
    )
    doubt = not chosen and above > tolerance
    return scene.replace(illumination=light), [Decision("exposure", True, said, doubt=doubt)]


@remembered(16)
def field_correlations(scene: Scene) -> list[_Correlation]:
    """g1 of lags float64[n], at a few lights and views of a scene that moves while its beams are on."""
    if scene.thin is not None:
        stack, window = scene.thin, scene.beams.window
        return [lambda lags: frame_correlation(stack, scene.wavelength, stack.moved(lags), window)]
    found = fastest(scene.volume.motions)
    assert found is not None, "exposures are of a medium that moves"
    law = found[0]

    def over_time(shares: np.ndarray, transfer: np.ndarray) -> _Correlation:
        decay = class_field(transfer, shares)
        return lambda lags: decay(reduced_time("CollimatedBeams.exposure", law, scene.wavelength, lags))

    return [over_time(*each) for each in _classes(scene)]


def _classes(scene: Scene) -> list[tuple[np.ndarray, np.ndarray]]:
    """Shares and mean momentum transfers of a pilot's light, at a few lights and views that any of it reaches."""
    tracer = scene_tracer(scene, False)
    seed = pilot_seed(scene.unitless_fingerprint())
    bank = tracer.trace(seed, PILOT_PATHS, stream=Stream.PILOT, threads=1)
    few, found = tracer.layout.probed(), []
    lights = np.unique(few.lights.vectors, axis=0, return_index=True)[1]
    for light in np.sort(lights):
        for view in range(len(few.views)):
            pair = few.of_ends(slice(light, light + 1), slice(view, view + 1))
            weights, turned = contributions(pair, bank), momentum_transfer(pair, bank)
            if weights.any():
                bins = momentum_classes(turned)
                share, number = np.bincount(bins, weights), np.bincount(bins, weights * turned)
                lit = share > 0
                found.append((share[lit], number[lit] / share[lit]))
    return found or [(np.ones(1), np.zeros(1))]  # no light


def _enough(field: _Correlation, exposure: float, tolerance: float) -> int:
    """Fewest instants whose squared contrast is within the tolerance of the exposure's."""
    least = _above(field, exposure, MOST_SUB_FRAMES)
    if not least <= tolerance:
        reject("CollimatedBeams.exposure",
               f"so short that {MOST_SUB_FRAMES} instants have its squared contrast within {tolerance:g} of itself",
               exposure, f"They are {least:.2g} off: shorten it, or say how many by sub_frames.")  # fmt: skip
    return sub_frames(field, exposure, tolerance=tolerance)


def _above(field: _Correlation, exposure: float, count: int) -> float:
    """K^2 of so many instants over that of the exposure, less one."""
    return sub_frame_contrast_squared(field, exposure, count) / contrast_squared(field, exposure) - 1


def _excess(fields: list[_Correlation], exposure: np.ndarray, counts: np.ndarray) -> float:
    """Largest K^2 of instants over that of their exposure, less one."""
    pairs = {*zip(exposure.tolist(), counts.tolist(), strict=True)}
    return max(_above(field, time, count) for field in fields for time, count in pairs)


def _range(counts: np.ndarray) -> str:
    return f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
