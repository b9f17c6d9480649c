"""Light behind a slab as a lens images it: its extent in focus, and the number of paths of a pixel.

Pilot paths say both. A connection reaches as far from where it entered as it comes sideways inside, and on from its
last particle along the steepest ray that the lens takes to the plane in focus: the plane is lit over X, the window and
twice what 99 % of the light keep to. What it adds there to pixels, and that it adds nothing to others, is in
:mod:`specklegen.paths.pixel_light`.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.values import remembered
from specklegen.instrument.lens import FLAT, Lens, Points
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions, endpoint_factors
from specklegen.paths.gaussianity import PathMoments
from specklegen.paths.layout import Layout
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.pixel_light import PixelLight, depths, sideways, tangents
from specklegen.paths.steps import straight_light
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    from specklegen.scene.imaging import Imaging

_INSIDE, _HALO = 0.99, 0.95  # shares of the light: within the lit plane, and within a halo
_FAINT = 7.0  # a Gaussian window is lit where its intensity is above e^-7


@dataclass(frozen=True)
class LitPlane:
    """The light on the plane in focus.

    Attributes
    ----------
    extent : float
        X, across what is lit.
    halo : float
        How far 95 % of the light come from where they entered.
    moments : PathMoments
        Of what one path adds to a pixel in the middle.
    turned : float
        Largest difference of the correlation of the outermost tilts between the rim of the pupil and its middle.
    """

    extent: float
    halo: float
    moments: PathMoments
    turned: float


def lens_of(scene: Scene) -> Lens:
    """The lens of a scene, its pupil sampled as finely as the lit plane asks for; that of points in the near field."""
    points = scene.sensor if scene.sensor.near else None
    if points is not None:
        scene = _wide_open(scene)
    camera: Imaging = scene.sensor  # type: ignore[assignment]
    lit = lit_plane(scene)
    asked = lit.extent / 2 + max(lit.extent / 2, camera.reach)
    least = max(3, int(np.ceil(2 * camera.aperture * asked / scene.wavelength * (1 - 1e-9))))
    views = least if camera.views is None else camera.views
    if views < least:
        reject(
            "Imaging.views", f"at least {least}", views,
            f"The plane in focus is lit over {lit.extent:.4g} and seen over {2 * camera.reach:.4g}: with sines more "
            f"than wavelength / {asked:.4g} = {scene.wavelength / asked:.3g} apart, light from one side would be seen "
            "on the other. Leave views out, or use a narrower window or a smaller |focus|.",
        )  # fmt: skip
    require_memory(
        "Imaging.views", "held", (8 * len(scene.lights) + 80) * float(views) ** 2, f"{views} directions across",
        f"The plane in focus is lit over {lit.extent:.4g}: use a smaller aperture, illuminated area or |focus|.",
        share=0.9,
    )  # fmt: skip
    grid = camera.pupil_grid(views)
    return Lens(scene, camera, grid) if points is None else Points(scene, camera, grid, points)


def _wide_open(scene: Scene) -> Scene:
    """Look with a lens that takes all light from what is lit of a face to the points of a scene behind it."""
    from specklegen.scene.imaging import Imaging

    points, faces = scene.views, scene.medium.faces
    aside, behind = np.hypot(*points[:, :2].T).max(initial=0.0), scene.side * (points[:, 2] - scene.exit_depth)
    index, most = faces.inside / faces.outside, 0.99 * scene.slab.largest_sine / np.sqrt(2)
    nearest = float(behind.min(initial=np.inf))
    side = "transmission" if scene.side > 0 else "reflection"

    def camera(aperture: float) -> Imaging:
        pitch = scene.wavelength / (8 * aperture)
        shape = (1, int(np.ceil(2 * aside / pitch)) + 1)
        return Imaging(shape=shape, pitch=pitch, aperture=aperture, side=side)  # type: ignore[arg-type]

    extent = scene.beams.window.support(_FAINT) + scene.thickness
    while True:
        radius = extent / np.sqrt(2) + aside  # of a square, its corner
        aperture = radius / np.hypot(radius, nearest) / index / FLAT
        if not nearest > 0 or aperture >= most:
            # Wider apertures see light from farther aside, so no extent in this loop exceeds that of the widest.
            widest, steep = max(extent, 1.1 * lit_plane(scene.replace(sensor=camera(most))).extent), 0.99 * FLAT * most
            passing = (widest / np.sqrt(2) + aside) * np.sqrt(1 / (steep * index) ** 2 - 1)
            reject(
                "NearField.points", f"at least {passing:.4g} behind the face here",
                nearest, f"The face is lit over {widest:.4g}, and light comes to nearer points at sines beyond "
                f"{most:.3g} inside. Move the points away, narrow the illuminated area, or use Imaging, whose aperture "
                "limits the light.",
            )  # fmt: skip
        found = lit_plane(scene.replace(sensor=camera(aperture))).extent
        if found <= extent:
            return scene.replace(sensor=camera(aperture).replace(focus=float(behind.max())))
        extent = 1.1 * found


@remembered(64)
def lit_plane(scene: Scene) -> LitPlane:
    """Illumination of the plane in focus, for the worst of a few lights, by pilot paths."""
    camera: Imaging = scene.sensor  # type: ignore[assignment]
    lens = Lens(scene, camera, camera.pupil_grid(3))
    pilot = scene_pilot(lens.pupil_scene.at_rest, False)
    layout, bank, window = pilot.tracer.layout, pilot.bank, scene.beams.window
    steep = tangents(scene, camera.aperture)
    base = window.support(_FAINT)
    extent, halo, worst = base, 0.0, None
    for light in -layout.lights.probed().vectors:
        ballistic = np.abs(steep_way(scene, light))
        extent = max(extent, base + 2 * ballistic)
        weights = contributions(layout.at(light, np.array([0.0, 0.0, scene.side])), bank)
        if not weights.any():
            continue
        aside = sideways(layout, bank, light)
        gap = depths(lens, layout, bank)
        reached = np.hypot(*aside.T) + np.abs(gap * steep[0] + camera.focus * steep[1])
        order = np.argsort(reached)
        share = np.cumsum(weights[order]) / weights.sum()
        outer, near = (float(reached[order][np.searchsorted(share, part)]) for part in (_INSIDE, _HALO))
        extent, halo = max(extent, base + 2 * outer), max(halo, near)
        once = float(np.square(weights).sum() / weights.sum() ** 2)
        if worst is None or once > worst[0]:
            worst = once, light, aside
    moments = PathMoments(0.0, 0.0)
    if worst is not None:
        _, light, aside = worst
        seen = layout.at(light, np.array([[0.0, 0.0, scene.side]]))
        entering = bank.weight * np.square(np.abs(endpoint_factors(seen, bank, seen.lights, "entry")[0]))
        moments = PixelLight(scene, lens, layout, bank, light, entering).pixel(aside, window)
    return LitPlane(extent, halo, moments, _turned(lens, layout, bank))


def steep_way(scene: Scene, light: np.ndarray) -> float:
    """Distance of the unscattered light of a beam from its window on the plane in focus."""
    if scene.side < 0:
        return 0.0
    sine = float(np.hypot(*light[:2]))
    inside, outside = tangents(scene, sine)
    if scene.refracts_inside:
        inside = sine * straight_light(scene.slab, np.array([sine])).slope[0] / scene.exit_depth
    return float(inside * scene.exit_depth + outside * scene.sensor.focus)  # type: ignore[attr-defined]


def _turned(lens: Lens, layout: Layout, bank: PathBank) -> float:
    """Largest |C_v - C| of the outermost tilts over four views v at the rim, C that in the middle of the pupil.

    A pattern that moves with the tilt has a correlation that turns with the view.
    """
    scene, lights = lens.scene, layout.lights.vectors
    if len(lights) < 2:
        return 0.0
    middle = -lights.mean(axis=0)
    gaps = lights[:, :2] + middle[:2]
    gap = 2 * gaps[np.square(gaps).sum(-1).argmax()]
    middle /= np.linalg.norm(middle)
    sine, correlations = scene.sensor.aperture, []  # type: ignore[attr-defined]
    for x, y in ((0, 0), (sine, 0), (-sine, 0), (0, sine), (0, -sine)):
        view = np.array([x, y, scene.side * np.sqrt(1 - sine**2 * bool(x or y))])
        weights = contributions(layout.at(middle, view), bank)
        if not weights.any():
            return np.inf
        way = sideways(layout, bank, middle) + depths(lens, layout, bank)[:, None] * (view[:2] / abs(view[2]))
        correlations.append(weights @ np.exp(-1j * scene.wavenumber * (way @ gap)) / weights.sum())
    return float(np.abs(np.array(correlations[1:]) - correlations[0]).max())
