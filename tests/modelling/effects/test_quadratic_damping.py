"""The law of quadratic damping, and a recording made by SciPy in which diagnosis finds it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from matching.diagnosis.diagnosis import diagnose
from modelling.measurement.recording import Recording
from modelling.model.files import from_dict
from modelling.simulation.simulate import simulate

COEFFICIENT = 0.4
NOISE = {"motor_speed": 0.02, "load_speed": 0.02, "link_torque": 0.1}
MODEL = {
    "inertias": {"motor": {"J": 0.1, "drag": {"value": 0.02, "tolerance": 0.5}}, "load": {"J": 1.2, "drag": 0.2}},
    "shafts": {"link": {
        "between": ["motor", "load"], "stiffness": {"value": 310, "tolerance": 0.1},
        "damping": {"value": 0.4, "tolerance": 0.6},
    }},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {
        "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": NOISE["motor_speed"]},
        "load_speed": {"measures": "speed", "of": "load", "uncertainty": NOISE["load_speed"]},
        "link_torque": {"measures": "torque", "of": "link", "uncertainty": NOISE["link_torque"]},
    },
}  # fmt: skip
TIME = np.arange(0, 8, 0.002)
TORQUE = 12 * np.sin(2 * np.pi * (0.5 * TIME + 0.6 * TIME**2)) + 8 * (TIME % 2 < 1)


def truth(noise: bool) -> dict[str, np.ndarray]:
    """Readings of a drive with stiffness 300 N·m/rad and damping 0.5 N·m·s/rad."""

    def torque(x):
        twist, rate = x[0] - x[1], x[2] - x[3]
        return 300 * twist + 0.5 * rate + COEFFICIENT * rate * abs(rate)

    def motion(t, x):
        pull = torque(x)
        return [x[2], x[3], (np.interp(t, TIME, TORQUE) - 0.02 * x[2] - pull) / 0.1, (pull - 0.2 * x[3]) / 1.2]

    x = solve_ivp(motion, (0, TIME[-1]), np.zeros(4), t_eval=TIME, rtol=1e-8, atol=1e-9, max_step=0.004).y
    readings = {"motor_speed": x[2], "load_speed": x[3], "link_torque": torque(x)}
    rng = np.random.default_rng(2)
    return {name: own + noise * NOISE[name] * rng.standard_normal(len(TIME)) for name, own in readings.items()}


@pytest.mark.parametrize("native", [True, False])
def test_it_moves_as_its_law_says(native: bool) -> None:
    effect = {"kind": "quadratic_damping", "at": "shafts.link", "coefficient": COEFFICIENT}
    values = {"inertias.motor.drag": 0.02, "shafts.link.stiffness": 300.0, "shafts.link.damping": 0.5}
    system = from_dict(MODEL | {"effects": [effect]}).with_values(values)
    got = simulate(system, TIME, {"motor_torque": TORQUE}, compile=native)
    for name, expected in truth(noise=False).items():
        np.testing.assert_allclose(got[name], expected, atol=2e-4 * np.ptp(expected))


def test_diagnosis_names_it_with_its_value() -> None:
    recording = Recording(TIME, {"motor_torque": TORQUE, **truth(noise=True)}, (), "made")
    found = diagnose(from_dict(MODEL), [recording])
    assert found.verdict == "explained"
    assert [(cause.kind, cause.at) for cause in found.causes] == [("quadratic_damping", "shafts.link")]
    own = found.causes[0].parameters["coefficient"]
    assert own.unit == "N*m*s^2/rad^2"
    assert abs(own.value - COEFFICIENT) < 4 * own.standard_uncertainty < 0.1 * COEFFICIENT
    for errors in found.errors.values():
        assert errors.after_holdout < 1.1 * errors.noise < 0.7 * errors.before_holdout
