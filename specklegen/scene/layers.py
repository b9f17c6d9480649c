"""Plane-parallel media: everything between two planes, of layers that may differ.

A medium of one's own between two planes needs one thing, what its layers are:

    class Graded(sg.media.Stratified):
        thickness: float
        top: float
        bottom: float

        @property
        def layers(self):
            paths = np.geomspace(self.top, self.bottom, 32)
            return [sg.media.Layer(thickness=self.thickness / 32, mean_free_path=path, scatterer=...) for path in paths]

It is then a medium everywhere: in scenes, in every sampler, in the memory effect, in files by ``type = "Graded"``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import (
    Field,
    model_validator,
)

from specklegen.core.errors import reject
from specklegen.core.quantities import nodes_of
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry, is_import_path
from specklegen.core.units import LENGTH
from specklegen.core.values import Positive, UnitInterval, Value, remembered
from specklegen.scene.faces import Faces, require_index
from specklegen.scene.motion import AnyMotion, Motion, fastest
from specklegen.scene.polarisation import Polarisation, require_polarised
from specklegen.scene.scatterers import AnyScatterer, Mixture, Scatterer
from specklegen.scene.unitless import unitless_fingerprint


class Layer(Value):
    """One layer of a medium, homogeneous.

    Parameters
    ----------
    thickness
        Length along the optical axis (z).
    mean_free_path
        1 / sigma_t, the mean distance between collisions, in the same unit of length.
    albedo
        Share of collisions that scatter; the rest absorb. 1 by default: nothing is absorbed.
    scatterer
        What one particle does with the light that it scatters.
    motion
        How the particles move (:class:`Brownian`, or a :class:`Motion` of one's own); by default they are at rest.
    index
        Its refractive index; left out, that of the medium's ``faces.inside``, as of all neighbours that say none. Where
        two layers differ, the face between them reflects and refracts.

    Examples
    --------
    >>> import specklegen as sg
    >>> sg.media.Layer(thickness=60.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.8)).optical_depth
    3.0
    """

    thickness: Annotated[Positive, LENGTH]
    mean_free_path: Annotated[Positive, LENGTH]
    albedo: UnitInterval = 1.0
    scatterer: AnyScatterer
    motion: AnyMotion | None = None
    index: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.index is not None:
            require_index("Layer.index", self.index)
        return self

    @property
    def optical_depth(self) -> float:
        """OD = thickness / mean_free_path: mean number of collisions straight through."""
        return self.thickness / self.mean_free_path


class Bulk(Value):
    """A medium with particles inside, of any shape; it answers what nobody then has to ask its type for."""

    stack: ClassVar[None] = None
    """Screens in its place: none."""
    homogeneous: ClassVar[bool] = True
    """Whether it is the same everywhere."""
    has_sides: ClassVar[bool]
    """Whether light can leave sideways."""

    @property
    def motions(self) -> tuple[Motion | None, ...]:
        """Motion of every layer or material."""
        return ()

    @property
    def moves(self) -> bool:
        """True if any of its particles does."""
        return self.flows or fastest(self.motions) is not None

    @property
    def flows(self) -> bool:
        """True if any of its particles are carried along."""
        return any(motion is not None and motion.carries for motion in self.motions)


class PlaneParallel(Bulk):
    """A medium between the planes z = 0 and z = thickness, infinite sideways: a slab, or layers. It has ``layers``."""

    has_sides: ClassVar[bool] = False
    dimension: ClassVar[int | None] = None
    voxel_counts: ClassVar[tuple[int, ...]] = (1, 1, 1)

    if TYPE_CHECKING:  # fields stand where they are written
        thickness: float
        mean_free_path: float
        faces: Faces
        layers: Sequence[Layer]

    @property
    def indices(self) -> tuple[float, ...]:
        """Refractive index of each layer, where any has another than ``faces.inside``; else of none."""
        return ()

    @property
    def refracts(self) -> bool:
        """True if light meets a step of the refractive index anywhere."""
        return bool(self.indices) or not self.faces.matched

    @property
    def largest_sine(self) -> float:
        """Direction sine, in the index ``faces.inside``, up to which light crosses all faces."""
        return min(self.faces.largest_sine, min((*self.indices, self.faces.inside)) / self.faces.inside)

    def lag(self, square: np.ndarray) -> np.ndarray:
        """Phase over -k that light of squared sines, in the index ``faces.inside``, gains beside light of the axis.

        Straight through all layers.
        """
        out, inside = np.zeros_like(square), self.faces.inside
        for layer in self.layers:
            ratio = inside / (layer.index or inside)
            out += layer.thickness * ratio * square / (1 + np.sqrt(1 - ratio**2 * square))
        return out

    def require_crossing(self, field: str, directions: np.ndarray) -> None:
        """Refuse directions float64[..., 3] in the index ``faces.inside``, that no light takes on its way in or out."""
        if not self.refracts or not directions.size:
            return
        sine = float(np.hypot(directions[..., 0], directions[..., 1]).max())
        if sine >= self.largest_sine:
            indices = self.faces.indices if not self.indices else (*self.indices, *self.faces.indices[1:])
            reject(field, f"of sines below {self.largest_sine:.4g}, where light crosses the faces of indices {indices}",
                   sine,
                   "These are sines inside the medium (index faces.inside); outside they are larger by the ratio of "
                   "indices.")  # fmt: skip

    @property
    def extinction(self) -> float:
        """sigma_t = 1 / mean_free_path, per unit length; of the densest layer."""
        return 1 / self.mean_free_path

    @property
    def narrowest(self) -> float:
        """Shortest side: the thickness, of the thinnest layer."""
        return self.thickness

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether points float64[n, d] are inside, bool[n]."""
        return (points[:, -1] >= 0) & (points[:, -1] <= self.thickness)

    def unitless_fingerprint(self) -> str:
        """SHA-256 of the medium in units of its thickness (or, without any, of its mean free path)."""
        return unitless_fingerprint(self, self.thickness or self.mean_free_path)


