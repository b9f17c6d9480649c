"""Interface of a sampler for planning and rendering.

Every sampler is a room of its own: it says whether it may serve a scene and why not (its rule), what it would cost, and
how it draws. The planner asks each, folds the decisions, and obeys the cheapest that may; nothing else knows which
sampler it is. A new one is a subclass of :class:`Sampler`, known by its name from its definition on.

    Sampler.obstacles(scene)        -> why it cannot draw the scene at all
    Sampler.propose(scene, request) -> the sampler dimensioned for the scene
        .cost(), .memory(threads)   -> what it takes
        .prepare(seed, threads)     -> Renderer -- media   --> Realization of the scene's own light
    MediaSampler
        .prepare_media(request)     -> Imager   -- media   --> Media -- images, superposed --> images of any light
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, NoReturn, Protocol, Self

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.nanoseconds import Cost
from specklegen.core.random_streams import Seed
from specklegen.core.registry import Registry
from specklegen.paths.gaussianity import EXACT, PathMoments
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    import torch

    from specklegen.instrument.lens import Lens
    from specklegen.scene.media import Slab
    from specklegen.scene.screens import ScreenStack
    from specklegen.synthesis.coherent import WaveGrid
    from specklegen.synthesis.correlations import Correlations, FilmBatch, LightBatch, Places
    from specklegen.synthesis.sight import Sight
    from specklegen.synthesis.streams import Streams

Where = tuple[slice, slice, slice]
"""Tilts, rows and columns of a piece in its stack."""

TORCH_BYTES = 197 * 2**20  # what importing torch takes
FIXED_BYTES = 58 * 2**20  # what compiled kernels, libraries and the plan itself take at the first render
RECORD_BYTES = 14 * 8 + 28  # of a connection
TILTS_STREAMED = 16  # whose fields on one tile are held at a time where a stack comes piece by piece

LEAST_FLOAT32, MOST_FLOAT32 = 1e-34, 1e35
"""Mean intensities that float32 holds with their dark grains and bright ones."""


@dataclass(frozen=True)
class Request:
    """Request to the sampler of a scene.

    Attributes
    ----------
    paths : int or None
        Paths a realization; None leaves them to ``rel_error`` or the default.
    rel_error : float or None
        Error of intensity correlations that a finite number of paths may leave.
    reverse : bool
        Whether reversed paths take part.
    tolerance : float
        Error within which a sampler must be.
    field_tolerance : float
        Relative error of fields against their direct sum.
    asked : str
        Name of the sampler that must serve, or "auto".
    streamed : bool
        Whether the stack comes piece by piece.
    envelope : bool
        Whether fields may be drawn under an envelope that turns with the tilt.
    merged : bool
        Whether images may be drawn under the mean envelope of an object, where not under that of each of its pixels.
    realizations : int
        Media that will be drawn, over which what is found once is shared.
    thorough : bool
        Whether more pilot paths are worth their time, where a first pilot leaves open whether a sampler serves.
    beside : float
        Error that another sampler states, which would serve instead: one that states less may, within the tolerance or
        not.
    walked : bool
        Whether light walks from its window on the entrance face to the exit plane, as that of coherent objects does.
    """

    paths: int | None
    rel_error: float | None
    reverse: bool
    tolerance: float
    field_tolerance: float = 1e-3
    asked: str = "auto"
    streamed: bool = False
    envelope: bool = True
    realizations: int = 1
    thorough: bool = True
    beside: float = 0.0
    walked: bool = False
    merged: bool = False

    def paths_by(self, moments: PathMoments, within_image: bool = False) -> int:
        """Return the paths asked for: their number, or those of the error by a pilot's moments, or the default."""
        if self.paths is not None:
            return self.paths
        return DEFAULT_PATHS if self.rel_error is None else moments.paths_for(self.rel_error, within_image=within_image)


class Realization(NamedTuple):
    """One medium: fields complex64[T, *sensor], or images float32[..., *sensor] of light without a field; its paths.

    Those are the one image [*sensor] of an incoherent object, or one an exposure, [T, *sensor].
    """

    image: np.ndarray
    connections: int = 0
    unfinished: int = 0


