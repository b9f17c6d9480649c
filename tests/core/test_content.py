"""Content: parts of a user's own are known by what they do, in fingerprints, caches, pickles and stores."""

import importlib
import pickle
import re
import subprocess
import sys
import threading
from collections import deque
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_recipe import assert_same
from forgotten import forget
from own_scatterers import defined, forgotten
from quick_recipes import quick_recipe
from refusals import assert_refused
from scipy.interpolate import CubicSpline

import specklegen as sg
from specklegen.core.content import Admitted, content_digest
from specklegen.core.errors import RuleError
from specklegen.datasets.store.generate import generate
from specklegen.memory_effects.correlation import MemoryEffectCorrelation


@pytest.fixture(autouse=True)
def a_name_that_is_free():
    forgotten()
    yield
    forgotten()


def slab(scatterer):
    return sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=scatterer)


def own_recipe(power=1.0):
    scatterer = {"type": "Lobe", "power": power}
    small = {"material": {"kernel_paths": 1000, "scatterer": scatterer}, "camera": {"shape": [16, 16]}}
    return quick_recipe("tilt-stack", **small, samples={"train": 8}, media="new")


def test_a_scatterer_defined_anew_is_another():
    """(1 + cos)^1 and (1 + cos)^30 under one name: g of .500 and .968."""
    first = slab(defined("(1 + cos) ** 1")[0]())
    second = slab(defined("(1 + cos) ** 30")[0]())
    assert first.scatterer.mean_cosine() == pytest.approx(0.5, abs=1e-3)
    assert second.scatterer.mean_cosine() == pytest.approx(0.968, abs=1e-3)
    assert first != second
    assert first.fingerprint() != second.fingerprint()
    again = slab(defined("(1 + cos)**1.0  # as at first, otherwise written")[0]())
    assert again.fingerprint() == first.fingerprint()


def test_a_recipe_loaded_anew_renders_the_new_class_and_an_old_one_is_refused():
    defined("(1 + cos) ** 1")
    old = own_recipe()
    assert old.sample(0, "train", 0)["parameters"]["g"] == pytest.approx(0.5, abs=1e-3)
    fingerprint = old.fingerprint()
    defined("(1 + cos) ** 30")
    new = own_recipe()
    assert new.fingerprint() != fingerprint
    assert new.sample(0, "train", 0)["parameters"]["g"] == pytest.approx(0.968, abs=1e-3)
    assert_refused(lambda: old.sample(0, "train", 1), r"Material\.scatterer must be of a class that is unchanged")
    assert old.fingerprint() == fingerprint


def test_a_global_variable_that_an_amplitude_looks_up_is_part_of_it():
    lobe, cell = defined("(1 + cos) ** POWER", POWER=1)
    before, recipe = slab(lobe()), own_recipe()
    first = recipe.sample(0, "train", 0)
    cell["POWER"] = 30
    after = slab(lobe())
    assert before.scatterer.mean_cosine() == pytest.approx(0.5, abs=1e-3)
    assert after.scatterer.mean_cosine() == pytest.approx(0.968, abs=1e-3)
    assert before.fingerprint() != after.fingerprint()
    assert_refused(lambda: recipe.sample(0, "train", 1), r"Material\.scatterer")
    cell["POWER"] = 1
    forget()
    assert_same(recipe.sample(0, "train", 0), first)


def test_what_is_drawn_within_ranges_is_part_of_a_recipe():
    """Alike at both ends of the range and different between."""
    defined("(1 + cos) ** self.power")
    ranged = {"uniform": [1.0, 3.0]}
    first = own_recipe(ranged).fingerprint()
    defined("(1 + cos) ** (self.power + 0.5 * (self.power - 1) * (3 - self.power))")
    assert own_recipe(ranged).fingerprint() != first


def test_samples_of_two_classes_do_not_end_up_in_one_store(tmp_path):
    """The class of g .889 is redefined as one of g .900; what is stored stays, and the rest is refused."""
    defined("(1 + cos) ** 8")
    generate(own_recipe(), samples=2, folder=tmp_path / "a.zarr", processes=1)
    defined("(1 + cos) ** 9")
    with pytest.raises(RuleError, match=r"generate\.folder.*content_sha256"):
        generate(own_recipe(), samples=4, folder=tmp_path / "a.zarr", processes=1)
    defined("(1 + cos) ** 8")
    assert generate(own_recipe(), samples=4, folder=tmp_path / "a.zarr", processes=1)["rendered"] == 2


