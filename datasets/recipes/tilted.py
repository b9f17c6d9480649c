"""Recipes whose samples are one image a tilt: the tilts, and their consequences."""

from collections.abc import Mapping
from typing import Any

from specklegen.datasets.distributions import is_draw
from specklegen.datasets.recipes.parts.tilts import Tilts
from specklegen.datasets.recipes.recipe import Recipe


class Tilted(Recipe):
    """A recipe of stacks ``stack`` [T, H, W] under ``tilts`` float64[T, 2] in radians.

    Parameters
    ----------
    tilts
        The tilts.
    """

    tilts: Tilts

    @property
    def media_alike(self) -> bool:
        """True if tilts are not drawn either."""
        return super().media_alike and not self.tilts.varies

    @property
    def tilts_turn(self) -> bool:
        """True if the azimuth is drawn."""
        return is_draw(self.tilts.azimuth)

    @property
    def pictures(self) -> int:
        """One a tilt."""
        return self.tilts.count

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Stacks and their tilts."""
        return {"stack": images, "tilts": tilts}
