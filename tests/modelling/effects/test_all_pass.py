"""The delay of a sensor as an all-pass, against the delay itself and a closed form."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.fmu.export import state_variables as states
from modelling.linear.linearise import linearise
from modelling.linear.state_space import response
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

BASE = {
    "inertias": {"rotor": {"J": 2.0, "drag": 1.0}},
    "inputs": {"drive": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor"}},
}
DELAY = 0.0025  # s


def with_effect(kind):
    return from_dict(BASE | {"effects": [{"kind": kind, "at": "sensors.speed", "delay": DELAY}]})


def test_its_response_is_the_closed_form_and_near_the_delay():
    frequencies = np.array([0.5, 5.0, 30.0, 100.0])
    plain = response(linearise(from_dict(BASE)), frequencies).values[:, 0, 0]
    s = 2j * np.pi * frequencies
    got = response(linearise(with_effect("all_pass")), frequencies).values[:, 0, 0] / plain
    np.testing.assert_allclose(got, ((1 - s * DELAY / 4) / (1 + s * DELAY / 4)) ** 2, rtol=1e-10)
    off = np.abs(np.angle(got / np.exp(-s * DELAY)))
    assert (off <= (2 * np.pi * frequencies * DELAY) ** 3 / 48 + 1e-12).all()


def test_in_steady_motion_it_reads_the_speed():
    time = np.arange(5) * 1e-3
    run = simulate(with_effect("all_pass"), time, {"drive": np.full(5, 3.0)}, start="steady")
    assert run.readings["speed"] == pytest.approx(3.0, rel=1e-6)


def test_both_states_are_described_in_the_unit_of_what_the_sensor_reads():
    described = {one.name: (one.unit, one.description) for one in states(compiled(with_effect("all_pass")))}
    assert described["sensors.speed.all_pass"] == ("rad/s", "sensors.speed behind the first half of its delay")
    assert described["sensors.speed.all_pass.2"] == ("rad/s", "sensors.speed behind both halves of its delay")
