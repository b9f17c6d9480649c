"""Interface of a scatterer: a phase function with an amplitude, and the row of numbers that the kernels read.

A particle has an amplitude s(cos theta), complex in general, with the integral of ``|s|^2`` over all directions equal
to 1; its phase function is ``|s|^2``. A family of particles is one class, and a family of one's own needs no more than
its amplitude:

    class Screened(sg.media.Scatterer):
        concentration: float

        def shape(self, cos, dimensions=3):
            return 1 / (1 + self.concentration * (1 - cos))

It is then a scatterer everywhere: in every sampler, in recipes by ``type = "Screened"``, in stores.
"""

import json
import math
from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, SerializeAsAny, WithJsonSchema

from specklegen.core.content import Admitted, content_digest
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.registry import imported, is_import_path

Dimensions = Literal[2, 3]

_TYPES: dict[str, type["Scatterer"]] = {}


def all_directions(dimensions: Dimensions) -> float:
    """Measure of all directions: 4 pi in three dimensions, 2 pi in flatland."""
    if dimensions not in (2, 3):
        reject("dimensions", "2 or 3", dimensions)
    return 2 * math.pi * (dimensions - 1)


class Row(NamedTuple):
    """A type of particle as the kernels read it.

    Attributes
    ----------
    kind : "isotropic", "henyey", "fisher" or "tabulated"
        Form of the amplitude (:mod:`specklegen.kernels.phase_table`).
    parameters : (float, float)
        Of a closed form.
    nodes, amplitudes, cumulative : float64[n], complex128[n], float64[n]
        Angles theta, s there, and the share of |s|^2 below; empty where the form is closed.
    """

    kind: Literal["isotropic", "henyey", "fisher", "tabulated"]
    parameters: tuple[float, float] = (0.0, 0.0)
    nodes: np.ndarray = np.empty(0)
    amplitudes: np.ndarray = np.empty(0, np.complex128)
    cumulative: np.ndarray = np.empty(0)


class Scatterer(Admitted, Pictured):
    """A type of particle, or several. Subclass it for a phase function of your own.

    A subclass is a frozen value with fields of its own and one method, ``shape(cos, dimensions)``: the amplitude, real
    or complex, up to a factor, at cosines of the scattering angle float64[...]. The name of the class is its ``type``;
    what it is known by, in fingerprints, seals and caches, is the SHA-256 of its tabulated amplitude. The table is made
    once for a value, and a later change of what ``shape`` looks up makes other values, not this one.

    Examples
    --------
    >>> import specklegen as sg
    >>> class Forward(sg.media.Scatterer):
    ...     power: float
    ...     def shape(self, cos, dimensions):
    ...         return (1 + cos) ** self.power
    >>> round(Forward(power=2.0).mean_cosine(3), 3)
    0.667
    """

    type: Any = None

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if cls.__name__.startswith("_"):
            return
        known = _TYPES.get(cls.__name__)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            reject("Scatterer name", "unique among scatterers", cls.__name__, f"{known.__module__} has the same name.")
        _TYPES[cls.__name__] = cls
        field = cls.model_fields["type"]
        if field.default is None:
            field.default = cls.__name__
            cls.model_rebuild(force=True)

    def _facts(self) -> Mapping[str, object]:
        own = {name: getattr(self, name) for name in type(self).model_fields if name != "type"}
        return own | {"mean cosine": self.mean_cosine()}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """The phase function |s|^2 in space, per steradian, over the scattering angle."""
        angles = np.linspace(0, np.pi, 721)
        power = sum(share * np.abs(each.amplitude(np.cos(angles))) ** 2 for each, share in self.components)
        draw_curve(axes, np.rad2deg(angles), power, label=label, fmt="-", xlabel="scattering angle, degrees",
                   ylabel="phase function, 1 / sr", yscale="log")  # fmt: skip

    def shape(self, cos: np.ndarray, dimensions: Dimensions = 3) -> np.ndarray:
        """Amplitude at cosines float64[...], real or complex, up to a factor: what a subclass says."""
        raise NotImplementedError(f"{type(self).__name__} must define its amplitude: shape(self, cos, dimensions)")

    def mean_cosine(self, dimensions: Dimensions = 3) -> float:
        """Mean cosine of the scattering angle, in 3D or in flatland."""
        return self._table(dimensions).mean_cosine(dimensions)

    def amplitude(self, cos: np.ndarray | float, dimensions: Dimensions = 3) -> np.ndarray:
        """Scattering amplitude s, per root steradian (root radian in 2D), at the cosine of the scattering angle."""
        return self._table(dimensions).amplitude(cos, dimensions)

    def row(self, dimensions: Dimensions) -> Row:
        """Return what the kernels read of it, in three dimensions or in flatland."""
        return self._table(dimensions).row(dimensions)

    def amplitude_matrix(self, cos: np.ndarray | float) -> np.ndarray:
        """Amplitudes S1 (of fields across the plane of scattering) and S2 (along it), complex128[2, ...], of a sphere.

        At cosines of the scattering angle, per root steradian, in three dimensions: ``|s|^2 = (|S1|^2 + |S2|^2) / 2``.
        A class of one's own may define it, up to a factor; a medium of polarisation "vector" then takes it.

        Raises
        ------
        RuleError
            Of particles of which only the scalar amplitude is known.
        """
        reject(f"{self.type}.amplitude_matrix", "computed for Mie or Rayleigh particles", self.type,
               'For this class use polarisation = "projector".')  # fmt: skip

    def exact_amplitude(self, theta: np.ndarray) -> np.ndarray:
        """Amplitude s, per root steradian, at the scattering angle, without a table where there is a formula."""
        return self.amplitude(np.cos(theta))

    @property
    def made_for(self) -> float | None:
        """Wavelength inside the medium that the particles are made for; None of those of any wavelength."""
        return None

    @property
    def has_matrix(self) -> bool:
        """True if its amplitudes S1 and S2 are known."""
        return type(self).amplitude_matrix is not Scatterer.amplitude_matrix

    @property
    def components(self) -> tuple[tuple["Scatterer", float], ...]:
        """Types of particle, and their shares of sigma_s."""
        return ((self, 1.0),)

    def content(self) -> object:
        """Return what the kernels read of it: in three dimensions, and in flatland where it has a meaning there."""
        kept = self._kept
        if "content" not in kept:
            read = [_read_by_kernels(self, 3), _read_by_kernels(self, 2)]
            if self.has_matrix:
                read.append(_to_9_digits(self.amplitude_matrix(np.cos(np.linspace(0, np.pi, 1001)))))
            kept["content"] = content_digest(*read)
        return kept["content"]

    def _table(self, dimensions: Dimensions):
        """Amplitude of a scatterer of somebody's own, linear in theta between nodes as close as it asks for."""
        all_directions(dimensions)
        kept = self._kept
        if "tables" not in kept:  # both at once: what the amplitude looks up may be another later
            kept["tables"] = {3: _tabulated(self, 3), 2: _tabulated(self, 2)}
        found = kept["tables"][dimensions]
        if isinstance(found, Exception):
            raise found
        return found

    @cached_property
    def _kept(self) -> dict[str, Any]:
        kind: Any = type(self)
        return _memo(kind, json.dumps(self.model_dump(mode="json"), sort_keys=True), content_digest(kind))


