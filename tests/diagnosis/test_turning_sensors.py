"""An error of a sensor that turns with its shaft is named with sensor and order; a torque of that order is not.

The motion is exact (matrix exponential of the linear drive, torque straight between samples); the error is put on the
readings afterwards, so nothing of the product makes the data.
"""

import numpy as np
import pytest
from scipy.linalg import expm

from matching.diagnosis.diagnose import diagnose
from matching.report.diagnosis import corrections
from modelling.effects.turning_sensors import correction
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

STEP = 2e-3  # s
NOISE = {"motor_speed": 0.02, "load_speed": 0.02, "load_angle": 2e-4, "link_torque": 0.05}


def exact(A: np.ndarray, B: np.ndarray, u: np.ndarray) -> np.ndarray:
    """States (t, x) of ẋ = A·x + B·u from rest, u (t,) straight between samples."""
    n = len(A)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[n, n + 1] = A, B, 1.0
    over = expm(block * STEP)
    out = np.zeros((len(u), n))
    for i in range(len(u) - 1):
        out[i + 1] = (over @ np.r_[out[i], u[i], (u[i + 1] - u[i]) / STEP])[:n]
    return out


def drawn(seed: int, order: float, amplitude: float, what: str, seconds: float = 8.0) -> tuple[dict, Recording, float]:
    """A drive whose ``what`` ("load_speed", "load_angle" or "torque" of the motor) has an error of an order; its model
    file, the recording, and the phase of the error."""
    rng = np.random.default_rng(seed)
    J1, J2, c, d1, d2 = (
        rng.uniform(0.05, 0.2),
        rng.uniform(0.5, 1.5),
        rng.uniform(0.3, 0.8),
        0.02,
        rng.uniform(0.1, 0.3),
    )
    k = rng.uniform(200, 500)
    # states: motor speed, load speed, motor angle, load angle
    A = np.array([[-(c + d1) / J1, c / J1, -k / J1, k / J1], [c / J2, -(c + d2) / J2, k / J2, -k / J2],
                  [1, 0, 0, 0], [0, 1, 0, 0]])  # fmt: skip
    t = np.arange(0, seconds, STEP)
    waves = zip(rng.uniform(0.2, 7.0, 8), rng.uniform(0, 6.3, 8), strict=True)
    torque = 4 + sum(1.5 * np.sin(2 * np.pi * f * t + phase) for f, phase in waves)
    acting, phase = torque, rng.uniform(-3, 3)
    B = np.array([1 / J1, 0, 0, 0])
    x = exact(A, B, acting)
    if what == "torque":  # a fixed point: the ripple over the angle that it makes
        for _ in range(12):
            acting = torque + amplitude * np.sin(order * x[:, 2] + phase)
            x = exact(A, B, acting)
    begin = rng.uniform(-3, 3)  # where the encoder begins
    w1, w2, a1, a2 = x.T
    a2 = a2 + begin * (what == "load_angle")
    clean = {"motor_speed": w1, "link_torque": k * (a1 - x[:, 3]) + c * (w1 - w2), "load_speed": w2}
    if what == "load_angle":
        clean["load_angle"] = a2 + amplitude * np.sin(order * a2 + phase)
        del clean["load_speed"]
    if what == "load_speed":
        clean["load_speed"] = w2 * (1 + amplitude * order * np.cos(order * a2 + phase))
    channels = {name: values + NOISE[name] * rng.standard_normal(len(t)) for name, values in clean.items()}

    def known(value: float) -> dict:
        return {"value": value * rng.uniform(0.9, 1.1), "tolerance": 0.3}

    of = {"motor_speed": ("speed", "motor"), "load_speed": ("speed", "load"), "load_angle": ("angle", "load"),
          "link_torque": ("torque", "link")}  # fmt: skip
    model = {
        "inertias": {"motor": {"J": J1, "drag": d1}, "load": {"J": known(J2), "drag": known(d2)}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": known(k), "damping": known(c)}},
        "inputs": {"drive": {"on": "motor"}},
        "sensors": {
            name: {"measures": of[name][0], "of": of[name][1], "uncertainty": NOISE[name]} for name in channels
        },
    }
    return model, Recording(t, channels | {"drive": torque}, (), "made", {}), phase


CASES = [
    pytest.param(5, "load_speed", 1, 4e-3, id="off its centre"),
    pytest.param(6, "load_angle", 2, 2e-3, id="resolver", marks=pytest.mark.long),
    pytest.param(7, "load_angle", 1, 3e-3, id="encoder off its centre", marks=pytest.mark.long),
    pytest.param(8, "load_speed", 17, 3e-4, id="teeth", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("seed", "what", "order", "amplitude"), CASES)
def test_the_sensor_is_named_with_its_order(seed: int, what: str, order: int, amplitude: float) -> None:
    model, recording, phase = drawn(seed, order, amplitude, what)
    found = diagnose(from_dict(model), [recording])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("sensor_ripple", f"sensors.{what}")]
    cause = found.causes[0]
    assert found.verdict == "explained"
    assert cause.confidence > 0.5
    table = np.loadtxt(corrections(found)[f"correction_{what}.csv"].splitlines(), delimiter=",", skiprows=1)
    angle = np.radians(table[:, 0])
    if what == "load_angle":
        wanted, size = np.degrees(amplitude * np.sin(order * angle + phase)), np.degrees(amplitude)
    else:
        wanted, size = 1 + amplitude * order * np.cos(order * angle + phase), amplitude * order
    np.testing.assert_allclose(table[:, 1], wanted, atol=0.3 * size)
    truth = {"order": order, "amplitude": amplitude, "phase": phase}
    for key, value in truth.items():
        own = cause.parameters[key]
        off = own.value - value
        off = np.angle(np.exp(1j * off)) if key == "phase" else off
        assert abs(off) < 4 * own.standard_uncertainty, key
        assert own.standard_uncertainty < (0.3 if key == "phase" else 0.1 * value), key


@pytest.mark.long
@pytest.mark.parametrize("seed", [11, 12])
def test_a_torque_of_that_order_is_no_error_of_a_sensor(seed: int) -> None:
    model, recording, _ = drawn(seed, 3, 1.0, "torque")
    found = diagnose(from_dict(model), [recording])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("torque_ripple", "inertias.motor")]


def test_the_table_is_the_error_over_a_turn() -> None:
    table = correction({"order": 2.0004, "amplitude": 0.01, "phase": 0.4, "amplitude_2": 0.002, "phase_2": -1.0})
    angle = table[:, 0]
    error = 0.01 * np.sin(2 * angle + 0.4) + 0.002 * np.sin(4 * angle - 1.0)
    np.testing.assert_allclose(table[:, 1], error, atol=1e-12)
    slope = np.gradient(np.r_[table[-1, 1], table[:, 1], table[0, 1]], angle[1])[1:-1]
    np.testing.assert_allclose(table[:, 2], slope, atol=1e-4)
    assert angle[0] == 0
    assert angle[-1] < 2 * np.pi
