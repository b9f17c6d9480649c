"""Coherent objects behind screens whose phases are drawn: when they are, and what it costs."""

from collections.abc import Sequence

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.nanoseconds import Cost
from specklegen.samplers.sampler import FIXED_BYTES, TORCH_BYTES
from specklegen.scene.scene import Scene
from specklegen.synthesis.drawn_screens import HELD, DrawnScreens, drawn_scene

MOST_POINTS = 4096
"""Points along a side, at most: a medium of one screen takes some seconds then."""


def drawn_cost(scene: Scene) -> Cost:
    """Count the operations of one medium."""
    drawn, amplitudes = drawn_scene(scene)
    of_medium, of_object, of_light = drawn.flops
    once = len(amplitudes) * of_light
    first = {"normal": float(np.prod(drawn.normals)), "flop": once + of_medium + len(amplitudes) * of_object}
    return Cost(first, {"flop": once})


def drawn_memory(scene: Scene) -> int:
    """Bytes by which the process grows at most."""
    drawn, amplitudes = drawn_scene(scene)
    held = 4 * len(drawn.stack.screens) + 4 * (len(amplitudes) if drawn.moved is None else 2)
    held += 6 * scene.sensor.near  # phases to the plane of points, in double precision
    images = 16.0 * len(amplitudes) * np.prod(scene.sensor.shape, dtype=float)
    return int(held * drawn.bytes + images + TORCH_BYTES + FIXED_BYTES)


def always_drawn(scene: Scene) -> bool:
    """Return whether no Gaussian field serves: phases of many directions count, or screens move."""
    return scene.sensor.regular_grid is None or getattr(scene.illumination, "times", None) is not None


def drawn_decision(scene: Scene, decisions: Sequence[Decision] = ()) -> Decision | None:
    """Return why phases are drawn: Gaussian fields are off by more than allowed, and the grid holds the light."""
    doubted, must = [each for each in decisions if each.part == "screens" and each.doubt], always_drawn(scene)
    if not (doubted or must):
        return None
    drawn, _ = drawn_scene(scene)
    if drawn.points > MOST_POINTS:
        if must:
            _reject_points(scene, drawn)
        return None
    gaussian = f". As Gaussian speckle ({doubted[0].reason})" if doubted else ""
    close = scene.sensor.near or scene.sensor.focused  # type: ignore[attr-defined]
    edges = "; edges of the lit area may add 0.001 of it at points and through lenses" if close else ""
    return Decision(
        "screens", True, f"phases drawn on {drawn.points}x{drawn.points} points, {drawn.spacing:.3g} apart, and light "
        f"carried from screen to screen; what the grid folds is below {HELD:.0e} of the light{edges}{gaussian}",
    )  # fmt: skip


def _reject_points(scene: Scene, drawn: DrawnScreens) -> None:
    reject(
        "CoherentObject.width", f"so small that {MOST_POINTS} points a side hold the light from screen to screen",
        f"{drawn.points} points",
        "A lens, points behind the screens and screens that move need the field itself. Its angles ask for points "
        f"{drawn.spacing:.3g} apart, and light and screens move over {drawn.period:.3g}. Use a smaller object, weaker "
        "screens, shorter distances or shorter times, or look at the far field of screens at rest.",
    )  # fmt: skip
