"""Nodes of an object: against the sum over all bright pixels, and against what they say that they leave out."""

import numpy as np
import pytest
import torch
from one_object import one_object
from zscore import assert_mean, refute_mean

from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis import imaging as imaging_module
from specklegen.synthesis import nodes as nodes_module
from specklegen.synthesis.imaging import ImagedMedia, lit_box
from specklegen.synthesis.nodes import nodes_of
from specklegen.synthesis.spectrum import LightModes

K = estimate_correlation(Slab(thickness=1000.0, mean_free_path=100.0, albedo=1.0, scatterer=HenyeyGreenstein(g=0.9)),
                         20_000, 1, threads=1)  # fmt: skip
GRAIN = 0.5 / 2e4
RNG = np.random.default_rng(0)
BRIGHT = (RNG.random((18, 22)) * (RNG.random((18, 22)) < 0.6)).astype(np.float32)
BRIGHT[[0, 1], :] = 0.0  # as many dark rows above as the box of bright pixels has to tell from those below


def sampler(**changes):
    options = {"wavelength": 0.5, "object_shape": BRIGHT.shape, "object_pitch": 0.62 * GRAIN, "width": 2e4,
               "grid": FarFieldGrid(shape=(17, 21), pitch=0.4 * GRAIN)} | changes  # fmt: skip
    return one_object(K, **options).imaging


def drawn(imaging, seed, frames=1, draws=None):
    """White fields under the window, complex64[1, F, N, R, rows, columns]."""
    generator = torch.Generator().manual_seed(seed)
    shape = (1, frames, imaging.draws if draws is None else draws, imaging.rank, *imaging.envelope.shape[1:])
    white = torch.randn(shape, dtype=torch.complex64, generator=generator)
    return white * imaging.envelope[0]


def of(imaging, light):
    """Nodes for every tilt, whatever they take."""
    lit = torch.nonzero(light.reshape(-1)).reshape(-1)
    return [nodes_of(modes, lit, len(lit)) for modes in imaging.modes[0]]


def error(found, expected):
    return float(torch.linalg.norm((found - expected).double()) / torch.linalg.norm(expected.double()))


def tilted():
    return sampler(base=np.array([[0.0, 0.0], [6.3 * GRAIN, -4.1 * GRAIN], [-9.0 * GRAIN, 2.2 * GRAIN]]))


def bounded():
    """A beam's light stays about it."""
    one = sampler()
    gains = torch.rand((1, 1, 2, 17, 21), generator=torch.Generator().manual_seed(1)) + 0.5
    maps = torch.stack([torch.ones(BRIGHT.shape), torch.linspace(-1, 1, 22).expand(BRIGHT.shape)])
    return imaging_module.replace(one, gains=gains, polynomials=maps)


CASES = {"one field": (sampler, 1),
         "two modes of light": (lambda: sampler(light=LightModes(np.array([0.6, 0.3]), (K, K), 0.1)), 1),
         "three tilts": (tilted, 1), "four frames": (sampler, 4), "round window": (lambda: sampler(profile="disc"), 1),
         "an envelope": (bounded, 1)}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("bytes_at_once", [2**13, 2**22])  # of one node, and of all
def test_images_by_nodes_are_those_by_all_bright_pixels(case, bytes_at_once, monkeypatch):
    """Both in single precision, whose rounding is 5e-7; the form of pairs is a third sum."""
    monkeypatch.setattr(nodes_module, "_CHUNK_BYTES", bytes_at_once)
    make, frames = CASES[case]
    imaging, light = make(), torch.from_numpy(BRIGHT)[None]
    fields, lit = drawn(imaging, 3, frames), int((light != 0).sum())
    nodes, box = of(imaging, light), lit_box(light[0])
    assert all(imaging.rank < len(each.pixels) < 0.75 * lit for each in nodes), "else nothing is saved"
    found = imaging.images_by_points(fields, light, nodes, box)
    pairs = imaging.images(imaging.spectra(fields), light, box)
    assert error(found, pairs) < 1.5e-6
    if frames == 1:
        assert error(found, imaging.images_by_points(fields, light)) < 1.5e-6
    dimmer = nodes[0]._replace(weights=nodes[0].weights * (1 + 1e-5))
    assert error(imaging.images_by_points(fields, light, [dimmer, *nodes[1:]], box), pairs) > 1.5e-6


@pytest.mark.parametrize(("frames", "draws"), [(1, 1), (1, 3), (4, 1)])
def test_beams_under_tilts_are_those_by_pairs(frames, draws):
    """Of one pixel, from the transforms of modes: each tilt, frame and draw its own."""
    base = GRAIN * np.array([[0.0, 0.0], [6.3, -4.1], [-9.0, 2.2], [1.0, 7.0]])[: 4 if frames == 1 else 1]
    options = {"object_shape": (1, 1), "base": base, "grid": FarFieldGrid(shape=(64, 72), pitch=0.4 * GRAIN)}
    imaging, light = sampler(**options), torch.full((1, 1, 1), 0.7)
    fields = drawn(imaging, 3, frames, draws)
    found = imaging.images_by_points(fields, light)
    pairs = imaging.images(imaging.spectra(fields), light)
    assert found.shape == (1, max(frames, len(base)), 64, 72)
    assert all(error(*both) < 1.5e-6 for both in zip(found[0], pairs[0], strict=True))
    assert error(1.001 * found, pairs) > 5e-4


