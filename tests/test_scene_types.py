"""Parts of a scene say what they are like; `make lint` counts the lines that ask for their types."""

import ast
import runpy
from pathlib import Path

import numpy as np
import pytest

import specklegen as sg

COUNTER = runpy.run_path(str(Path(__file__).parents[1] / "scripts/count_scene_types.py"))


def test_the_count_knows_every_part_and_every_way_to_ask():
    parts = COUNTER["part_names"]()
    assert parts >= {"Slab", "VoxelGrid", "PhaseScreen", "CollimatedBeams", "NearField", "Mie", "Sensor"}
    ask = COUNTER["asks"]
    for text in ("isinstance(x, Slab)", "not isinstance(a.b, Box | int)", "instance('x', x, FarFieldGrid)"):
        assert ask(ast.parse(text), parts) == {1}
    assert ask(ast.parse("isinstance(x, int); Slab(thickness=1)"), parts) == set()


BOX = sg.Box(lower=[-1, -1, 0], upper=[1, 2, 4], mean_free_path=1.0, scatterer=sg.Isotropic())
GRID = sg.VoxelGrid(lower=[-1, 0], upper=[1, 4], extinction=np.ones((4, 3)), scatterers=[sg.Isotropic()])
SLAB = sg.Slab(thickness=3.0, mean_free_path=1.0, scatterer=sg.Isotropic(), faces=sg.Faces(inside=1.5))
SCREEN = sg.PhaseScreen(rms_phase=1.0, correlation_length=10.0)


@pytest.mark.parametrize(("medium", "sides", "homogeneous", "dimension", "matched"), [
    (BOX, True, True, 3, True), (GRID, True, False, 2, True), (SLAB, False, True, None, False),
    (SCREEN, False, True, 3, True), (sg.GroundGlass(grit=220), False, True, 3, True),
    (sg.ScreenStack(screens=[SCREEN]), False, True, 3, True),
])  # fmt: skip
def test_media_say_what_they_are_like(medium, sides, homogeneous, dimension, matched):
    said = medium.has_sides, medium.homogeneous, medium.dimension, medium.faces.matched
    assert said == (sides, homogeneous, dimension, matched)
    assert (medium.stack is None) == (medium in (BOX, GRID, SLAB))


@pytest.mark.parametrize(
    ("light", "limited", "near", "coherent"),
    [(sg.PlaneWaves([[0.0, 0, 1]]), False, False, True), (sg.PointSources([[0.0, 0, -9]]), False, True, True),
     (sg.CollimatedBeams.tilts([0.0], width=9.0), True, False, True),
     (sg.FocusedBeams([[0.0, 0, 9]], aperture=0.1), True, False, True),
     (sg.light.CoherentObject(np.ones((2, 2)), 9.0), True, False, True),
     (sg.IncoherentObject(brightness=np.ones((1, 1)), pitch=1e-3, width=9.0), True, False, False)],
)  # fmt: skip
def test_lights_say_what_they_are_like(light, limited, near, coherent):
    assert (light.limited, light.near, light.coherent) == (limited, near, coherent)
    assert light.vectors.shape == (1, 3)