def require_still_faces(medium: PlaneParallel, owner: str) -> None:
    """Refuse a flow between faces that reflect or refract."""
    if medium.flows and medium.refracts:
        reject(f"{owner}.motion", "at rest or random, since its faces reflect", medium.motions,
               "Leave out the flow or the index mismatch.")  # fmt: skip


class Stratified(PlaneParallel, Registered):
    """A medium of plane layers, each of its own density and particles. Subclass it for a medium of your own.

    A subclass is a frozen value with fields of its own and one property, ``layers``: what light meets from z = 0 on.
    The name of the class is its ``type``; what it is known by, in fingerprints and stores, are its layers. One that
    changes steadily is as many thin layers as it takes: the step between two should be small beside what either does to
    light. A field ``faces`` of type :class:`Faces` gives the medium a step of the refractive index at both outer faces;
    layers that say an ``index`` make steps between them.

    What the layers are together follows from them: ``thickness``, ``optical_depth``, ``mean_free_path`` (the shortest),
    ``albedo`` (the mean over collisions straight through) and ``scatterer`` (the mixture of the particles that scatter
    there). A subclass may have fields of these names, if they say the same.

    Examples
    --------
    >>> import specklegen as sg
    >>> class Denser(sg.media.Stratified):
    ...     thickness: float
    ...     @property
    ...     def layers(self):
    ...         paths, share = [20.0, 10.0, 5.0, 2.5], self.thickness / 4
    ...         return [sg.media.Layer(thickness=share, mean_free_path=path, scatterer=sg.media.Isotropic())
    ...                 for path in paths]
    >>> Denser(thickness=40.0).optical_depth
    7.5
    """

    registry: ClassVar = Registry("medium of layers")
    homogeneous: ClassVar[bool] = False
    type: Any = None

    if TYPE_CHECKING:
        optical_depth: float
        albedo: float
        scatterer: Scatterer
        faces: Faces
        polarisation: Polarisation
        layers: Sequence[Layer]

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        if not cls._has("layers") and not cls.__name__.startswith("_"):
            reject(f"{cls.__name__}.layers", "a property, or a field with a sequence of Layer", None)
        super().__pydantic_init_subclass__(**kwargs)
        for name, value in _TOGETHER.items():
            if not cls._has(name):
                setattr(cls, name, property(value))
            elif name in cls.model_fields and name in nodes_of(Layer):  # of the dimension that it has in each layer
                cls.model_fields[name].metadata.append(nodes_of(Layer)[name].dimension)
        if not cls._has("faces"):
            cls.faces = Faces()
        if not cls._has("polarisation"):
            cls.polarisation = "scalar"

    @classmethod
    def _has(cls, name: str) -> bool:
        return name in cls.model_fields or hasattr(cls, name)

    @classmethod
    def is_member(cls) -> bool:
        """Return whether the class says its layers."""
        return super().is_member() and cls._has("layers")

    @model_validator(mode="after")
    def _check(self) -> Self:
        owner, layers = type(self).__name__, list(self.layers)
        if not layers or not all(isinstance(layer, Layer) for layer in layers):
            reject(f"{owner}.layers", "a sequence of at least one Layer", layers)
        for name, value in _TOGETHER.items():
            said = getattr(self, name)
            if name != "scatterer" and not math.isclose(said, value(self), rel_tol=1e-9):
                remedy = "Leave it out, or rename the field."
                reject(f"{owner}.{name}", f"the value of its layers, {value(self):.10g}", said, remedy)
        fastest(self.motions)  # laws that are no factor apart are refused
        require_still_faces(self, owner)
        for layer in layers:
            require_polarised(owner, self.polarisation, layer.scatterer, self.faces, layer.motion)
        if self.polarisation != "scalar" and self.refracts and len(merged(layers)) > 1:
            reject(f"{owner}.{'layers' if self.indices else 'faces'}", "of one index, since light is polarised",
                   self.indices or self.faces,
                   "Use equal indices: for polarised light only a Slab may have faces.")  # fmt: skip
        return self

    def content(self) -> object:
        """Return what decides a medium of a user's own: its layers, and their model of polarised light."""
        return [*self.layers, *([] if self.polarisation == "scalar" else [self.polarisation])]

    @property
    def scatterers(self) -> tuple[Scatterer, ...]:
        """The particles of all layers, each once, in the order in which light meets them."""
        return tuple({layer.scatterer.canonical_json(): layer.scatterer for layer in self.layers}.values())

    @property
    def motions(self) -> tuple[Motion | None, ...]:
        """Motion of every layer."""
        return tuple(layer.motion for layer in self.layers)

    @property
    def narrowest(self) -> float:
        """Thickness of the thinnest layer."""
        return min(layer.thickness for layer in self.layers)

    @property
    def indices(self) -> tuple[float, ...]:
        """Refractive index of each layer, where any has another than ``faces.inside``; else of none."""
        inside = self.faces.inside
        found = tuple(inside if layer.index is None else layer.index for layer in self.layers)
        return () if set(found) == {inside} else found

    @property
    def edges(self) -> np.ndarray:
        """Depths of the faces of all layers, float64[n + 1], 0 first."""
        return np.append(0.0, np.cumsum([layer.thickness for layer in self.layers]))


