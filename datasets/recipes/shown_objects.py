"""Recipes whose samples show an object of a family: its pictures, its labels, and what splits share of them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from specklegen.core.lazy import torch
from specklegen.core.values import IDENTITY
from specklegen.datasets.objects import AnyFamily
from specklegen.datasets.recipes.recipe import Recipe

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses


class ShownObjects(Recipe):
    """A recipe of samples with an ``object`` float32[h, w], brightness 0 to 1.

    Parameters
    ----------
    objects
        Family of the pictures.
    """

    objects: AnyFamily

    def physics(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Everything that decides a pixel; a folder of pictures counts by its contents, not by its path."""
        return super().physics(context) | {"objects": self.objects.identity(context)}

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the files of the objects, by number."""
        return self.objects.file_names

    def split_notes(self) -> str:
        """Say what the splits share, in Markdown sentences for the data card."""
        return (
            f"{super().split_notes()} No object of one split appears in another: "
            f"the sources of `{self.objects.type}` are dealt to the splits before any sample is drawn."
        )

    def labels(self, drawn: "Addresses", numbers: Sequence[int]) -> "dict[str, torch.Tensor]":
        """Labels float64[B] of the objects of samples, by name."""
        labels = self.objects.labels_of(drawn, numbers)
        return {name: torch.from_numpy(column).to(drawn.device) for name, column in labels.items()}
