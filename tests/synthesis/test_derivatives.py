"""Derivatives of every registered operator, found by enumeration, against differences of what it returns."""

import os
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch

import specklegen
from specklegen.core.errors import RuleError
from specklegen.datasets.recipes.parts import atlas_batches as atlas
from specklegen.instrument.camera import Camera
from specklegen.synthesis import mixtures
from specklegen.synthesis.correlations import Mixtures
from specklegen.synthesis.fused import FORMS, STEPWISE
from specklegen.synthesis.imaging import imagings
from specklegen.synthesis.sight import Sight
from specklegen.synthesis.streams import Streams

FLOAT32 = 1e-2, 1e-4
"""Step of the differences and their tolerance, over the derivative's size: values of 2^-24 over the step, 6e-6, some of
them of cancelling sums."""
FLOAT64 = 1e-4, 1e-8
"""Rounding of 1e-16 over the step, and the fifth derivative times its fourth power."""


def put(*shape, low=0.0, high=1.0, seed=0):
    return torch.from_numpy(np.random.default_rng([seed, *shape]).uniform(low, high, shape))


def _mixture():
    radius, share = put(2, 9, high=3.0), put(2, 9, seed=1)
    radius[:, 0] = 0.0
    share = share / share.sum(1, keepdim=True)
    return radius, share, share[:, 0]


def _slabs():
    tables = atlas.atlas_tables(torch.device("cpu"))
    slabs = torch.tensor([[1000.0, 10.0, 0.9, 0.98], [1.0, 5.3, 0.83, 0.999]], dtype=torch.float64)
    return slabs, [*tables.axes], tables.shares, tables.table, tables.bounds, 0.02


def _waves():
    """Of three rows at six lags, in the order of an FFT, and of four columns at four."""
    down = 0.7 * torch.arange(3, dtype=torch.float64) * torch.tensor([0.0, 1.0, 2.0, -3.0, -2.0, -1.0])[:, None]
    across = 0.4 * torch.arange(4, dtype=torch.float64)[:, None] * torch.arange(4)
    return torch.exp(1j * down)[None], torch.exp(1j * across)[None]


def _cases():
    """Arguments of each operator, where its floating tensors are differentiated, and with which step and tolerance."""
    radius, share, single = _mixture()
    key, whole = torch.arange(12).reshape(2, 3, 2), torch.tensor([4, 3])
    square = torch.tensor([[[1.1, 1.2, 4.3, 1.7], [4.3, 1.7, 3.9, 4.4], [3.9, 4.4, 1.1, 1.2]]], dtype=torch.float64)
    window = put(2, low=3.05, high=3.45), torch.tensor([5, 6]), put(2, low=0.6, high=0.7), 7
    return {
        "mixture": ((put(2, 5, high=9.0), radius, share), (0, 1, 2), FLOAT64),
        "half_range": ((radius, share, single), (0, 1, 2), FLOAT64),
        "gaussian_beams": ((put(6, low=-1.0), put(2, low=0.5)), (0, 1), FLOAT64),
        "window_power": ((*window, False), (0, 2), FLOAT64),
        "window_power, Gaussian": ((*window, True), (0, 2), FLOAT64),
        "speckle_contrast": ((put(2, 3, 4), put(2, 3, 4, seed=1)), (0, 1), FLOAT64),
        "lag_transform": ((put(2, 5), put(2), put(2), put(2), 4), (0, 1, 2, 3), FLOAT64),
        "waves": ((put(2, 4), put(2, 3), put(2, 3, seed=1), False), (0, 1, 2), FLOAT32),
        "waves, precise": ((put(2, 4), put(2, 3), put(2, 3, seed=1), True), (0, 1, 2), FLOAT64),
        "fields": ((key, 0, put(2, low=0.2, high=0.8), whole, whole, put(2, 4, 4).float(), 2, [5, 4]), (2, 5), FLOAT32),
        "pair_products": ((put(2, 2, 3, 4, 5, 2),), (0,), FLOAT64),
        "mode_maps": ((put(2, 2, 3, 6), put(2, 2, 3)), (0, 1), FLOAT64),
        "lag_sum": ((put(2, 6, 1, 5, 4, 2), put(2, 3, 5, 6, 4, 2)), (0, 1), FLOAT64),
        "map_lags": ((put(2, 3, 1, 5, 4), *_waves(), put(2, 3, 5, 6, 4, 2)), (0, 3), FLOAT64),
        "half_seen": ((put(2, 3, 6, 4, 2), put(2, 2, 3, 3), put(2, 2, 2, 4), put(2, 3, 10, 2), [5, 4]),
                      (0, 1, 2, 3), FLOAT64),
        "slab_correlations": (_slabs(), (0,), FLOAT64),
        "turned": ((put(3, 5, 4), torch.tensor([2, 0]), put(2)), (0, 2), FLOAT64),
        "coverage": ((square, 6, 6), (0,), FLOAT64),
    }