def _depths(medium: Stratified) -> list[float]:
    return [layer.optical_depth for layer in medium.layers]


def _albedo(medium: Stratified) -> float:
    scattered = [layer.optical_depth * layer.albedo for layer in medium.layers]
    return min(math.fsum(scattered) / math.fsum(_depths(medium)), max(layer.albedo for layer in medium.layers))


@remembered(64)
def _scatterer(medium: Stratified) -> Scatterer:
    """Mixture of the particles of all layers, by how much of the light they scatter straight through."""
    parts = [(each, share * layer.albedo * layer.optical_depth) for layer in medium.layers
             for each, share in layer.scatterer.components]  # fmt: skip
    total = math.fsum(amount for _, amount in parts) or 1.0
    if len(parts) == 1 or not any(amount for _, amount in parts):
        return medium.layers[0].scatterer
    return Mixture(types=[each for each, _ in parts], fractions=[amount / total for _, amount in parts])


_TOGETHER: dict[str, Callable[[Any], Any]] = {
    "thickness": lambda medium: math.fsum(layer.thickness for layer in medium.layers),
    "optical_depth": lambda medium: math.fsum(_depths(medium)),
    "mean_free_path": lambda medium: min(layer.mean_free_path for layer in medium.layers),
    "albedo": _albedo,
    "scatterer": _scatterer,
}
"""What a medium is as a whole, from its layers."""


class Layers(Stratified):
    """Layers one behind the other: skin over fat, skull over brain.

    Parameters
    ----------
    layers
        :class:`Layer` after :class:`Layer`, from the one that light enters first.
    faces
        The step of the refractive index at both outer faces, which layers with an ``index`` of their own have to what
        is outside, of index 1 if nothing is said. Wavelengths and tilts are those in ``faces.inside``, 1 again.
        Path sums, `covariance`, `memory_effect`, `joint_correlation` and `reflectance_transmittance` know all steps,
        path sums also through a lens and at points outside; films and `temporal_correlation` those that are met near
        the axis, in transmission (docs/media.md). Polarised light and light of a band refuse them.
    polarisation
        What the particles of all layers do to polarised light. "scalar": light has none. "projector": every scattering
        takes away what of the field lies along the new direction. "vector": by the particles' own amplitudes
        (:class:`Mie`, :class:`Rayleigh`).

    Examples
    --------
    >>> import specklegen as sg
    >>> skin = sg.media.Layer(thickness=100.0, mean_free_path=25.0, scatterer=sg.media.HenyeyGreenstein(0.8))
    >>> fat = sg.media.Layer(thickness=900.0, mean_free_path=90.0, albedo=0.99,
    ...                      scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> both = sg.Layers(layers=[skin, fat])
    >>> both.thickness, both.optical_depth, both.edges
    (1000.0, 14.0, array([   0.,  100., 1000.]))
    """

    layers: tuple[Layer, ...] = Field(min_length=1, kw_only=False)  # type: ignore[assignment]
    faces: Faces = Faces()
    polarisation: Polarisation = "scalar"

def merged(layers: Sequence[Layer]) -> list[Layer]:
    """Layers with neighbours of one kind made one."""

    def kind(layer: Layer) -> tuple:
        moving = layer.motion and layer.motion.canonical_json()
        return layer.mean_free_path, layer.albedo, layer.scatterer.canonical_json(), moving, layer.index

    alike = (list(group) for _, group in groupby(layers, kind))
    return [group[0].replace(thickness=math.fsum(layer.thickness for layer in group)) for group in alike]


def is_stratified(value: Any) -> bool:
    """Return whether a value is, or describes, a medium of layers."""
    if not isinstance(value, Mapping):
        return isinstance(value, Stratified)
    return value.get("type") in Stratified.registry or is_import_path(value.get("type"))


AnyStratified = Annotated[Stratified, *member_of(Stratified)]
"""A medium of layers of any type, written with its type."""
