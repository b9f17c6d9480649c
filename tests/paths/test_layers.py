"""Layers: against adding, against a literal walk, and against a slab that is cut into layers."""

import numpy as np
import pytest
from references.layered_walk import BATCHES, walk_layers
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.oracles.adding_doubling import layered_light
from specklegen.paths.analog_walk import transmittance
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.tracer import plane_tracer, scene_tracer

AXIS = np.array([0.0, 0.0, 1.0])
UPPER = sg.Layer(thickness=30.0, mean_free_path=20.0, albedo=0.95, scatterer=sg.HenyeyGreenstein(0.8))
LOWER = sg.Layer(thickness=40.0, mean_free_path=10.0, albedo=0.8, scatterer=sg.Isotropic())
TWO = sg.Layers([UPPER, LOWER])
CLEAR = [UPPER.replace(albedo=1.0), LOWER.replace(albedo=1.0)]


def described(layers) -> list[tuple[float, float, float]]:
    """Layers as the sums of adding read them."""
    return [(layer.optical_depth, layer.albedo, layer.scatterer.g) for layer in layers]


def cut(parts: int, by: float = 1e-9) -> tuple[sg.Slab, sg.Layers]:
    """A slab, and the same in layers that differ by next to nothing, so that no two are made one."""
    lobe = sg.HenyeyGreenstein(0.9)
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=lobe)
    layers = [
        sg.Layer(thickness=100.0 / parts, mean_free_path=20.0 * (1 + by * (n % 2)), scatterer=lobe)
        for n in range(parts)
    ]
    return slab, sg.Layers(layers)


