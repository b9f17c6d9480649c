"""States and addresses: each holds the other, and nonsense in an address is where the sliders begin."""

import pytest

from specklegen.explorer.controls import CONTROLS, State, address_of, state_of


def test_every_field_has_a_control_that_begins_on_a_step():
    assert tuple(CONTROLS) == State._fields
    for name, begins in State()._asdict().items():
        assert begins in CONTROLS[name].steps
        assert len(set(CONTROLS[name].steps)) == len(CONTROLS[name].steps)


def test_every_step_survives_the_address():
    for name, control in CONTROLS.items():
        for step in control.steps:
            state = State()._replace(**{name: step})
            found = state_of(address_of(state))
            assert found == state
            assert type(getattr(found, name)) is type(step)


def test_the_address_holds_what_was_moved_alone():
    assert address_of(State()) == {}
    assert address_of(State(g=0.5, lobe="VonMisesFisher")) == {"g": "0.5", "lobe": "VonMisesFisher"}


@pytest.mark.parametrize(
    ("address", "state"),
    [
        ({"g": "0.91"}, State()),  # the nearest step is where it begins
        ({"g": "0.92"}, State(g=0.93)),
        ({"thickness": "1e9"}, State(thickness=4000.0)),
        ({"g": "nan"}, State()),
        ({"g": "inf"}, State()),
        ({"g": "<b>"}, State()),
        ({"lobe": "Mie"}, State()),
        ({"unknown": "1"}, State()),
    ],
)
def test_what_no_slider_can_show_is_not_taken(address, state):
    assert state_of(address) == state
