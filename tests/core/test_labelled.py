"""Results as data: what xarray, NumPy files and tables give back is the result to the bit, with axes and units."""

import csv
import dataclasses
import json

import h5py
import numpy as np
import pytest
import xarray
from refusals import assert_refused

import specklegen as sg
from specklegen.core import labelled
from specklegen.models.judging.evaluation import Evaluation

SLAB = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.Isotropic(), motion=sg.Brownian(diffusion=0.1))
LIGHT = sg.CollimatedBeams.tilts([0.0, 1e-3], width=100.0)
GRID = sg.FarField.grid((3, 4), 1e-3)


def scene(**changes):
    still = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.Isotropic())
    given = {"wavelength": 0.5, "medium": still, "illumination": LIGHT, "sensor": GRID} | changes
    return sg.Scene(**given)


def temporal(lags=(0.0, 0.5)):
    return sg.temporal_correlation(SLAB, wavelength=0.5, lags=lags, paths=500)


def evaluation():
    scores = {"sharp": {"pearson": np.array([0.5, 0.25])}}
    both = {"sharp": {"pearson": np.array([0.1, 0.2])}, "limited": {"pearson": np.array([0.3, np.nan])}}
    return Evaluation({"one": scores, "two": both}, np.array([3, 4]), np.array([1, -1]), np.array([0.5, 1.0]),
                      np.array([0, 0]), {"one": np.array([True, False]), "two": np.array([False, False])})  # fmt: skip


RESULTS = {
    "MemoryEffect": lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts=[0.0, 0.02, 0.3], paths=500),
    "JointCorrelation": lambda: sg.joint_correlation(SLAB, wavelength=0.5, tilts=[0.0, 0.01], shifts=[0.0, 1.0, 2.0],
                                                     lags=[0.0, 1.0], paths=500),
    "TemporalCorrelation": temporal, "ExposureContrast": lambda: temporal().contrast([0.1, 0.2, 1.0]),
    "Covariance": lambda: sg.covariance(scene(sensor=sg.FarField.grid((1, 3), 1e-3)), paths=500),
    "SpeckleStack": lambda: sg.render(scene(), paths=64), "Evaluation": evaluation,
}  # fmt: skip


@pytest.fixture(params=RESULTS)
def result(request):
    return RESULTS[request.param]()


def expected(result):
    return {name: each.values for name, each in result._arrays().items()}


def test_arrays_have_an_axis_a_dimension_and_are_all_that_the_result_holds(result):
    arrays = result._arrays()
    for each in arrays.values():
        assert len(each.axes) == each.values.ndim == len(set(each.axes))
    if dataclasses.is_dataclass(result) and not isinstance(result, Evaluation):
        held = {f.name for f in dataclasses.fields(result)} - {"classes", "decisions"}
        assert held == set(arrays) | set(result._single)


def test_datasets_hold_values_axes_and_units(result):
    data = result.to_xarray()
    for name, each in result._arrays().items():
        assert (name in data.coords) == each.coordinate
        assert data[name].dims == each.axes
        assert data[name].attrs["units"] == each.unit
        np.testing.assert_array_equal(data[name].values, each.values)
    assert data.attrs["result"] == type(result).__name__


def test_files_of_numpy_come_back_to_the_bit(result, tmp_path):
    result.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        told = json.loads(str(file["specklegen"]))
        assert told["result"] == type(result).__name__
        assert set(told["arrays"]) == set(expected(result)) == set(file) - {"specklegen"}
        for name, values in expected(result).items():
            assert file[name].dtype == values.dtype
            np.testing.assert_array_equal(file[name], values)


