"""A stack of screens in the place of a forward-scattering slab, and how far its speckle is from the slab's.

M equal screens of ``sigma^2 = OD / M`` each, whose correlation length ``xi = (2 / (1 - g))^(1/2) / k`` gives the phase
function of one deflection the slab's mean ``1 - cos``. Their gaps ``L / (M^2 - 1)^(1/2)`` and their middle at ``L / 2``
leave both variances of the lateral walk as in the slab, ``L^2 / 12`` and ``L^2 / 3`` times ``OD theta^2``. What is
replaced is the shape of the phase function, which becomes Gaussian; wide angles, backscattering and absorption are left
out: screens let all light through, and what the slab lets through is walked beside them. docs/screens.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from specklegen.core.arguments import instance, positive_number, whole_number
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.units import WAVELENGTH
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.paths.analog_walk import require_walkable, transmittance
from specklegen.samplers.screens.correlation import screen_correlation
from specklegen.scene.media import Slab
from specklegen.scene.polarisation import require_scalar
from specklegen.scene.screens import PhaseScreen, ScreenStack, require_thin

_REACH, _TILTS = 2.0, 17  # in half ranges of the slab
_MOST_SCREENS = 10_000  # no slab needs as many; each is a value of the stack


@dataclass(frozen=True, repr=False)
class Replacement(Pictured):
    """A stack like a slab, with the error that it makes.

    Attributes
    ----------
    stack : ScreenStack
    tilts : float64[T]
        Differences of direction sines, up to twice the slab's half range.
    of_slab, of_stack : float64[T]
        C_I at a fixed view near the axis.
    standard_error : float64[T]
        Of the slab's, whose paths are random.
    radiance : float
        What leaves straight ahead behind the stack, over what does behind the slab.
    transmittance, transmittance_error : float
        Share of the light that the slab lets through at any angle, unscattered light included, and its standard error.
        The stack lets all of it through, so that its images are 1 / ``transmittance`` times too bright in all.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=500.0, scatterer=sg.media.HenyeyGreenstein(0.98))
    >>> found = sg.media.stack_like(slab, wavelength=0.5, screens=4, paths=2000)
    >>> len(found.stack.screens), found.of_slab.shape == found.of_stack.shape
    (4, True)
    """

    stack: ScreenStack
    tilts: np.ndarray
    of_slab: np.ndarray
    of_stack: np.ndarray
    standard_error: np.ndarray
    radiance: float
    transmittance: float
    transmittance_error: float

    _named = {"largest difference of C_I": "error", "C_I of the slab": "of_slab", "standard error": "standard_error",
              "radiance along the axis, over that of the slab": "radiance",
              "share of light that the slab transmits": "transmittance"}  # fmt: skip

    def _facts(self) -> Mapping[str, object]:
        return {"screens": len(self.stack.screens), **super()._facts()}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Both curves of C_I, the slab's with bars of two standard errors."""
        draw_curve(axes, self.tilts, self.of_slab, self.standard_error, "slab", fmt="o")
        axes.plot(self.tilts, self.of_stack, label="stack of screens")
        axes.set(xlabel="tilt (sine)", ylabel=r"intensity correlation  $C_I$", ylim=(-0.03, 1.05))
        axes.legend()

    @property
    def error(self) -> float:
        """Largest difference of C_I."""
        return float(np.abs(self.of_stack - self.of_slab).max())


@with_units
@shielded()
def stack_like(
    slab: Slab, *, wavelength: Annotated[float, WAVELENGTH], screens: int = 8, paths: int = 100_000, seed: Seed = 0
) -> Replacement:
    """Screens in the place of a slab.

    Parameters
    ----------
    slab
        Of matched faces; forward scattering, or the screens are refused.
    wavelength
        Inside the slab, in its unit of length.
    screens
        How many, at least 2: more follow the slab's curve further, and take longer to render.
    paths
        Random paths of the slab's memory effect, with which the screens' is compared.
    seed
        Of those paths: a whole number, or a sequence of them.

    Raises
    ------
    RuleError
        Where the phase function is too wide for thin screens, the slab has no range, or its faces reflect.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=500.0, scatterer=sg.media.HenyeyGreenstein(0.98))
    >>> found = sg.media.stack_like(slab, wavelength=0.5, screens=4, paths=2000)
    >>> found.stack.thickness, len(found.stack.screens)
    (887.2983346207417, 4)
    """
    instance("stack_like slab", slab, Slab)
    require_scalar("stack_like slab", slab)
    wavelength = positive_number("stack_like wavelength", wavelength)
    count = whole_number("stack_like screens", screens, 2, _MOST_SCREENS)
    paths = whole_number("stack_like paths", paths, 1)
    require_walkable("stack_like", slab, paths)
    if not slab.faces.matched:
        reject("stack_like slab.faces", "matched: screens do not reflect", slab.faces, "Use faces=Faces().")
    if not 0 < slab.optical_depth:
        reject("stack_like slab", "of an optical depth above 0", slab.optical_depth)
    wavenumber = 2 * np.pi / wavelength
    length = np.sqrt(2 / (1 - slab.scatterer.mean_cosine())) / wavenumber
    screen = PhaseScreen(rms_phase=float(np.sqrt(slab.optical_depth / count)), correlation_length=float(length))
    gap = slab.thickness / np.sqrt(count**2 - 1)
    stack = require_thin(
        ScreenStack(screens=(screen,) * count, gaps=(float(gap),) * (count - 1),
                    behind=float((slab.thickness - gap * (count - 1)) / 2)), wavelength,
    )  # fmt: skip
    correlation, closed = estimate_correlation(slab, paths, seed), screen_correlation(stack, wavelength)
    half = correlation.half_range() if correlation.weights.any() else np.inf
    if not np.isfinite(half):
        reject("stack_like slab", "a slab whose speckle decorrelates with tilt", slab,
               "Its light is scattered once only.")
    q = np.linspace(0.0, _REACH * half, _TILTS)
    intensity, _, error = correlation.intensity(q)
    radiance = float(closed.weights.sum() / (correlation.weights.sum() / correlation.paths))
    through = transmittance(slab, paths, pilot_seed(slab.unitless_fingerprint()))
    return Replacement(stack, q / wavenumber, intensity, np.square(closed(q)), error, radiance, *through)
