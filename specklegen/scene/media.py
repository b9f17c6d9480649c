"""Media: where the scatterers are and how dense."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    Discriminator,
    Field,
    Tag,
    field_validator,
    model_validator,
)

from specklegen.core.errors import reject
from specklegen.core.units import INVERSE_LENGTH, LENGTH
from specklegen.core.values import Array, NonNegative, Positive, UnitInterval, position_vectors
from specklegen.scene.faces import Faces
from specklegen.scene.layers import (
    AnyStratified,
    Bulk,
    Layer,
    PlaneParallel,
    Stratified,
    is_stratified,
    merged,
    require_still_faces,
)
from specklegen.scene.motion import AnyMotion, Motion, fastest
from specklegen.scene.polarisation import Polarisation, require_polarised
from specklegen.scene.scatterers import AnyScatterer
from specklegen.scene.screens import GroundGlass, PhaseScreen, ScreenStack


class _Bounded(Bulk):
    """A medium between two corners, its index that of what is around."""

    has_sides: ClassVar[bool] = True
    refracts: ClassVar[bool] = False
    indices: ClassVar[tuple[float, ...]] = ()

    if TYPE_CHECKING:  # fields stand where they are written
        lower: Array
        upper: Array

    @property
    def faces(self) -> Faces:
        """Faces that do nothing."""
        return Faces()

    @property
    def dimension(self) -> int | None:
        """2 in flatland, 3 in space."""
        return len(self.lower)

    @property
    def voxel_counts(self) -> tuple[int, ...]:
        """Voxels along each coordinate."""
        return (1,) * len(self.lower)

    @property
    def thickness(self) -> float:
        """Length along the optical axis."""
        return float(self.upper[-1] - self.lower[-1])

    @property
    def narrowest(self) -> float:
        """Shortest side."""
        return float(np.min(self.upper - self.lower))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[n, d] are inside, bool[n]."""
        return np.asarray(((points >= self.lower) & (points <= self.upper)).all(axis=1))


