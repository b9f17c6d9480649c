"""Jones matrices of connections against projections written out in space; those of walks against their parts."""

import numpy as np
import pytest
from scenes import slab as slab_of_depth

import specklegen as sg
from specklegen.kernels.jones import node_place
from specklegen.paths.bank import backwards, walk_frame
from specklegen.paths.endpoints import AXIS
from specklegen.paths.jones import Ends, connection_matrices, laboratory_frame, scattering, type_matrices, walk_matrices
from specklegen.paths.phase_tables import walk_lobes
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.slab_tracer import trace

RAYLEIGH = Ends((sg.Rayleigh(),), "projector")


def directions(count, seed=0):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def slab(depth=3.0, polarisation="projector", scatterer=None):
    return slab_of_depth(depth).replace(scatterer=scatterer or sg.Rayleigh(), polarisation=polarisation)


def in_space(matrix, before, after):
    """A matrix between the walk's frames of two directions as what it does to fields in space, complex[..., 3, 3]."""
    return np.swapaxes(walk_frame(after), -1, -2) @ matrix @ walk_frame(before)


def projected(before, after):
    """(I - w w^T) on fields across ``before``, over the root of (1 + cos^2) / 2."""
    cos = (before * after).sum(-1)[..., None, None]
    outer = np.einsum("...i,...j", after, after)
    across = np.eye(3) - np.einsum("...i,...j", before, before)
    return (np.eye(3) - outer) @ across * np.sqrt(2 / (1 + cos**2))


def test_a_scattering_takes_away_what_lies_along_the_new_direction():
    before, after = directions(50), directions(50, 1)
    found = scattering(RAYLEIGH, before, walk_frame(before), after, walk_frame(after))
    np.testing.assert_allclose(in_space(found, before, after), projected(before, after), atol=1e-12)
    straight = scattering(RAYLEIGH, before, walk_frame(before), before, walk_frame(before))
    np.testing.assert_allclose(straight, np.broadcast_to(np.eye(2), (50, 2, 2)), atol=1e-12)
    back = scattering(RAYLEIGH, before, walk_frame(before), -before, walk_frame(-before))
    across = np.eye(3) - np.einsum("...i,...j", before, before)
    np.testing.assert_allclose(np.abs(in_space(back, before, -before)), np.abs(across), atol=1e-7)


def test_walked_backwards_fields_see_the_transposed_matrix():
    first, last = directions(20), directions(20, 1)
    matrices = np.random.default_rng(2).normal(size=(20, 2, 2)) + 1j * np.random.default_rng(3).normal(size=(20, 2, 2))
    found = in_space(backwards(matrices, first, last), -last, -first)
    np.testing.assert_allclose(found, np.swapaxes(in_space(matrices, first, last), -1, -2), atol=1e-12)


@pytest.mark.parametrize("polarisation", ["projector", "vector"])
def test_a_walk_of_three_scatterings_carries_the_one_between(polarisation):
    """M is then S of the middle vertex, of the angle between the directions that are recorded; |M|^2 = 2."""
    medium = slab(polarisation=polarisation)
    bank = trace(medium, plane_proposal(medium, AXIS, AXIS[None]), 1, 2000)
    assert bank.jones is not None
    many = bank.multiple
    np.testing.assert_allclose(np.square(np.abs(many.jones)).sum(axis=(1, 2)), 2, atol=1e-12)
    two, three = bank.select(bank.orders == 2), bank.select(bank.orders == 3)
    np.testing.assert_array_equal(two.jones, np.broadcast_to(np.eye(2), two.jones.shape))
    one, other = three.entry_direction, three.exit_direction
    expected = projected(one, other)
    found = in_space(three.jones, one, other)
    np.testing.assert_allclose(found, expected, atol=1e-9 if polarisation == "projector" else 1e-4)