def test_tables_come_back_to_the_bit(result, tmp_path):
    result.to_csv(tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as file:
        head, *rows = csv.reader(line for line in file if not line.startswith("#"))
    columns = {name.partition(" [")[0]: column for name, column in zip(head, zip(*rows, strict=True), strict=True)}
    data = result.to_xarray()
    order = max((each.axes for each in result._arrays().values()), key=len)
    together = data.to_dataframe(dim_order=order).reset_index()
    assert len(rows) == len(together)
    for name, values in expected(result).items():
        parts = {f"{name}.real": "real", f"{name}.imag": "imag"} if np.iscomplexobj(values) else {name: ""}
        for column, part in parts.items():
            wanted = together[name].to_numpy()
            wanted = getattr(wanted, part) if part else wanted
            if wanted.dtype.kind == "f":
                found = np.array([float(x or "nan") for x in columns[column]], wanted.dtype)
                np.testing.assert_array_equal(found, wanted)
            else:
                assert [*columns[column]] == [str(x) for x in wanted.tolist()]


def whole(data, name):
    """An array of a file that may hold its real and imaginary parts as two."""
    return np.asarray(data[name]) if name in data else np.asarray(data[f"{name}.real"]) + 1j * data[f"{name}.imag"]


def test_files_of_netcdf_and_hdf5_come_back_to_the_bit(result, tmp_path):
    result.to_netcdf(tmp_path / "a.nc")
    result.to_hdf5(tmp_path / "a.h5")
    known = {name: int(x) if isinstance(x, bool) else x for name, x in result._numbers().items()}
    with xarray.open_dataset(tmp_path / "a.nc") as net, h5py.File(tmp_path / "a.h5") as file:
        for name, each in result._arrays().items():
            held = file[name].asstr() if each.values.dtype.kind == "U" else file[name]
            for found in (whole(net, name), np.asarray(held)):
                np.testing.assert_array_equal(found, each.values)
            assert file[name].attrs["units"] == each.unit
            assert tuple(file[name].dims[n].label for n in range(len(each.axes))) == each.axes
            assert net[name if name in net else f"{name}.real"].dims == each.axes
        for attributes in ({name.removesuffix("_of_views"): each for name, each in net.attrs.items()}, file.attrs):
            assert {name: attributes[name] for name in known} == pytest.approx(known, nan_ok=True)


def test_a_stack_says_where_its_views_and_lights_are():
    stack = sg.render(scene(), paths=64, realizations=2)
    data = stack.to_xarray()
    assert data["intensity"].dims == ("realizations", "tilts", "rows", "columns")
    np.testing.assert_array_equal(data["direction_x"][0], GRID.sines[0])
    np.testing.assert_allclose(data["light_direction_x"], np.sin([0.0, 1e-3]), rtol=1e-12)
    light = sg.IncoherentObject(brightness=np.ones((2, 2)), pitch=1e-4, width=100.0)
    image = sg.render(scene(illumination=light), paths=64)
    assert image.to_xarray()["intensity"].dims == ("rows", "columns")
    assert image.to_xarray()["intensity"].attrs["units"] == "squared length of the scene"
    near = sg.render(scene(sensor=sg.NearField([[0.0, 0.0, 20.0], [1.0, 0.0, 20.0]])), paths=64).to_xarray()
    assert near["intensity"].dims == ("tilts", "views_0")
    assert (near["z"].attrs["units"], near["intensity"].attrs["units"]) == ("length of the scene", "1")
    np.testing.assert_array_equal(near["x"], [0.0, 1.0])
    lens = sg.Imaging(shape=(4, 6), pitch=1.0, aperture=0.1, magnification=2.0)
    image = sg.render(scene(sensor=lens), paths=64).to_xarray()
    np.testing.assert_array_equal(image["y"], [-0.75, -0.25, 0.25, 0.75])  # on the plane in focus
    assert (image["x"].dims, image["intensity"].attrs["units"]) == (("columns",), "1")


def test_other_endings_and_endless_tables_are_refused(tmp_path, monkeypatch):
    curve = temporal()
    for path, verb in ((tmp_path / "a.csv", "save"), (tmp_path / "a.npz", "to_csv"), (3, "save"),
                       (tmp_path / "a.h5", "to_netcdf"), (tmp_path / "a.nc", "to_hdf5")):  # fmt: skip
        with pytest.raises(sg.RuleError, match=f"^{verb} path must be"):
            getattr(curve, verb)(path)
    monkeypatch.setattr(labelled, "MOST_ROWS", 1)
    assert_refused(lambda: curve.to_csv(tmp_path / "a.csv"), r"^TemporalCorrelation\.to_csv must be")
    assert not [*tmp_path.iterdir()]


def test_results_say_what_they_were_computed_of(tmp_path):
    """Medium, wavelength with its unit, mode, seed, paths and version, in every format."""
    medium = sg.Slab(thickness="10 um", mean_free_path="5 um", scatterer=sg.HenyeyGreenstein(0.9))
    asked = {"wavelength": "500 nm", "tilts": ["0 deg", "1 mrad"], "paths": 100, "seed": 7}
    curve = sg.memory_effect(medium, mode="reflection", **asked)
    known = {"medium": medium.canonical_json(), "wavelength": 0.5, "wavelength_unit": "micrometre", "seed": 7,
             "mode": "reflection", "view": "axis", "paths": 100, "version": sg.__version__}  # fmt: skip
    assert known.items() <= curve.physics.items()
    assert known.items() <= curve.to_xarray().attrs.items()
    curve.to_csv(tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert {f"# {name} = {value}" for name, value in known.items()} <= set(lines)
    assert np.loadtxt(lines[sum(line.startswith("#") for line in lines) + 1 :], delimiter=",").shape[0] == 2
    curve.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        assert known.items() <= json.loads(str(file["specklegen"]))["numbers"].items()
    moving = medium.replace(motion=sg.Brownian(diffusion="1 um^2/s"))
    blurred = sg.temporal_correlation(moving, lags=["1 ms"], **asked | {"seed": 2**40}).contrast(["2 ms", "0.01 s"])
    assert np.array_equal(blurred.exposures, [2e-3, 1e-2])
    blurred.to_netcdf(tmp_path / "b.nc")
    with xarray.open_dataset(tmp_path / "b.nc") as file:
        assert (file.attrs["seed"], file.attrs["wavelength_unit"]) == (str(2**40), "micrometre")
    stack = sg.render(scene(), paths=64, seed=3).physics
    assert (stack["seed"], stack["wavelength_unit"]) == (3, "length of the scene")
    assert sg.Scene(**{**{name: json.loads(stack[name]) for name in ("medium", "illumination", "sensor")},
                       "wavelength": stack["wavelength"]}) == scene()  # fmt: skip
    view = sg.memory_effect(medium, mode="reflection", view=[0.1, 0.0, -(0.99**0.5)], **asked).physics["view"]
    assert json.loads(view)[0] == 0.1
