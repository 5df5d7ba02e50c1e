"""A car that rolls out: no torque acts all the time, and the resistance that the model lacks is found all the same."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, FRICTION = 76.0, 1.2


def rolling(drag, time, first):
    """Speed (t,) from J·s' = −T − c·s², in closed form; c = 0: a straight line."""
    if drag == 0:
        return first - FRICTION / J * time
    root = np.sqrt(FRICTION / drag)
    return root * np.tan(np.arctan(first / root) - np.sqrt(FRICTION * drag) / J * time)


@pytest.mark.parametrize(
    ("drag", "rate", "measures"), [(0.039344, 2.0, "speed"), (0.1, 5.0, "speed"), (0.0, 2.0, "angle")]
)
def test_the_friction_of_a_roll_out(drag, rate, measures):
    time = np.arange(round(200 * rate)) / rate
    speed = rolling(drag, time, 7.5)
    seen, noise = speed, 0.01
    if measures == "angle":
        seen = 7.5 * time - FRICTION / J * time**2 / 2
    data = {
        "inertias": {"car": {"J": J}},
        "inputs": {"torque": {"on": "car"}},
        "sensors": {"seen": {"measures": measures, "of": "car", "uncertainty": noise}},
    }
    if drag:
        data["effects"] = [{"kind": "quadratic_drag", "at": "inertias.car", "coefficient": drag}]
    rng = np.random.default_rng(4)
    channels = {"torque": np.zeros_like(time), "seen": seen + noise * rng.normal(size=len(time))}
    found = diagnose(from_dict(data), [Recording(time, channels, source="roll.csv")])
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.kind in (
        "coulomb_friction",
        "constant_torque",
    )  # which of them a roll-out in one direction leaves open
    value = cause.parameters["torque"]
    assert abs(value.value - FRICTION) < 4 * value.standard_uncertainty
    assert value.standard_uncertainty < 0.02
