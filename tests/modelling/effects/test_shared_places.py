"""One effect at several inputs or sensors: its parameters exist once, in files, equations and screening."""

import tomllib

import numpy as np
import pytest

from modelling.effects import EFFECTS
from modelling.effects.effect import members, place_in_words, shared_place
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict

BOTH = ["sensors.speed", "sensors.slow"]
SYSTEM = {
    "inertias": {"rotor": {"J": 0.5}, "wheel": {"J": 1.0}},
    "shafts": {"link": {"between": ["rotor", "wheel"], "stiffness": 50.0}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {
        "speed": {"measures": "speed", "of": "rotor"},
        "slow": {"measures": "speed", "of": "wheel"},
        "angle": {"measures": "angle", "of": "rotor"},
    },
}


def with_effect(**effect) -> dict:
    return SYSTEM | {"effects": [effect]}


def test_a_shared_lag_has_one_time_constant_and_a_state_for_each_sensor() -> None:
    system = from_dict(with_effect(kind="lag", at=BOTH, time_constant="8 ms"))
    (name,) = [name for name in system.parameters if name.endswith("time_constant")]
    model = compiled(system)
    assert [state for state in model.states if "lag" in state] == ["sensors.speed.lag", "sensors.slow.lag"]
    x = np.array([0.0, 0.0, 3.0, 5.0, 1.0, 2.0])  # speeds 3 and 5, their readings behind the lag 1 and 2
    rates = np.array(model.rates(x, [0.0], model.vector({name: 0.01}))).ravel()
    np.testing.assert_allclose(rates[4:], [(3 - 1) / 0.01, (5 - 2) / 0.01])


def test_a_shared_effect_comes_back_from_its_file() -> None:
    system = from_dict(with_effect(kind="sensor_delay", at=BOTH, delay=0.002))
    text = dumps(system)
    assert text.count("delay = ") == 1
    assert from_dict(tomllib.loads(text)) == system
    assert system.effects[0].places == tuple(BOTH)


@pytest.mark.parametrize(
    ("effect", "word"),
    [
        ({"kind": "sensor_offset", "at": BOTH, "offset": 1.0}, "several places"),
        ({"kind": "lag", "at": [BOTH[0], BOTH[0]], "time_constant": 0.1}, "twice"),
        ({"kind": "lag", "at": ["sensors.sped", BOTH[0]], "time_constant": 0.1}, "sped"),
        ({"kind": "lag", "at": [], "time_constant": 0.1}, "no text"),
    ],
)
def test_wrong_lists_are_named(effect: dict, word: str) -> None:
    with pytest.raises(InputError, match=word):
        from_dict(with_effect(**effect))


def test_an_effect_of_one_place_may_not_stand_in_a_group_too() -> None:
    twice = [{"kind": "lag", "at": BOTH, "time_constant": 0.1}, {"kind": "lag", "at": BOTH[1], "time_constant": 0.2}]
    with pytest.raises(InputError, match=r"stands twice at sensors\.slow"):
        from_dict(SYSTEM | {"effects": twice})


def test_groups_are_the_sensors_of_one_quantity_unless_all_are() -> None:
    system = from_dict(SYSTEM)
    assert EFFECTS["lag"].shared_places(system) == [shared_place(BOTH)]
    assert EFFECTS["sensor_offset"].shared_places(system) == []
    only = SYSTEM | {"sensors": {name: SYSTEM["sensors"][name] for name in ("speed", "slow")}}
    assert EFFECTS["lag"].shared_places(from_dict(only)) == []  # the same as a lag of the input


def test_words_of_places() -> None:
    assert members(shared_place(BOTH)) == tuple(BOTH)
    assert place_in_words("shafts.link") == "shafts.link"
    assert place_in_words("a.x+a.y+a.z") == "a.x, a.y and a.z"


def test_a_logger_holds_the_sensors_of_a_quantity_and_others_beside_them():
    sensors = {f"{name}_speed": {"measures": "speed", "of": name} for name in ("a", "b")}
    angle = {"a_angle": {"measures": "angle", "of": "a"}}
    table = {"inertias": {"a": {"J": 1.0}, "b": {"J": 1.0}}, "shafts": {"s": {"between": ["a", "b"], "stiffness": 9.0}}}
    offset = EFFECTS["clock_offset"]
    both = shared_place(["sensors.a_speed", "sensors.b_speed"])
    assert offset.shared_places(from_dict(table | {"sensors": sensors | angle})) == [both]
    assert offset.shared_places(from_dict(table | {"sensors": sensors})) == []  # nothing beside them
    assert offset.shared_places(from_dict(table | {"sensors": angle | {"b_speed": sensors["b_speed"]}})) == []
