"""The materials of a batch of media: drawn numbers, their consequences, and the memory effect.

Here the ways part: slabs that the lookup table has are looked up on the device, all together; every other material is
known on the host, one by one, and tells its memory effect from there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from specklegen.datasets.addresses import Addresses
from specklegen.datasets.recipes.parts.atlas_batches import atlas_tables, correlations, single_radiance
from specklegen.datasets.recipes.parts.diffuser import KnownDiffuser
from specklegen.datasets.recipes.parts.light import Light
from specklegen.datasets.recipes.parts.material import CharacterizedMaterial, Estimator, Material, known_light
from specklegen.datasets.split import Purpose, generator, substream
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.scene.screens import ScreenStack
from specklegen.synthesis.correlations import Correlations, LightBatch, Mixtures, Places, Tabulated
from specklegen.synthesis.mixtures import half_range, mixture

_NUMBERS = ("thickness", "optical_depth", "g", "albedo")


@dataclass(frozen=True)
class Materials:
    """Materials of M media.

    Attributes
    ----------
    parameters : dict of float64[M]
        What is stored with every sample.
    correlations : Correlations
        Their memory effect.
    half_range : float64[M]
        Lateral wavevector difference at which C_I is half way to its floor; inf where there is none.
    slabs : sequence of function
        Each makes the medium of the engine.
    """

    parameters: dict[str, torch.Tensor]
    correlations: Correlations
    half_range: torch.Tensor
    slabs: Sequence[Callable[[], Slab | ScreenStack]]

    def __len__(self) -> int:
        return len(self.slabs)

    def at(self, places: Places) -> "Materials":
        """Some of them."""
        slabs = self.slabs
        if isinstance(slabs, _LookedUp):
            slabs = _LookedUp(slabs.numbers[places])
        else:
            slabs = tuple(slabs[n] for n in (range(len(self))[places] if isinstance(places, slice) else places))
        some = {name: value[places] for name, value in self.parameters.items()}
        return Materials(some, self.correlations.at(places), self.half_range[places], slabs)

    def range_sine(self, wavelength: float) -> torch.Tensor:
        """Sine of the memory-effect range, float64[M]; inf where there is none."""
        return self.half_range * wavelength / (2 * np.pi)

    def light(self, light: Light, bandwidth: float, paths: int) -> list[tuple[list[int], LightBatch | None]]:
        """Modes of light of a band in wavenumber, those of equally many together, and which media they are behind."""
        if not bandwidth:
            return [([*range(len(self))], None)]
        by_count: dict[int, list[int]] = {}
        modes = [known_light(make(), paths, bandwidth, light.spectrum) for make in self.slabs]  # type: ignore[arg-type]
        for place, own in enumerate(modes):
            by_count.setdefault(len(own.shares), []).append(place)
        put = lambda rows: torch.tensor(np.array(rows), dtype=torch.float64).to(self.half_range.device)  # noqa: E731
        return [
            (places, LightBatch(
                put([modes[n].shares for n in places]),
                tuple(Tabulated([modes[n].correlations[mode] for n in places]) for mode in range(count)),
                put([modes[n].flat for n in places]),
            ))
            for count, places in by_count.items()
        ]  # fmt: skip


def drawn_materials(
    material: Material, drawn: Addresses, media: Sequence[int], wavelength: float
) -> list[tuple[list[int], Materials]]:
    """Draw the materials of media, those that are known in the same way together, and which they are.

    Parameters
    ----------
    material
        Of the recipe: a slab, screens, or one of a name.
    drawn, media
        Whose numbers, and of which media.
    wavelength
        Inside them.
    """
    if not in_atlas(material):
        return [([*range(len(media))], _listed(material, drawn, media, wavelength))]
    materials, served = _looked_up(material, drawn, media, wavelength)
    if drawn.device.type == "meta" or bool(served.all()):
        return [([*range(len(media))], materials)]
    yes = [place for place, own in enumerate(served.tolist()) if own]
    no = [place for place in range(len(media)) if place not in set(yes)]
    rest = (no, _listed(material, drawn, [media[place] for place in no], wavelength))
    return [(yes, materials.at(yes)), rest] if yes else [rest]


def in_atlas(material: Material) -> bool:
    """True if slabs are looked up all together; a class of one's own says itself what its slabs are."""
    if type(material) is not Material or material.kernel != "atlas":
        return False
    return material.scatterer is None and material.faces.matched