class Renderer(Protocol):
    """A sampler made ready under a seed: what is found once is found."""

    def media(self, count: int) -> Iterator[Realization]:
        """Media 0, 1, ..., in their order, under the scene's own light."""
        ...

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Fields of one medium piece by piece, complex64[t, h, w]: together the stack of :meth:`media`."""
        ...


class Media(Protocol):
    """B media as they were drawn, to be looked through by any light."""

    def __len__(self) -> int:
        """Number of media, B."""
        ...

    def images(self, light: "torch.Tensor") -> "torch.Tensor":
        """Images over their expected value, real[B, T or F, H, W], of objects real[B, h, w]."""
        ...

    def superposed(self, amplitudes: "torch.Tensor", step: float) -> "torch.Tensor":
        """Images of beams complex[B, h, w] that interfere, over their mean over media, real[B, 1, H, W]."""
        ...


class Imager(Protocol):
    """Media made ready that share all that is found once; which of them is drawn, random streams say."""

    def __len__(self) -> int:
        """Number of media, or 1 where all are alike."""
        ...

    def at(self, places: "Places") -> "Imager":
        """Return the renderers of some of the media."""
        ...

    def media(self, streams: "Streams") -> Media:
        """Draw media."""
        ...

    def contrast(self, light: "torch.Tensor", media: "Places" = ...) -> "torch.Tensor":
        """Expected contrast float64[B] of images of objects real[B, h, w] under polarised light."""
        ...


class Contrast(Protocol):
    """Predictor of the contrast of images before they are made."""

    def contrast(self, light: "torch.Tensor") -> "torch.Tensor":
        """Expected contrast float64[B] of images of objects real[B, h, w] under polarised light."""
        ...


class Waves(NamedTuple):
    """Plane waves of coherent objects before media.

    Attributes
    ----------
    grid : WaveGrid
    divisions : int
        Views across a camera pixel.
    ballistic : bool
        Whether light that is not scattered reaches the camera.
    """

    grid: "WaveGrid"
    divisions: int
    ballistic: bool


@dataclass(frozen=True)
class MediaRequest:
    """M media that objects are looked at through, all asked of a sampler at once.

    Attributes
    ----------
    sight : Sight
        Windows, beams and cameras.
    correlations : Correlations
        Memory effect of each.
    light : LightBatch or None
        Modes of the light; None of one.
    tolerance : float
        Share of the intensity that modes may leave out.
    media : tuple of function
        Each makes the medium of the engine.
    moved : float64[M, T, S, 2] or None
        How far each of S screens has moved at every base tilt.
    units : float64[M]
        Expected intensity of a beam of brightness 1, at one view.
    shared : bool
        Whether many objects look through each medium.
    contrast : Contrast or None
        What tells the contrast of images, where the memory effect does not.
    film : FilmBatch or None
        Memory effect in time, of media that move: asked of samplers that say ``films``.
    planes : tuple of Lens
        Of a camera with a lens: for each plane in focus one, all over the directions of the medium's scene.
    imager : Imager or None
        What draws the one medium, where its recipe has found that from the medium's paths already.
    waves : Waves or None
        Of coherent objects: plane waves whose fields add.
    """

    sight: "Sight"
    correlations: "Correlations"
    light: "LightBatch | None"
    tolerance: float
    media: "tuple[Callable[[], Slab | ScreenStack], ...]"
    units: "torch.Tensor"
    moved: "torch.Tensor | None" = None
    shared: bool = False
    contrast: "Contrast | None" = None
    film: "FilmBatch | None" = None
    planes: "tuple[Lens, ...]" = ()
    imager: "Imager | None" = None
    waves: "Waves | None" = None


@dataclass(frozen=True)
class Abilities:
    """Abilities of a sampler, independent of the scene.

    Attributes
    ----------
    media : "volumes", "thin" or "any"
        Whether it draws volumes of scatterers, thin screens, or both.
    medium_by_medium : bool
        Whether it is planned for the scene of each medium with every beam, not once for all media of a recipe.
    lens : "none", "origin" or "face"
        Whether phases of its fields at many views are those that a lens needs (:mod:`specklegen.instrument.lens`), and
        whence they are counted: from z = 0, or from the face where light leaves, as if it came from there.
    films : bool
        Whether :meth:`MediaSampler.prepare_media` knows the frames of media that move (``MediaRequest.film``).
    """

    media: Literal["volumes", "thin", "any"] = "any"
    medium_by_medium: bool = False
    lens: Literal["none", "origin", "face"] = "none"
    films: bool = False


class Sampler(ABC):
    """A way to render a scene, chosen and dimensioned. Subclass it for one of your own.

    ``class Mine(Sampler, name="mine")`` is known as "mine" to :func:`specklegen.plan` and the command line. It says
    when it serves (:meth:`obstacles`, :meth:`propose`), what it takes (:meth:`cost`, :meth:`memory`), and how it draws
    (:meth:`prepare`). One that renders recipes, too, is a :class:`MediaSampler`. What it does not say is 0, or nothing.

    Attributes
    ----------
    name : str
        As one asks for it.
    abilities : Abilities
        What it can do.
    scene : Scene
    paths : int
        Paths that it traces, for each realization or once.
    expected_error : float
        Relative error that so many paths leave, ...
    error_of : str
        ... and of what.
    correlation_error : float
        Standard error of correlations between tilts, where all seeds share it.
    summation : str
        How its fields come about, in a word or two.
    gaussianity : Gaussianity
        Whether so many paths make Gaussian speckle.
    intensity : float
        Largest mean intensity among a few lights and views; 0 where it is not known.
    by_direction : bool
        Whether a recipe's media are made ready for each direction of a wide camera: all of a recipe, if any needs it.
    """

    name: ClassVar[str]
    abilities: ClassVar[Abilities] = Abilities()
    scene: Scene
    paths = 0
    expected_error = 0.0
    correlation_error = 0.0
    error_of = "intensity scale"
    summation = "of its own"
    gaussianity = EXACT
    intensity = 0.0
    by_direction = False

    def __init_subclass__(cls, name: str | None = None, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for former in _FORMER.keys() & vars(cls).keys():
            reject(f"{cls.__name__}.{former}", f"given by {_FORMER[former]}", vars(cls)[former],
                   "The interface of samplers changed: see the example in docs/extending.md.")  # fmt: skip
        cls.name = name or cls.__name__
        if cls.__module__ != __name__:  # bases are no samplers to be asked for
            SAMPLERS.add(cls.name, cls)

    @classmethod
    def obstacles(cls, scene: Scene) -> list[str]:
        """Say why it cannot draw a scene at all, whatever the tolerance; an empty list where nothing is known."""
        if cls.abilities.media == "volumes" and scene.thin is not None:
            return ["draws volumes of scatterers only"]
        if cls.abilities.media == "thin" and scene.thin is None:
            return ["draws thin screens only"]
        return []

    @classmethod
    @abstractmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """Make the sampler for a scene, None where it may not serve; with what speaks for it or against."""

    @abstractmethod
    def prepare(self, seed: Seed, threads: int | None) -> Renderer:
        """Do once what all realizations share."""

    def cost(self) -> Cost:
        """Count the operations of realizations; by default none."""
        return Cost()

    def memory(self, threads: int) -> int:  # noqa: ARG002
        """Bytes by which the process grows at most in its first plan and render, of one realization."""
        held = float(np.prod(self.scene.sensor.shape)) * len(self.scene.lights)
        return int(8 * held * 4 + TORCH_BYTES + FIXED_BYTES)


_FORMER = dict.fromkeys(("thin", "medium_by_medium", "from_face", "films"), "abilities") | {"operations": "cost()"}
"""Names that samplers of a user's own had before, and what has taken their place."""