def batches(medium, view: np.ndarray, paths: int = 64 * 1000, seed: int = 3) -> np.ndarray:
    """Radiance along a view, float64[64]: means of batches of paths."""
    tracer = plane_tracer(medium, 1.0, AXIS[None], view[None], False)
    bank = tracer.trace(seed, paths, threads=1)
    return np.bincount(bank.paths * BATCHES // paths, contributions(tracer.layout, bank), BATCHES) * BATCHES / paths


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("side", ["transmitted", "reflected"])
def test_light_along_the_axis_is_that_of_adding(order, side):
    layers = TWO.layers[::order]
    exact = layered_light(described(layers))
    view = AXIS if side == "transmitted" else -AXIS
    assert_mean(batches(sg.Layers(layers), view), getattr(exact, side))


def test_a_layer_of_another_depth_is_caught():
    """Five per cent of the lower layer's mean free path."""
    other = sg.Layers([UPPER, LOWER.replace(mean_free_path=10.5)])
    exact = layered_light(described(TWO.layers)).transmitted
    refute_mean(batches(other, AXIS, 64 * 4000), exact)


@pytest.mark.parametrize("order", [1, -1])
def test_transmittance_is_that_of_adding(order):
    layers = TWO.layers[::order]
    found, error = transmittance(sg.Layers(layers), 60_000, 1)
    assert_z(found, layered_light(described(layers)).transmittance, error)


@pytest.mark.parametrize("order", [1, -1])
def test_reflectance_and_transmittance_are_those_of_adding(order):
    layers = TWO.layers[::order]
    exact = layered_light(described(layers))
    found = sg.reflectance_transmittance(sg.Layers(layers), paths=20_000)
    assert_z(found.reflectance, exact.reflectance, found.reflectance_error)
    assert_z(found.transmittance, exact.transmittance, found.transmittance_error)


def test_layers_in_air_are_those_of_mcml():
    """Three layers of its manual, a million photons: R .237544 and .0243729 at the face, T .0964896, each +- 4e-4."""
    layers = [
        sg.Layer(thickness=d, mean_free_path=1 / (a + s), albedo=s / (a + s), scatterer=sg.HenyeyGreenstein(g))
        for d, a, s, g in ((0.1, 1, 100, 0.9), (0.1, 1, 10, 0.0), (0.2, 2, 10, 0.7))
    ]
    medium = sg.Layers(layers, faces=sg.Faces(inside=1.37, outside=1.0))
    found = sg.reflectance_transmittance(medium, paths=50_000)
    assert_z(found.reflectance, 0.237544 + 0.0243729, found.reflectance_error, slack=4e-4)
    assert_z(found.transmittance, 0.0964896, found.transmittance_error, slack=4e-4)


def test_the_memory_effect_is_that_of_a_literal_walk():
    q = np.array([0.02, 0.05, 0.1])
    table = [(lay.thickness, lay.mean_free_path, lay.albedo, lay.scatterer.g, 1.0) for lay in CLEAR]
    sums = walk_layers(table, paths=64 * 1000, seed=5).sums(q)
    curve = sg.memory_effect(sg.Layers(CLEAR), wavelength=1.0, tilts=np.arcsin(q / (2 * np.pi)), paths=64 * 1000,
                             threads=1)  # fmt: skip
    # Jackknife of the ratio of both sums.
    without = (sums.sum(axis=0) - sums)[:, 1:] / (sums.sum(axis=0) - sums)[:, :1]
    literal = BATCHES * (sums[:, 1:].sum(axis=0) / sums[:, 0].sum()) - (BATCHES - 1) * without.mean(axis=0)
    spread = np.sqrt((BATCHES - 1) * without.var(axis=0))
    error = np.hypot(spread, curve.standard_error / (2 * np.abs(curve.field)))
    assert_z(curve.field.real, literal, error, degrees=BATCHES - 1)
    turned = sg.memory_effect(sg.Layers(CLEAR[::-1]), wavelength=1.0, tilts=curve.tilts, paths=64 * 1000, threads=1)
    assert_z(turned.intensity, curve.intensity, np.hypot(turned.standard_error, curve.standard_error))  # reciprocity


def test_narrow_lobes_over_wide_ones_cost_no_more_than_a_literal_walk():
    """Depth 10 of g = .95 and depth 1 of even scattering: errors at most twice that walk's, where they were nine times
    as large; one per cent of K is caught."""
    table = [(500.0, 50.0, 1.0, 0.95, 1.0), (100.0, 100.0, 1.0, 0.0, 1.0)]
    q = 1 / 600.0
    for order, paths in ((1, 64 * 4000), (-1, 64 * 1000)):
        layers = [
            sg.Layer(thickness=d, mean_free_path=mean, scatterer=sg.HenyeyGreenstein(g)) for d, mean, _, g, _ in table
        ]
        sums = walk_layers(table[::order], paths=paths, seed=5).sums([q])
        value, spread = jackknife(sums, lambda total: (total[1:] / total[0]) ** 2)
        curve = sg.memory_effect(sg.Layers(layers[::order]), wavelength=1.0, tilts=[np.arcsin(q / (2 * np.pi))],
                                 paths=paths, threads=1)  # fmt: skip
        assert curve.standard_error[0] < 2 * spread[0]
        error = np.hypot(spread, curve.standard_error)
        assert_z(curve.intensity, value, error, degrees=BATCHES - 1)
        if order == 1:
            refute_z(curve.intensity * 1.01**2, value, error, degrees=BATCHES - 1)


def test_paths_weighed_both_ways_have_the_density_of_either_end():
    """W = sigma_1 / (p(x1, w1) + p(xB, -w) sigma_1 / sigma_B), first directions spread as at either end."""
    length, g, depths = np.array([20.0, 10.0]), np.array([0.8, -0.3]), np.array([1.5, 4.0])
    layers = [
        sg.Layer(thickness=d * mean, mean_free_path=mean, scatterer=sg.HenyeyGreenstein(each))
        for d, mean, each in zip(depths, length, g, strict=True)
    ]
    bank = plane_tracer(sg.Layers(layers), 1.0, AXIS[None], -AXIS[None], True).trace(3, 2000, threads=1).multiple

    def density(z, cos):
        """Over sigma there, of a first vertex and direction."""
        there = (z >= 30.0).astype(int)
        deep = np.where(there, depths[0] + (z - 30.0) / length[1], z / length[0])
        lobe = (1 - g[there] ** 2) / (4 * np.pi * (1 + g[there] ** 2 - 2 * g[there] * cos) ** 1.5)
        return np.exp(-deep) / -np.expm1(-depths.sum()) * (0.9 * lobe + 0.1 / (4 * np.pi))

    back = density(bank.exit[:, 2], -bank.exit_direction[:, 2])
    np.testing.assert_allclose(
        bank.weight, 1 / (density(bank.entry[:, 2], bank.entry_direction[:, 2]) + back), rtol=1e-9
    )


def test_a_slab_in_equal_layers_has_its_single_scattering():
    """In closed form p(1) OD e^-OD of the slab, and of its layers; their errors from batches of paths."""
    slab, layers = cut(5)
    exact = slab.scatterer.amplitude(np.ones(1))[0] ** 2 * slab.optical_depth * np.exp(-slab.optical_depth)
    for medium in (slab, layers):
        tracer = plane_tracer(medium, 1.0, AXIS[None], AXIS[None], False)
        bank = tracer.trace(3, 64 * 2000, threads=1).single
        found = np.bincount(bank.paths // 2000, contributions(tracer.layout, bank), BATCHES) / 2000
        assert_mean(found, abs(exact))
        refute_mean(found, 2 * abs(exact))


def test_backscattering_of_a_slab_in_layers_is_that_of_the_slab():
    slab, layers = cut(3)
    found = []
    for medium in (slab, layers):
        tracer = plane_tracer(medium, 1.0, AXIS[None], -AXIS[None], True)
        bank = tracer.trace(1, 64 * 500, threads=1)
        found.append(np.bincount(bank.paths * BATCHES // bank.count, contributions(tracer.layout, bank), BATCHES))
    means, errors = np.mean(found, axis=1), np.std(found, axis=1, ddof=1) / 8
    assert_z(means[1], means[0], np.hypot(*errors))


def test_layers_that_are_alike_are_traced_as_the_slab_that_they_are():
    layer = sg.Layer(thickness=50.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=layer.scatterer)
    banks = []
    for medium in (slab, sg.Layers([layer, layer])):
        tracer = plane_tracer(slab, 1.0, AXIS[None], AXIS[None], False)
        banks.append(type(tracer)(tracer.layout, medium, tracer.proposal).trace(1, 500))
    assert banks[0].records.tobytes() == banks[1].records.tobytes()


class Graded(sg.Stratified):
    """Mean free paths that fall with depth: a user's own medium."""

    thickness: float
    top: float
    bottom: float
    albedo: float = 1.0

    @property
    def layers(self):
        paths = np.geomspace(self.top, self.bottom, 8)
        alike = {"thickness": self.thickness / len(paths), "albedo": self.albedo, "scatterer": sg.Isotropic()}
        return [sg.Layer(mean_free_path=path, **alike) for path in paths]


def scene(medium) -> sg.Scene:
    light = sg.CollimatedBeams.tilts([0.0, 1e-3], width=500.0)
    return sg.Scene(wavelength=0.5, medium=medium, illumination=light, sensor=sg.FarField.grid((8, 8), 2e-4))


def test_a_medium_of_ones_own_is_a_medium_everywhere():
    medium = Graded(thickness=40.0, top=40.0, bottom=10.0, albedo=0.9)
    exact = layered_light(described(medium.layers))
    assert_mean(batches(medium, AXIS), exact.transmitted)
    whole = scene(medium)
    assert sg.Scene.from_toml(whole.to_toml()) == whole
    assert sg.Scene.from_json(whole.canonical_json()).medium == medium
    assert sg.render(whole, paths=256, seed=1).field.shape == (2, 8, 8)
    assert scene_tracer(whole, False).layout.volume.extinction.shape == (8,)
    assert sg.mean_field(whole).shape == (2, 8, 8)


def test_a_medium_of_ones_own_is_known_by_its_layers():
    def made(path: float) -> sg.Stratified:
        class Own(sg.Stratified):
            depth: float

            @property
            def layers(self):
                return [UPPER.replace(mean_free_path=path), LOWER]

        return Own(depth=1.0)

    assert made(20.0).fingerprint() == made(20.0).fingerprint() != made(21.0).fingerprint()
    before = scene(made(20.0)).canonical_json()
    assert sg.Scene.from_json(before).canonical_json() == before
    made(21.0)
    assert_refused(lambda: sg.Scene.from_json(before), "Own content must be that of")


def test_a_medium_of_ones_own_is_read_by_its_import_path(tmp_path, monkeypatch):
    (tmp_path / "sediments.py").write_text(
        "import specklegen as sg\n\n\nclass Silt(sg.Stratified):\n    depth: float\n\n    @property\n"
        "    def layers(self):\n        alike = {'scatterer': sg.Isotropic(), 'thickness': self.depth}\n"
        "        return [sg.Layer(mean_free_path=path, **alike) for path in (10.0, 5.0)]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    table = scene(TWO).model_dump(mode="json") | {"medium": {"type": "sediments:Silt", "depth": 3.0}}
    assert sg.Scene(**table).medium.optical_depth == pytest.approx(0.9)


def test_what_layers_are_together_follows_from_them():
    assert TWO.thickness == 70.0
    assert TWO.optical_depth == pytest.approx(5.5)
    assert TWO.mean_free_path == 10.0
    assert TWO.albedo == pytest.approx((1.5 * 0.95 + 4 * 0.8) / 5.5)
    assert TWO.scatterer.g == pytest.approx(0.8 * 1.5 * 0.95 / (1.5 * 0.95 + 4 * 0.8))
    assert TWO.edges.tolist() == [0.0, 30.0, 70.0]


def test_a_medium_that_says_otherwise_than_its_layers_is_refused():
    class Wrong(sg.Stratified):
        thickness: float

        @property
        def layers(self):
            return [UPPER]

    Wrong(thickness=30.0)
    assert_refused(lambda: Wrong(thickness=31.0), r"Wrong.thickness must be the value of its layers, 30")
    with pytest.raises(sg.RuleError, match=r"Nothing.layers must be"):

        class Nothing(sg.Stratified):
            depth: float

    assert_refused(lambda: sg.Layers([]), r"Layers.layers")


@pytest.mark.parametrize("sampler", ["paths", "stationary"])
def test_intensities_of_both_samplers_are_those_of_the_paths(sampler):
    """Mean intensity over views and realizations of a two-layer medium, beside that of its slab walk."""
    whole = scene(sg.Layers(CLEAR))
    tracer = scene_tracer(whole, False)
    assert tracer.medium.thickness == 70.0
    stacks = [sg.render(whole, paths=2000, seed=seed, sampler=sampler, threads=1).field for seed in range(10)]
    powers = np.square(np.abs(np.array(stacks))).mean(axis=(1, 2, 3))
    exact = layered_light(described(CLEAR)).transmitted * 500.0**2
    assert_mean(powers, exact, slack=0.02 * exact)  # of the stationary sampler's tolerance
