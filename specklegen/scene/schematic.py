"""A sketch of a scene from the side: light from the left, the medium, the views. Not to scale; the words say how large.

Point sources and near-field points of a medium with corners stand where they are, in units of its sides.
"""

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.errors import counted
from specklegen.scene.screens import ScreenStack

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from specklegen.scene.scene import Scene

_STEEPEST = 0.35
"""Slope at which the most tilted beam is drawn, when all are too close to the axis to be told apart."""
_MOST = 5
"""Beams drawn."""


def draw_scene(axes: "Axes", scene: "Scene") -> None:
    """Draw the sketch; the medium is the square from ``(0, -1)`` to ``(1, 1)`` of the axes."""
    _draw_medium(axes, scene)
    _draw_light(axes, scene)
    _draw_sensor(axes, scene)
    axes.set_xlim(-1.7, 2.7)
    axes.set_ylim(-1.45, 1.45)
    axes.set_axis_off()


def _draw_medium(axes: "Axes", scene: "Scene") -> None:
    if scene.thin is not None:
        _draw_screens(axes, scene, scene.thin)
        return
    medium = scene.volume
    if medium.has_sides and not medium.homogeneous:
        density = medium.extinction if scene.dimension == 2 else medium.extinction.mean(axis=1)
        axes.imshow(density.T, extent=(0, 1, -1, 1), origin="lower", cmap="Greys", vmin=0, aspect="auto")
    else:
        axes.fill_between([0, 1], -1, 1, color="0.85", lw=0)
        rng = np.random.default_rng(0)  # dots of a drawing; nothing is simulated with them
        across, along = rng.uniform(-0.97, 0.97, 400), rng.uniform(0.02, 0.98, 400)
        dots = int(np.clip(20 * medium.optical_depth, 10, 400))
        axes.plot(along[:dots], across[:dots], ".", color="0.45", ms=2.5)
    if medium.has_sides:
        axes.plot([0, 1, 1, 0, 0], [-1, -1, 1, 1, -1], color="0.3", lw=1)
    elif not medium.homogeneous:
        axes.vlines(medium.edges[1:-1] / medium.thickness, -1, 1, color="0.3", lw=1)
    words = f"{type(medium).__name__}, thickness {medium.thickness:.6g}\noptical depth {medium.optical_depth:.3g}"
    axes.text(0.5, 1.08, words, ha="center", va="bottom", fontsize=8)


def _draw_screens(axes: "Axes", scene: "Scene", stack: ScreenStack) -> None:
    depth = stack.thickness - stack.distances
    for place, phase in zip(depth / (stack.thickness or 1.0), stack.phases(scene.wavelength), strict=True):
        axes.plot([place, place], [-1, 1], color="0.3", lw=2, ls=(0, (1, 1)))
        axes.text(place, -1.12, f"{phase:.3g} rad", ha="center", va="top", fontsize=8)
    angle = stack.rms_angle(scene.wavelength)
    words = f"{type(scene.medium).__name__}, thickness {stack.thickness:.6g}\nrms angle {angle:.3g}"
    axes.text(0.5, 1.08, words, ha="center", va="bottom", fontsize=8)