def _listed(material: Material, drawn: Addresses, media: Sequence[int], wavelength: float) -> Materials:
    different = media if material.varies else media[:1]
    streams = (generator(substream(drawn.seed, drawn.split, Purpose.MATERIAL, medium)) for medium in different)
    known = [material.realized(rng, drawn.split) for rng in streams]
    materials = characterized_materials(material, known, wavelength, drawn.device)
    return materials if len(materials) == len(media) else materials.at([0] * len(media))


def characterized_materials(
    material: Material, known: Sequence[CharacterizedMaterial | KnownDiffuser], wavelength: float, device: torch.device
) -> Materials:
    """Return materials of the host as a batch."""
    rows = [each.parameters(wavelength) | material.labels(each.slab) for each in known]  # type: ignore[arg-type]
    put = lambda numbers: torch.tensor(numbers, dtype=torch.float64).to(device)  # noqa: E731
    return Materials(
        {name: put([row[name] for row in rows]) for name in rows[0]}, Tabulated([each.correlation for each in known]),
        put([each.half_range for each in known]), tuple(partial(_same, each.slab) for each in known),
    )  # fmt: skip


def _same(slab: Slab | ScreenStack) -> Slab | ScreenStack:
    return slab


def _looked_up(
    material: Material, drawn: Addresses, media: Sequence[int], wavelength: float
) -> tuple[Materials, torch.Tensor]:
    """Slabs by the lookup table, and whether each is there, bool[M]."""
    sources = [material.source(name, drawn.split) for name in _NUMBERS]
    thickness, depth, g, albedo = drawn.numbers(Purpose.MATERIAL, sources, media)
    mean_free_path = thickness / depth
    depth = thickness / mean_free_path
    entry = correlations(atlas_tables(drawn.device), thickness, depth, g, albedo, material.kernel_tolerance)
    half, known = half_range(entry.radius, entry.share, entry.single)
    sine = half * wavelength / (2 * torch.pi)
    whole = lambda value: torch.full_like(depth, value)  # noqa: E731
    parameters = {
        "wavelength": whole(wavelength), "thickness": thickness, "mean_free_path": mean_free_path,
        "optical_depth": depth, "g": g, "albedo": albedo, "ballistic_fraction": torch.exp(-depth),
        "single_share": entry.single, "forward_radiance": single_radiance(depth, 1 - g, albedo) / entry.single,
        "memory_effect_range": torch.arcsin(sine.clamp(max=1.0)),
        "estimator": whole(float(Estimator.ATLAS)),
    }  # fmt: skip
    numbers = torch.stack([thickness, mean_free_path, albedo, g], -1)
    mixtures = Mixtures(entry.radius, entry.share, mixture)
    return Materials(parameters, mixtures, half, _LookedUp(numbers)), entry.served & known


@dataclass(frozen=True, eq=False)
class _LookedUp(Sequence[Callable[[], Slab]]):
    """Functions that make slabs, one by one of those that are asked for.

    Attributes
    ----------
    numbers : float64[M, 4]
        Thickness, mean free path, albedo and g.
    """

    numbers: torch.Tensor

    def __getitem__(self, place: int) -> Callable[[], Slab]:  # type: ignore[override]
        return partial(_slab, self.numbers, range(len(self))[place])  # which ends an iteration

    def __len__(self) -> int:
        return len(self.numbers)


def _slab(numbers: torch.Tensor, place: int) -> Slab:
    thickness, mean_free_path, albedo, g = numbers[place].tolist()
    return Slab(
        thickness=thickness, mean_free_path=mean_free_path, albedo=albedo, scatterer=HenyeyGreenstein(g=g)
    )  # fmt: skip