class Slab(PlaneParallel):
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
    motion
        How the particles move (:class:`Brownian`, or a :class:`Motion` of one's own); by default they are at rest.
    polarisation
        "scalar": light has none. "projector": every scattering takes away what of the field lies along the new
        direction, as particles of low contrast do, whose phase function is otherwise kept. "vector": by the particles'
        own amplitudes S1 and S2 (:class:`Mie`, :class:`Rayleigh`). Known to :func:`memory_effect`,
        :func:`temporal_correlation`, :func:`mueller_matrix` and scenes with ``polarisers``; all else refuses it.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> slab.optical_depth, round(slab.transport_length)
    (10.0, 1000)
    """

    type: Literal["Slab"] = "Slab"
    thickness: Annotated[NonNegative, LENGTH]
    mean_free_path: Annotated[Positive, LENGTH]
    albedo: UnitInterval = 1.0
    scatterer: AnyScatterer
    faces: Faces = Faces()
    motion: AnyMotion | None = None
    polarisation: Polarisation = "scalar"

    @model_validator(mode="after")
    def _check(self) -> Self:
        _require_density("Slab", self.mean_free_path)
        require_still_faces(self, "Slab")
        require_polarised("Slab", self.polarisation, self.scatterer, self.faces, self.motion)
        return self

    @property
    def optical_depth(self) -> float:
        """OD = thickness / mean_free_path: mean number of collisions straight through."""
        return self.thickness / self.mean_free_path

    @property
    def layers(self) -> tuple[Layer, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The slab as one layer; none without a thickness."""
        if self.thickness == 0:
            return ()
        return (
            Layer(
                thickness=self.thickness, mean_free_path=self.mean_free_path, albedo=self.albedo,
                scatterer=self.scatterer, motion=self.motion,
            ),
        )  # fmt: skip

    @property
    def scatterers(self) -> tuple[AnyScatterer, ...]:
        """The one scatterer, as a medium of several lists its own."""
        return (self.scatterer,)

    @property
    def motions(self) -> tuple[Motion | None, ...]:
        """The one motion."""
        return (self.motion,)

    @property
    def transport_length(self) -> float:
        """l* = mean_free_path / (1 - g): distance over which a path forgets its direction."""
        return self.mean_free_path / (1 - self.scatterer.mean_cosine())


PlaneMedium = Slab | Stratified
"""Whatever lies between two planes: what functions take that serve a slab and layers alike."""


def as_slab(medium: PlaneMedium) -> Slab | None:
    """Return the slab that a plane-parallel medium is, where all its layers are alike; None where they are not.

    Nor where they have another index than the one in which wavelengths are measured.
    """
    if isinstance(medium, Slab):
        return medium
    if medium.indices:
        return None
    layers = merged(medium.layers)
    if len(layers) > 1:
        return None
    (one,) = layers
    return Slab(thickness=one.thickness, mean_free_path=one.mean_free_path, albedo=one.albedo, scatterer=one.scatterer,
                faces=medium.faces, motion=one.motion, polarisation=medium.polarisation)  # fmt: skip


class Box(_Bounded):
    """A homogeneous, index-matched, axis-parallel box, in space or in flatland.

    Parameters
    ----------
    lower, upper
        float64[3] or float64[2], opposite corners; the last axis is the optical axis.
    mean_free_path
        1 / sigma_t, the mean distance between collisions, in the unit of the corners.
    albedo
        Share of collisions that scatter; the rest absorb. 1 by default: nothing is absorbed.
    scatterer
        What one particle does with the light that it scatters.
    motion
        How the particles move (:class:`Brownian`, or a :class:`Motion` of one's own); by default they are at rest.
    polarisation
        As of a :class:`Slab`, in space; known to scenes with ``polarisers``.

    Examples
    --------
    >>> import specklegen as sg
    >>> box = sg.media.Box(lower=[-50, -50, 0], upper=[50, 50, 20], mean_free_path=10.0, scatterer=sg.media.Isotropic())
    >>> box.thickness, box.optical_depth
    (20.0, 2.0)
    """

    type: Literal["Box"] = "Box"
    lower: Annotated[Array, LENGTH]
    upper: Annotated[Array, LENGTH]
    mean_free_path: Annotated[Positive, LENGTH]
    albedo: UnitInterval = 1.0
    scatterer: AnyScatterer
    motion: AnyMotion | None = None
    polarisation: Polarisation = "scalar"

    @model_validator(mode="after")
    def _check(self) -> Self:
        _require_corners("Box", self.lower, self.upper)
        _require_density("Box", self.mean_free_path)
        _require_polarised(self)
        return self

    @property
    def motions(self) -> tuple[Motion | None, ...]:
        """The one motion."""
        return (self.motion,)

    @property
    def scatterers(self) -> tuple[AnyScatterer, ...]:
        """The one scatterer, as a medium of several lists its own."""
        return (self.scatterer,)

    @property
    def optical_depth(self) -> float:
        """OD along the optical axis."""
        return self.thickness / self.mean_free_path

    @property
    def extinction(self) -> float:
        """sigma_t = 1 / mean_free_path, per unit length."""
        return 1 / self.mean_free_path


class VoxelGrid(_Bounded):
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
    motion
        How all particles move, or a motion for each material, None of one at rest; by default all are.
    polarisation
        As of a :class:`Slab`, in space; known to scenes with ``polarisers``.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> extinction = np.full((4, 8, 8), 0.1)  # [z, y, x], per unit length
    >>> extinction[:2] = 0.0
    >>> corners = [-40, -40, 0], [40, 40, 40]
    >>> cloud = sg.media.VoxelGrid(lower=corners[0], upper=corners[1], extinction=extinction,
    ...                            scatterers=[sg.media.Isotropic()])
    >>> round(cloud.optical_depth, 3)
    2.0
    """

    homogeneous: ClassVar[bool] = False
    type: Literal["VoxelGrid"] = "VoxelGrid"
    lower: Annotated[Array, LENGTH]
    upper: Annotated[Array, LENGTH]
    extinction: Annotated[Array, INVERSE_LENGTH]
    albedo: Array = Field(default_factory=lambda: np.ones(()), validate_default=True)
    material: Array = Field(default_factory=lambda: np.zeros(()), validate_default=True)
    scatterers: tuple[AnyScatterer, ...]
    motion: AnyMotion | tuple[AnyMotion | None, ...] | None = None
    polarisation: Polarisation = "scalar"

    @field_validator("motion", mode="before")
    @classmethod
    def _at_rest(cls, given: Any) -> Any:
        """Read an empty table, which TOML has for a material at rest."""
        return [None if each == {} else each for each in given] if isinstance(given, list) else given

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
                reject(f"VoxelGrid.{name}", f"one number, or an array of extinction's shape {shape}",
                       getattr(self, name).shape)
        if (self.albedo < 0).any() or (self.albedo > 1).any():
            reject("VoxelGrid.albedo", "between 0 and 1 everywhere", self.albedo)
        if not self.scatterers:
            reject("VoxelGrid.scatterers", "at least one scatterer", self.scatterers)
        known = np.isin(self.material, np.arange(len(self.scatterers)))
        if not known.all():
            reject("VoxelGrid.material", f"whole numbers from 0 to {len(self.scatterers) - 1}, one for each scatterer",
                   float(np.atleast_1d(self.material)[~np.atleast_1d(known)][0]))  # fmt: skip
        if isinstance(self.motion, tuple) and len(self.motion) != len(self.scatterers):
            reject("VoxelGrid.motion", f"one for all, or one for each of {len(self.scatterers)} scatterers",
                   len(self.motion))  # fmt: skip
        fastest(self.motions)  # laws that are no factor apart are refused
        _require_polarised(self)
        return self

    @property
    def motions(self) -> tuple[Motion | None, ...]:
        """Motion of every material."""
        return self.motion if isinstance(self.motion, tuple) else (self.motion,) * len(self.scatterers)

    @property
    def optical_depth(self) -> float:
        """OD of the densest straight line along the optical axis."""
        return float(self.extinction.sum(axis=0).max() * self.thickness / self.extinction.shape[0])

    @property
    def voxel_counts(self) -> tuple[int, ...]:
        """Voxels along each coordinate."""
        return self.extinction.shape[::-1]

    @property
    def mean_free_path(self) -> float:
        """1 / sigma_t of the densest voxel; infinite where all are empty."""
        densest = float(self.extinction.max())
        return 1 / densest if densest > 0 else np.inf


def _require_density(owner: str, mean_free_path: float) -> None:
    if mean_free_path < 1 / np.finfo(np.float64).max:
        reject(f"{owner}.mean_free_path", "large enough that its inverse is finite", mean_free_path)


def _require_polarised(medium: Box | VoxelGrid) -> None:
    """Refuse polarised light in flatland, and particles and motions that it is not known for."""
    if medium.polarisation != "scalar" and medium.dimension == 2:
        reject(f"{medium.type}.polarisation", '"scalar" in flatland', medium.polarisation,
               "Give the corners three coordinates: there the field has one component.")  # fmt: skip
    for scatterer, motion in zip(medium.scatterers, medium.motions, strict=True):
        require_polarised(medium.type, medium.polarisation, scatterer, medium.faces, motion)


def _require_corners(owner: str, lower: np.ndarray, upper: np.ndarray) -> None:
    for name, corner in (("lower", lower), ("upper", upper)):
        if position_vectors(f"{owner}.{name}", corner).ndim != 1:
            reject(f"{owner}.{name}", "one corner, of length 2 or 3", corner.shape)
    if lower.shape != upper.shape:
        reject(f"{owner}.upper", f"of as many coordinates as lower ({len(lower)})", upper)
    if not (lower < upper).all():
        reject(f"{owner}.upper", f"above lower = {lower} along every axis", upper)


def _tag(value: Any) -> Any:
    """Type by which a medium is read, one for all of layers."""
    if is_stratified(value):
        return "Layers"
    return value.get("type") if isinstance(value, Mapping) else getattr(value, "type", None)


Medium = Annotated[
    Annotated[Slab, Tag("Slab")]
    | Annotated[Box, Tag("Box")]
    | Annotated[VoxelGrid, Tag("VoxelGrid")]
    | Annotated[AnyStratified, Tag("Layers")],
    Discriminator(_tag),
]
"""Scatterers in a volume."""


def require_medium(field: str, medium: object, remedy: str) -> Medium:
    """Return a medium of scatterers in a volume."""
    if not isinstance(medium, PlaneParallel | Box | VoxelGrid):
        reject(field, "a Slab, Layers, a Box or a VoxelGrid", medium, remedy)
    return medium  # type: ignore[return-value]


AnyMedium = Annotated[
    Annotated[Slab, Tag("Slab")]
    | Annotated[Box, Tag("Box")]
    | Annotated[VoxelGrid, Tag("VoxelGrid")]
    | Annotated[AnyStratified, Tag("Layers")]
    | Annotated[PhaseScreen, Tag("PhaseScreen")]
    | Annotated[GroundGlass, Tag("GroundGlass")]
    | Annotated[ScreenStack, Tag("ScreenStack")],
    Discriminator(_tag),
]
"""What a scene may hold: a volume, or thin screens."""
