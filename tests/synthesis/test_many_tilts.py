"""Stacks of many tilts by moments of the noise within cells, against noise that is white within them too."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.synthesis import many_tilts as module
from specklegen.synthesis.exit_grid import sampled_amplitude
from specklegen.synthesis.many_tilts import ManyTilts, many_tilts
from specklegen.synthesis.stacks import mean_intensity, stack_sampler

WAVELENGTH, WIDTH, PITCH, VIEWS = 0.5, 400.0, 5e-4, (4, 6)
GRAIN = WAVELENGTH / WIDTH
REACH = 30.0  # radius whose memory effect falls over some tilts
TOLERANCE = 1e-3  # of intensities: singular values of 1e-3 are left out, and .0002 by the circle


def scene(tilts=16, step=(3 * GRAIN, 0.0), first=(0.01, -0.004)):
    sines = np.array(first) + np.arange(tilts)[:, None] * np.array(step)
    light = sg.CollimatedBeams(directions=np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(1))]), width=WIDTH)
    slab = sg.Slab(thickness=1.0, mean_free_path=0.2, scatterer=sg.HenyeyGreenstein(0.9))  # no phase of its face
    return sg.Scene(wavelength=WAVELENGTH, medium=slab, illumination=light,
                    sensor=sg.FarField.grid(VIEWS, PITCH, center=(0.002, 0.001)))  # fmt: skip


def correlation(reach=REACH):
    radius = reach * np.array([0.0, 0.3, 0.7, 1.0, 1.6, 2.5])
    return MemoryEffectCorrelation(radius, np.array([[0.05, 0.1, 0.25, 0.3, 0.2, 0.1]]), 1, 0.05)


def made(where, known=None):
    found = many_tilts(where, known or correlation(), dtype=torch.complex128)
    assert isinstance(found, ManyTilts)
    return found


def implied(sampler):
    """Covariance complex[T V, T V] of what a sampler draws, of unit noise put through it."""
    rank, (down, across) = sampler.root.rank, sampler.moments
    root = sampler._moments(torch.eye(rank, dtype=torch.complex128))  # cells that are as many as the numbers
    tilts = len(root)
    places = down * across * sampler.y.count * sampler.x.count
    unit = torch.eye(places, dtype=torch.complex128).reshape(places, down, across, sampler.y.count, sampler.x.count)
    seen = torch.stack([
        sampler._fields(each.expand(tilts, *each.shape), slice(None)).reshape(tilts, -1) for each in unit
    ]).reshape(down * across, -1, tilts, int(np.prod(VIEWS)))  # fmt: skip
    fields = torch.einsum("qxtv,tqr->tvrx", seen, root).reshape(tilts * int(np.prod(VIEWS)), -1)
    return (fields @ fields.mH).numpy()


def literal(where, sampler, known):
    """I K b^2 summed over cells, in which noise is white: by 400 points along either side of each."""
    sines, grid, k = where.beams.directions[:, :2], where.grid, where.wavenumber
    x, y = grid.sines
    views = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ends = (views - sines[:, None]).reshape(-1, 2)  # of every tilt and view
    power = sampled_amplitude(sampler.x, sampler.y, where.beams.window) ** 2
    apart = k * (ends[:, None] - ends)
    factors = []
    for n, axis in ((1, sampler.y), (0, sampler.x)):
        inner = (np.arange(400) - 199.5) / 400 * axis.size if sampler.moments[1 - n] > 1 else np.zeros(1)
        unique, which = np.unique(apart[..., n].round(9), return_inverse=True)
        within = np.exp(-1j * np.multiply.outer(unique, inner)).mean(-1)
        cells = np.exp(-1j * np.multiply.outer(unique, axis.positions))
        factors.append((cells, within, which.reshape(apart.shape[:2])))
    (rows, down, at), (columns, across, beside) = factors
    window = (rows @ power @ columns.T)[at, beside] * down[at] * across[beside]
    between = np.repeat(np.repeat(known.matrix(sines, k), len(views), 0), len(views), 1)
    return mean_intensity(known, where.beams.window.area) * between * window


CASES = {
    "along x": scene(), "along y": scene(step=(0.0, -3 * GRAIN)), "aslant": scene(12, (2.5 * GRAIN, 1.7 * GRAIN)),
    "far apart": scene(16, (5 * GRAIN, 0.0)),
    "of even angles": scene().replace(  # their sines are even within .0002 of a step
        illumination=sg.CollimatedBeams.tilts(np.arange(-8, 8) * 0.6 * GRAIN, width=WIDTH)
    ),
    "of even angles aside": scene().replace(  # .0004 of a step
        illumination=sg.CollimatedBeams.tilts(0.02 + np.arange(-8, 8) * 0.6 * GRAIN, width=WIDTH)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_covariance_is_that_of_white_noise(name, monkeypatch):
    monkeypatch.setattr(module, "_PAYS", 100.0)
    where = CASES[name]
    reach = (5 if "of even angles" in name else 1) * REACH
    sampler = made(where, correlation(reach))
    found, exact = implied(sampler), literal(where, sampler, correlation(reach))
    scale = exact.real.max()
    assert np.abs(found - exact).max() < TOLERANCE * scale
    wider = literal(where, sampler, correlation((2.0 if name == "far apart" else 1.1) * reach))
    assert np.abs(found - wider).max() > 3 * TOLERANCE * scale  # an error in the range is seen


@pytest.mark.parametrize(("step", "off", "reach"), [
    ((3 * GRAIN, 0.0), 0.02, 0.3), ((-3 * GRAIN, 2.5 * GRAIN), 0.06, 0.1),
])  # fmt: skip
def test_moments_of_tilts_off_even_places_are_mixed(step, off, reach, monkeypatch):
    """Phases within a cell turn by up to 0.1, along x and aslant; the spot is narrow, so K is that of even places."""
    monkeypatch.setattr(module, "_PAYS", 100.0)
    monkeypatch.setattr(module, "_UNEVEN", 0.05)
    number, known = np.arange(16), correlation(reach * REACH)
    sines = [0.01, -0.004] + np.outer(number - 8 + off * np.sin(0.4 * number), step)
    light = sg.CollimatedBeams(directions=np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(1))]), width=WIDTH)
    where = scene().replace(illumination=light)
    sampler = made(where, known)
    exact = literal(where, sampler, known)
    scale = exact.real.max()
    assert np.abs(implied(sampler) - exact).max() < 0.4 * TOLERANCE * scale
    for wrong in (None, 2 * torch.eye(sampler.mixtures.shape[1]) - sampler.mixtures):  # unmixed; turned the other way
        assert np.abs(implied(replace(sampler, mixtures=wrong)) - exact).max() > TOLERANCE * scale


def test_moments_to_the_fourth_order_across_tilts(monkeypatch):
    """Means, products and intensities' products of tilts near and far, against the literal covariance, by z."""
    monkeypatch.setattr(module, "_PAYS", 100.0)
    where = scene(16)
    sampler = made(where)
    drawn = np.stack([sampler.sample(5, n).numpy().reshape(16, -1) for n in range(4000)])
    exact = literal(where, sampler, correlation())
    views = int(np.prod(VIEWS))
    pairs = [(0, 3, 0, 3), (0, 3, 1, 3), (0, 3, 1, 9), (2, 17, 5, 12), (0, 0, 15, 23), (7, 20, 8, 2)]
    for t, v, s, w in pairs:
        a, b = drawn[:, t, v], drawn[:, s, w]
        p, q = t * views + v, s * views + w
        between, one, two = exact[p, q], exact[p, p].real, exact[q, q].real
        slack = TOLERANCE * one
        for part in (np.real, np.imag):
            if p != q or part is np.real:
                assert_mean(part(a * b.conj()), part(between), slack=slack)
            assert_mean(part(a * b), 0.0)
            assert_mean(part(a), 0.0)
        product = np.square(np.abs(a) * np.abs(b))
        assert_mean(product, one * two + abs(between) ** 2, slack=4 * slack * one)
    refute_mean(product, 1.3 * one * two)


