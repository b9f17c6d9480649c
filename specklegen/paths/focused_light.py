"""Focused light on its way in: sums of collimated beams over one bank of paths, and how few of these it meets.

The field of a focus is that of its beams, added up with their amplitudes. Paths start anywhere under the window, while
light in focus is a fraction of it across: those that start there carry all of its speckle.
"""

import numpy as np
from scipy.special import j0

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.values import remembered
from specklegen.instrument.lens import Lens
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions, endpoint_factors, single_factors
from specklegen.paths.far_field import SLANT, far_field_decision, lobe_width, overlap
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.layout import Layout
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.pixel_light import PixelLight
from specklegen.scene.scene import Scene

_FEW, _BLOCK = 5, 2**22  # foci that stand for all; factors held at a time
ALLOWED = 0.05
"""Share of the light in focus that may be lost to lobes that every beam of a wide cone meets at an angle of its own."""
_PAIRS = 33  # distances of two beams at which lobes are compared


def focus_loss(scene: Scene, reverse: bool, part: float = 1.0) -> float:
    """Share of the light in the middle of a focus that path sums lose at most beside narrow phase functions.

    A spot is the transform of pairs of beams: H(t) of them are t apart, and keep K(t) = E[w J0(k t |R|)] / E[w], R from
    where light enters to where it leaves. Of what scatters more than once, K_m, phase functions that each beam meets at
    an angle of its own leave |A(t)|^2 (:mod:`specklegen.paths.far_field`): int H K_m (1 - |A|^2) / int H K. ``part``
    narrows the cone of light; ``scene`` is seen from afar.
    """
    light, wavelength = scene.illumination, scene.wavelength
    side = light.side(wavelength)  # type: ignore[attr-defined]
    one = light.of(np.zeros(1, int)).replace(width=side)  # type: ignore[attr-defined]
    sines, own, step = one.modes(wavelength).directions[:, :2], np.abs(one.amplitudes(wavelength)[0]), wavelength / side
    place = np.rint(sines / step).astype(int)
    across = 4 * int(np.abs(place).max(initial=0)) + 2
    lens = np.zeros((across, across))
    lens[place[:, 1] % across, place[:, 0] % across] = own
    pairs = np.fft.ifft2(np.square(np.abs(np.fft.fft2(lens)))).real
    axis = np.fft.fftfreq(across, 1 / across) * step
    apart = np.hypot(axis, axis[:, None]) * part
    at = np.linspace(0, float(apart.max()), _PAIRS)
    pilot = scene_pilot(scene.replace(illumination=scene.beams), reverse)
    bank, views = pilot.bank, pilot.tracer.layout.views
    seen = pilot.tracer.layout.at(np.array([0.0, 0.0, 1.0]), views.of(np.array([len(views) // 2])).vectors)
    weights, often = contributions(seen, bank), bank.orders > 1
    ways = np.hypot(*(bank.exit - bank.entry)[often, :2].T)
    kept = np.array([weights[often] @ j0(scene.wavenumber * t * ways) for t in at])
    parted = np.array([1 - overlap(scene.slab.scatterer, float(f"{min(t, 3.0):.9g}")) ** 2 for t in at])
    lost = (pairs * np.interp(apart, at, np.maximum(kept, 0.0) * parted)).sum()
    whole = (pairs * (np.interp(apart, at, kept) + weights[~often].sum())).sum()
    return float(lost / whole) if lost < whole else 1.0


def narrow_lobes(scene: Scene, reverse: bool) -> list[Decision]:
    """Effect of path sums on a focus behind narrow phase functions; refuse cones whose focus they widen."""
    lit = scene.replace(illumination=scene.beams)
    decision = far_field_decision(lit)
    if decision is None or not decision.doubt or not len(scene.illumination.vectors):
        return [] if decision is None else [decision]
    lost = focus_loss(scene, reverse)
    if lost > ALLOWED:
        sines = np.hypot(*lit.beams.directions[:, :2].T)
        low, high = 0.0, 1.0
        for _ in range(8):
            part = (low + high) / 2
            low, high = (part, high) if focus_loss(scene, reverse, part) <= ALLOWED else (low, part)
        edge = lit.wavelength / lit.beams.width  # cells that the rim of the pupil cuts reach beyond it
        passing = max(low * float(sines.max()), SLANT**0.5 - edge)
        wide = scene.illumination.sine(scene.wavelength)  # type: ignore[attr-defined]
        reject(
            "FocusedBeams.aperture", f"at most {min(passing, 0.99 * wide):.3g} for this phase function", wide,
            f"The phase function is {lobe_width(scene.slab.scatterer):.2g} wide, and scatterers receive the cone: "
            f"path sums would lose {lost:.2g} of the light in focus. "
            "Use a smaller aperture or a wider waist.",
        )  # fmt: skip
    return [Decision(
        decision.part, False,
        f"not reached within a mean free path, and beams of the cone have different scattering "
        f"angles: at most {lost:.2g} of the light in focus is lost (limit {ALLOWED:g})",
    )]  # fmt: skip


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
    few = np.unique(np.linspace(0, len(scene.illumination.vectors) - 1, _FEW).astype(int))
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
    worst = PathMoments(0.0, 0.0)
    for entering in np.square(np.abs(entrance_factors(layout, bank, amplitudes))):
        if not (power * entering).any():
            continue
        if lens is None:
            own = PathMoments.of(power * entering, bank.paths, bank.count).stated()
        else:
            light = PixelLight(scene, lens, layout, bank, np.array([0.0, 0.0, 1.0]), bank.weight * entering)
            own = light.pixel(bank.exit[:, :2])
        worst = max(worst, own, key=lambda m: m.relative_variance)
    return worst
