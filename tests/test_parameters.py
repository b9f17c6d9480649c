"""Parameters of public callables: each is described where it stands, and a default of None is explained.

What a page of the API has to say is partly a matter of form. Of every public function and class: each parameter is the
head of an entry in the docstring's section Parameters (of results, whose fields are read and not given, Attributes);
the entry is no mere pointer to another page; and where the default is None it says what that stands for. Units cannot
be told from words by a rule; lengths and angles are asked for one of the words by which their unit is told.
"""

import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

from specklegen import SUBJECTS

PACKAGES = ("", *(f".{name}" for name in SUBJECTS), ".datasets", ".fdtd", ".instrument", ".materials", ".measured",
            ".models", ".wavetracing")  # fmt: skip
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
HEAD = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?:\s*:\s*(.*))?$")
POINTER = re.compile(r"see\b.*|as asked for.*|(?:[^.;:]*, )?as (?:in|of|for)\b[^.;:]*\.?", re.IGNORECASE)
ROLE = re.compile(r":\w+:`~?([^`]*)`")
NOTHING_GIVEN = re.compile(r"\b(default|None|without|instead|else|otherwise|optional|unless|where|left out|if)\b",
                           re.IGNORECASE)  # fmt: skip
ANGLES = ("tilt", "tilts", "azimuth", "theta", "incidence", "phi", "rotation")
LENGTHS = ("wavelength", "thickness", "mean_free_path", "width", "pitch", "distance", "focal_length",
           "coherence_length", "pixel_width", "half_width", "dx", "diameter", "beam_diameter")  # fmt: skip
ANGLE_WORDS = re.compile(r"radian|degree|turn|direction|sine|rotation|polarisation|matrix", re.IGNORECASE)
LENGTH_WORDS = re.compile(r"\bunits?\b|length|\bmm\b|metre|micrometre|\bum\b|\bnm\b|pixel|sine|grid|cells",
                          re.IGNORECASE)  # fmt: skip


def entries(docstring: str) -> dict[str, tuple[str, str]]:
    """Kind, as the head states it, and description of every name in the sections Parameters and Attributes."""
    starts = [(match[1], match.start(), match.end()) for match in SECTION.finditer(docstring)]
    found: dict[str, tuple[str, str]] = {}
    for place, (title, _, begin) in enumerate(starts):
        if title not in ("Parameters", "Attributes"):
            continue
        body = docstring[begin : starts[place + 1][1] if place + 1 < len(starts) else None]
        names: list[str] = []
        for line in body.splitlines():
            head = HEAD.match(line)
            if head:
                names = [name.lstrip("*") for name in head[1].split(", ")]
                found |= {name: ((head[2] or "").strip(), "") for name in names}
            elif line.strip():
                found |= {name: (found[name][0], f"{found[name][1]} {line.strip()}".strip()) for name in names}
    return found


def faults(docstring: str, parameters: dict[str, Any]) -> Iterator[str]:
    """What is missing of parameters, given with their defaults; ``inspect.Parameter.empty`` where there is none."""
    told = entries(docstring)
    for name, default in parameters.items():
        if name not in told:
            yield f"{name} is not described"
            continue
        kind, text = told[name]
        if not text and not kind:
            yield f"{name} has no description"
        elif text and POINTER.fullmatch(ROLE.sub(r"\1", text)):
            yield f'{name} only points elsewhere: "{text}"'
        elif default is None and not NOTHING_GIVEN.search(f"{kind} {text}"):
            yield f'{name} does not say what None stands for: "{text}"'
        for names, words in ((ANGLES, ANGLE_WORDS), (LENGTHS, LENGTH_WORDS)):
            if name in names and not words.search(f"{kind} {text} {docstring.partition('Parameters')[0]}"):
                yield f'{name} has no unit: "{kind} {text}"'


def public() -> dict[str, Any]:
    """Functions and classes of the public packages, by the name under which the page stands."""
    found = {}
    for package in (importlib.import_module(f"specklegen{name}") for name in PACKAGES):
        for name in package.__all__:
            thing = getattr(package, name)
            if inspect.isfunction(thing) or inspect.isclass(thing):
                found[f"{package.__name__}.{name}"] = thing
    return found


PUBLIC = public()


def parameters_of(thing: Any) -> dict[str, Any]:
    """Parameters and their defaults; of a class those of its constructor, none where Python alone knows them. A
    protocol is not called."""
    if getattr(thing, "_is_protocol", False):
        return {}
    try:
        return {name: each.default for name, each in inspect.signature(thing).parameters.items()}
    except ValueError:
        return {}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_parameter_is_described_where_it_stands(name):
    thing = PUBLIC[name]
    found = list(faults(inspect.getdoc(thing) or "", parameters_of(thing)))
    assert found == [], f"{name}: {'; '.join(found)}"


def methods() -> dict[str, Any]:
    """Public methods of these classes that have a section Parameters, by their qualified names."""
    found = {}
    for thing in (thing for thing in PUBLIC.values() if inspect.isclass(thing)):
        for name, method in inspect.getmembers(thing):
            method = getattr(method, "__func__", method)
            if inspect.isfunction(method) and not name.startswith("_") and method.__module__.startswith("specklegen"):
                if "Parameters" in SECTION.findall(inspect.getdoc(method) or ""):
                    found[f"{method.__module__}.{method.__qualname__}"] = method
    return found


def test_methods_that_describe_parameters_describe_all():
    """Small ones are told in a sentence; those with a section Parameters leave none out, and point nowhere."""
    found = methods()
    assert len(found) > 30
    for name, method in found.items():
        given = {key: default for key, default in parameters_of(method).items() if key not in ("self", "cls")}
        assert list(faults(inspect.getdoc(method) or "", given)) == [], name


def test_faults_are_seen():
    text = (
        "Do it.\n\nParameters\n----------\nscene\n    See :func:`plan`.\npaths, seed\n    As of :func:`render`.\n"
        "threads\n    How many.\nwidth\n    Of the beam.\nkind : {\"a\", \"b\"}\ntilt\n    Its angle, radians.\n\n"
        "Examples\n--------\nlost\n    No parameter.\n"
    )  # fmt: skip
    empty = inspect.Parameter.empty
    given = {"scene": empty, "paths": empty, "seed": 0, "threads": None, "width": 1.0, "kind": "a", "tilt": 0.0}
    given["lost"] = 1
    assert [each.partition(":")[0] for each in faults(text, given)] == [
        "scene only points elsewhere", "paths only points elsewhere", "seed only points elsewhere",
        "threads does not say what None stands for", "width has no unit", "lost is not described",
    ]  # fmt: skip
    assert list(faults(text.replace("How many.", "How many; None is one."), {"threads": None, "tilt": 0.0})) == []
