"""Media: where the scatterers are and how dense."""

from typing import Literal

from specklegen.scatterers import Scatterer
from specklegen.values import NonNegative, Positive, UnitInterval, Value


class Slab(Value):
    """A plane-parallel scattering layer, 0 <= z <= thickness, infinite sideways, index-matched.

    Parameters
    ----------
    thickness
        Length along the optical axis (z).
    mean_free_path
        1 / sigma_t, the mean distance between collisions, in the same unit.
    albedo
        Share of collisions that scatter; the rest absorb.
    scatterer
        What one particle does with the light that it scatters.
    """

    type: Literal["Slab"] = "Slab"
    thickness: NonNegative
    mean_free_path: Positive
    albedo: UnitInterval = 1.0
    scatterer: Scatterer

    @property
    def optical_depth(self) -> float:
        """OD = thickness / mean_free_path: mean number of collisions straight through."""
        return self.thickness / self.mean_free_path

    @property
    def extinction(self) -> float:
        """sigma_t = 1 / mean_free_path, per unit length."""
        return 1 / self.mean_free_path

    @property
    def transport_length(self) -> float:
        """l* = mean_free_path / (1 - g): distance over which a path forgets its direction."""
        return self.mean_free_path / (1 - self.scatterer.g)


Medium = Slab