def test_one_bright_pixel_off_the_axis_stays_where_it_is():
    """Behind a cached medium, whose spectra are multiplied by the transform of the box of bright pixels alone."""
    imaging, light = sampler(), torch.zeros((1, *BRIGHT.shape))
    light[0, 3, 4] = 1.0
    fields = drawn(imaging, 3)
    kept, by_points = ImagedMedia(imaging, None, imaging.spectra(fields)), imaging.images_by_points(fields, light)
    assert error(kept.images(light), by_points) < 1.5e-6
    assert error(kept.images(light.roll(1, 2)), by_points) > 0.1


def test_what_is_left_out_is_what_the_factor_says(monkeypatch):
    """With few nodes: the mean square over media of what a pixel's intensity lacks, by dense algebra and by draws."""
    monkeypatch.setattr(nodes_module, "LEFT", 3e-2)
    imaging, light = sampler(), torch.from_numpy(BRIGHT)[None]
    (nodes,) = of(imaging, light)
    modes = imaging.modes[0, 0].double()[:, nodes.lit]
    second = (modes.T @ modes).square() + 1  # <p_j p_l> of Gaussian fields of intensity 1
    at = (nodes.pixels[:, None] == nodes.lit).nonzero()[:, 1]
    best = torch.linalg.solve(second[at][:, at], second[at])
    np.testing.assert_allclose(nodes.weights, best, atol=1e-8)
    left = (second - second[:, at] @ best).diagonal()
    assert float(left.max()) <= 3e-2
    fewer = at[:-1]
    without = second - second[:, fewer] @ torch.linalg.solve(second[fewer][:, fewer], second[fewer])
    assert float(without.diagonal().max()) > 3e-2, "one node fewer would not do"
    white = torch.randn((20_000, len(modes)), dtype=torch.complex128, generator=torch.Generator().manual_seed(2))
    power = (white @ modes.to(white.dtype)).abs().square()
    lacking = power - power[:, at] @ nodes.weights
    worst = int(left.argmax())
    squares = lacking[:, worst].square().numpy()
    assert_mean(squares, float(left[worst]))
    refute_mean(squares, 1.25 * float(left[worst]))
    assert_mean(lacking[:, worst].numpy(), 1 - float(nodes.weights[:, worst].sum()))


def test_too_few_nodes_would_be_seen(monkeypatch):
    imaging, light = sampler(), torch.from_numpy(BRIGHT)[None]
    fields, box = drawn(imaging, 3), lit_box(light[0])
    every = of(imaging, light)
    monkeypatch.setattr(nodes_module, "LEFT", 1e-6)
    few = of(imaging, light)
    assert len(few[0].pixels) < len(every[0].pixels)
    by_all = imaging.images_by_points(fields, light)
    assert error(imaging.images_by_points(fields, light, every, box), by_all) < 1.5e-6
    assert error(imaging.images_by_points(fields, light, few, box), by_all) > 1e-5


def test_one_bright_point_is_as_precise(monkeypatch):
    """The pixel that nodes tell least of, over a faint object: nothing averages what they leave out of it."""
    imaging, light = sampler(), torch.from_numpy(BRIGHT)[None]
    fields, box = drawn(imaging, 3), lit_box(light[0])

    def lost():
        """Relative error of its image."""
        (nodes,) = of(imaging, light)
        modes = imaging.modes[0, 0].double()[:, nodes.lit]
        at = (nodes.pixels[:, None] == nodes.lit).nonzero()[:, 1]
        second = (modes.T @ modes).square() + 1
        least = (second - second[:, at] @ nodes.weights).diagonal().argmax()
        point = 1e-6 * light
        point.view(-1)[nodes.lit[least]] = 1.0
        pairs = imaging.images(imaging.spectra(fields), point, box)
        return error(imaging.images_by_points(fields, point, [nodes], box), pairs)

    assert lost() < 4e-6
    monkeypatch.setattr(nodes_module, "LEFT", 3e-10)
    assert lost() > 6e-6


def test_few_functions_have_few_nodes():
    """One field for all pixels has one node; pixels that are alike are told by one of them; most is kept to."""
    lit = torch.arange(7)
    same = nodes_of(torch.ones((1, 7)), lit, 7)
    assert same is not None
    assert same.pixels.tolist() == [0]
    np.testing.assert_allclose(same.weights, 1.0, rtol=1e-12)
    twice = torch.eye(3)[:, [0, 0, 1, 2, 2, 1, 0]]
    three = nodes_of(twice, lit, 3)
    assert three is not None
    assert three.pixels.tolist() == [0, 2, 3]
    np.testing.assert_allclose(three.weights, twice, atol=1e-12)
    assert nodes_of(twice, lit, 2) is None
    assert nodes_of(twice, lit, 0) is None


def test_nodes_are_taken_where_they_take_the_fewest_operations():
    """An object in one part of a wide frame, whose modes are those of the whole frame."""
    grid = FarFieldGrid(shape=(128, 128), pitch=0.4 * GRAIN)
    options = {"object_shape": (28, 28), "object_pitch": 0.5 * GRAIN, "grid": grid}
    wide, light = sampler(**options), torch.zeros((1, 28, 28))
    light[0, 3:17, 5:23] = 1.0
    taken = wide.nodes(light, 1, 1)
    assert taken is not None
    few = torch.zeros_like(light)
    few[0, 5, 3:9] = 1.0
    assert wide.nodes(few, 1, 1) is None
    assert wide.nodes(torch.zeros_like(light), 1, 1) is None
    assert sampler(**options, dtype=torch.complex128).nodes(light, 1, 1) is None, "they would be seen"
    media, box = ImagedMedia(wide, drawn(wide, 4)), lit_box(light[0])
    assert torch.equal(media.seen(light, box), wide.images_by_points(media.drawn, light, taken, box))
    assert error(media.seen(light, box), wide.images_by_points(media.drawn, light)) < 1.5e-6