class MediaSampler(Sampler):
    """A sampler that renders recipes as well: it makes many media ready at once, for whatever light comes later."""

    @abstractmethod
    def prepare_media(self, request: MediaRequest) -> "Sequence[tuple[list[int], Imager]]":
        """Make media of a recipe ready: those alike together, and which they are."""

    def instead(self, said: Sequence[Decision]) -> "tuple[Sampler, tuple[Decision, ...]] | None":  # noqa: ARG002
        """Return another that serves this scene, where all media of a recipe want one sampler; None: there is no other.

        With what is then said in the place of ``said``.
        """
        return None


def _is_sampler(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Sampler) and found not in (Sampler, MediaSampler)


SAMPLERS: Registry[type[Sampler]] = Registry("sampler", _is_sampler)
"""Every sampler by the name that one asks for it."""

AnySampler = str | type[Sampler]
"""A sampler that is asked for: its name, the import path of one of a user's own, its class; or "auto"."""


def asked_sampler(field: str, asked: AnySampler) -> type[Sampler] | None:
    """Class of the sampler that is asked for; None of "auto"."""
    if not isinstance(asked, str) and not _is_sampler(asked):
        reject(field, "the name of a sampler, or its class", asked)
    if asked == "auto":
        return None
    return asked if _is_sampler(asked) else SAMPLERS.find(field, asked, beside=("auto",))  # type: ignore[return-value]


def require_float32(intensity: float) -> None:
    """Refuse a scene whose mean intensity, a float64, float32 does not hold with its dark grains and bright ones."""
    if intensity and not LEAST_FLOAT32 <= intensity <= MOST_FLOAT32:
        _reject_range(intensity)


def require_finite(images: np.ndarray) -> np.ndarray:
    """Return fields complex64 or intensities float32, unless their intensities overflow."""
    if images.size:
        parts = np.ascontiguousarray(images).view(np.float32)  # whose extremes are found without a copy
        highest = max(float(parts.max()), -float(parts.min()))
        power = 2 * highest**2 if np.iscomplexobj(images) else highest
        if not power < float(np.finfo(np.float32).max):
            _reject_range(power)
    return images


def _reject_range(intensity: float) -> NoReturn:
    reject(
        "Scene intensity", f"between {LEAST_FLOAT32:g} and {MOST_FLOAT32:g}, since images are float32", intensity,
        "Intensities are areas: give every length in a unit near the wavelength, or use covariance, which is float64.",
    )  # fmt: skip


def image_of(scene: Scene, field: np.ndarray) -> np.ndarray:
    """Field [n, ...] of one medium as complex64[n, *sensor]; of light without one, its images float32[..., *sensor]."""
    field = field.reshape(len(field), *scene.sensor.shape)
    light = scene.illumination
    if light.coherent:
        return field.astype(np.complex64)
    power = np.square(field.real) + np.square(field.imag)
    return np.tensordot(light.shares, power, axes=1).reshape(*light.images, *scene.sensor.shape).astype(np.float32)
