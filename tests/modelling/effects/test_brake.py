"""A brake against equations of this file: it stops what turns, holds it under a load, and lets go."""

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

J, BODY, STIFFNESS, DAMPING, DEFLECTION, SETTLING = 0.7, 40.0, 3e4, 300.0, 0.02, 0.002
TIME = np.arange(0, 4, 1e-3)
PULLED = np.interp(TIME, [0.4, 0.5, 3.3, 3.4], [0, 1500, 1500, 0])
PUSHED = np.interp(TIME, [2.4, 2.5], [0, 700])


def own_motion():
    """Speeds (t, 2) of wheel and body, by Runge and Kutta's classical method."""
    fine = 40

    def rates(x, brake, push):
        wheel, body, twist, pad = x
        pad_rate = wheel - abs(wheel) * pad / DEFLECTION
        shaft = STIFFNESS * twist + DAMPING * (wheel - body)
        braking = brake * (pad + SETTLING * pad_rate) / DEFLECTION
        return np.array([(push - shaft - braking) / J, shaft / BODY, wheel - body, pad_rate])

    x, h, out = np.array([20.0, 20.0, 0.0, 0.0]), 1e-3 / fine, []
    for n in range(len(TIME)):
        out.append(x[:2])
        for piece in range(fine):
            at = TIME[n] + (piece + 0.5) * h
            u = np.interp(at, TIME, PULLED), np.interp(at, TIME, PUSHED)
            k1 = rates(x, *u)
            k2 = rates(x + h / 2 * k1, *u)
            k3 = rates(x + h / 2 * k2, *u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3, *u))
    return np.array(out)


@pytest.fixture(scope="module")
def readings():
    system = from_dict({
        "inertias": {"wheel": {"J": J}, "body": {"J": BODY}},
        "shafts": {"tyre": {"between": ["wheel", "body"], "stiffness": STIFFNESS, "damping": DAMPING}},
        "inputs": {"brake": {"on": "wheel"}, "motor": {"on": "wheel"}},
        "sensors": {name: {"measures": "speed", "of": name} for name in ("wheel", "body")},
        "effects": [{"kind": "brake", "at": "inputs.brake", "deflection": DEFLECTION, "settling": SETTLING}],
    })  # fmt: skip
    start = {"speed(wheel)": 20.0, "speed(body)": 20.0}
    return simulate(system, TIME, {"brake": PULLED, "motor": PUSHED}, start=start).readings


@pytest.mark.long
def test_it_brakes_as_its_equations_say(readings):
    own = own_motion()
    for number, name in enumerate(("wheel", "body")):
        assert np.abs(readings[name] - own[:, number]).max() < 2e-3


def test_it_brakes_evenly_and_holds_without_creeping(readings):
    falling = readings["body"][(TIME > 0.6) & (TIME < 0.9)]
    np.testing.assert_allclose(np.diff(falling) / 1e-3, -1500 / (J + BODY), rtol=0.1)
    held = readings["wheel"][(TIME > 3.1) & (TIME < 3.3)]  # against a push of half its torque
    assert abs(np.sum(held) * 1e-3) < 1e-3  # rad
    assert readings["body"][-1] > 5, "let go"


def test_a_brake_is_never_pulled_below_zero():
    """Recorded as negative it would drive; a channel of noise about 0 is a brake that is not pulled."""
    system = from_dict({
        "inertias": {"wheel": {"J": 1.0}}, "inputs": {"torque": {"on": "wheel"}, "brake": {"on": "wheel"}},
        "sensors": {"speed": {"measures": "speed", "of": "wheel"}},
        "effects": [{"kind": "brake", "at": "inputs.brake", "deflection": 0.01}],
    })  # fmt: skip
    time, random = np.arange(500) * 1e-2, np.random.default_rng(1)
    noise, torque = 0.3 * random.standard_normal(500), np.ones(500)
    with pytest.raises(InputError, match=r"inputs.brake: is -2.* the torque of a brake is 0 or more"):
        simulate(system, time, {"torque": torque, "brake": -20.0 * (time > 2) + noise}, start="rest")
    free = simulate(system, time, {"torque": torque, "brake": noise}, start="rest")["speed"][-1]
    assert 0 < free <= time[-1]  # 1 N·m on 1 kg·m², and no more
    held = simulate(system, time, {"torque": torque, "brake": 20.0 * (time > 2) + noise}, start="rest")["speed"]
    assert abs(held[-1]) < 0.05
