"""Particles of a recipe's media in Brownian motion: how fast, and what that does to the fields of all frames.

What a path of the material gives to its particles decides how soon its light is forgotten
(:mod:`specklegen.memory_effects.moving`); how fast they move is drawn for every medium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.random_streams import Stream
from specklegen.core.units import DIFFUSION, TIME
from specklegen.core.values import Value
from specklegen.datasets.distributions import Draw, UnboundedDraw, ends, require_above
from specklegen.datasets.recipes.media import DrawnMedia
from specklegen.datasets.recipes.parts.diffuser import Diffuser
from specklegen.datasets.recipes.parts.material import known_motion
from specklegen.datasets.split import Purpose
from specklegen.memory_effects.moving import MovingCorrelation
from specklegen.synthesis.correlations import FilmBatch

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.recipe import Recipe
    from specklegen.synthesis import mixtures as _mixtures
else:
    _mixtures = LazyModule("specklegen.synthesis.mixtures")

GIVEN = ("diffusion", "tau0", "correlation_time")
"""What says how fast particles move, one of them."""


class Speed(Value):
    """Speed at which particles move, by one of three numbers; each may vary from medium to medium.

    Parameters
    ----------
    diffusion
        D, of layers the fastest: length^2 over a unit of time.
    tau0
        1 / (D k^2), k inside the medium.
    correlation_time
        Time over which the correlation of the field falls to 1/e, from which the paths of a material find D.
    """

    diffusion: Annotated[Draw, DIFFUSION] | None = None
    tau0: Annotated[Draw, TIME] | None = None
    correlation_time: Annotated[UnboundedDraw, TIME] | None = None

    @property
    def speed(self) -> Any:
        """The number that was given."""
        return next(value for value in (self.diffusion, self.tau0, self.correlation_time) if value is not None)

    def require_speed(self, owner: str, which: str = "") -> None:
        """Refuse none or several of the three, and a number that is not above 0 or infinite."""
        given = [name for name in GIVEN if getattr(self, name) is not None]
        if len(given) != 1:
            reject(owner, f"given by one of {', '.join(GIVEN)}{which and ','}{which}", given)
        require_above(f"{owner}.{given[0]}", self.speed, 0)
        if not np.isfinite(ends(self.speed)[1]):
            reject(f"{owner}.{given[0]}", "finite, since particles move", self.speed,
                   "For a medium at rest, leave out the motion.")  # fmt: skip

    def tau0_of(self, known: Sequence[MovingCorrelation], speed: np.ndarray, wavelength: float) -> np.ndarray:
        """tau0 float64[M] of media, from the numbers that were drawn for them float64[M].

        Raise a `RuleError` for a time of 1/e where what rests keeps the correlation above.
        """
        if self.diffusion is not None:
            return 1 / (speed * np.square(2 * np.pi / wavelength))
        if self.tau0 is not None:
            return speed
        for each, time in zip(known, speed.tolist(), strict=True):
            if np.isinf(each.decay()):
                kept = f"A share of {each.static_share:.3g} of the light meets no moving particle."
                reject(f"{type(self).__name__}.correlation_time", "left out, since g1 stays above 1/e", time,
                       f"{kept} Give tau0.")  # fmt: skip
        return speed / np.array([each.decay() for each in known])


def require_moving(recipe: Recipe, which: str) -> None:
    """Refuse media that cannot be filmed.

    Raise a `RuleError` for screens, lookup tables, light of a band, and layers that are all at rest.
    """
    material: Any = recipe.material
    if isinstance(material, Diffuser):
        reject("Recipe.material", f"of scatterers {which}", "screens",
               "For moving screens, give [dynamics] velocities.")
    if material.kernel != "estimate":
        reject("Material.kernel", f'"estimate" {which}, since the lookup table has no momentum transfer',
               material.kernel)
    if recipe.wavenumber_bandwidth:
        reject("Recipe.light.bandwidth", f"0 {which}", recipe.light.bandwidth,
               "Motion with a bandwidth is not modelled.")
    if not all(material.in_motion(slab).moves for slab in material.extremes()):
        reject("Material.layers", f"given with a layer that moves {which}", "all at rest")


def moving(material: Any, slab: Any) -> MovingCorrelation:
    """Memory effect in time of a slab of a material."""
    return known_motion(material.in_motion(slab), material.kernel_paths)


def filmed_media(
    recipe: Recipe, speed: Speed, drawn: Addresses, numbers: Sequence[int], media: DrawnMedia, lags: np.ndarray,
    between: np.ndarray,
) -> DrawnMedia:  # fmt: skip
    """Draw the speed of media, and find what motion does to them at lags float64[n], int64[F, F] between frames."""
    host = replace(drawn, device=torch.device("cpu"))
    (asked,) = (each.numpy() for each in host.numbers(Purpose.DYNAMICS, [speed.speed], numbers))
    known = [moving(recipe.material, make()) for make in media.materials.slabs]
    tau0 = speed.tau0_of(known, asked, recipe.wavelength)
    x = lags / tau0[:, None]
    put = lambda rows: torch.from_numpy(np.array(rows)).to(drawn.device, non_blocking=True)  # noqa: E731
    shares = put([each.shares(own) for each, own in zip(known, x, strict=True)])
    film = FilmBatch(put([each.radius for each in known]), shares, _mixtures.mixture, between)
    dynamics = {
        "diffusion": 1 / (np.square(2 * np.pi / recipe.wavelength) * tau0), "tau0": tau0,
        "correlation_time": np.array([each.decay() for each in known]) * tau0,
        "static_share": np.array([each.static_share for each in known]),
    }  # fmt: skip
    parameters = media.parameters | {name: put(rows) for name, rows in dynamics.items()}
    return replace(media, parameters=parameters, still=torch.zeros_like(media.still), film=film)


def frame_keys(recipe: Recipe, drawn: Addresses, numbers: Sequence[int]) -> torch.Tensor:
    """Keys int64[M, halves, F - 1, 2] of the fields of all frames but the first."""
    halves, later = len(recipe.medium_purposes), recipe.frames - 1
    moved = drawn.words(numbers, [Purpose.DYNAMICS])[:, :, None].expand(-1, halves, later, -1)
    number = torch.stack(torch.meshgrid(torch.arange(halves), torch.arange(1, later + 1), indexing="ij"), -1)
    return drawn.keys(Stream.STATIONARY, torch.cat([moved, number.expand(len(numbers), -1, -1, -1)], -1))
