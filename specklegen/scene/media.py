"""Media: where the scatterers are and how dense."""

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import Array, NonNegative, Positive, UnitInterval, Value, position_vectors
from specklegen.scene.faces import Faces
from specklegen.scene.scatterers import AnyScatterer
from specklegen.scene.screens import GroundGlass, PhaseScreen, ScreenStack
from specklegen.scene.unitless import unitless_fingerprint


class Slab(Value):
    """A plane-parallel scattering layer, 0 <= z <= thickness, infinite sideways.

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
    faces
        The step of the refractive index at both faces; by default there is none. Wavelengths, wavenumbers and
        directions are always those inside.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9))
    >>> slab.optical_depth, round(slab.transport_length)
    (10.0, 1000)
    """

    type: Literal["Slab"] = "Slab"
    thickness: NonNegative
    mean_free_path: Positive
    albedo: UnitInterval = 1.0
    scatterer: AnyScatterer
    faces: Faces = Faces()

    @model_validator(mode="after")
    def _check(self) -> Self:
        _require_density("Slab", self.mean_free_path)
        return self

    @model_serializer(mode="wrap")
    def _without_matched_faces(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out faces that do nothing: the slab is then what it was before it could have any."""
        content = write(self)
        if self.faces.matched:
            content.pop("faces", None)
        return content

    @property
    def optical_depth(self) -> float:
        """OD = thickness / mean_free_path: mean number of collisions straight through."""
        return self.thickness / self.mean_free_path

    @property
    def extinction(self) -> float:
        """sigma_t = 1 / mean_free_path, per unit length."""
        return 1 / self.mean_free_path

    def unitless_fingerprint(self) -> str:
        """SHA-256 of the slab in units of its thickness (or, without any, of its mean free path)."""
        return unitless_fingerprint(self, self.thickness or self.mean_free_path)

    @property
    def transport_length(self) -> float:
        """l* = mean_free_path / (1 - g): distance over which a path forgets its direction."""
        return self.mean_free_path / (1 - self.scatterer.mean_cosine())


class Box(Value):
    """A homogeneous, index-matched, axis-parallel box, in space or in flatland.

    Parameters
    ----------
    lower, upper
        float64[3] or float64[2], opposite corners; the last axis is the optical axis.
    mean_free_path, albedo, scatterer
        As for :class:`Slab`.

    Examples
    --------
    >>> import specklegen as sg
    >>> box = sg.Box(lower=[-50, -50, 0], upper=[50, 50, 20], mean_free_path=10.0, scatterer=sg.Isotropic())
    >>> box.thickness, box.optical_depth
    (20.0, 2.0)
    """

    type: Literal["Box"] = "Box"
    lower: Array
    upper: Array
    mean_free_path: Positive
    albedo: UnitInterval = 1.0
    scatterer: AnyScatterer

    @model_validator(mode="after")
    def _check(self) -> Self:
        _require_corners("Box", self.lower, self.upper)
        _require_density("Box", self.mean_free_path)
        return self

    @property
    def thickness(self) -> float:
        """Length along the optical axis."""
        return float(self.upper[-1] - self.lower[-1])

    @property
    def optical_depth(self) -> float:
        """OD along the optical axis."""
        return self.thickness / self.mean_free_path

    @property
    def extinction(self) -> float:
        """sigma_t = 1 / mean_free_path, per unit length."""
        return 1 / self.mean_free_path


class VoxelGrid(Value):
    """A box of voxels, each with its own density and material; index-matched, in space or in flatland.

    Parameters
    ----------
    lower, upper
        float64[3] or float64[2], opposite corners.
    extinction
        sigma_t of each voxel, per unit length, at least 0: float64[nz, ny, nx] or float64[nz, nx] (array axes run
        against the order of coordinates: the last one is x).
    albedo
        Of each voxel, or one number for all.
    material
        Number of each voxel's scatterer, from 0; by default all are the first.
    scatterers
        The materials.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> extinction = np.full((4, 8, 8), 0.1)  # [z, y, x], per unit length
    >>> extinction[:2] = 0.0
    >>> corners = [-40, -40, 0], [40, 40, 40]
    >>> cloud = sg.VoxelGrid(lower=corners[0], upper=corners[1], extinction=extinction, scatterers=[sg.Isotropic()])
    >>> round(cloud.optical_depth, 3)
    2.0
    """

    type: Literal["VoxelGrid"] = "VoxelGrid"
    lower: Array
    upper: Array
    extinction: Array
    albedo: Array = Field(default_factory=lambda: np.ones(()), validate_default=True)
    material: Array = Field(default_factory=lambda: np.zeros(()), validate_default=True)
    scatterers: tuple[AnyScatterer, ...]

    @model_validator(mode="after")
    def _check(self) -> Self:
        _require_corners("VoxelGrid", self.lower, self.upper)
        shape = self.extinction.shape
        if len(shape) != len(self.lower) or not self.extinction.size:
            reject("VoxelGrid.extinction", f"an array of {len(self.lower)} axes, none of them empty", shape)
        if (self.extinction < 0).any():
            reject("VoxelGrid.extinction", "at least 0 everywhere", float(self.extinction.min()))
        for name in ("albedo", "material"):
            if getattr(self, name).shape not in ((), shape):
                reject(f"VoxelGrid.{name}", f"one number, or of extinction's shape {shape}", getattr(self, name).shape)
        if (self.albedo < 0).any() or (self.albedo > 1).any():
            reject("VoxelGrid.albedo", "between 0 and 1 everywhere", self.albedo)
        if not self.scatterers:
            reject("VoxelGrid.scatterers", "at least one scatterer", self.scatterers)
        known = np.isin(self.material, np.arange(len(self.scatterers)))
        if not known.all():
            reject(
                "VoxelGrid.material",
                f"whole numbers from 0 to {len(self.scatterers) - 1}, one for each scatterer",
                float(np.atleast_1d(self.material)[~np.atleast_1d(known)][0]),
            )
        return self

    @property
    def thickness(self) -> float:
        """Length along the optical axis."""
        return float(self.upper[-1] - self.lower[-1])

    @property
    def optical_depth(self) -> float:
        """OD of the densest straight line along the optical axis."""
        return float(self.extinction.sum(axis=0).max() * self.thickness / self.extinction.shape[0])

    @property
    def mean_free_path(self) -> float:
        """1 / sigma_t of the densest voxel; infinite where all are empty."""
        densest = float(self.extinction.max())
        return 1 / densest if densest > 0 else np.inf


def _require_density(owner: str, mean_free_path: float) -> None:
    if mean_free_path < 1 / np.finfo(np.float64).max:
        reject(f"{owner}.mean_free_path", "large enough that its inverse is finite", mean_free_path)


def _require_corners(owner: str, lower: np.ndarray, upper: np.ndarray) -> None:
    for name, corner in (("lower", lower), ("upper", upper)):
        if position_vectors(f"{owner}.{name}", corner).ndim != 1:
            reject(f"{owner}.{name}", "one corner, of length 2 or 3", corner.shape)
    if lower.shape != upper.shape:
        reject(f"{owner}.upper", f"of as many coordinates as lower ({len(lower)})", upper)
    if not (lower < upper).all():
        reject(f"{owner}.upper", f"above lower = {lower} along every axis", upper)


Medium = Annotated[Slab | Box | VoxelGrid, Field(discriminator="type")]
"""Scatterers in a volume."""

AnyMedium = Annotated[
    Slab | Box | VoxelGrid | PhaseScreen | GroundGlass | ScreenStack, Field(discriminator="type")
]
"""What a scene may hold: a volume, or thin screens."""