def test_what_is_written_is_read_by_the_class_of_that_content_alone():
    lobe, _ = defined("(1 + cos) ** self.power")
    scene = slab(sg.Mixture(types=[lobe(power=2.0), sg.Isotropic()], fractions=[0.5, 0.5]))
    text, sent = scene.canonical_json(), pickle.dumps(own_recipe())
    assert sg.Slab.from_json(text) == scene
    assert sg.Slab.from_toml(scene.to_toml()) == scene
    assert "content_sha256" not in scene.to_toml()
    defined("(1 - cos) ** self.power")
    assert_refused(lambda: sg.Slab.from_json(text), "Lobe content must be that of SHA-256")
    assert_refused(lambda: pickle.loads(sent), r"Material\.scatterer|Recipe must be of the fingerprint")


MODULE = """
import specklegen as sg
class Lobe(sg.Scatterer):
    power: float = 1.0
    def shape(self, cos, dimensions=3):
        return (1 + cos) ** {power}
"""
SEND = """
import lobes, pickle, sys
from quick_recipes import quick_recipe
from scipy.interpolate import CubicSpline
pickle.dump([pickle.dumps(value) for value in {}], sys.stdout.buffer)
"""
RUN = """
import pickle, sys, lobes
from specklegen.core.errors import RuleError
for content in pickle.load(open(sys.argv[1], "rb")):
    try:
        print(pickle.loads(content).fingerprint())
    except RuleError:
        print("refused")
"""


def test_a_file_that_is_edited_is_noticed_by_processes_that_start_later(tmp_path):
    """Scatterer and recipe, sent by a pickle to a process whose module says something else."""
    (tmp_path / "lobes.py").write_text(MODULE.format(power=2))
    values = (
        "[lobes.Lobe(), quick_recipe('tilt-stack', material={'kernel_paths': 1000, 'scatterer': {'type': 'Lobe'}})]"
    )
    path = {"PYTHONPATH": ":".join([str(tmp_path), *sys.path]), "PYTHONDONTWRITEBYTECODE": "1"}
    run, file = partial(subprocess.run, capture_output=True, env=path, check=True), tmp_path / "sent"
    file.write_bytes(run([sys.executable, "-c", SEND.format(values)]).stdout)
    for power, refused in ((2, 0), (3, 2)):
        (tmp_path / "lobes.py").write_text(MODULE.format(power=power))
        said = run([sys.executable, "-c", RUN, str(file)]).stdout.split()
        assert len(said) == 2
        assert said.count(b"refused") == refused


def test_packaged_classes_count_by_their_fields_alone():
    """Fingerprints of what a user has not defined are those of before."""
    assert sg.HenyeyGreenstein(0.9).canonical_json() == '{"g":0.9,"type":"HenyeyGreenstein"}'
    assert sg.HenyeyGreenstein(0.9).content_sha256 == ""
    recipe = quick_recipe("tilt-stack")
    assert pickle.loads(pickle.dumps(recipe)) == recipe


def test_a_class_of_ones_own_that_poses_as_a_packaged_one_is_another():
    class Posing(sg.HenyeyGreenstein):
        def row(self, dimensions):
            return sg.HenyeyGreenstein(self.g / 2).row(dimensions)

    assert slab(Posing(0.9)).fingerprint() != slab(sg.HenyeyGreenstein(0.9)).fingerprint()


FACTOR = 2.0


def doubled(x):
    """Twice."""
    return FACTOR * x


def hiding(value):
    class Hiding:
        _factor = value

        def picture(self, x):
            return self._factor * x

    return Hiding


def admitted(value):
    class Hiding(Admitted):
        _factor: float = value

        def picture(self, x):
            return self._factor * x

    return Hiding