def test_one_by_one_is_the_stack(monkeypatch):
    monkeypatch.setattr(module, "_PAYS", 100.0)
    sampler = made(scene())
    whole = sampler.sample((3, 1), 2)
    pieces = torch.cat(list(sampler.one_by_one((3, 1), 2)))
    torch.testing.assert_close(pieces, whole, rtol=1e-12, atol=1e-12 * float(whole.abs().max()))
    assert not torch.allclose(sampler.sample((3, 1), 3), whole)


def test_it_serves_where_it_takes_fewer_operations():
    """Many even tilts of a correlation that is round; not few, not uneven ones, not complex correlations."""
    known = correlation(2000.0)
    long = sg.Scene(wavelength=1.0, medium=scene().medium, sensor=sg.FarField.grid((40, 40), 2e-6),
                    illumination=sg.CollimatedBeams.tilts(np.arange(100) * 4e-5, width=1e5))  # fmt: skip
    found, shared = many_tilts(long, known), stack_sampler(long, known)
    assert isinstance(found, ManyTilts)
    assert found.root.rank * found.x.count * found.y.count < 0.5 * shared.mixing.shape[1] * shared.window[0].size
    few = long.replace(illumination=sg.CollimatedBeams.tilts(np.arange(5) * 4e-5, width=1e5))
    uneven = long.replace(illumination=sg.CollimatedBeams.tilts(np.arange(100) ** 1.1 * 4e-5, width=1e5))
    from_the_axis = long.replace(illumination=sg.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(120), width=1e5))
    assert isinstance(many_tilts(from_the_axis, known), ManyTilts)  # sines within .0005 of a step
    many = long.replace(illumination=sg.CollimatedBeams.tilts(np.deg2rad(0.0025) * np.arange(300), width=1e5))
    assert isinstance(many_tilts(many, known), ManyTilts)
    assert many_tilts(few, known) is None
    assert many_tilts(uneven, known) is None
    assert many_tilts(long, object()) is None


def test_renders_are_drawn_so():
    """A render of many tilts is this sampler's, whole and in pieces."""
    slab = sg.Slab(thickness=2000.0, mean_free_path=400.0, scatterer=sg.HenyeyGreenstein(0.9))
    light = sg.CollimatedBeams.tilts(np.arange(-40, 40) * 4e-5, width=1e5)
    where = sg.Scene(wavelength=1.0, medium=slab, illumination=light, sensor=sg.FarField.grid((24, 24), 2e-6))
    chosen = sg.plan(where).chosen
    shared = chosen.prepare(1, 1).shared
    assert isinstance(shared.stacks, ManyTilts)
    stack = sg.render(where, seed=1).field
    np.testing.assert_array_equal(stack, shared.stacks.sample(1).numpy())
    for place, field in sg.render_tiles(where, seed=1):
        np.testing.assert_allclose(field, stack[place], atol=1e-5 * np.abs(stack).max())
