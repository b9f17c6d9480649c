"""Places of a city for maps of coverage, by rule: lengths in metres."""

from typing import NamedTuple

import numpy as np

from specklegen.wavetracing import Building, Geometry, Mesh, Plane, Transmitter

CONCRETE = Building(name="concrete")


class Place(NamedTuple):
    """A scene, its antenna, its map, the outlines drawn over it, and boxes that are solid."""

    scene: Geometry
    antenna: Transmitter
    plane: Plane
    outlines: list[np.ndarray]
    solids: list

    @property
    def air(self) -> np.ndarray:
        """bool[h, w], whether the middle of a cell lies in no solid."""
        return self.outside(self.plane.points)

    def outside(self, points, margin=0.0) -> np.ndarray:
        """bool[...], whether points float64[..., 3] lie in no solid, nor within a margin of one."""
        free = np.ones(points.shape[:-1], bool)
        for a, b in self.solids:
            free &= ~((points > np.array(a) - margin) & (points < np.array(b) + margin)).all(axis=-1)
        return free


def box(lower, upper, material=CONCRETE) -> Mesh:
    """A solid between two corners, normals outwards."""
    lower, upper = np.array(lower, float), np.array(upper, float)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (upper - lower) + lower
    quads = (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(faces), material)


def wall(start, end, low, high, material) -> Mesh:
    """An upright rectangle from ``start`` to ``end`` (x, y), between two heights."""
    (x, y), (u, v) = start, end
    corners = np.array([[x, y, low], [u, v, low], [u, v, high], [x, y, high]], float)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), material)


def outline(lower, upper, axes=(0, 1)) -> np.ndarray:
    """Rectangle of a box in a map, float64[5, 2]."""
    (a, b), (c, d) = (lower[axes[0]], lower[axes[1]]), (upper[axes[0]], upper[axes[1]])
    return np.array([[a, b], [c, b], [c, d], [a, d], [a, b]], float)


def street_canyon() -> Place:
    """Four blocks of houses, a street between them and one across; the antenna stands in the street."""
    blocks = [((x, y, 0), (x + 40, y + 30, 20)) for x in (-46, 6) for y in (-36, 6)]
    ground = Mesh([[-120, -120, 0], [120, -120, 0], [120, 120, 0], [-120, 120, 0.0]], np.array([[0, 1, 2], [0, 2, 3]]),
                  Building(name="concrete"))  # fmt: skip
    scene = Geometry([ground, *(box(a, b) for a, b in blocks)])
    plane = Plane(center=[0, 0, 1.5], shape=(25, 30), pitch=3.3)
    return Place(scene, Transmitter([-38, 0, 4.0], beam_angle=0.05), plane, [outline(a, b) for a, b in blocks], blocks)


def forty_blocks(seed: int = 1) -> Place:
    """Eight by five blocks of houses, 12 to 30 m high by ``seed``, streets of 12 m between; an antenna in a street."""
    heights = np.random.default_rng(seed).uniform(12, 30, (8, 5))
    blocks = [((52 * i - 202, 42 * j - 105, 0), (52 * i - 162, 42 * j - 75, heights[i, j])) for i in range(8)
              for j in range(5)]  # fmt: skip
    ground = Mesh([[-260, -160, 0], [260, -160, 0], [260, 160, 0], [-260, 160, 0.0]], np.array([[0, 1, 2], [0, 2, 3]]),
                  CONCRETE)  # fmt: skip
    scene = Geometry([ground, *(box(a, b) for a, b in blocks)])
    plane = Plane(center=[0, 0, 1.5], shape=(36, 68), pitch=6.0)
    antenna = Transmitter([-40, -27, 8.0], beam_angle=0.05)
    return Place(scene, antenna, plane, [outline(a, b) for a, b in blocks], blocks)


def stairwell() -> Place:
    """Three flights of stairs, each beside the one below, in a shaft of concrete; a map upright along the flights."""
    parts = [((0, 0, -0.2), (8, 3, 0)), ((-0.2, 0, 0), (0, 3, 9)), ((8, 0, 0), (8.2, 3, 9)), ((0, 0, 9), (8, 3, 9.2)),
             ((0, -0.2, 0), (8, 0, 9)), ((0, 3, 0), (8, 3.2, 9))]  # fmt: skip
    steps = []
    for flight in range(2):
        for step in range(10):
            x = 1.5 + 0.5 * (step if flight == 0 else 9 - step)
            z = 3.0 * flight + 0.3 * step
            low, high = (0.0, 1.4) if flight == 0 else (1.6, 3.0)
            steps.append(((x, low, z + 0.15), (x + 0.5, high, z + 0.3)))
    landings = [((6.5, 0, 2.85), (8, 3, 3.0)), ((0, 0, 5.85), (1.5, 3, 6.0))]
    solids = [*parts, *steps, *landings]
    scene = Geometry([box(a, b) for a, b in solids])
    plane = Plane(center=[4, 0.7, 4.5], normal=[0, 1.0, 0], up=[0, 0, 1.0], shape=(22, 20), pitch=0.4)
    drawn = [outline(a, b, (0, 2)) for a, b in (*parts[:4], *landings, *steps[:10])]
    return Place(scene, Transmitter([7.2, 1.5, 1.5], beam_angle=0.12), plane, drawn, solids)


def two_rooms() -> Place:
    """Two rooms of plasterboard with a door between them, and an antenna in one."""
    board, shell = Building(name="plasterboard", thickness=0.1), Building(name="brick", thickness=0.25)
    outer = [((-5, -3), (5, -3)), ((5, -3), (5, 3)), ((5, 3), (-5, 3)), ((-5, 3), (-5, -3))]
    inner = [((0, -3), (0, 0.5)), ((0, 1.5), (0, 3))]
    walls = [wall(a, b, 0, 2.7, shell) for a, b in outer] + [wall(a, b, 0, 2.7, board) for a, b in inner]
    floors = [Mesh([[-5, -3, z], [5, -3, z], [5, 3, z], [-5, 3, z]], np.array([[0, 1, 2], [0, 2, 3]]), CONCRETE)
              for z in (0.0, 2.7)]  # fmt: skip
    plane = Plane(center=[0, 0, 1.2], shape=(24, 40), pitch=0.25)
    drawn = [np.array(part, float) for part in (*outer, *inner)]
    antenna = Transmitter([-3.5, -2, 1.8], beam_angle=0.12)
    return Place(Geometry([*walls, *floors]), antenna, plane, drawn, [])


PLACES = {"street canyon": street_canyon, "stairwell": stairwell, "two rooms": two_rooms}