ALIKE = [
    (lambda x: x + 1, lambda x: x + 1), ({"a": 1, "b": 2}, {"b": 2, "a": 1}), (np.arange(3), np.arange(3)),
    (partial(doubled, 2), partial(doubled, 2)), (sg.Isotropic(), sg.Isotropic()),
    (torch.arange(9)[3:6], torch.arange(3, 6)), (re.compile("a"), re.compile("a")),
    (CubicSpline([0, 1, 2], [0, 1, 2]), CubicSpline([0, 1, 2], [0, 1, 2])),
    (np.array([[1], None], dtype=object), np.array([[1], None], dtype=object)),
    (threading.Lock(), threading.Lock()),  # which cannot be pickled
    (hiding(1), hiding(1)),
    (admitted(1), admitted(1)),
]  # fmt: skip
DIFFERENT = [
    (lambda x: x + 1, lambda x: x + 2), (lambda x, y=1: x + y, lambda x, y=2: x + y),
    (lambda x: np.sin(x), lambda x: np.cos(x)), (lambda x: [n + 1 for n in x], lambda x: [n + 2 for n in x]),
    (np.arange(3), np.arange(3.0)), (np.zeros((2, 3)), np.zeros((3, 2))), ([1, 2], [1, 3]), ([[1], 2], [[1, 2]]),
    (1, 1.0), (1, True), ("1", 1), (0.0, -0.0), (partial(doubled, 2), partial(doubled, 3)),
    (torch.zeros(2), torch.ones(2)), (torch.ones(2, dtype=torch.complex64), 1j * torch.ones(2)),
    (re.compile("a"), re.compile("b")), (CubicSpline([0, 1, 2], [0, 1, 2]), CubicSpline([0, 1, 2], [0, 1, 3])),
    (Fraction(1, 2), Fraction(1, 3)), (Path("a"), Path("b")), (range(3), range(4)), (deque([1]), deque([2])),
    (lru_cache(lambda x: x), lru_cache(lambda x: x + 1)), (np.vectorize(lambda x: x), np.vectorize(lambda x: x + 1)),
    (hiding(1), hiding(2)), (admitted(1), admitted(2)),
]  # fmt: skip


@pytest.mark.parametrize("pair", ALIKE)
def test_what_is_alike_has_one_digest(pair):
    assert content_digest(pair[0]) == content_digest(pair[1])


@pytest.mark.parametrize("pair", DIFFERENT)
def test_what_is_different_has_two(pair):
    assert content_digest(pair[0]) != content_digest(pair[1])


def test_code_is_followed_to_what_it_refers_to(monkeypatch):
    def inner(x):
        return doubled(x) + 1

    before = content_digest(inner)
    monkeypatch.setitem(globals(), "FACTOR", 3.0)
    assert content_digest(inner) != before


def test_what_a_module_of_ones_own_holds_is_part_of_it(tmp_path, monkeypatch):
    """By ``import lenses``, from a package too; what a function does not look up there is not."""
    (tmp_path / "optics").mkdir()
    (tmp_path / "optics" / "__init__.py").write_text("")
    (tmp_path / "optics" / "lenses.py").write_text("FOCUS, OTHER = 1.0, 1.0\ndef bent(x):\n    return FOCUS * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    lenses = importlib.import_module("optics.lenses")
    for name in ("optics", "optics.lenses"):
        monkeypatch.setitem(sys.modules, name, sys.modules[name])
    space = {"optics": sys.modules["optics"], "lenses": lenses}
    for code in ("lambda x: lenses.bent(x)", "lambda x: optics.lenses.bent(x)"):
        seen = eval(code, space)  # noqa: S307
        before = content_digest(seen)
        monkeypatch.setattr(lenses, "OTHER", 2.0)
        assert content_digest(seen) == before
        monkeypatch.setattr(lenses, "FOCUS", lenses.FOCUS + 1)
        assert content_digest(seen) != before


def test_what_an_object_has_worked_out_is_no_part_of_it():
    """Neither of one's own class nor of this package's, whose correlations find their mixture when they are asked."""

    class Square:
        def __init__(self, side):
            self.side = side

        @cached_property
        def area(self):
            return self.side**2

    correlation = MemoryEffectCorrelation(np.array([400.0]), np.ones((1, 1)), paths=1, single_share=0.0)
    for thing, asked in ((Square(2), "area"), (correlation, "_mixture")):
        before = content_digest(thing)
        getattr(thing, asked)
        assert content_digest(thing) == before
    assert content_digest(Square(2)) != content_digest(Square(3))


def test_functions_that_call_each_other_have_a_digest():
    def even(n):
        return n == 0 or odd(n - 1)

    def odd(n):
        return n != 0 and even(n - 1)

    assert content_digest(even) == content_digest(even)


def test_an_admitted_value_is_known_by_its_code():
    """What registries of other parts get without saying anything: families of objects, media, cameras."""

    def family(factor):
        class Family(Admitted):
            size: float = 1.0

            def picture(self):
                return factor * self.size

        return Family()

    assert family(1).fingerprint() == family(1).fingerprint()
    assert family(1).fingerprint() != family(2).fingerprint()
    assert family(1).canonical_json() != family(2).canonical_json()
