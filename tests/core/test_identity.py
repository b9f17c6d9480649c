"""Fingerprints: fields that equal their defaults are no part of them, whatever their type, and all others are."""

import inspect
import io
import json
import pkgutil
import shutil
import subprocess
import sys
from collections import defaultdict
from contextlib import redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
import pytest
from pydantic import BaseModel, Field
from scenes import ROOT

import specklegen as sg
from specklegen.core.values import NAME_FIELDS, Array, Value
from specklegen.datasets.recipes.specification import DATA_VERSION
from specklegen.instrument.camera import Camera

DEFAULTS = Path(__file__).parent / "defaults.json"


def packaged_classes() -> list[type[Value]]:
    """List all classes of values of the package that can be made, by module and name."""
    for module in pkgutil.walk_packages(sg.__path__, "specklegen."):
        if not module.name.endswith("__main__"):
            with suppress(ModuleNotFoundError):  # of an extra that is not installed
                import_module(module.name)
    classes, stack = set(), [Value]
    while stack:
        stack += (below := stack.pop().__subclasses__())
        classes |= {each for each in below if each.__module__.startswith("specklegen.")}
    bases = {each for each in classes if inspect.isabstract(each) or each.__name__[0] == "_" or not each.model_fields}
    return sorted(classes - bases, key=lambda each: (each.__module__, each.__name__))


class Part(Value):
    """A value with a default of every type."""

    type: Literal["Part"] = "Part"
    kind: Literal["part"] = "part"
    number: float = 1.0
    flag: bool | float = True
    pair: tuple[float, ...] = (1.0, 2.0)
    array: Array = Field(default_factory=lambda: np.arange(3.0))
    camera: Camera = Camera(photons=10.0)
    renamed: Annotated[float, Field(alias="other name")] = 0.0


def test_defaults_are_left_out_whatever_their_type():
    plain = '{"kind":"part","type":"Part"}'
    assert Part().canonical_json() == plain
    stated = Part(number=1, flag=True, pair=[1, 2], array=[0, 1, 2], camera={"photons": 10}, **{"other name": -0.0})
    assert stated.canonical_json() == plain
    assert (stated, stated.fingerprint()) == (Part(), Part().fingerprint())


@pytest.mark.parametrize("changed", [{"number": 1.0000000000000002}, {"flag": 1.0}, {"flag": False}, {"pair": (1.0,)},
                                     {"array": np.arange(2.0)}, {"array": np.arange(3.0)[:, None]},
                                     {"camera": Camera(photons=10.0, gain=2.0)}, {"other name": 1e-300}])  # fmt: skip
def test_another_value_is_part_of_the_fingerprint(changed):
    part = Part(**changed)
    assert part.fingerprint() != Part().fingerprint()
    assert set(changed) < set(json.loads(part.canonical_json()))
    assert Part.from_json(part.canonical_json()) == part


def test_files_for_readers_have_every_field():
    assert {"number", "array", "other name"} < set(Part().model_dump(mode="json", by_alias=True))
    assert "number = 1.0" in Part().to_toml()


def label(cls: type[Value]) -> str:
    """What a fingerprint tells of a class: its ``type`` and ``kind``, or else its name."""
    fields = cls.model_fields
    return str([(name, fields[name].default) for name in NAME_FIELDS if name in fields] or cls.__name__)


def test_no_two_packaged_classes_share_a_fingerprint():
    classes = defaultdict(list)
    for cls in packaged_classes():
        if all(cls.model_fields[name].default is not None for name in NAME_FIELDS if name in cls.model_fields):
            classes[label(cls)].append(cls)
    shared = {name: alike for name, alike in classes.items() if len({str(each.model_fields) for each in alike}) > 1}
    assert shared == {}
    made = []
    for cls in (each for each in packaged_classes() if "None" not in label(each)):
        with suppress(sg.RuleError, TypeError):  # some fields depend on each other, or have no default
            made.append(cls())
    assert len(made) > 10
    assert len({one.fingerprint() for one in made}) == len(made)


def unions_of_values(annotation: Any) -> list[list[type[Value]]]:
    """Classes of values that are members of one union, for each union within an annotation."""
    parts = [part for part in get_args(annotation) if part is not type(None)]
    members = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
    inner = [union for part in parts for union in unions_of_values(part)]
    return inner if get_origin(annotation) in (tuple, list, dict) or len(members) < 2 else [*inner, members]


def test_members_of_a_union_are_told_apart_by_name_or_by_required_fields():
    for cls in packaged_classes():
        for name, field in cls.model_fields.items():
            for members in unions_of_values(field.annotation):
                required = [frozenset(n for n, f in one.model_fields.items() if f.is_required()) for one in members]
                unnamed = [
                    fields for one, fields in zip(members, required, strict=True)
                    if not set(NAME_FIELDS) & one.model_fields.keys()
                ]  # fmt: skip
                assert len(set(unnamed)) == len(unnamed), (cls, name)
                assert frozenset() not in unnamed or len(unnamed) == 1, (cls, name)


