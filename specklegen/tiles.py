"""Stacks too large for memory, piece by piece: the same paths, phases and noise as :func:`specklegen.render`.

    for where, field in sg.results.render_tiles(scene, seed=0):
        store[where] = field

Path sums come in tiles of at most 512 x 512 views and sixteen tilts, stationary stacks tilt by tilt. A bank of paths
is traced once where its connections fit, else once a piece.
"""

from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from specklegen.core.arguments import file_path, flag, instance, whole_number
from specklegen.core.budgets import Budget, BudgetFields, budget_of, require_time
from specklegen.core.errors import reject, warn_user
from specklegen.core.libraries import library_versions
from specklegen.core.shielded import shielded, shielded_steps
from specklegen.core.whole_files import making
from specklegen.mean.field import mean_field
from specklegen.planning.planning import Options, planned, streaming_obstacle
from specklegen.samplers.sampler import AnySampler, Where, require_finite
from specklegen.scene.scene import Scene


@shielded()
def render_tiles(
    scene: Scene, *, budget: Budget | None = None, realization: int | None = None, sampler: AnySampler = "auto",
    mean: bool = False, field_tolerance: float = 1e-3, **fields: Unpack[BudgetFields],
) -> Iterator[tuple[Where, np.ndarray]]:  # fmt: skip
    """Render a stack piece by piece, in memory that its size does not bound.

    Parameters
    ----------
    scene
        Beams through a slab, seen on a regular far-field grid.
    budget
        Paths or an error, seed, threads and reversed paths (:class:`specklegen.results.Budget`); ``rel_error`` as of
        :func:`specklegen.render`. By default 100 000 paths.
    realization
        Medium (seed, realization); None is that of :func:`specklegen.render` with ``realizations=None``, number 0.
    sampler
        "auto" takes the cheapest that is right within the tolerance; "paths", "stationary" or one of your own, where
        you know better (:func:`specklegen.plan` says what each serves).
    mean
        Add the mean field.
    field_tolerance
        Relative error of the NUFFT against the direct sum, between 0 and 1: smaller is slower.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

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

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> sum(piece.size for where, piece in sg.results.render_tiles(scene, seed=0))
    512
    """
    obstacle = streaming_obstacle(instance("render_tiles scene", scene, Scene))
    if obstacle or (isinstance(sampler, str) and sampler == "covariance"):
        served = "CollimatedBeams through a slab, seen by a FarFieldGrid"
        reject("render_tiles scene", served, obstacle or sampler, "Use render.")
    number = 0 if realization is None else whole_number("render_tiles realization", realization, 0, 2**63 - 1)
    budget = budget_of("render_tiles", budget, fields, unused=("seconds", "tolerance"))
    plan = planned(scene, budget, Options(sampler, mean, field_tolerance, streamed=True, owner="render_tiles"))
    require_time("render_tiles paths", plan.seconds, f"{plan.paths} paths", "Ask for fewer, or a larger rel_error.")
    remedy = "" if sampler == "auto" else ' Use sampler="auto".'
    for doubt in plan.doubts:
        warn_user(f"{doubt}.{remedy}")
    pieces = plan.chosen.prepare(budget.seed, budget.threads).fields(number)
    return shielded_steps(_with_mean(pieces, scene if mean else None))


