"""Recipe kind "analysed-object": one hidden object behind a slab in polarised light, an image behind each analyser.

What a crossed analyser passes has been turned out of its plane on detours: it has a shorter memory effect and sees
another speckle than the parallel one. Both memory effects are two-dimensional
(:mod:`specklegen.memory_effects.polarised_fields`); the fields behind two analysers at right angles are drawn
independent of each other, which they are but for |K_ab|^2 <= 0.005 between two pixels of an object.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.random_streams import pilot_seed
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.parts.light import Analyser
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.instrument.mosaic import ANGLES, PolarisationMosaic
from specklegen.memory_effects.polarised_fields import PolarisedCorrelation, estimate_polarised_correlation
from specklegen.scene.media import Slab
from specklegen.scene.polarisation import Polarisers
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.samplers.sampler import MediaRequest
    from specklegen.synthesis import correlations as _correlations
else:
    _correlations = LazyModule("specklegen.synthesis.correlations")

TOGETHER = ({"parallel", "crossed"}, {"circular", "flipped"})
"""Analysers at right angles to each other, which may see one medium together."""
_BOTH: tuple[Analyser, ...] = ("parallel", "crossed")


def polarisers(analyser: Analyser) -> Polarisers:
    """Light, and an analyser of a recipe: its name, or its angle from linear light along x."""
    if analyser in ("circular", "flipped"):
        return Polarisers.circular(flipped=analyser == "flipped")
    if analyser == "crossed":
        return Polarisers.crossed()
    angle = 0.0 if isinstance(analyser, str) else float(analyser)
    return Polarisers(light=[1, 0], analyser=[np.cos(angle), np.sin(angle)])


@lru_cache(maxsize=256)
def known_behind(slab: Slab, analyser: Analyser, paths: int) -> PolarisedCorrelation:
    """Find the memory effect of a slab behind an analyser, from the same paths behind all of them."""
    seed = pilot_seed(slab.unitless_fingerprint())
    correlation = estimate_polarised_correlation(slab, polarisers(analyser), paths, seed)
    if not correlation.weights.any():
        reject("Material.kernel_paths", f"enough that some light passes the slab and the analyser {analyser}",
               paths)  # fmt: skip
    return correlation


@dataclass(frozen=True)
class BehindAnalysers:
    """K behind several analysers, between which fields are independent."""

    isotropic: ClassVar[bool] = False
    each: tuple[PolarisedCorrelation, ...]

    @property
    def weights(self) -> np.ndarray:
        """Contributions behind the first."""
        return self.each[0].weights

    def planar(self, qx: np.ndarray, qy: np.ndarray) -> np.ndarray:
        """K float64[A, A, h, w] between all of them, or float64[h, w] behind the first."""
        if qx.ndim == 2:
            return self.each[0].planar(qx, qy)
        correlation = np.zeros(qx.shape)
        for n, own in enumerate(self.each):
            correlation[n, n] = own.planar(qx[n, n], qy[n, n])
        return correlation


@dataclass(frozen=True)
class BehindMosaic:
    """K behind the polarisers of a mosaic, whose fields are two components of one, seen at four angles.

    C_ab = a_x b_x C_xx + a_y b_y C_yy + (a_x b_y + a_y b_x) C_xy,    C_xy = C_45 - (C_xx + C_yy) / 2

    for linear light along x and real matrices of paths, for which C_xy is real and even.

    Attributes
    ----------
    each : PolarisedCorrelation
        Behind analysers along the light, across it, and at 45 degrees.
    angles : float64[A]
        Of the polarisers from the light, radians.
    """

    isotropic: ClassVar[bool] = False
    each: tuple[PolarisedCorrelation, PolarisedCorrelation, PolarisedCorrelation]
    angles: tuple[float, ...]

    @property
    def weights(self) -> np.ndarray:
        """Contributions along the light."""
        return self.each[0].weights

    def planar(self, qx: np.ndarray, qy: np.ndarray) -> np.ndarray:
        """K float64[A, A, h, w] between all of them, at the same differences; or float64[h, w] behind the first."""
        alone = qx.ndim == 2
        along, across, between = (
            float(one.weights.sum()) * one.planar(*((qx, qy) if alone else (qx[0, 0], qy[0, 0]))) for one in self.each
        )
        mixed = between - (along + across) / 2
        axes = np.array([[np.cos(a), np.sin(a)] for a in self.angles[: 1 if alone else None]])
        x, y = axes[:, 0], axes[:, 1]
        correlation = (
            np.multiply.outer(np.outer(x, x), along) + np.multiply.outer(np.outer(y, y), across)
            + np.multiply.outer(np.outer(x, y) + np.outer(y, x), mixed)
        )  # fmt: skip
        total, less = (float(one.weights.sum()) for one in self.each[:2])
        cross = float(self.each[2].weights.sum()) - (total + less) / 2
        lit = np.sqrt(x * x * total + y * y * less + 2 * x * y * cross)
        correlation /= np.outer(lit, lit)[:, :, None, None]
        return correlation[0, 0] if alone else correlation


@dataclass(frozen=True)
class AnalysedView(MediumView):
    """Copy with light and analyser."""

    polarisers: Polarisers = Polarisers()  # noqa: RUF009 - frozen

    def _scene(self, light: Any, grid: Any) -> Scene:
        return Scene(wavelength=self.seen.wavelength, medium=self.slab, illumination=light, sensor=grid,
                     polarisers=self.polarisers)  # fmt: skip


class AnalysedObject(HiddenObject):
    """One object behind a slab in polarised light, one camera image an analyser.

    Samples: ``stack`` float32[A, H, W] (or uint16 counts), ``object`` float32[h, w]. Every image has mean 1 over its
    own expected intensity; what share of the light each analyser passes is among the parameters
    (``analyser_share_0``, ...), with the degree of polarisation of the light, ``polarisation_degree``. The
    memory-effect range is that of scalar light, and ``expected_contrast`` that of the first image. With an exposure,
    ``photons`` are the mean of each image, as if each were exposed for as long as its light needs; in one exposure for
    all, the second image would have ``analyser_share_1 / analyser_share_0`` of the first one's.

    Parameters
    ----------
    light
        ``polarisation`` says what the particles do, ``analyser`` what stands before the camera.
    mosaic
        A camera with a polariser before each pixel (:class:`specklegen.instrument.PolarisationMosaic`): then there
        is no other analyser, and ``stack`` is its one raw image, of mean 1 over the expected light of all pixels.
    """

    kind: Literal["analysed-object"] = "analysed-object"  # type: ignore[assignment]
    polarises: ClassVar[bool] = True
    on_benches: ClassVar[bool] = False
    looked_up: ClassVar[bool] = False
    mosaic: PolarisationMosaic | None = None

    @model_validator(mode="after")
    def _check_analysers(self) -> Self:
        light, some = self.light, self.light.analysers
        if light.polarisation == "scalar":
            reject("Light.polarisation", '"projector" or "vector" in recipes of kind analysed-object', "scalar")
        if len(some) > 1 and (len(set(some)) < len(some) or not any(set(some) <= both for both in TOGETHER)):
            reject("Light.analyser", "one analyser, or parallel and crossed, or circular and flipped", some,
                   "Fields are drawn independently, and those behind other pairs are correlated.")  # fmt: skip
        if type(self.material) is not Material or self.material.kernel != "estimate":
            reject("Recipe.material", 'a slab given by its numbers, with kernel = "estimate", in polarised light',
                   self.material)  # fmt: skip
        if light.bandwidth or (self.lab is not None and self.lab.bandwidth) or not light.polarised:
            reject("Recipe.light", "of one wavelength, and polarised", light,
                   "Bandwidth and depolarised light are not modelled here.")
        if self.mosaic is not None:
            if light.analyser != "none":
                reject("Light.analyser", '"none" before a mosaic of polarisers', light.analyser,
                       "The mosaic analyses the light: leave out light.analyser, or the mosaic.")  # fmt: skip
            if light.polarisation != "projector":
                reject("Light.polarisation", '"projector" before a mosaic', light.polarisation,
                       "Fields of vector light at its angles have complex correlations, which are "
                       "not modelled.")  # fmt: skip
            if any(side % 2 for side in self.camera_shape):
                reject("CameraGrid.shape", "a shape of even sides, for a mosaic of two by two", self.camera_shape)
        self._polarised(self.material.extremes()[0])  # a scatterer without amplitudes is refused here
        return self

    def _polarised(self, slab: Slab) -> Slab:
        return slab.replace(polarisation=self.light.polarisation)

    @property
    def _drawn(self) -> tuple[Analyser, ...]:
        """Analysers whose fields are drawn: without any, both components; all angles of a mosaic."""
        if self.mosaic is not None:
            return ("parallel", *(math.radians(angle) for angle in ANGLES[1:]))
        some = self.light.analysers
        return _BOTH if some == ("none",) else some

    @property
    def _whole(self) -> bool:
        """True if there is none, and both components add up."""
        return self.light.analysers == ("none",) and self.mosaic is None

    @property
    def _seen(self) -> tuple[Analyser, ...]:
        """Analysers that each have an image."""
        return self.light.analysers if self.mosaic is None else self._drawn

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`named` names."""
        each = self.pictures, "one camera image an analyser"
        count, description = each if self.mosaic is None else (1, "raw image of a mosaic of polarisers")
        return {"stack": self.observation((count, *self.camera_shape), ("analyser", "y", "x"), description)}

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Images behind all analysers."""
        return {"stack": images}

    @property
    def pictures(self) -> int:
        """One an analyser."""
        return len(self._seen)

    def on_sensor(self, images: Any, parameters: Mapping[str, Any]) -> Any:
        """Light on the pixels: of a mosaic what each of its polarisers passes, of mean 1 over all of them."""
        if self.mosaic is None:
            return images
        shares = torch.stack([parameters[f"analyser_share_{n}"] for n in range(self.pictures)], 1)
        mixed = torch.from_numpy(self.mosaic.mixture(*self.camera_shape)).to(images)  # of each image, at each pixel
        passed = (mixed * shares.to(images)[:, :, None, None] * images).sum(1, keepdim=True)
        return passed / (mixed.mean((1, 2)) * shares.to(images)).sum(1)[:, None, None, None]

    @property
    def path_sum_obstacle(self) -> str | None:
        """Analysers."""
        return "analysers"

    def tilts_of(
        self, drawn: Addresses, numbers: Sequence[int]
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """No tilt; once an analyser, as they are base tilts to the modes."""
        angles, parameters = super().tilts_of(drawn, numbers)
        return angles.repeat(1, self.pictures, 1), parameters

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, behind every analyser."""
        return [
            AnalysedView(self._polarised(view.slab), view.seen, view.shape, view.pitch, view.tilts,
                         polarisers(each))  # type: ignore[arg-type]
            for view in super().extremes() for each in self._drawn
        ]  # fmt: skip

    def idealisations(self, scene: Scene) -> list[Decision]:
        """Parts left out of every image, and of the two together."""
        fields = Decision("analysers", True,
                          "fields behind two of them are taken as independent (correlation below 0.005)")
        exposed = Decision("one exposure for all analysers", False, "idealised: every image has the mean photons of "
                           "the exposure, whatever share of the light its analyser passes")  # fmt: skip
        longer = self.exposure is not None and self.pictures > 1 and self.mosaic is None
        return [*super().idealisations(scene), fields, *([exposed] if longer else [])]

    def seen_media(self, drawn: Addresses, numbers: Sequence[int], materials: Materials) -> DrawnMedia:
        """Draw what is seen of media; their memory effect is that of polarised light."""
        slabs = [self._polarised(make()) for make in materials.slabs]  # type: ignore[arg-type]
        every = dict.fromkeys((*self._drawn, *_BOTH))
        behind = {each: [self._known(slab, each) for slab in slabs] for each in every}
        put = lambda rows: torch.tensor(rows, dtype=torch.float64).to(drawn.device)  # noqa: E731
        lit = {each: put([float(k.weights.sum()) for k in known]) for each, known in behind.items()}
        total = sum(lit[each] for each in _BOTH)
        parameters = {f"analyser_share_{n}": (total if self._whole else lit[each]) / total
                      for n, each in enumerate(self._seen)}  # fmt: skip
        parameters["polarisation_degree"] = (lit["parallel"] - lit["crossed"]) / total
        if self._whole:
            known = [_sum_of(behind[_BOTH[0]][n], behind[_BOTH[1]][n]) for n in range(len(slabs))]
        elif self.mosaic is not None:
            angles = tuple(math.radians(angle) for angle in ANGLES)
            three = zip(behind["parallel"], behind["crossed"], behind[self._drawn[1]], strict=True)
            known = [BehindMosaic(each, angles) for each in three]
        else:
            known = [BehindAnalysers(tuple(behind[each][n] for each in self._drawn)) for n in range(len(slabs))]
        seen = replace(
            materials, parameters=materials.parameters | parameters, correlations=_correlations.Tabulated(known),
            slabs=tuple(partial(_same, slab) for slab in slabs),
        )  # fmt: skip
        return super().seen_media(drawn, numbers, seen)

    def _known(self, slab: Slab, analyser: Analyser) -> PolarisedCorrelation:
        return known_behind(slab, analyser, self.material.kernel_paths)

    def requests(self, media: DrawnMedia) -> list[tuple[list[int], MediaRequest]]:
        """Request to the sampler; without an analyser both components add up by their shares."""
        requests = super().requests(media)
        if not self._whole:
            return requests
        whole = []
        for places, request in requests:
            rows = [[self._known(make(), each) for each in _BOTH] for make in request.media]  # type: ignore[arg-type]
            lit = torch.tensor([[float(k.weights.sum()) for k in row] for row in rows], dtype=torch.float64)
            shares = (lit / lit.sum(1, keepdim=True)).to(media.tilts.device)
            light = _correlations.LightBatch(
                shares, tuple(_correlations.Tabulated([row[n] for row in rows]) for n in (0, 1)),
                torch.zeros(len(rows), dtype=torch.float64, device=shares.device),
            )  # fmt: skip
            whole.append((places, replace(request, light=light)))
        return whole


def _same(slab: Slab) -> Slab:
    return slab


def _sum_of(one: PolarisedCorrelation, other: PolarisedCorrelation) -> PolarisedCorrelation:
    """K of light that both analysers pass together."""
    weights = one.weights + other.weights
    share = np.stack([one.weights.sum(axis=0), other.weights.sum(axis=0)])
    squares = share[0] * one.radius**2 + share[1] * other.radius**2
    radius = np.sqrt(np.divide(squares, share.sum(axis=0), out=np.zeros_like(squares), where=share.sum(axis=0) > 0))
    return PolarisedCorrelation(
        radius, weights, one.second + other.second, one.fourth + other.fourth, one.paths
    )
