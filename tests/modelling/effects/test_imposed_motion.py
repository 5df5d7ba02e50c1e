"""An inertia that moves as recorded: against the equation of the other inertia with the motion put in."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.modal.modes import modes
from modelling.model_file import dumps, from_dict
from modelling.simulation.simulate import simulate

J, STIFFNESS, DAMPING, RATE, SPEED = 0.4, 300.0, 0.6, 2 * np.pi * 3, 5.0
TIME = np.arange(0, 1.5, 1e-3)


def model(measures="speed", **changed):
    return {
        "inertias": {"a": {"J": J}, "b": {"J": 1.5, "drag": 0.1}},
        "shafts": {"link": {"between": ["a", "b"], "stiffness": STIFFNESS, "damping": DAMPING}},
        "inputs": {"drive": {"on": "a"}, "road": {"on": "b", "measures": measures}},
        "sensors": {"torque": {"measures": "torque", "of": "link"}, "speed": {"measures": "speed", "of": "b"}},
        "effects": [{"kind": "imposed_motion", "at": "inertias.b"}],
    } | changed


def speed(t):
    return SPEED * np.sin(RATE * t)


def angle(t):
    return SPEED / RATE * (1 - np.cos(RATE * t))


def torque(t):
    return 20 * np.sin(2 * np.pi * t)


@pytest.fixture(scope="module")
def expected():
    """Shaft torque (t,) by the equation of inertia a alone."""

    def twist_torque(t, state):
        return STIFFNESS * (state[0] - angle(t)) + DAMPING * (state[1] - speed(t))

    def rates(t, state):
        return [state[1], (torque(t) - twist_torque(t, state)) / J]

    solution = solve_ivp(rates, (0, TIME[-1]), [0.0, 0.0], t_eval=TIME, rtol=1e-9, atol=1e-10)
    return twist_torque(TIME, solution.y)


@pytest.mark.parametrize(("measures", "recorded"), [("speed", speed), ("angle", angle)])
def test_other_inertia_feels_the_recorded_motion(measures, recorded, expected):
    done = simulate(from_dict(model(measures)), TIME, {"drive": torque(TIME), "road": recorded(TIME)})
    assert np.abs(done.readings["torque"] - expected).max() < 2e-3 * np.abs(expected).max()
    assert np.sqrt(np.mean((done.readings["speed"] - speed(TIME)) ** 2)) < 5e-3 * SPEED


def test_mass_matrix_without_the_imposed_inertia():
    """A drive torque accelerates inertia a alone; no torque moves b."""
    compiled_model = compiled(from_dict(model()))
    rates = np.array(compiled_model.rates(np.zeros(4), [8.0, 0.0], compiled_model.p0)).ravel()
    by_coordinate = dict(zip(compiled_model.coordinates, rates[2:], strict=True))
    assert by_coordinate == pytest.approx({"a": 8.0 / J, "b": 0.0}, abs=1e-12)


def test_modes_are_those_with_the_imposed_inertia_held():
    """What is held is no mode of 0 Hz."""
    frequencies = [mode.frequency for mode in modes(from_dict(model()))]
    assert frequencies == pytest.approx([np.sqrt(STIFFNESS / J) / (2 * np.pi)], rel=1e-9)


def test_units_and_file():
    system = from_dict(model("angle"))
    assert system.input_units == {"drive": "N*m", "road": "rad"}
    assert 'measures = "angle"' in dumps(system)
    without = model(inputs={"drive": {"on": "a"}, "road": {"on": "b"}})
    assert from_dict(without).input_units == {"drive": "N*m", "road": "rad/s"}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"effects": []}, "nothing imposes the motion of 'b'"),
        ({"inputs": {"road": {"on": "b", "measures": "force"}}}, "inputs.road.measures"),
        ({"inputs": {"road": {"on": "b"}, "road2": {"on": "b"}}}, "recorded twice"),
    ],
)
def test_what_does_not_fit_is_said(changed, said):
    with pytest.raises(InputError, match=said):
        from_dict(model(**changed))