def render_to_zarr(scene: Scene, out: Path | str, *, progress: bool = False, **arguments):
    """Render a stack into a new zarr group at ``out``, which xarray opens, by :func:`render_tiles`; return its field.

    The group holds ``field`` complex64[tilt, y, x] in the square root of the scene's unit of area a steradian, the
    direction sines ``x``, ``y`` of the views, and ``tilt_x``, ``tilt_y`` of the illumination. Its attributes hold the
    scene as JSON (``Scene.from_json`` reads it), the arguments, and the versions of the libraries.

    Parameters
    ----------
    scene
        Beams through a slab, seen on a regular far-field grid.
    out
        Folder of the group; chunks of the field are one tilt of the stack's pieces. It gets its name when it is
        complete: until then it lies beside it under a temporary name (:mod:`specklegen.core.whole_files`).
    progress
        Whether to show a bar.
    arguments
        ``paths`` (100 000 by default) or ``rel_error``, ``seed``, ``realization``, ``sampler``, ``reverse``, ``mean``,
        ``field_tolerance``, ``threads``: by name, with the meaning that they have in :func:`render_tiles`.

    Returns
    -------
    zarr.Array
        The field.

    Raises
    ------
    RuleError
        At once, for a scene of another kind, and for arguments that :func:`specklegen.plan` refuses.
    FileExistsError
        If there is something at ``out``.

    Examples
    --------
    >>> import tempfile
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sg.results.render_to_zarr(scene, f"{folder}/stack.zarr", seed=0).shape
    (2, 16, 16)
    """
    import zarr
    from tqdm import tqdm

    out, progress = file_path("render_to_zarr out", out), flag("render_to_zarr progress", progress)
    pieces = render_tiles(scene, **arguments)
    shape = (len(scene.beams.directions), *scene.sensor.shape)
    if out.exists():
        raise FileExistsError(f"{out} exists; choose another folder, or remove it.")
    first = list(islice(pieces, 1))  # the largest: those at the far edges are cut off
    chunks = (1, *first[0][1].shape[1:]) if first else shape
    about: dict[str, Any] = {
        "long_name": "field; |field|^2 is a differential scattering cross-section for unit irradiance",
        "units": "unit of length",
        "coordinates": "x y tilt_x tilt_y",
    }
    with making(out) as temporary:
        group = zarr.create_group(str(temporary), attributes=_attributes(scene, arguments))
        for name, dims, values, meaning in _axes(scene):
            attributes: dict[str, Any] = {"long_name": meaning, "units": "1"}
            axis = group.create_array(
                name, shape=values.shape, dtype="float64", dimension_names=dims, attributes=attributes
            )
            axis[...] = values
        array = group.create_array(
            "field", shape=shape, chunks=chunks, dtype="complex64", dimension_names=("tilt", "y", "x"), attributes=about
        )
        with tqdm(total=int(np.prod(shape)), unit="view", unit_scale=True, disable=not progress) as bar:
            for where, field in chain(first, pieces):
                array[where] = field
                bar.update(field.size)
    return zarr.open_group(str(out), mode="r+")["field"]


def _attributes(scene: Scene, arguments: dict[str, Any]) -> dict[str, Any]:
    """Attributes of a group; JSON types."""
    return {
        "title": "speckle stack of specklegen", "scene": scene.model_dump_json(by_alias=True),
        "arguments": {name: repr(value) for name, value in arguments.items()}, "libraries": library_versions(),
    }  # fmt: skip


def _axes(scene: Scene) -> list[tuple[str, tuple[str, ...], np.ndarray, str]]:
    """Name, dimensions, values and meaning of each axis of a stack."""
    grid = scene.grid
    (x, y), light = grid.sines, scene.beams.directions
    return [
        ("x", ("x",), x, "direction sine of the view in x, inside the medium"),
        ("y", ("y",), y, "direction sine of the view in y, inside the medium"),
        ("tilt_x", ("tilt",), light[:, 0], "direction sine of the illumination in x, inside the medium"),
        ("tilt_y", ("tilt",), light[:, 1], "direction sine of the illumination in y, inside the medium"),
    ]


def _with_mean(pieces: Iterator[tuple[Where, np.ndarray]], scene: Scene | None) -> Iterator[tuple[Where, np.ndarray]]:
    """Add the mean field of a scene, piece by piece; refuse what float32 does not hold."""
    for where, field in pieces:
        if scene is not None:
            field = field + mean_field(_part(scene, where)).astype(np.complex64)
        yield where, require_finite(field)


def _part(scene: Scene, where: Where) -> Scene:
    """The scene with the tilts and views of a piece."""
    grid, (tilts, rows, columns) = scene.grid, where
    x, y = grid.sines
    x, y = x[columns], y[rows]
    part = grid.replace(shape=(len(y), len(x)), center=((x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2))
    return scene.replace(sensor=part, illumination=scene.beams.replace(directions=scene.beams.directions[tilts]))
