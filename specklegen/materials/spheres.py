"""Spheres of one size in water: the suspensions that are sold as standards."""

import math
from collections.abc import Callable

from specklegen.materials import indices
from specklegen.materials.preset import Checked, Number, Optics, Preset
from specklegen.scene.scatterers import Mie

_DAIMON = "Water: Daimon and Masumura, Applied Optics 46, 3811 (2007)"


def in_water(index: Callable[[float], float]) -> Callable[..., Optics]:
    """Function that makes the optics of spheres of a refractive index."""

    def make(wavelength: float, micrometre: float, *, radius: float, volume_fraction: float) -> Optics:
        water = indices.water(wavelength)
        sphere = Mie(radius=radius * micrometre, wavelength=wavelength / water * micrometre,
                     refractive_index=index(wavelength) / water)  # fmt: skip
        density = volume_fraction / (4 / 3 * math.pi * radius**3)  # in a cubic micrometre
        return Optics(sphere, density * sphere.scattering_cross_section / micrometre**2, 0.0, water)

    return make


def _numbers(radius: float) -> dict[str, Number]:
    return {
        "radius": Number(radius, 0.05, 5.0, "micrometres", "of a sphere", "A choice of the user", Checked.ASSUMED),
        "volume_fraction": Number(0.01, 0.001, 0.05, "", "share of the volume that the spheres fill",
                                  "A choice of the user", Checked.ASSUMED),  # fmt: skip
    }


_DENSE = (
    "Independent scattering: above some per cent of volume, neighbors screen each other and less is scattered. The "
    "absorption of water is left out."
)

POLYSTYRENE = Preset("polystyrene", "polystyrene spheres in water, by Mie theory",
                     (indices.POLYSTYRENE[0], indices.CLEAR_WATER), _numbers(0.5),
                     ("Polystyrene: Sultanova, Kasarova and Nikolov, Acta Physica Polonica A 116, 585 (2009)", _DAIMON),
                     in_water(indices.polystyrene), _DENSE)  # fmt: skip

SILICA = Preset("silica", "fused silica spheres in water, by Mie theory", (indices.SILICA[0], indices.CLEAR_WATER),
                _numbers(0.5), ("Silica: Malitson, Journal of the Optical Society of America 55, 1205 (1965)", _DAIMON),
                in_water(indices.silica), _DENSE)  # fmt: skip
