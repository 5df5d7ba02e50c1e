"""The law of a relaxing (Maxwell) element, and recordings made by matrix exponentials in which diagnosis finds it."""

import numpy as np
import pytest
from scipy.linalg import expm

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import simulate

J, DRAG, STIFFNESS, DAMPING, RELAXING, TIME_CONSTANT = (0.1, 1.0), (0.03, 0.15), 350.0, 0.5, 250.0, 0.02
STEP, NOISE = 2e-3, {"motor_speed": 0.01, "load_speed": 0.01, "link_torque": 0.03}
TIME = STEP * np.arange(4000)
MODEL = {
    "inertias": {
        "motor": {"J": J[0], "drag": {"value": 0.02, "tolerance": 0.6}},
        "load": {"J": J[1], "drag": {"value": 0.18, "tolerance": 0.6}},
    },
    "shafts": {"link": {
        "between": ["motor", "load"], "stiffness": {"value": 380, "tolerance": 0.3},
        "damping": {"value": 0.6, "tolerance": 0.6},
    }},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {name: {"measures": measures, "of": of, "uncertainty": NOISE[name]} for name, measures, of in (
        ("motor_speed", "speed", "motor"), ("load_speed", "speed", "load"), ("link_torque", "torque", "link"),
    )},
}  # fmt: skip


def recorded(seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Torque, and readings without noise: states speeds, twist, twist of the relaxing spring; exact for straight
    inputs."""
    rng = np.random.default_rng(seed)
    torque = 12 * np.sin(2 * np.pi * (0.3 * TIME + 0.9 * TIME**2) + rng.uniform(0, 6)) + 6 * np.sign(np.sin(2.1 * TIME))
    rate = np.array([1.0, -1.0, 0.0, 0.0])
    pull = DAMPING * rate + np.array([0.0, 0.0, STIFFNESS, RELAXING])
    A = np.array([-pull / J[0], pull / J[1], rate, rate])
    A[0, 0] -= DRAG[0] / J[0]
    A[1, 1] -= DRAG[1] / J[1]
    A[3, 3] -= 1 / TIME_CONSTANT
    block = np.zeros((6, 6))
    block[:4, :4], block[0, 4], block[4, 5] = A, 1 / J[0], 1.0
    over = expm(block * STEP)
    x = np.zeros((len(TIME), 4))
    for k in range(len(TIME) - 1):
        x[k + 1] = (over @ np.array([*x[k], torque[k], (torque[k + 1] - torque[k]) / STEP]))[:4]
    return torque, {"motor_speed": x[:, 0], "load_speed": x[:, 1], "link_torque": x @ pull}


@pytest.mark.parametrize("native", [True, False])
def test_it_moves_as_its_law_says(native: bool) -> None:
    torque, expected = recorded(1)
    effect = {"kind": "relaxation", "at": "shafts.link", "stiffness": RELAXING, "time_constant": TIME_CONSTANT}
    values = {"inertias.motor.drag": DRAG[0], "inertias.load.drag": DRAG[1]}
    values |= {"shafts.link.stiffness": STIFFNESS, "shafts.link.damping": DAMPING}
    system = from_dict(MODEL | {"effects": [effect]}).with_values(values)
    got = simulate(system, TIME, {"motor_torque": torque}, compile=native)
    for name, own in expected.items():
        np.testing.assert_allclose(got[name], own, atol=2e-4 * np.ptp(own))


@pytest.mark.long
def test_rubber_is_found_with_its_values() -> None:
    torque, readings = recorded(2)
    rng = np.random.default_rng(3)
    noisy = {name: own + NOISE[name] * rng.standard_normal(len(TIME)) for name, own in readings.items()}
    found = diagnose(from_dict(MODEL), [Recording(TIME, {"motor_torque": torque, **noisy})])
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert (cause.kind, cause.at) == ("relaxation", "shafts.link")
    for key, value in (("stiffness", RELAXING), ("time_constant", TIME_CONSTANT)):
        own = cause.parameters[key]
        assert abs(own.value - value) < 4 * own.standard_uncertainty < 0.2 * value
