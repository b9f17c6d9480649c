"""The coherent wave of a random layer, by the 1D solver and by the engine's mean for the equivalent slab."""

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.fdtd import RandomLayer, coherent_transmission, equivalent_slab

WAVELENGTH = 0.6  # vacuum, micrometres
REALIZATIONS = 4000


def engine_mean(slab_thickness: float, mean_free_path: float, index: float) -> float:
    """|m| at v = i over that of an empty slab, from the engine: the beam's own coherent transmission."""

    def peak(free_path: float) -> float:
        scene = sg.Scene(wavelength=WAVELENGTH / index,
                         medium=sg.Slab(thickness=slab_thickness, mean_free_path=free_path, scatterer=sg.Isotropic()),
                         illumination=sg.CollimatedBeams.tilts([0.0], width=2000.0),
                         sensor=sg.FarField(directions=[[0.0, 0.0, 1.0]]))  # fmt: skip
        return float(np.abs(sg.mean_field(scene)[0, 0]))

    return peak(mean_free_path) / peak(1e12)


def layer(cells: int, correlation_length: float, rms_index: float) -> RandomLayer:
    return RandomLayer(n_points=cells, dx=0.002, correlation_length=correlation_length, rms_index=rms_index)


@pytest.mark.parametrize(("cells", "correlation_length", "rms_index"),
                         [(7000, 0.05, 0.1), (3500, 0.05, 0.08), (1500, 0.02, 0.1)])  # fmt: skip
def test_both_means_agree_where_both_are_valid(cells, correlation_length, rms_index):
    random = layer(cells, correlation_length, rms_index)
    slab = equivalent_slab(random, WAVELENGTH)
    assert slab.valid
    solver = coherent_transmission(random, WAVELENGTH, "transfer_matrix", n_realizations=REALIZATIONS)
    ours = engine_mean(slab.thickness, slab.mean_free_path, random.n_background)
    # Beyond noise, the limits that `coherent` states: OD to 1 % (rms index / n_b <= 0.07), L_c / L of the forward part.
    slack = 0.5 * slab.optical_depth * (0.01 + correlation_length / slab.thickness) * ours
    assert_z(abs(solver.amplitude), ours, solver.standard_error, slack=slack)


def test_a_wrong_mean_free_path_is_caught():
    random = layer(7000, 0.05, 0.1)
    slab = equivalent_slab(random, WAVELENGTH)
    solver = coherent_transmission(random, WAVELENGTH, "transfer_matrix", n_realizations=REALIZATIONS)
    wrong = engine_mean(slab.thickness, 1 / slab.forward_coefficient * 1.2, random.n_background)
    refute_z(abs(solver.amplitude), wrong, solver.standard_error)


def test_a_phase_screen_has_no_equivalent_slab():
    random = layer(1500, 3.0, 0.03)
    slab = equivalent_slab(random, WAVELENGTH)
    assert not slab.valid
    assert "correlation lengths" in slab.reason
    solver = coherent_transmission(random, WAVELENGTH, "transfer_matrix", n_realizations=REALIZATIONS)
    ours = engine_mean(slab.thickness, slab.mean_free_path, random.n_background)
    refute_z(abs(solver.amplitude), ours, solver.standard_error)