def test_ends_are_projections_too():
    medium = slab()
    bank = trace(medium, plane_proposal(medium, AXIS, AXIS[None]), 1, 500)
    view = np.array([0.6, 0.0, 0.8])
    found = connection_matrices(RAYLEIGH, bank, AXIS, view)
    for n in np.flatnonzero(bank.orders == 3)[:20]:
        one, last = bank.entry_direction[n], bank.exit_direction[n]
        way = projected(last, view) @ projected(one, last) @ projected(AXIS, one)
        here, there = laboratory_frame(AXIS), laboratory_frame(view)
        np.testing.assert_allclose(found[n], there @ way @ here.T, atol=1e-9)


def test_the_way_back_is_the_transposed_way():
    """In exact backscattering, so that light of kept helicity interferes at its full strength."""
    medium = slab()
    bank = trace(medium, plane_proposal(medium, AXIS, -AXIS[None], bidirectional=True), 1, 300)
    there = connection_matrices(RAYLEIGH, bank.multiple, AXIS, -AXIS)
    back = connection_matrices(RAYLEIGH, bank.reversed(), AXIS, -AXIS)
    np.testing.assert_allclose(back, np.swapaxes(there, -1, -2), atol=1e-12)
    assert len(there) > 100


def test_banks_are_pure_functions_of_their_paths():
    medium = slab()
    proposal = plane_proposal(medium, AXIS, AXIS[None])
    whole = trace(medium, proposal, 1, 5000)
    part = trace(medium, proposal, 1, 600, first=4200)
    place = (whole.paths >= 4200) & (whole.paths < 4800)
    np.testing.assert_array_equal(whole.select(place).jones, part.jones)
    np.testing.assert_array_equal(whole.select(place).records, part.records)
    assert trace(slab(polarisation="scalar"), proposal, 1, 10).jones is None


def test_tables_of_walks_follow_the_amplitudes():
    """Half-way between nodes, of a sphere larger than the wavelength."""
    pytest.importorskip("miepython")
    sphere = sg.Mie(radius=0.6, wavelength=0.5, refractive_index=1.2)
    ends = Ends((sphere,), "vector")
    nodes, table = walk_lobes(sphere)[0].rows[:, 0], walk_matrices(ends)
    middle = (nodes[:-1] + nodes[1:]) / 2
    one, two = sphere.amplitude_matrix(1 - middle)
    exact = np.stack([one, two]) * np.sqrt(2 / (abs(one) ** 2 + abs(two) ** 2))
    at = table[:, 0] + 1j * table[:, 1], table[:, 2] + 1j * table[:, 3]
    found = np.stack([(each[:-1] + each[1:]) / 2 for each in at])
    power = np.square(np.abs(sphere.amplitude(1 - middle))) * np.diff(nodes)
    missed = (np.square(np.abs(found - exact)).sum(axis=0) * power).sum() / power.sum()
    assert np.sqrt(missed) < 0.01  # of light's field; a mean degree of polarisation is off by its square


def test_amplitudes_by_type_follow_the_particles():
    """Of layers, half-way between nodes, of a sphere larger than the wavelength."""
    pytest.importorskip("miepython")
    sphere = sg.Mie(radius=0.6, wavelength=0.5, refractive_index=1.2)
    parts = [sg.Layer(thickness=1.0, mean_free_path=1.0, scatterer=each) for each in (sg.Rayleigh(), sphere)]
    table = type_matrices(sg.Layers(layers=parts, polarisation="vector"))
    place = (np.arange(table.shape[1] - 1) + 0.5) / (table.shape[1] - 1)
    cosine = 1 - 2 * np.where(place <= 0.5, 2 * place**2, 1 - 2 * (1 - place) ** 2)
    for rows, particle in zip(table, (sg.Rayleigh(), sphere), strict=True):
        one, two = particle.amplitude_matrix(cosine)
        exact = np.stack([one, two]) * np.sqrt(2 / (abs(one) ** 2 + abs(two) ** 2))
        found = (rows[:-1] + rows[1:]) / 2
        np.testing.assert_allclose(found[:, 0::2] + 1j * found[:, 1::2], exact.T, atol=1e-3)
    places = np.array([node_place(v) for v in (0.0, 1.0, 2.0)])
    np.testing.assert_allclose(places, [0, 0.5, 1], atol=1e-12)
