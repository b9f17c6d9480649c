"""What help(), signatures and the tab key show of public names: words, and no machinery."""

import inspect

import pytest
from public_names import NAMES, public

import specklegen as sg
from specklegen.core.errors import RuleError


def public_callables():
    """Every public function and class, and the public methods of the classes."""
    for name in NAMES:
        thing = public(name)
        yield name, thing
        if isinstance(thing, type):
            yield from ((f"{name}.{n}", getattr(thing, n)) for n in dir(thing) if callable(getattr(thing, n)))


def test_no_signature_spells_out_validators_or_array_protocols():
    spelt_out = {}
    for name, thing in public_callables():
        try:
            written = str(inspect.signature(thing))
        except (ValueError, TypeError):  # classes of the interpreter, such as errors
            continue
        if any(word in written for word in ("Annotated", "Validator", "_typing", "*unnamed")):
            spelt_out[name] = written
    assert spelt_out == {}


SIGNATURES = {
    sg.Slab: "(*, thickness: float >= 0, mean_free_path: float > 0, albedo: float in [0, 1] = 1.0, scatterer: Scat",
    sg.HenyeyGreenstein: "(g: float)",
    sg.VonMisesFisher: "(concentration: float in (0, 1e+10])",
    sg.Mixture: "(*, types: tuple[Scatterer, ...], fractions: tuple[float in [0, 1], ...])",
    sg.NearField: "(points: array)",
}  # fmt: skip


def test_a_signature_says_type_rule_and_default():
    for kind, told in SIGNATURES.items():
        assert str(inspect.signature(kind)).startswith(told.rstrip(")"))


def test_a_field_whose_place_is_obvious_needs_no_name():
    for kind, field, value in (
        (sg.HenyeyGreenstein, "g", 0.9), (sg.VonMisesFisher, "concentration", 30.0),
        (sg.NearField, "points", [[1.0, 2.0]]), (sg.PointSources, "points", [[1.0, 2.0]]),
        (sg.FarField, "directions", [[0.0, 1.0]]), (sg.PlaneWaves, "directions", [[0.0, 1.0]]),
    ):  # fmt: skip
        assert kind(value) == kind(**{field: value})


def test_what_has_no_obvious_place_is_refused():
    for kind, places, names in ((sg.HenyeyGreenstein, (0.9, 0.8), {}), (sg.HenyeyGreenstein, (0.9,), {"g": 0.8}),
                                (sg.Slab, (1.0, 2.0, 3.0), {})):  # fmt: skip
        with pytest.raises(RuleError, match="must be given by the names of its fields"):
            kind(*places, **names)
