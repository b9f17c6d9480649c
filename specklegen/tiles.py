"""Stacks too large for memory, piece by piece: the same paths, phases and noise as :func:`specklegen.render`.

    for where, field in sg.render_tiles(scene, seed=0):
        store[where] = field

Path sums come in tiles of at most 512 x 512 views and sixteen tilts, stationary stacks tilt by tilt. A bank of paths
is traced once where its connections fit, else once a piece.
"""

import warnings
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import numpy as np

from specklegen.core.arguments import instance
from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.random_streams import Seed
from specklegen.mean.field import mean_field
from specklegen.paths.reversal import Reverse
from specklegen.planning.planning import plan, streaming_obstacle
from specklegen.samplers.sampler import SamplerName, Where
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid


def render_tiles(
    scene: Scene,
    *,
    paths: int | None = None,
    rel_error: float | None = None,
    seed: Seed = 0,
    realization: int | None = None,
    sampler: SamplerName = "auto",
    reverse: Reverse = "auto",
    mean: bool = False,
    field_tolerance: float = 1e-3,
    threads: int | None = None,
) -> Iterator[tuple[Where, np.ndarray]]:
    """Render a stack piece by piece, in memory that its size does not bound.

    Parameters
    ----------
    scene
        Beams through a slab, seen on a regular far-field grid.
    paths, rel_error, sampler, reverse, mean, field_tolerance, threads
        See :func:`specklegen.render`; ``plan(..., streamed=True)`` states the memory.
    seed, realization
        Medium (seed, realization); None is that of :func:`specklegen.render` with ``realizations=None``, number 0.

    Returns
    -------
    iterator of (where, field)
        Slices (tilts, rows, columns) and complex64[t, h, w]. The pieces cover every view of every tilt once. They are
        those of the stack of ``render``: to the bit for path sums, within rounding from the stationary sampler and of
        the mean.

    Raises
    ------
    RuleError
        At once, for a scene of another kind, and as :func:`specklegen.plan` does.
    """
    obstacle = streaming_obstacle(instance("render_tiles scene", scene, Scene))
    if obstacle or sampler == "covariance":
        served = "CollimatedBeams through a slab, seen by a FarFieldGrid"
        reject("render_tiles scene", served, obstacle or sampler, "Use render.")
    made = plan(
        scene, paths=paths, rel_error=rel_error, sampler=sampler, reverse=reverse, mean=mean,
        field_tolerance=field_tolerance, streamed=True, threads=threads,
    )  # fmt: skip
    for doubt in made.doubts:
        warnings.warn(f"{doubt}. Leave the choice to sampler=\"auto\".", DoubtWarning, stacklevel=2)
    pieces = made.chosen.prepare(seed, threads).pieces(realization or 0)
    return _with_mean(pieces, scene if mean else None)


def render_to_zarr(scene: Scene, out: Path | str, *, progress: bool = False, **arguments):
    """Render a stack into a new zarr array at ``out``, complex64[T, H, W], by :func:`render_tiles`.

    Parameters
    ----------
    scene, arguments
        See :func:`render_tiles`.
    out
        Folder of the array; its chunks are one tilt of the stack's pieces. It gets its name when it is complete:
        until then it lies beside it as ``.NAME.unfinished``, which the next call for the same folder replaces.
    progress
        Show a bar.

    Returns
    -------
    zarr.Array

    Raises
    ------
    RuleError
        See :func:`render_tiles`.
    FileExistsError
        If there is something at ``out``.
    """
    import zarr
    from tqdm import tqdm

    out = Path(out)
    pieces = render_tiles(scene, **arguments)
    shape = (len(scene.beams.directions), *scene.sensor.shape)
    if out.exists():
        raise FileExistsError(f"{out} exists; choose another folder, or remove it.")
    unfinished = out.with_name(f".{out.name}.unfinished")
    first = list(islice(pieces, 1))  # the largest: those at the far edges are cut off
    chunks = (1, *first[0][1].shape[1:]) if first else shape
    array = zarr.create_array(str(unfinished), shape=shape, chunks=chunks, dtype=np.complex64, overwrite=True)
    with tqdm(total=int(np.prod(shape)), unit="view", unit_scale=True, disable=not progress) as bar:
        for where, field in chain(first, pieces):
            array[where] = field
            bar.update(field.size)
    unfinished.rename(out)
    return zarr.open_array(str(out), mode="r+")


def _with_mean(pieces: Iterator[tuple[Where, np.ndarray]], scene: Scene | None) -> Iterator[tuple[Where, np.ndarray]]:
    """Add the mean field of a scene, piece by piece."""
    for where, field in pieces:
        yield where, field if scene is None else field + mean_field(_part(scene, where)).astype(np.complex64)


def _part(scene: Scene, where: Where) -> Scene:
    """The scene with the tilts and views of a piece."""
    grid, (tilts, rows, columns) = scene.sensor, where
    assert isinstance(grid, FarFieldGrid)
    x, y = grid.sines
    x, y = x[columns], y[rows]
    part = grid.replace(shape=(len(y), len(x)), center=((x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2))
    return scene.replace(sensor=part, illumination=scene.beams.replace(directions=scene.beams.directions[tilts]))
