"""Speed and memory of wave tracing as ratios, in one run on one core.

    python scripts/wavetracing_benchmark.py [--only NAME]

Times are CPU seconds of this process, the best of some repeats; the two sides of a ratio are run in turn, so that a
change of the machine's speed meets both. Only the row of two threads takes wall seconds. Rows against Embree need the
extra ``validate``.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import time
import warnings
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numba import njit

from specklegen.core.errors import DoubtWarning
from specklegen.wavetracing import CollimatedEmitter, Cone, Geometry, Mesh, Plane, perforated_screen, trace
from specklegen.wavetracing.kernels import cone_bvh, ray_bvh
from specklegen.wavetracing.kernels.region_patterns import draw_polygons

RAYS = 100_000
NO_FACETS = np.empty(0, np.int32)


@njit(nogil=True)
def _cones(origins, cone, tree, depths):
    """Move one cone to many origins; return the nodes visited."""
    visited = 0
    for n in range(origins.shape[0]):
        cone[:3] = origins[n]
        depths[n], _, count = cone_bvh.closest(cone, 0.0, np.inf, tree)
        visited += count
    return visited


def sphere(rings: int) -> Mesh:
    """A unit sphere of 4 rings (rings - 1) triangles, by latitude and longitude."""
    polar, turn = np.pi * np.arange(1, rings) / rings, np.pi * np.arange(2 * rings) / rings
    body = np.stack(
        [np.outer(np.sin(polar), np.cos(turn)), np.outer(np.sin(polar), np.sin(turn)),
         np.outer(np.cos(polar), np.ones(2 * rings))], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    vertices = np.concatenate([body, [[0, 0, 1], [0, 0, -1]]])
    n, top = 2 * rings, len(body)
    i, j = np.meshgrid(np.arange(rings - 2), np.arange(n), indexing="ij")
    a, b = (i * n + j).ravel(), (i * n + (j + 1) % n).ravel()
    j = np.arange(n)
    caps = [np.stack([np.full(n, top), j, (j + 1) % n], axis=1)]
    last = (rings - 2) * n
    caps.append(np.stack([np.full(n, top + 1), last + (j + 1) % n, last + j], axis=1))
    return Mesh(vertices, np.concatenate([np.stack([a, a + n, b], 1), np.stack([b, a + n, b + n], 1), *caps]))


def best(*runs: Callable[[], object], repeats: int = 5) -> list[float]:
    """CPU seconds of each run at its best, in turn."""
    for run in runs:
        run()
    times = [[] for _ in runs]
    for _ in range(repeats):
        for run, seconds in zip(runs, times, strict=True):
            start = time.process_time()
            run()
            seconds.append(time.process_time() - start)
    return [min(seconds) for seconds in times]


class Queries:
    """Rays and cones from below at a sphere."""

    def __init__(self, rings: int) -> None:
        self.scene = Geometry(sphere(rings))
        rng = np.random.default_rng(0)
        self.origins = np.column_stack([rng.uniform(-0.6, 0.6, (RAYS, 2)), np.full(RAYS, -3.0)])
        self.directions = np.tile([0.0, 0.0, 1.0], (RAYS, 1))
        self.out, self.place = np.empty(RAYS), np.empty(RAYS, np.int64)

    def rays(self) -> int:
        """Nodes visited by all rays."""
        return ray_bvh.nearest_of(self.origins, self.directions, 0.0, NO_FACETS, self.scene.tree, self.out, self.place)

    def cones(self, radius: float, count: int = RAYS) -> int:
        """Nodes visited by ``count`` cones of a width."""
        cone = Cone(np.zeros(3), np.eye(3), radius, radius, 1e-6, 1e-6).packed()
        return _cones(self.origins[:count], cone, self.scene.tree, self.out[:count])

    @property
    def triangle(self) -> float:
        """Radius of a disc of the area of a triangle."""
        return float(np.sqrt(4 / len(self.scene)))


def nodes() -> None:
    """Nodes visited, over sizes."""
    rows = [(len(q.scene), q.rays() / RAYS, q.cones(0.05, 2000) / 2000) for q in map(Queries, (15, 60, 240, 500))]
    for one, two in pairwise(rows):
        print(f"nodes of a ray, {one[0]} to {two[0]} triangles: {one[1]:.1f} to {two[1]:.1f}, "
              f"a doubling {(two[1] - one[1]) / np.log2(two[0] / one[0]):.2f} [<= 4]")  # fmt: skip
    print("nodes of a cone of width 0.05: " + ", ".join(f"{count:.0f}" for _, _, count in rows))


def queries() -> None:
    """A cone against a ray, and against Embree's."""
    for rings in (15, 60, 240):
        q = Queries(rings)
        ray, cone = best(q.rays, lambda q=q: q.cones(q.triangle))
        text = f"{len(q.scene)} triangles: ray {1e9 * ray / RAYS:.0f} ns, cone / ray {cone / ray:.2f} [<= 2]"
        try:
            import trimesh
            from trimesh.ray.ray_pyembree import RayMeshIntersector
        except ImportError:
            print(text)
            continue
        mesh = trimesh.Trimesh(q.scene.vertices, q.scene.faces, process=False)
        fast = RayMeshIntersector(mesh)
        cone, theirs = best(
            lambda q=q: q.cones(q.triangle), lambda q=q, f=fast: f.intersects_first(q.origins, q.directions)
        )
        own = q.scene.meshes[0]

        def their_build(mesh=mesh, q=q) -> None:
            RayMeshIntersector(mesh).intersects_first(q.origins[:1], q.directions[:1])

        mine, embree = best(lambda own=own: Geometry(own), their_build, repeats=3)
        size = (q.scene.memory + own.vertices.nbytes + own.faces.nbytes) / len(q.scene)
        print(f"{text}, cone / Embree {cone / theirs:.1f} [<= 15], build / Embree {mine / embree:.2f} [<= 4], "
              f"{size:.0f} B a triangle [<= 250]")  # fmt: skip


