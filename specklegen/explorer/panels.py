"""Panels of a state: each is a pure function of it."""

import time
import warnings
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from specklegen.core.errors import DoubtWarning
from specklegen.core.statistics import autocorrelation
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.brownian import moving
from specklegen.explorer.controls import State
from specklegen.explorer.recipe import (
    GLIDE,
    PIXEL,
    SEED,
    SIDE,
    SPHERES,
    SPLIT,
    analysed_of,
    extent_of,
    imaged,
    lens_of,
    motion_of,
    of_glass,
    recipe_of,
    tilts_of,
)
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.evaluation import aligned_to, targets_of
from specklegen.models.metrics import pearson
from specklegen.models.recoverability.verdict import Verdict, recoverable
from specklegen.models.retrieval.phase_retrieval import Retrieval
from specklegen.pictures import autocorrelation_of_object
from specklegen.samplers.screens.film import frame_correlation
from specklegen.scene.window import Window

_RETRIEVAL = Retrieval(restarts=4)
_POINTS = 121  # of a curve
SIXTEEN = 16


def _drawn(recipe: Any, number: int) -> dict[str, Any]:
    """Draw a sample of a recipe; what the planner doubts about it is stated by :func:`doubts`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)
        return recipe.sample(SEED, SPLIT, number)


def _of_images(make: Callable[[State], Any]) -> Callable[[State], Any]:
    """Keep the last four results of what depends on the hidden object's image, whatever else is set."""
    kept = lru_cache(maxsize=4)(make)
    return wraps(make)(lambda state: kept(imaged(state)))


@_of_images
def sample(state: State) -> dict[str, Any]:
    """Hidden object, camera image and parameters: sample ``state.sample`` of the recipe."""
    return _drawn(recipe_of(state), state.sample)


def doubts(state: State) -> tuple[str, ...]:
    """Doubts of the planner about rendering this quickly, in its words."""
    recipe = recipe_of(state).replace(name="explored")  # plans anew: a recipe warns once
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DoubtWarning)
        recipe.rendering  # noqa: B018 - looked at for what it says
    return tuple(dict.fromkeys(str(each.message) for each in caught if issubclass(each.category, DoubtWarning)))


class Tilted(NamedTuple):
    """One beam before and after a tilt.

    Attributes
    ----------
    images : float[2, H, W]
        Camera images; the pattern moves with the tilt.
    shift : float
        By so many pixels along a row.
    correlation : float
        C_I of the slab at that tilt.
    """

    images: np.ndarray
    shift: float
    correlation: float


def tilted(state: State) -> Tilted:
    """Speckle under tilt."""
    recipe = tilts_of(state)
    drawn = _drawn(recipe, state.sample)
    sine = float(np.sin(drawn["tilts"][1, 0]))
    return Tilted(np.asarray(drawn["stack"]), sine / recipe.geometry.grid.pitch, float(c_i(state, np.array([sine]))[0]))


class Moved(NamedTuple):
    """Two frames of the camera's image while particles move, and how the speckle of one beam forgets.

    Attributes
    ----------
    images : real[2, H, W]
        At once, and the state's lag later.
    lags, intensity : float64[n]
        Milliseconds, from 0, and |g1|^2 there.
    fallen : float
        Milliseconds after which |g1|^2 is half way to its floor.
    correlation : float
        |g1|^2 at the state's lag.
    """

    images: np.ndarray
    lags: np.ndarray
    intensity: np.ndarray
    fallen: float
    correlation: float


Forgetting = tuple[Callable[[np.ndarray], np.ndarray], float]
"""|g1|^2 at lags float64[n] in milliseconds, and the lag at which it is half way to its floor."""


