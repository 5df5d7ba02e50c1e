"""A torque by points against linear interpolation, and the messages of its file."""

import tomllib

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict
from modelling.simulation.simulate import simulate

POINTS, TORQUES = [-2.0, -0.5, 0.3, 4.0], [1.5, 0.2, -0.4, -3.0]
STIFFNESS = 300.0


def model(**table):
    return from_dict(
        {
            "inertias": {"a": {"J": 0.4}, "b": {"J": 1.5}},
            "shafts": {"link": {"between": ["a", "b"], "stiffness": STIFFNESS}},
            "inputs": {"drive": {"on": "a"}},
            "sensors": {"torque": {"measures": "torque", "of": "link"}},
            "effects": [{"kind": "table"} | table],
        }
    )


@pytest.mark.parametrize("x", [-5.0, -2.0, -1.1, 0.0, 0.3, 2.2, 9.0])
def test_torque_is_linear_between_points_and_constant_beyond(x):
    over_speed = compiled(model(at="inertias.b", speed=POINTS, torque=TORQUES))
    over_angle = compiled(model(at="inertias.b", angle=POINTS, torque=TORQUES))
    over_twist = compiled(model(at="shafts.link", twist=POINTS, torque=TORQUES))
    expected = np.interp(x, POINTS, TORQUES)
    rates = np.array(over_speed.rates([0, 0, 0, x], [0.0], over_speed.p0)).ravel()
    assert rates[3] == pytest.approx(expected / 1.5, rel=1e-12, abs=1e-12)
    rates = np.array(over_angle.rates([x, x, 0, 0], [0.0], over_angle.p0)).ravel()
    assert rates[3] == pytest.approx(expected / 1.5, rel=1e-12, abs=1e-12)
    (torque,) = np.array(over_twist.readings([x, 0, 0, 0], [0.0], over_twist.p0, 0.0)).ravel()
    assert torque == pytest.approx(STIFFNESS * x + expected, rel=1e-12, abs=1e-10)


def test_file_and_back():
    system = model(at="inertias.b", angle=["0 deg", "90 deg"], torque=[0.0, "2 N*m"])
    assert system.parameters["inertias.b.table.angle_2"].value == pytest.approx(np.pi / 2)
    assert from_dict(tomllib.loads(dumps(system))) == system
    assert "angle = [" in dumps(system)


def test_it_is_simulated():
    """A free disc under −2·speed: decay with exp(−2·t/J)."""
    data = {
        "inertias": {"disc": {"J": 4.0}},
        "inputs": {"drive": {"on": "disc"}},
        "sensors": {"speed": {"measures": "speed", "of": "disc"}},
        "effects": [{"kind": "table", "at": "inertias.disc", "speed": [-10.0, 10.0], "torque": [20.0, -20.0]}],
    }
    time = np.linspace(0, 2, 201)
    done = simulate(from_dict(data), time, {"drive": 0 * time}, start={"speed(disc)": 3.0})
    np.testing.assert_allclose(done["speed"], 3 * np.exp(-0.5 * time), atol=1e-6)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"at": "inertias.b", "speed": [0.0, 1.0], "torque": [1.0]}, "same number of points"),
        ({"at": "inertias.b", "speed": [1.0, 1.0], "torque": [1.0, 2.0]}, "do not increase"),
        ({"at": "inertias.b", "twist": [0.0, 1.0], "torque": [1.0, 2.0]}, "angle or speed"),
        ({"at": "shafts.link", "speed": [0.0, 1.0], "torque": [1.0, 2.0]}, "twist"),
        ({"at": "shafts.link", "twist": 0.1, "torque": [1.0, 2.0]}, "is no list"),
        ({"at": "shafts.link", "torque": [1.0, 2.0]}, "needs one list"),
        ({"at": "shafts.link", "twists": [0.0, 1.0], "torque": [1.0, 2.0]}, "twist"),
    ],
)
def test_wrong_tables_say_what_is_wrong(table, message):
    with pytest.raises(InputError, match=message):
        model(**table)