def sampler() -> None:
    """Microseconds an edge of the polygon sampler."""
    for sides in (4, 12, 32):
        turn = 2 * np.pi * np.arange(sides) / sides
        corners = 6 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        ends = np.roll(corners, -1, axis=0)
        edges = np.hstack([(corners + ends) / 2, ends - corners])
        area = 18 * sides * np.sin(2 * np.pi / sides)
        xi = np.empty((20_000, 2))
        (seconds,) = best(lambda edges=edges, area=area, xi=xi: draw_polygons(1, 2, 0, edges, area, xi))
        print(f"pattern of {sides} edges: {1e6 * seconds / 20_000 / sides:.2f} us an edge [<= 1]")


def screens() -> None:
    """An open beam through a hole of a screen of about 1000 triangles, over a ray."""
    turn = 2 * np.pi * np.arange(8) / 8
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    holes = [3 * ring + [30 * i, 30 * j] for i in range(-5, 5) for j in range(-5, 5)]
    outline = 1e5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    scene = Geometry(perforated_screen(outline, holes))
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-1, 1, (RAYS, 2)), np.full(RAYS, -10.0)])
    directions = np.tile([0.0, 0.0, 1.0], (RAYS, 1))
    out, place = np.empty(RAYS), np.empty(RAYS, np.int64)
    receiver = Plane(center=np.array([0, 0, 1e4]), shape=(8, 8), pitch=1e3)
    source, count = CollimatedEmitter([-1, -1, -10], [1, 1, -10], [0, 0, 1.0], 10.0, 1.0), 4000

    def rays() -> None:
        ray_bvh.nearest_of(origins, directions, 0.0, NO_FACETS, scene.tree, out, place)

    for amplitude in ("auto", "gaussian"):
        ray, beam = best(
            rays, lambda a=amplitude: trace(scene, source, receiver, count, 0, amplitude=a, threads=1), repeats=3
        )
        found = trace(scene, source, receiver, count, 0, amplitude=amplitude, threads=1).statistics
        print(f"{len(scene)} triangles, open beam ({amplitude}) / ray: {beam / count / (ray / RAYS):.0f} [<= 20]; "
              f"{found.region_triangles / found.regions:.0f} triangles a region")  # fmt: skip


def threads() -> None:
    """Wall seconds on one thread over those on two."""
    turn = np.pi / 6 * np.arange(12)
    star = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.where(np.arange(12) % 2, 3.5, 6.0)[:, None]
    scene = Geometry(perforated_screen(1e5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), [star]))
    source = CollimatedEmitter([-6, -6, -10], [6, 6, -10], [0, 0, 1.0], 1e4, 1.0)
    receiver = Plane(center=np.array([0, 0, 2500.0]), shape=(40, 40), pitch=30.0)
    wall, cpu = [], []
    for count in (1, 2, 1, 2):
        start, used = time.perf_counter(), time.process_time()
        trace(scene, source, receiver, 400_000, 0, amplitude="uniform", threads=count)
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - used)
    one, two = min(wall[::2]), min(wall[1::2])
    # On a busy machine the second thread waits for a core; what both take of the processor tells what they cost.
    print(f"{1e6 * one / 400_000:.1f} us a beam; two threads {one / two:.2f} times as fast [>= 1.7], "
          f"{min(cpu[1::2]) / min(cpu[::2]):.3f} of the processor seconds of one")  # fmt: skip


ROWS = {"nodes": nodes, "queries": queries, "sampler": sampler, "screens": screens, "threads": threads}


def main() -> None:
    """Print all rows, or one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=ROWS)
    only = parser.parse_args().only
    warnings.simplefilter("ignore", DoubtWarning)
    for name, row in ROWS.items():
        if only in (None, name):
            row()


if __name__ == "__main__":
    main()
