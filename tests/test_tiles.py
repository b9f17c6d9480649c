"""Stacks piece by piece: the pieces cover the stack of render, to the bit or within rounding."""

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import specklegen as sg
from specklegen.paths.chunks import Chunks
from specklegen.paths.pilot import scene_pilot
from specklegen.samplers.path_sums import sampler, summation, tiling
from specklegen.samplers.path_sums.cost import Work, memory_bytes
from specklegen.samplers.stationary.sampler import Stationary

SINGLE = 1e-5  # complex64 sums of some thousand terms of order 1


def scene(shape=(40, 33), tilts=5, side="transmission", width=2e4) -> sg.Scene:
    return sg.Scene(wavelength=1.0,
                    medium=sg.Slab(thickness=200.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.7)),
                    illumination=sg.CollimatedBeams.tilts(1e-4 * np.arange(tilts), width=width),
                    sensor=sg.FarField.grid(shape=shape, pitch=0.4 / width, side=side))  # fmt: skip


CASES = {
    "nufft": (scene(), {"sampler": "paths", "paths": 3000}),
    "reversed, summed directly": (scene((20, 17), 2, "reflection", 40.0),
                                  {"sampler": "paths", "paths": 200, "reverse": True}),
    "stationary": (scene(), {"sampler": "stationary", "paths": 3000}),
}  # fmt: skip


@pytest.fixture
def small_pieces(monkeypatch):
    """Pieces of 16 views a side and two tilts; three chunks of paths, traced anew for each."""
    monkeypatch.setattr(tiling, "MOST_VIEWS", 16)
    monkeypatch.setattr(sampler, "TILTS_STREAMED", 2)
    monkeypatch.setattr(sampler, "CONNECTIONS_KEPT", 0)
    monkeypatch.setattr(Chunks, "count", 3)
    summation.scene_nufft.cache_clear()
    yield
    summation.scene_nufft.cache_clear()


def gathered(this: sg.Scene, **options) -> tuple[np.ndarray, int]:
    """The stack from its pieces, each view of which must come once, and their number."""
    shape = (len(this.lights), *this.sensor.shape)
    field, times, pieces = np.zeros(shape, np.complex64), np.zeros(shape, int), 0
    for where, part in sg.render_tiles(this, **options):
        assert part.dtype == np.complex64
        assert field[where].shape == part.shape
        field[where] = part
        times[where] += 1
        pieces += 1
    assert (times == 1).all()
    return field, pieces


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("mean", [False, True])
@pytest.mark.usefixtures("small_pieces")
def test_pieces_are_the_whole(name, mean):
    this, options = CASES[name]
    found, pieces = gathered(this, seed=3, mean=mean, threads=2, **options)
    expected = sg.render(this, seed=3, mean=mean, threads=1, **options).field
    assert pieces > 3
    if name == "stationary" or mean:
        assert np.abs(found - expected).max() < SINGLE * np.abs(expected).max()
    else:
        assert found.tobytes() == expected.tobytes()
    other, _ = gathered(this, seed=3, realization=1, mean=mean, **options)
    assert np.abs(other - found).max() > 0.1 * np.abs(sg.render(this, seed=3, **options).field).max()


@pytest.mark.usefixtures("small_pieces")
def test_a_stack_goes_to_zarr(tmp_path):
    this, options = CASES["nufft"]
    array = sg.render_to_zarr(this, tmp_path / "stack.zarr", seed=3, **options)
    assert array[:].tobytes() == sg.render(this, seed=3, **options).field.tobytes()
    assert array.chunks == (1, *next(sg.render_tiles(this, seed=3, **options))[1].shape[1:])
    with pytest.raises(FileExistsError, match="choose another folder"):
        sg.render_to_zarr(this, tmp_path / "stack.zarr", seed=3, **options)