@lru_cache(maxsize=4)
def moved(state: State) -> Moved:
    """A film of two frames, of spheres in water (:data:`specklegen.explorer.recipe.SPHERES`), or of a glass that glides
    (:data:`specklegen.explorer.recipe.GLIDE`).
    """
    frames = _drawn(motion_of(state), state.sample)["frames"]
    forgets, half = (_glided if of_glass(state) else _wandered)(state)
    lags = np.linspace(0, max(3 * half, 1.2 * state.lag), _POINTS)
    at = float(forgets(np.array([state.lag]))[0])
    return Moved(np.asarray(frames), lags, forgets(lags), half, at)


def _wandered(state: State) -> Forgetting:
    """Tell how spheres that wander forget: |g1|^2 at lags in milliseconds, and where it is half way down."""
    recipe = motion_of(state)
    known = moving(recipe.material, recipe.material.extremes()[0])
    rate = 1e-3 * SPHERES.diffusion * (2 * np.pi / state.wavelength) ** 2  # x of a millisecond
    half = float(known.decay(np.sqrt((1 + known.static_share**2) / 2)) / rate)
    return lambda lags: np.square(known.field(rate * lags)), half


def _glided(state: State) -> Forgetting:
    """Tell how a moving ground glass forgets, likewise; a lone one as it leaves the window."""
    recipe = motion_of(state)
    glass: Any = recipe.material.extremes()[0]
    window = Window(recipe.geometry.profile, recipe.geometry.width)

    def forgets(lags: np.ndarray) -> np.ndarray:
        moved = np.zeros((len(lags), len(glass.screens), 2))
        moved[:, 0, 0] = GLIDE * lags
        return np.square(np.abs(frame_correlation(glass, state.wavelength, moved, window)))

    end = recipe.geometry.width / GLIDE
    half: Any = optimize.brentq(lambda lag: forgets(np.array([lag]))[0] - 0.5, 0.0, end)
    return forgets, half


class Analysed(NamedTuple):
    """The hidden object in polarised light, behind two analysers at right angles.

    Attributes
    ----------
    images : real[2, H, W]
        Each of mean 1: what kept its polarisation, and the rest.
    shares : tuple of float
        Of the light, that each analyser passes.
    """

    images: np.ndarray
    shares: tuple[float, float]


@lru_cache(maxsize=4)
def analysed(state: State) -> Analysed:
    """Two images of one object by the projector model, of a kernel of its own behind each analyser."""
    drawn = _drawn(analysed_of(state), state.sample)
    first, second = (float(drawn["parameters"][f"analyser_share_{n}"]) for n in (0, 1))
    return Analysed(np.asarray(drawn["stack"]), (first, second))


class Focused(NamedTuple):
    """A lit spot through a lens.

    Attributes
    ----------
    images : float32[1 or 2, H, W]
        On the exit face, and on the plane in focus where that is another one; of one medium.
    field : float
        Side of what the camera sees of the plane, micrometres.
    grain : float
        Size of a speckle on the plane, wavelength / (2 aperture), micrometres.
    """

    images: np.ndarray
    field: float
    grain: float


@lru_cache(maxsize=4)
def focused(state: State) -> Focused:
    """The slab's exit, where :data:`specklegen.explorer.recipe.SPOT` of its entrance is lit, through a lens."""
    images = _drawn(lens_of(state), state.sample)["stack"]
    grain = state.wavelength / (2 * state.lens)
    return Focused(np.asarray(images), state.camera * PIXEL / state.magnification, grain)


def c_i(state: State, sines: np.ndarray) -> np.ndarray:
    """Intensity correlation of the slab at differences of the direction sine, float64 of their shape."""
    correlation = recipe_of(state).material_of(SEED, SPLIT, state.sample).correlation
    return np.square(correlation(2 * np.pi / state.wavelength * np.asarray(sines, np.float64)))


class Curve(NamedTuple):
    """Memory effect with the object marked.

    Attributes
    ----------
    angles, c_i : float64[n]
        Milliradians inside the slab, and C_I there.
    extent : float
        Width of the object, milliradians.
    range : float
        Where C_I is half way to its floor, milliradians.
    across : float
        C_I between the ends of the object.
    """

    angles: np.ndarray
    c_i: np.ndarray
    extent: float
    range: float
    across: float


