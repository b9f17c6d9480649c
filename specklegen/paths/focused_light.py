"""Focused light on its way in: sums of collimated beams over one bank of paths, and how few of these it meets.

The field of a focus is that of its beams, added up with their amplitudes. Paths start anywhere under the window, while
light in focus is a fraction of it across: those that start there carry all of its speckle.
"""

import numpy as np

from specklegen.core.values import remembered
from specklegen.instrument.lens import Lens
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import endpoint_factors, single_factors
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.layout import Layout
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.pixel_light import PixelLight
from specklegen.scene.scene import Scene

_FEW, _BLOCK = 5, 2**22  # foci that stand for all; factors held at a time


def entrance_factors(layout: Layout, bank: PathBank, amplitudes: np.ndarray) -> np.ndarray:
    """Endpoint factors complex128[T, M] of foci at the entrances: of beams added up by amplitudes complex128[T, N]."""
    out = np.empty((len(amplitudes), len(bank)), complex)
    step = max(64, _BLOCK // max(amplitudes.shape[1], 1))
    for start in range(0, len(bank), step):
        part = slice(start, start + step)
        out[:, part] = amplitudes @ endpoint_factors(layout, bank.select(part), layout.lights, "entry")
    return out


@remembered(32)
def focus_moments(scene: Scene, reverse: bool, lens: Lens | None = None) -> PathMoments:
    """Moments of what a path adds to the field of a focus, at the worst of a few: to a view, or to a pixel of an image.

    ``scene`` is seen from afar; through a ``lens``, over its pupil.
    """
    pilot = scene_pilot(scene.replace(illumination=scene.beams), reverse)
    layout, bank = pilot.tracer.layout, pilot.bank
    few = np.unique(np.linspace(0, len(scene.illumination.points) - 1, _FEW).astype(int))  # type: ignore[attr-defined]
    if not len(bank) or not len(scene.illumination.vectors):
        return PathMoments(0.0, 0.0)
    amplitudes = scene.illumination.of(few).amplitudes(scene.wavelength)  # type: ignore[attr-defined]
    views = layout.views.few()
    view = views.of(np.array([len(views) // 2]))
    power = bank.weight * np.square(np.abs(endpoint_factors(layout, bank, view, "exit")[0]))
    once = bank.orders == 1
    if once.any():
        axis = layout.at(np.array([0.0, 0.0, 1.0]), view.vectors[0]) if not view.near else None
        if axis is not None:
            power[once] *= np.square(np.abs(single_factors(axis, bank.select(once))[0, 0]))
    found = PathMoments(0.0, 0.0)
    for entering in np.square(np.abs(entrance_factors(layout, bank, amplitudes))):
        if not (power * entering).any():
            continue
        if lens is None:
            own = PathMoments.of(power * entering, bank.paths, bank.count).stated()
        else:
            light = PixelLight(scene, lens, layout, bank, np.array([0.0, 0.0, 1.0]), bank.weight * entering)
            own = light.pixel(bank.exit[:, :2])
        found = max(found, own, key=lambda m: m.relative_variance)
    return found
