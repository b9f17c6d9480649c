"""Number of instants that make up an exposure of speckle that moves: as few as its contrast allows.

n instants at the midpoints of n parts of an exposure T, added up, have a squared contrast ``K^2`` that is too high by
an amount of order ``1 / n^2`` (:mod:`specklegen.theory.speckle_contrast`). n follows from g1, that of a pilot's classes
of momentum transfer at a few lights and views,

    K^2 = sum_ab p_a p_b F(2 (Y_a + Y_b) x(T))

where nothing flows, with e^(i k t D) of Doppler shifts D where something does, or of screens in closed form; nothing is
taken off afterwards. It depends on the medium, the direction of the beams and T alone, so that a film with one exposure
more keeps those before.
"""

from collections.abc import Callable, Sequence

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.values import remembered
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import doppler_shift, geometric_classes, momentum_classes, momentum_transfer
from specklegen.paths.tracer import scene_tracer
from specklegen.paths.volumes import collects_flow, drift_of, volume_of
from specklegen.samplers.screens.film import frame_correlation
from specklegen.scene.illumination import MOST_SUB_FRAMES
from specklegen.scene.motion import law_of, reduced_time
from specklegen.scene.scene import Scene
from specklegen.theory.speckle_contrast import class_field, contrast_squared, sub_frame_contrast_squared, sub_frames

_Correlation = Callable[[np.ndarray], np.ndarray]
_PATHS = 6000  # that tell how light of a scene decorrelates in time
_FEW = 64  # instants that are tried before the most that there may be
_SHIFTS, _TRANSFERS = 513, 65
"""Classes of Doppler shifts, each 3 % wide: of 10 radians those of a class keep .996; and of Y beside them."""


def with_sub_frames(scene: Scene, tolerance: float) -> tuple[Scene, list[Decision]]:
    """The scene with a number of sub-frames for every exposure, and what is to be said of them."""
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
    reason = (
        f"{_range(light.instants)} instants an exposure, {light.instants.sum()} in all, whose squared contrast is at "
        f"most {above:.2g} of itself above that of the exposure, {allowed}"
    )
    doubt = not chosen and above > tolerance
    return scene.replace(illumination=light), [Decision("exposure", True, reason, doubt=doubt)]


@remembered(16)
def field_correlations(scene: Scene) -> tuple[_Correlation, ...]:
    """g1 of lags float64[n], at a few lights and views of a scene that moves while its beams are on."""
    if scene.thin is not None:
        stack, window = scene.thin, scene.beams.window
        return (lambda lags: frame_correlation(stack, scene.wavelength, stack.moved(lags), window),)
    law = law_of(scene.volume.motions)
    assert law is not None, "exposures are of a medium that moves"
    volume, window = volume_of(scene.volume, scene.dimension), scene.beams.window
    drift = drift_of(volume)

    def over_time(shares: np.ndarray, transfer: np.ndarray, doppler: np.ndarray) -> _Correlation:
        decay = class_field(transfer, shares)

        def field(lags: np.ndarray) -> np.ndarray:
            x = reduced_time("CollimatedBeams.exposure", law, scene.wavelength, lags)
            if drift is not None:  # what the window still lights
                return decay(x) * window.overlap(lags * drift[0], lags * drift[1])
            if not doppler.any():
                return decay(x)
            turned = (np.exp(-2 * one * transfer + 1j * scene.wavenumber * lag * doppler)
                      for one, lag in zip(x, lags, strict=True))  # fmt: skip
            return np.array([shares @ each for each in turned]) / shares.sum()

        return field

    return tuple(over_time(*each) for each in _classes(scene))


def _classes(scene: Scene) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Shares, mean momentum transfers and Doppler shifts of a pilot's light, at a few lights and views it reaches."""
    tracer = scene_tracer(scene, False)
    seed = pilot_seed(scene.unitless_fingerprint())
    bank = tracer.trace(seed, _PATHS, stream=Stream.PILOT, threads=1)
    few, classes = tracer.layout.probed(), []
    lights = np.unique(few.lights.vectors, axis=0, return_index=True)[1]
    for light in np.sort(lights):
        for view in range(len(few.views)):
            pair = few.of_ends(slice(light, light + 1), slice(view, view + 1))
            weights, turned = contributions(pair, bank), momentum_transfer(pair, bank)
            if not weights.any():
                continue
            shifts = doppler_shift(pair, bank) if scene.volume.flows else 0 * turned
            bins = momentum_classes(turned)
            if collects_flow(pair.volume):  # by both
                size = geometric_classes(np.abs(shifts), _SHIFTS) * np.where(shifts < 0, -1, 1)
                both = np.stack([geometric_classes(turned, _TRANSFERS), size])
                bins = np.unique(both, axis=1, return_inverse=True)[1].ravel()
            sums = [np.bincount(bins, weights * each) for each in (np.ones(len(weights)), turned, shifts)]
            lit = sums[0] > 0
            classes.append((sums[0][lit], sums[1][lit] / sums[0][lit], sums[2][lit] / sums[0][lit]))
    return classes or [(np.ones(1), np.zeros(1), np.zeros(1))]  # no light


def _enough(field: _Correlation, exposure: float, tolerance: float) -> int:
    """Fewest instants whose squared contrast is within the tolerance of the exposure's."""
    if _above(field, exposure, _FEW) <= tolerance:
        return sub_frames(field, exposure, tolerance=tolerance)
    least = _above(field, exposure, MOST_SUB_FRAMES)
    if not least <= tolerance:
        reject("CollimatedBeams.exposure",
               f"so short that {MOST_SUB_FRAMES} instants reproduce its squared contrast within {tolerance:g}",
               exposure, f"They differ by {least:.2g}: shorten the exposure, or set sub_frames.")  # fmt: skip
    return sub_frames(field, exposure, tolerance=tolerance)


def _above(field: _Correlation, exposure: float, count: int) -> float:
    """K^2 of so many instants over that of the exposure, less one."""
    return sub_frame_contrast_squared(field, exposure, count) / contrast_squared(field, exposure) - 1


def _excess(fields: Sequence[_Correlation], exposure: np.ndarray, counts: np.ndarray) -> float:
    """Largest K^2 of instants over that of their exposure, less one."""
    pairs = {*zip(exposure.tolist(), counts.tolist(), strict=True)}
    return max(_above(field, time, count) for field in fields for time, count in pairs)


def _range(counts: np.ndarray) -> str:
    return f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