def memory_curve(state: State) -> Curve:
    """C_I over the angle, up to three ranges or past the object; of what remembers without end, past the object."""
    half = float(recipe_of(state).material_of(SEED, SPLIT, state.sample).range_sine(state.wavelength))
    extent = extent_of(state)
    sines = np.linspace(0, max(3 * half if np.isfinite(half) else 0.0, 1.2e-3 * extent), _POINTS)
    across = float(c_i(state, np.array([np.sin(1e-3 * extent)]))[0])
    reach = 1e3 * float(np.arcsin(half)) if half < 1 else np.inf
    return Curve(1e3 * np.arcsin(sines.clip(0, 1)), c_i(state, sines), extent, reach, across)


class Lags(NamedTuple):
    """Autocorrelations, zero lag in the middle and equal to 1; both as wide as twice the object.

    Attributes
    ----------
    image : float64[m, m]
        Of the camera image.
    object : float64[n, n]
        Of the hidden object, its mean left in.
    """

    image: np.ndarray
    object: np.ndarray


def autocorrelations(state: State) -> Lags:
    """Show what the camera image still tells, beside the truth."""
    shown = sample(state)
    pitches = shown["parameters"]
    half = max(2, round(SIDE * float(pitches["object_pitch"]) / float(pitches["camera_pitch"])))
    lags = autocorrelation(shown["image"])
    middle, half = lags.shape[0] // 2, min(half, lags.shape[0] // 2)
    window = slice(middle - half, middle + half + 1)
    return Lags(lags[window, window], autocorrelation_of_object(shown["object"]))


class Retrieved(NamedTuple):
    """Phase retrieval of the image shown.

    Attributes
    ----------
    image : float32[SIDE, SIDE]
        Moved onto the object, and turned as it is.
    correlation, limited : float
        Pearson correlation to the object, and to it as a lens as wide as the window would show it: what the judgement
        is about, since speckle carries no more.
    """

    image: np.ndarray
    correlation: float
    limited: float


@_of_images
def retrieved(state: State) -> Retrieved:
    """Phase retrieval from the autocorrelation (Katz et al. 2014), divided by C_I where that promises more."""
    recipe = recipe_of(state)
    batch = tensors({name: np.asarray(value)[None] if name != "parameters" else
                     {key: np.array([number]) for key, number in value.items()}
                     for name, value in sample(state).items()})  # fmt: skip
    reconstructed = katz(_RETRIEVAL, recipe=recipe, seed=SEED)(batch)
    truths = targets_of(batch, recipe.profile)
    moved = {name: aligned_to(reconstructed, truth, (SIDE, SIDE)) for name, truth in truths.items()}
    scores = {name: float(pearson(moved[name], truth[..., :SIDE, :SIDE])[0]) for name, truth in truths.items()}
    return Retrieved(moved["sharp"][0].numpy(), scores["sharp"], scores["diffraction-limited"])


@_of_images
def verdict(state: State) -> Verdict:
    """Return whether phase retrieval works on such images, and why not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)
        return recoverable(recipe_of(state), seed=SEED)


class Sixteen(NamedTuple):
    """Sixteen samples.

    Attributes
    ----------
    images : real[16, H, W]
    objects : float32[16, SIDE, SIDE]
    rate : float
        Samples a second that this process made of them, on this machine and as busy as it was.
    """

    images: np.ndarray
    objects: np.ndarray
    rate: float


def sixteen(state: State) -> Sixteen:
    """The first sixteen samples of the recipe, and how quickly they were made once the slab is known."""
    recipe = recipe_of(state)
    sample(state)
    begun = time.perf_counter()
    batch = recipe.batch(SEED, SPLIT, range(SIXTEEN))
    return Sixteen(batch["image"], batch["object"], SIXTEEN / (time.perf_counter() - begun))