CASES = _cases()
_ROOT = Path(specklegen.__file__).parent
for _folder, _, _names in os.walk(_ROOT, followlinks=True):
    for _file in (Path(_folder, name) for name in _names if name.endswith(".py")):
        if "synthesis.fused import" in _file.read_text():
            import_module(".".join(("specklegen", *_file.relative_to(_ROOT).with_suffix("").parts)))


def outputs(operator, arguments):
    """Floating results of an operator, float64[n] in all."""
    found = operator(*arguments)
    parts = found if isinstance(found, tuple | list) else [found]
    return torch.cat([part.double().flatten() for part in parts if part.is_floating_point()])


def difference(operator, arguments, place, direction, step):
    """Derivative along a direction, by differences of fourth order."""

    def at(times):
        moved = list(arguments)
        moved[place] = arguments[place] + (times * step * direction).to(arguments[place].dtype)
        return outputs(operator, moved)

    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)


def derivative(operator, arguments, place, direction, cotangent):
    """Derivative of <cotangent, outputs> along a direction, backward."""
    given = list(arguments)
    given[place] = arguments[place].clone().requires_grad_()
    (slope,) = torch.autograd.grad(cotangent @ outputs(operator, given), given[place])
    return float((slope.double() * direction).sum())


def test_every_operator_is_differentiated_here():
    known = {name.partition("::")[2] for name in torch._C._dispatch_get_all_op_names()
             if name.startswith("specklegen::")}  # fmt: skip
    assert known == set(FORMS)
    assert {name.partition(",")[0] for name in CASES} | set(STEPWISE) == set(FORMS)
    assert set(STEPWISE) == {"exposed"}


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_what_the_operator_returns(name):
    arguments, places, (step, tolerance) = CASES[name]
    operator = getattr(torch.ops.specklegen, name.partition(",")[0])
    for place in places:
        direction = put(*arguments[place].shape, low=-1.0, seed=2) * (1e-2 + arguments[place].double().abs())
        expected = difference(operator, arguments, place, direction, step)
        cotangent = put(len(expected), low=-1.0, seed=3)
        bound = tolerance * float(expected.norm() * cotangent.norm())
        assert bound > 0
        found = derivative(operator, arguments, place, direction, cotangent)
        assert abs(found - float(cotangent @ expected)) < bound

        def moved(x, place=place):
            return outputs(operator, [x if n == place else other for n, other in enumerate(arguments)])

        _, forward = torch.func.jvp(moved, (arguments[place],), (direction.to(arguments[place].dtype),))
        assert abs(float(cotangent @ (forward - expected))) < bound


