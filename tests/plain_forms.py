"""The program as other devices run it, on the CPU: torch forms, few ranks, one bound for all cells, large chunks."""

import warnings
from contextlib import contextmanager
from dataclasses import replace

import torch

from specklegen.datasets.recipes import generator
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.synthesis import imaging, modes
from specklegen.synthesis.fused import FORMS


@contextmanager
def plain_forms():
    """Every operator in the form that no device has a better one for."""
    over = torch.library.Library("specklegen", "IMPL")  # noqa: TOR901
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that there is a form for the CPU already
            for name, form in FORMS.items():
                over.impl(name, form, "CPU", allow_override=True)
        yield
    finally:
        over._destroy()


@contextmanager
def as_on_devices(monkeypatch, chunk=8):
    """All that a device does in another way than the CPU."""
    plain = Recipe.sight

    def bounded(self, *arguments, **options):
        return replace(plain(self, *arguments, **options), bound=self._most_cells)

    with plain_forms(), monkeypatch.context() as patch:
        patch.setattr(Recipe, "sight", bounded)
        patch.setattr(generator, "CHUNK", chunk)
        for module in (modes, imaging, generator):
            patch.setattr(module, "one_by_one", lambda _: False)
        yield