@pytest.mark.usefixtures("small_pieces")
def test_a_stack_in_zarr_explains_itself(tmp_path):
    """xarray opens it, its axes have values and meanings, and its scene renders to the same bits."""
    xarray = pytest.importorskip("xarray")
    this, options = CASES["nufft"]
    sg.render_to_zarr(this, tmp_path / "stack.zarr", seed=3, **options)
    data = xarray.open_zarr(tmp_path / "stack.zarr", consolidated=False)
    assert data.field.dims == ("tilt", "y", "x")
    x, y = this.sensor.sines
    assert np.array_equal(data.x, x)
    assert np.array_equal(data.y, y)
    assert np.array_equal(data.tilt_x, this.illumination.directions[:, 0])
    assert {"x", "y", "tilt_x", "tilt_y"} <= set(data.field.coords)
    assert all(data[name].attrs["units"] and data[name].attrs["long_name"] for name in ("field", "x", "tilt_y"))
    assert data.attrs["arguments"]["seed"] == "3"
    again = sg.Scene.from_json(data.attrs["scene"])
    assert again == this
    assert data.field.values.tobytes() == sg.render(again, seed=3, **options).field.tobytes()


@pytest.mark.usefixtures("small_pieces")
def test_an_interrupted_stack_has_no_name_and_is_made_anew(tmp_path, monkeypatch):
    this, options = CASES["nufft"]
    real = sampler.nufft_tile

    def fails(layout, bank, phases, plan, tile, **rest):
        if tile.rows.start:
            raise KeyboardInterrupt
        return real(layout, bank, phases, plan, tile, **rest)

    with monkeypatch.context() as patch:
        patch.setattr(sampler, "nufft_tile", fails)
        with pytest.raises(KeyboardInterrupt):
            sg.render_to_zarr(this, tmp_path / "stack.zarr", seed=3, **options)
    assert not (tmp_path / "stack.zarr").exists()
    array = sg.render_to_zarr(this, tmp_path / "stack.zarr", seed=3, **options)
    assert array[:].tobytes() == sg.render(this, seed=3, **options).field.tobytes()
    assert [file.name for file in tmp_path.iterdir()] == ["stack.zarr"]


@pytest.mark.usefixtures("small_pieces")
def test_pieces_are_summed_with_one_thread_of_linear_algebra(monkeypatch):
    """As a render is: more would change last bits. Between pieces the caller has them all again."""
    real, seen = sampler.nufft_tile, []

    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    def watched(*args, **kwargs):
        seen.append(threads())
        return real(*args, **kwargs)

    monkeypatch.setattr(sampler, "nufft_tile", watched)
    this, options = CASES["nufft"]
    with threadpool_limits(2):
        for _ in sg.render_tiles(this, seed=3, **options):
            assert threads() == {2}
    assert seen
    assert all(each == {1} for each in seen)


def test_what_cannot_be_streamed_is_refused_at_once():
    this = scene()
    with pytest.raises(sg.RuleError, match="seen by a FarFieldGrid; got 'CollimatedBeams seen by FarField'"):
        sg.render_tiles(this.replace(sensor=sg.FarField(directions=[[0.0, 0.0, 1.0]])))
    box = sg.Box(lower=[-1.0] * 3, upper=[1.0] * 3, mean_free_path=1.0, scatterer=sg.Isotropic())
    with pytest.raises(sg.RuleError, match="got 'the medium is a Box'. Use render"):
        sg.render_tiles(this.replace(medium=box), paths=1000)


@pytest.mark.parametrize("stationary", [False, True])
def test_what_is_held_does_not_grow_with_the_stack(stationary):
    """4096 x 4096 views of 100 tilts are 12.5 GiB; as one stack the same work is stated beyond that."""
    bytes_held = {}
    for n in (2048, 4096):
        for streamed in (False, True):
            this = scene((n, n), 100, width=1e5)
            if stationary:
                pilot = scene_pilot(scene((8, 8), 1, width=1e5), False)
                needed = Stationary(this, 10_000, "axial", pilot, streamed).memory(1)
            else:
                needed = memory_bytes(Work(this, 10_000, 10.0, 1.0, True, None, 1, streamed=streamed), 1)
            bytes_held[n, streamed] = needed
    assert bytes_held[4096, False] > 100 * 4096**2 * 8
    assert bytes_held[4096, True] < 0.2 * bytes_held[4096, False]
    if not stationary:
        assert bytes_held[2048, True] == bytes_held[4096, True]