def _draw_light(axes: "Axes", scene: "Scene") -> None:
    light = scene.illumination
    if light.near:
        axes.plot(*_placed(scene, light.points), "*", color="C3", ms=8)
        axes.text(-1.65, -1.3, counted(len(light.points), "point source"), fontsize=8)
        return
    if light.gridded:
        axes.imshow(np.abs(light.fields[0]), extent=(-1.65, -1.05, -0.3, 0.3), cmap="gray", vmin=0, aspect="auto")
        axes.text(-1.65, -1.3, "{}x{} pixels whose fields add".format(*light.fields.shape[1:]), fontsize=8)
        return
    if light.focused:
        depth = float(np.clip(light.points[:, -1].sum() / max(len(light.points), 1) / scene.thickness, -0.6, 1.6))
        for side in (-0.7, 0.7):
            axes.plot([-0.9, depth], [side, 0.0], color="C3", lw=1)
        axes.plot([-0.9, -0.9], [-0.7, 0.7], color="C3", lw=3, alpha=0.5)  # the lens
        axes.text(-1.65, -1.3, f"light focused on {counted(len(light.points), 'point')}", fontsize=8)
        return
    if light.images == ():
        axes.imshow(light.brightness, extent=(-1.65, -1.05, -0.3, 0.3), cmap="gray", vmin=0, aspect="auto")
        axes.text(-1.65, -1.3, "{}x{} mutually incoherent beams".format(*light.brightness.shape), fontsize=8)
    else:
        angle = np.rad2deg(np.arccos(np.clip(light.directions[:, -1], -1, 1))).max(initial=0.0)
        tilted = f", tilted by up to {angle:.3g}°" if angle else ""
        axes.text(-1.65, -1.3, counted(len(light.directions), "beam") + tilted, fontsize=8)
    spread = np.unique(np.round(light.directions[:, 0] / np.maximum(np.abs(light.directions[:, -1]), 1e-9), 12))
    chosen = spread[np.unique(np.linspace(0, len(spread) - 1, min(len(spread), _MOST)).astype(int))]
    largest = np.abs(chosen).max(initial=0.0)
    if largest < 0.05:
        chosen = chosen * (_STEEPEST / largest if largest else 1.0)
    for slope in np.clip(chosen, -2, 2):
        axes.annotate("", (-0.02, 0.0), (-0.9, -0.9 * slope), arrowprops={"arrowstyle": "->", "color": "C3", "lw": 1})
    if light.limited:
        axes.plot([0, 0], [-0.8, 0.8], color="C3", lw=3, alpha=0.5)
        axes.text(-0.06, -0.95, f"illuminated: {light.profile},\n{light.width:.6g} wide", ha="right", fontsize=8)
    else:
        axes.plot([-0.04, -0.04], [-1.2, 1.2], color="C3", lw=1, ls=":")


def _draw_sensor(axes: "Axes", scene: "Scene") -> None:
    sensor = scene.sensor
    shape = "x".join(map(str, sensor.shape))
    if sensor.near:
        axes.plot(*_placed(scene, scene.views), "s", color="C0", ms=4)
        axes.text(1.2, -1.3, f"{shape} near-field points", fontsize=8)
        return
    if sensor.focused:
        front, back = ((1.0, 2.3) if scene.side > 0 else (0.0, -1.35))
        plane = front + np.sign(scene.side) * np.clip(sensor.focus / (scene.thickness or 1.0), -1, 1)
        axes.plot([plane, plane], [-0.35, 0.35], color="C0", lw=2, ls="--")
        axes.plot([(front + back) / 2] * 2, [-0.6, 0.6], color="C0", lw=3, alpha=0.6)  # the lens
        axes.plot([back, back], [-0.35, 0.35], color="C0", lw=4)
        for height in (-0.6, 0.6):
            axes.plot([plane, (front + back) / 2, back], [0.0, height, 0.0], color="C0", lw=0.8, alpha=0.6)
        axes.text(back, 0.65, f"{shape} pixels\nthrough a lens", ha="center", va="bottom", fontsize=8)
        return
    sides = (scene.views[:, -1] >= 0, (2.3, 1.05)), (scene.views[:, -1] < 0, (-1.35, -0.08))
    for place, face in (drawn for some, drawn in sides if some.any()):
        axes.plot([place, place], [-0.55, 0.55], color="C0", lw=4)
        for height in (-0.45, 0.0, 0.45):
            axes.plot([face, place], [height * 0.4, height], color="C0", lw=0.8, alpha=0.6)
        axes.text(place, 0.65, f"{shape} directions\nin the far field", ha="center", va="bottom", fontsize=8)


def _placed(scene: "Scene", points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of points (x, ..., z) in the sketch, those far away at its rim."""
    medium = scene.volume
    if not medium.has_sides:
        along = points[:, -1] / (medium.thickness or 1.0)
        across = points[:, 0] / max(float(np.abs(points[:, 0]).max(initial=0.0)), 1e-300)
    else:
        low, high = medium.lower, medium.upper
        along = (points[:, -1] - low[-1]) / (high[-1] - low[-1])
        across = 2 * (points[:, 0] - low[0]) / (high[0] - low[0]) - 1
    return np.clip(along, -1.6, 2.6), np.clip(across, -1.2, 1.2)
