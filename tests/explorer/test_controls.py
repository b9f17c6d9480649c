"""States and addresses: each holds the other, and nonsense in an address is where the sliders begin."""

from dataclasses import asdict

import pytest

from specklegen.explorer.controls import CONTROLS, State, address_of, read, shown


def test_every_field_has_a_control_that_begins_on_a_step():
    for name, begins in asdict(State()).items():
        assert begins in CONTROLS[name].steps
        assert len(set(CONTROLS[name].steps)) == len(CONTROLS[name].steps)


def test_every_step_survives_the_address():
    for name, control in CONTROLS.items():
        for step in control.steps:
            state = State().replace(**{name: step})
            found, _ = read(address_of(state))
            assert found == state
            assert type(getattr(found, name)) is type(step)


def test_the_address_holds_what_was_moved_alone():
    assert address_of(State()) == {}
    assert address_of(State(g=0.5, lobe="VonMisesFisher")) == {"g": "0.5", "lobe": "VonMisesFisher"}


SAID = [
    ({"g": "0.91"}, State(), "g must be one of 0.1, "),  # the nearest step is where it begins
    ({"g": "0.92"}, State(g=0.93), "got 0.92. Shown is 0.93."),
    ({"thickness": "1e99"}, State(), "thickness must be a number from 200 to 4000; got 1e99. Shown is 1000."),
    ({"thickness": "199.9"}, State(), "thickness must be a number from 200 to 4000"),
    ({"sample": "-1"}, State(), "sample must be a number from 0 to 15; got -1. Shown is 0."),
    ({"g": "nan"}, State(), "g must be a number"),
    ({"g": "inf"}, State(), "g must be a number"),
    ({"g": "<b>"}, State(), "g must be a number"),
    ({"lobe": "Mie"}, State(), "lobe must be one of HenyeyGreenstein, VonMisesFisher; got Mie."),
    ({"unknown": "1"}, State(), "unknown is no control and is ignored"),
]


@pytest.mark.parametrize(("address", "state", "sentence"), SAID)
def test_what_no_slider_can_show_is_said(address, state, sentence):
    found, said = read(address)
    assert found == state
    assert len(said) == 1
    assert sentence in said[0]


def test_an_address_that_is_shown_as_it_was_asked_for_says_nothing():
    """Its own, with as many digits as it writes; and each wrong word of an address has its own sentence."""
    for name, control in CONTROLS.items():
        for step in control.steps:
            assert read(address_of(State().replace(**{name: step})))[1] == ()
    assert len(read({"thickness": "x", "g": "0.9", "lobe": "Mie", "no": "1"})[1]) == 3


def test_controls_stand_where_they_say_something():
    slab, layers, glass = (shown(State(medium=medium)) for medium in CONTROLS["medium"].steps)
    assert {"thickness", "refractive_index", "tilt"} < set(slab)
    assert not {"grit", "gap", "second_g", "iris"} & set(slab)
    assert {"second_thickness", "second_g", "thickness"} < set(layers)
    assert not {"grit", "refractive_index"} & set(layers)
    assert {"grit", "gap"} < set(glass)
    assert not {"thickness", "g", "lens"} & set(glass)
    lengths = {"iris", "object_distance", "object_width", "camera_distance", "pixel"}
    assert set(shown(State(setup="laboratory lengths"))) - set(slab) == lengths
    assert set(slab) - set(shown(State(setup="laboratory lengths"))) == {"aperture", "extent"}


def test_controls_stand_in_their_view():
    seeing, motion, polarised, lens = (set(shown(State(view=view))) for view in CONTROLS["view"].steps)
    assert "view" in seeing & motion & polarised & lens
    assert seeing - motion == {"tilt"}
    assert motion - seeing == {"lag"}
    assert polarised - seeing == {"analysers"}
    assert lens - seeing == {"focus", "lens", "magnification"}
    assert {"object", "extent", "aperture", "setup"} <= seeing - lens
    assert "analysers" not in shown(State(view="polarisation", medium="two layers"))
    assert not {"focus", "lens"} & set(shown(State(view="a lens", medium="ground glass")))
