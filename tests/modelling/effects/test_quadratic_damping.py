"""The law of quadratic damping, and a recording made by SciPy in which diagnosis finds it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from matching.diagnosis.diagnose import diagnose
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
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


def slipping(*more: dict) -> dict:
    """The drive with a damper of 6 N·m·s/rad in series, quadratic damping and further effects at the link."""
    effects = [
        {"kind": "quadratic_damping", "at": "shafts.link", "coefficient": COEFFICIENT},
        {"kind": "slip", "at": "shafts.link", "coefficient": 6.0},
        *more,
    ]
    return MODEL | {"effects": effects}


def test_beside_slip_the_spring_takes_its_root_of_the_torque_balance() -> None:
    """6·(twist rate − r) = 310·spring + 0.4·r + 0.4·r·|r| is solved for r by bisection, step by step."""
    time = TIME[:1001]

    def rate(x: np.ndarray) -> float:
        def balance(r: float) -> float:
            return 310 * x[2] + 0.4 * r + COEFFICIENT * r * abs(r) - 6 * (x[0] - x[1] - r)

        return brentq(balance, -1e3, 1e3, xtol=1e-12)

    def motion(t: float, x: np.ndarray) -> list[float]:
        pull = 6 * (x[0] - x[1] - rate(x))
        return [(np.interp(t, TIME, TORQUE) - 0.02 * x[0] - pull) / 0.1, (pull - 0.2 * x[1]) / 1.2, rate(x)]

    x = solve_ivp(motion, (0, time[-1]), np.zeros(3), t_eval=time, rtol=1e-7, atol=1e-8, max_step=0.004).y
    torque = [6 * (row[0] - row[1] - rate(row)) for row in x.T]
    got = simulate(from_dict(slipping()), time, {"motor_torque": TORQUE[:1001]})
    for name, expected in (("motor_speed", x[0]), ("load_speed", x[1]), ("link_torque", np.array(torque))):
        np.testing.assert_allclose(got[name], expected, atol=3e-4 * np.ptp(expected))


def test_beside_slip_and_lash_it_is_refused_in_one_line() -> None:
    lash = {"kind": "backlash", "at": "shafts.link", "gap": 0.01}
    with pytest.raises(InputError, match=r"shafts\.link: has free play, a damper in series and quadratic damping"):
        simulate(from_dict(slipping(lash)), TIME, {"motor_torque": TORQUE})


@pytest.mark.long
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