class _WithAnisotropy(Scatterer):
    """A scatterer whose g follows from its amplitude; Henyey and Greenstein's has it as a field."""

    @property
    def g(self) -> float:
        """Anisotropy: mean cosine of the scattering angle in 3D."""
        return self.mean_cosine(3)


@lru_cache(32)
def _memo(kind: type[Scatterer], fields: str, code: str) -> dict[str, Any]:  # noqa: ARG001
    """Cached facts of scatterers of one class with these numbers and this code, to be filled in."""
    return {}


def _tabulated(scatterer: Scatterer, dimensions: Dimensions) -> Any:
    """Table of an amplitude, or why there is none."""
    from specklegen.scene.scatterers.tabulated import tabulated

    try:
        return tabulated(lambda theta: scatterer.shape(np.cos(theta), dimensions), type(scatterer).__name__)
    except Exception as error:  # noqa: BLE001, raised where the table is asked for
        return error


def _read_by_kernels(scatterer: Scatterer, dimensions: Dimensions) -> object:
    """Rows of all components with their shares, to 9 digits: the last ones are another processor's."""
    try:
        rows = [(each.row(dimensions), share) for each, share in scatterer.components]
    except Exception:
        if dimensions == 3:
            raise
        return None
    return [(row.kind, row.parameters, *map(_to_9_digits, row[2:]), share) for row, share in rows]


def _to_9_digits(table: np.ndarray) -> np.ndarray:
    """Numbers, complex or not, to 9 digits each, as real ones; what is below 1e-12 of the largest is 0."""
    parts = np.stack([table.real, table.imag])
    digits, exponent = np.frexp(np.where(np.abs(parts) < 1e-12 * np.abs(parts).max(initial=0.0), 0.0, parts))
    return np.ldexp(np.round(digits * 2.0**30), exponent - 30) + 0.0


def _read(value: Any) -> Any:
    if isinstance(value, Scatterer):
        # A mixture of one type is that type, to its bits and its fingerprint.
        return value.components[0][0] if len(value.components) == 1 else value
    if not isinstance(value, Mapping):
        raise ValueError("a scatterer")
    name = value.get("type")
    if is_import_path(name):
        name = imported("Scatterer.type", str(name)).__name__
    if not isinstance(name, str) or name not in _TYPES:
        raise ValueError(
            f"of a known type ({', '.join(sorted(_TYPES))}); import the module of your own type first"
        )
    return _read(_TYPES[name](**{**value, "type": name}))


AnyScatterer = Annotated[
    SerializeAsAny[Scatterer],
    BeforeValidator(_read),
    WithJsonSchema({"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}),
]
"""A scatterer of any family, written with its type."""


def scatterer_class(name: str) -> type[Scatterer]:
    """Return the class of a type of scatterer known here."""
    return _TYPES[name]
