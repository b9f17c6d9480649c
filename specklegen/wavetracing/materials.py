"""Response of a surface to incident light.

Field reflection of a half space of relative permittivity eta, with time e^{-i omega t}, c = cos(theta) and
q = sqrt(eta - sin(theta)^2), Im q >= 0:

    r_TE = (c - q) / (c + q),   r_TM = (eta c - q) / (eta c + q),

and of a wall of thickness D between air and air, with x = exp(i 2 pi D q / wavelength):

    R = r (1 - x^2) / (1 - r^2 x^2),   T = (1 - r^2) x / (1 - r^2 x^2).

Building materials follow Recommendation ITU-R P.2040-4: eta = a f^b + i 17.975 c f^(d - 1), f in GHz. Power is
unpolarised in wave tracing: the mean of TE and TM.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from specklegen.core.arguments import choice, positive_number
from specklegen.core.errors import reject, warn_user
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, RATE
from specklegen.core.values import ComplexNumber, Positive, UnitInterval, Value

# Kinds as the kernels know them.
ABSORBER, CONDUCTOR, HALF_SPACE, WALL, DIFFUSE = 0, 1, 2, 3, 4
LIGHT_SPEED = 299_792_458.0

# a, b, c, d and the band in GHz for which they are stated; a material may have several fits.
ITU: dict[str, tuple[tuple[float, float, float, float, float, float], ...]] = {
    "concrete": ((5.24, 0.0, 0.0462, 0.7822, 1, 100), (5.17, 0.0, 0.0145, 1.09, 110, 330)),
    "brick": ((3.91, 0.0, 0.0238, 0.16, 1, 40), (4.15, 0.0, 0.0006, 1.5712, 110, 330)),
    "plasterboard": (
        (2.73, 0.0, 0.0085, 0.9395, 1, 100), (2.56, 0.0, 1e-4, 1.7799, 110, 330), (2.65, 0.0, 2e-4, 1.598, 100, 400),
    ),
    "wood": (
        (1.99, 0, 0.0047, 1.0718, 1e-3, 100), (1.82, 0, 0.004, 1.0761, 110, 330), (2.1183, 0, 0.0055, 1.1113, 100, 400),
    ),
    "glass": (
        (6.31, 0, 0.0036, 1.3394, 0.1, 100), (5.79, 0, 0.0004, 1.658, 220, 450), (6.5767, 0, 0.0012, 1.4697, 100, 400),
    ),
    "clear acrylic": ((2.58, 0.0, 0.0001, 1.6524, 110, 330),),
    "ceiling board": (
        (1.48, 0, 0.0011, 1.075, 1, 100), (1.52, 0, 0.0029, 1.029, 220, 450), (1.2567, 0, 1.3e-4, 1.454, 100, 400),
    ),
    "chipboard": ((2.58, 0.0, 0.0217, 0.78, 1, 100), (2.16, 0.0, 0.0023, 1.359, 100, 200)),
    "plywood": (
        (2.71, 0.0, 0.33, 0.0, 1, 40), (1.94, 0.0, 0.0067, 0.9982, 110, 330), (2.17, 0.0, 0.0063, 1.045, 100, 400),
    ),
    "marble": ((7.074, 0.0, 0.0055, 0.9262, 1, 60),),
    "floorboard": ((3.66, 0.0, 0.0044, 1.3515, 50, 100),),
    "vinyl tile": ((3.62, 0.0, 0.0051, 0.8422, 1, 40),),
    "carpet tile": ((2.08, 0.0, 0.0009, 0.82, 1, 40),),
    "asphalt": ((4.83, 0.0, 0.0108, 1.3969, 1, 40),),
    "metal": ((1.0, 0.0, 1e7, 0.0, 1, 100),),
    "very dry ground": ((3.0, 0.0, 0.00015, 2.52, 1, 10),),
    "medium dry ground": ((15.0, -0.1, 0.035, 1.63, 1, 10),),
    "wet ground": ((30.0, -0.4, 0.15, 1.3, 1, 10),),
}  # fmt: skip


@with_units
def itu_permittivity(name: str, frequency: Annotated[float, RATE]) -> complex:
    """Return the relative permittivity of a building material at a frequency in hertz (ITU-R P.2040-4, table 3).

    Where two rows hold the frequency, the one of the narrower band counts; where none does, the nearest one, with a
    `DoubtWarning`. Raise a `RuleError` for an unknown name, or a frequency that is not positive and finite.

    Parameters
    ----------
    name
        Of the table, such as "concrete", "brick", "glass" or "wood".
    frequency
        Hertz.

    Examples
    --------
    >>> from specklegen.wavetracing import itu_permittivity
    >>> itu_permittivity("concrete", 1e9)
    (5.24+0.830445j)
    """
    choice("material name", name, ITU)
    frequency = positive_number("frequency", frequency)
    gigahertz = frequency / 1e9
    a, b, c, d, lowest, highest = min(
        ITU[name], key=lambda row: (max(row[4] / gigahertz, gigahertz / row[5], 1.0), row[5] - row[4])
    )
    if not lowest <= gigahertz <= highest:
        bands = " and ".join(f"{row[4]:g} to {row[5]:g}" for row in ITU[name])
        warn_user(f"the permittivity of {name} is stated for {bands} GHz, not {gigahertz:.4g} GHz")
    # sigma = c f^d over (omega eps_0) is 17.975 c f^(d - 1)
    return complex(a * gigahertz**b, 17.975 * c * gigahertz ** (d - 1))


class Absorber(Value):
    """A black surface: takes all light in.

    Parameters
    ----------
    kind
        Name by which a file asks for it; there is no other.

    Examples
    --------
    >>> from specklegen.wavetracing import Absorber, perforated_screen
    >>> black = perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]], material=Absorber())
    >>> black.material.kind
    'absorber'
    """

    kind: Literal["absorber"] = "absorber"

    def row(self, wavelength: float) -> np.ndarray:
        """Return what the kernels know of it: kind, Re and Im of the permittivity, thickness in wavelengths."""
        return np.array([ABSORBER, 0.0, 0.0, 0.0])


class Conductor(Value):
    """A perfect electric conductor: reflects all light, as a mirror.

    Parameters
    ----------
    kind
        Name by which a file asks for it; there is no other.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, perforated_screen
    >>> mirror = perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]], material=Conductor())
    >>> mirror.material.kind
    'conductor'
    """

    kind: Literal["conductor"] = "conductor"

    def row(self, wavelength: float) -> np.ndarray:
        """Return what the kernels know of it; see `Absorber.row`."""
        return np.array([CONDUCTOR, 0.0, 0.0, 0.0])


class Diffuse(Value):
    """A Lambert surface: reflects the share ``albedo`` of power over its hemisphere, on the side that is lit.

    Parameters
    ----------
    kind
        Name by which a file asks for it; there is no other.
    albedo
        Share of the power that is reflected, 0 to 1; the rest is taken in.

    Examples
    --------
    >>> from specklegen.wavetracing import Diffuse
    >>> plaster = Diffuse(albedo=0.8)
    >>> plaster.albedo
    0.8
    """

    kind: Literal["diffuse"] = "diffuse"
    albedo: UnitInterval

    def row(self, wavelength: float) -> np.ndarray:
        """Return what the kernels know of it; the albedo stands for Re of the permittivity."""
        return np.array([DIFFUSE, self.albedo, 0.0, 0.0])


class Smooth(Value):
    """A smooth dielectric: a half space, or a wall of a thickness in air, which also transmits.

    Parameters
    ----------
    kind
        Name by which a file asks for it; there is no other.
    permittivity
        Relative, complex, with Im >= 0: the square of the refractive index (time goes as e^{-i omega t}).
    thickness
        Of a wall, in the unit of all lengths; by default there is a half space behind the face.

    Examples
    --------
    >>> from specklegen.wavetracing import Smooth
    >>> glass = Smooth(permittivity=2.25)
    >>> glass.permittivity
    (2.25+0j)
    """

    kind: Literal["smooth"] = "smooth"
    permittivity: ComplexNumber
    thickness: Annotated[Positive, LENGTH] | None = None

    def model_post_init(self, context) -> None:
        """Refuse gain."""
        if self.permittivity.imag < 0 or self.permittivity == 0:
            reject("Smooth.permittivity", "not 0, with Im >= 0 (time e^{-i omega t})", self.permittivity)

    def row(self, wavelength: float) -> np.ndarray:
        """Return what the kernels know of it; see `Absorber.row`."""
        kind = HALF_SPACE if self.thickness is None else WALL
        return np.array([kind, self.permittivity.real, self.permittivity.imag, (self.thickness or 0.0) / wavelength])


class Building(Value):
    """A building material of ITU-R P.2040-4, by name; lengths in metres. With a thickness it is a wall.

    Parameters
    ----------
    kind
        Name by which a file asks for it; there is no other.
    name
        Of the table, such as "concrete", "brick", "glass" or "wood".
    thickness
        Of a wall, metres; by default there is a half space behind the face.

    Examples
    --------
    >>> from specklegen.wavetracing import Building
    >>> wall = Building(name="concrete", thickness=0.2)
    >>> wall.thickness
    0.2
    """

    kind: Literal["building"] = "building"
    name: str
    thickness: Annotated[Positive, LENGTH] | None = None

    def model_post_init(self, context) -> None:
        """Refuse a name that no table has, before anything is traced."""
        choice("Building.name", self.name, ITU)

    def row(self, wavelength: float) -> np.ndarray:
        """Return what the kernels know of it at a wavelength in metres."""
        eta = itu_permittivity(self.name, LIGHT_SPEED / wavelength)
        return Smooth(permittivity=eta, thickness=self.thickness).row(wavelength)


Material = Annotated[Absorber | Conductor | Diffuse | Smooth | Building, Field(discriminator="kind")]
"""Any of the materials."""
