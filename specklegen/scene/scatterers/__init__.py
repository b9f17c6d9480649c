"""Phase functions of the particles of a medium, one family a file; importing the package registers them."""

from specklegen.scene.scatterers.henyey_greenstein import HenyeyGreenstein
from specklegen.scene.scatterers.isotropic import Isotropic
from specklegen.scene.scatterers.mie import Mie
from specklegen.scene.scatterers.mixture import Mixture
from specklegen.scene.scatterers.percus_yevick import PercusYevick
from specklegen.scene.scatterers.rayleigh import Rayleigh
from specklegen.scene.scatterers.scatterer import AnyScatterer, Dimensions, Row, Scatterer
from specklegen.scene.scatterers.tabulated import Tabulated
from specklegen.scene.scatterers.von_mises_fisher import VonMisesFisher

__all__ = [
    "AnyScatterer", "Dimensions", "HenyeyGreenstein", "Isotropic", "Mie", "Mixture", "PercusYevick", "Rayleigh", "Row",
    "Scatterer", "Tabulated", "VonMisesFisher",
]  # fmt: skip