def test_a_derivative_of_a_hundredth_less_is_caught():
    arguments, _, (step, tolerance) = CASES["slab_correlations"]
    operator, direction = torch.ops.specklegen.slab_correlations, put(2, 4, low=-1.0) * 1e-2
    expected = difference(operator, arguments, 0, direction, step)
    cotangent = put(len(expected), low=-1.0, seed=3)
    found = 0.99 * derivative(operator, arguments, 0, direction, cotangent)
    assert abs(found - float(cotangent @ expected)) > tolerance * float(expected.norm() * cotangent.norm())


def test_without_derivatives_operators_run_as_they_are():
    """The same bits, though a tensor would ask for one."""
    q, radius, share = CASES["mixture"][0]
    with torch.no_grad():
        assert torch.equal(mixtures.mixture(q.clone().requires_grad_(), radius, share),
                           mixtures.mixture(q, radius, share))  # fmt: skip


def test_counts_have_no_derivative():
    light, keys = put(2, 3, high=9.0), torch.arange(16).reshape(2, 4, 2)
    numbers = Camera(photons=9.0).electronics
    assert torch.ops.specklegen.exposed(light, keys, numbers).shape == (2, 3)
    with pytest.raises(RuleError, match="exposed must be given tensors without a derivative"):
        torch.ops.specklegen.exposed(light.requires_grad_(), keys, numbers)


def test_slopes_of_the_memory_effect():
    """d C_I / d(ln L, ln OD, ln(1 - g), ln albedo) of a slab: the digits of an independent program."""
    tables = atlas.atlas_tables(torch.device("cpu"))

    def c_i(logarithms):
        thickness, depth, drop, albedo = (row[None] for row in logarithms.exp())
        kernels = atlas.correlations(tables, thickness, depth, 1 - drop, albedo, 0.02)
        q = torch.full((1, 1), 2.742, dtype=torch.float64)
        return mixtures.mixture(q, kernels.radius, kernels.share).square().sum()

    at = torch.tensor([1.0, 10.0, 0.1, 0.98], dtype=torch.float64).log()
    expected = torch.tensor([-0.313, -0.637, -0.558, -2.84], dtype=torch.float64)
    for slope in (torch.func.grad(c_i)(at), torch.func.jacfwd(c_i)(at), torch.autograd.functional.jacobian(c_i, at)):
        assert torch.allclose(slope, expected, rtol=0.003, atol=0)


@pytest.mark.parametrize(("shape", "tilts"), [((5, 6), 1), ((1, 1), 3), ((3, 2), 2)])
def test_images_have_derivatives_by_the_medium(shape, tilts):
    """By the radii of its mixture, through modes and fields: backward and forward, against differences."""
    pitch, light = put(1, low=0.002, high=0.003), put(1, *shape, low=0.1)
    sight = Sight(0.5, "square", shape, (9, 7), (0.0, 0.0), True, torch.tensor([200.0]).double(), pitch, pitch,
                  put(1, tilts, 2, low=-0.01, high=0.01))  # fmt: skip
    streams = Streams(torch.arange(4).reshape(1, 2, 1, 2), torch.zeros(1), torch.arange(2).reshape(1, 2))
    share, radius = torch.tensor([[0.1, 0.5, 0.4]]).double(), torch.tensor([[0.0, 20.0, 45.0]]).double()

    def images(radius):
        ((_, imaging),) = imagings(sight, Mixtures(radius, share, mixtures.mixture), tolerance=0.01, precise=True)
        return imaging.media(streams).images(light)

    direction = torch.tensor([[0.0, 1.0, -0.6]]).double()
    expected = difference(images, [radius], 0, direction, 1e-4)
    cotangent = put(len(expected), low=-1.0, seed=3)
    forward = torch.func.jvp(images, (radius,), (direction,))[1]
    slope = derivative(images, [radius], 0, direction, cotangent)
    bound = 1e-8 * float(expected.norm() * cotangent.norm())
    assert abs(slope - float(cotangent @ expected)) < bound
    assert abs(float(cotangent @ (forward.flatten() - expected))) < bound
    assert abs(1.001 * slope - float(cotangent @ expected)) > bound