def test_whoever_changes_a_default_raises_the_data_version():
    """A default stands for every value that does not state the field. New fields may come. If this fails on purpose,
    raise DATA_VERSION, and write the file anew: ``PYTHONPATH=tests python tests/core/test_identity.py``."""
    recorded = json.loads(DEFAULTS.read_text())
    present = defaults()
    changed = {name: (value, present.get(name)) for name, value in recorded["defaults"].items()
               if name in present and present[name] != value}  # fmt: skip
    assert changed == {} or recorded["data_version"] != DATA_VERSION
    assert recorded["data_version"] == DATA_VERSION, f"write {DEFAULTS.name} anew"


def defaults() -> dict[str, str]:
    """Return the default of every field of every packaged class of values."""
    return {
        f"{cls.__name__}.{name}": repr(field.get_default(call_default_factory=True))
        for cls in packaged_classes() for name, field in cls.model_fields.items() if not field.is_required()
    }  # fmt: skip


GROWN = {
    "specklegen/instrument/camera.py": ("class Camera(", "    photons:"),
    "specklegen/scene/media.py": ("class Slab(", "    thickness:"),
    "specklegen/scene/scatterers/henyey_greenstein.py": ("class HenyeyGreenstein(", "    g:"),
    "datasets/recipes/specification.py": ("class Specification(", "    name:"),
    "datasets/recipes/parts/light.py": ("class Light(", "    bandwidth:"),
}
"""Class of each file that gets a new field, and the field before which it stands."""
PROGRAM = """
import json, sys
import specklegen as sg
from specklegen.core.values import Value
from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.verify import verify
from specklegen.instrument.camera import Camera
from specklegen.models.judging.tasks import TASKS

camera, light = {"photons": 1000.0, "bit_depth": 12}, {"bandwidth": 0.001}
recipe = load_recipe("through-slab", {"exposure": camera, "light": light, "material": {"kernel_paths": 500}})
slab = sg.Slab(thickness=10.0, mean_free_path=1.0, scatterer=sg.HenyeyGreenstein(0.9))
prints = {name: load_recipe(name).fingerprint() for name in recipe_names()}
prints |= {"recipe": recipe.fingerprint(), "slab": slab.fingerprint(), "unitless": slab.unitless_fingerprint()}
for task in TASKS:
    if task.kind not in ("waves", "frames"):
        task.recipe()  # refuses another fingerprint
changed = {}
if "new_field" in Camera.model_fields:
    new = {"new_field": 1.0}
    tables = {"exposure": camera, "light": light, "material": {"kernel_paths": 500}}
    others = [{"exposure": camera | new}, {"light": light | new}, new]
    made = [load_recipe("through-slab", tables | other) for other in others]
    made += [slab.replace(new_field=1.0), slab.replace(scatterer=sg.HenyeyGreenstein(0.9, new_field=1.0))]
    changed = {"changed": [each.fingerprint() for each in made]}
done = generate(recipe, samples=int(sys.argv[2]), folder=sys.argv[1], processes=1)
print(json.dumps({"prints": prints, "sound": verify(sys.argv[1]).sound, "total": done["total"], **changed}))
"""


def run(root: Path, store: Path, samples: int) -> dict[str, Any]:
    """Run the program above with the packages of a folder."""
    command = [sys.executable, "-c", PROGRAM, str(store), str(samples)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_new_field_with_a_default_changes_no_fingerprint(tmp_path, monkeypatch):
    """Five classes get a field: fingerprints, tasks of the benchmark and a store that goes on are as before."""
    for folder in ("specklegen", "datasets", "models"):
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "a.zarr"), "4"])
    with redirect_stdout(io.StringIO()) as said:
        exec(PROGRAM, {})  # as it is: here, which spares a process
    before = json.loads(said.getvalue().splitlines()[-1])
    for name, (cls, field) in GROWN.items():
        head, start, rest = (tmp_path / name).read_text().partition(f"\n{cls}")
        above, line, below = rest.partition(f"\n{field}")
        assert start, name
        assert line, name
        (tmp_path / name).write_text(f"{head}{start}{above}\n    new_field: float = 0.0{line}{below}")
    after = run(tmp_path, tmp_path / "a.zarr", 8)
    assert after["prints"].items() <= before["prints"].items()  # other tests may have entered recipes here
    assert len(after["prints"]) > 20
    assert (before["total"], after["total"]) == (4, 8)
    assert after["sound"]
    assert len({*after["changed"], before["prints"]["recipe"], before["prints"]["slab"]}) == len(GROWN) + 2


if __name__ == "__main__":
    DEFAULTS.write_text(json.dumps({"data_version": DATA_VERSION, "defaults": defaults()}, indent=1) + "\n")
