"""The loss of a rigid gear is found in a recording that shares no code with the models: stepped here, signs and all."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

RATIO, MOTOR, LOAD, DRAG, EFFICIENCY = 12.0, 3e-4, 0.05, 4e-4, 0.8
STEP, INNER, SAMPLES = 2e-3, 20, 1200


def servo(torque):
    """Speed of the load (t,) at a motor torque (t,): what the gear passes on is less by its loss, either way."""
    speed, out = 0.0, []
    for first, last in zip(torque, [*torque[1:], torque[-1]], strict=True):
        out.append(speed)
        for k in range(INNER):  # the torque of a recording is linear between its samples
            now = first + (last - first) * (k + 0.5) / INNER
            way, given = np.sign(speed), now - DRAG * RATIO * speed
            passes = 1.0
            for _ in range(2):  # the share depends on the side that drives, which follows from the torque
                acceleration = passes * RATIO * given / (LOAD + passes * RATIO**2 * MOTOR)
                passed = RATIO * (given - MOTOR * RATIO * acceleration)
                passes = EFFICIENCY if passed * way >= 0 else 1 / EFFICIENCY
            speed += STEP / INNER * acceleration
    return np.array(out)


@pytest.fixture(scope="module")
def diagnosis():
    rng, time = np.random.default_rng(4), STEP * np.arange(SAMPLES)
    torque = 0.5 * np.sin(2 * np.pi * time) + 0.3 * np.sin(2 * np.pi * 2.7 * time + 1)
    speed = servo(torque)
    noise = 0.002
    system = from_dict({
        "inertias": {
            "motor": {"J": {"value": 1.1 * MOTOR, "tolerance": 0.3}, "drag": {"value": DRAG, "tolerance": 0.5}},
            "load": {"J": LOAD},
        },
        "gears": {"reduction": {"between": ["motor", "load"], "ratio": RATIO}},
        "inputs": {"motor_torque": {"on": "motor"}},
        "sensors": {"load_speed": {"measures": "speed", "of": "load", "uncertainty": noise}},
    })  # fmt: skip
    reading = speed + noise * rng.standard_normal(SAMPLES)
    return diagnose(system, [Recording(time, {"motor_torque": torque, "load_speed": reading})])


@pytest.mark.long
def test_the_loss_is_named_with_its_efficiency(diagnosis):
    cause = diagnosis.causes[0]
    assert (cause.kind, cause.at) == ("gear_loss", "gears.reduction")
    assert cause.parameters["efficiency"].value == pytest.approx(EFFICIENCY, abs=0.01)


@pytest.mark.long
def test_nothing_else_is_named_for_certain(diagnosis):
    assert not [cause for cause in diagnosis.causes[1:] if cause.confidence > 0.8]
