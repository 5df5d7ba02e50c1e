"""Channels of one logger whose clock is far off: found as one, also where a fit from short delays ends elsewhere."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from plant.explicit import scene_of, write_recording
from plant.hidden import Hidden
from plant.marks import needs_compiler

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.problem import base_problem
from modelling.effects.sensors_and_actuators import LATE_SIGN
from modelling.model_file import dumps, from_dict, load
from modelling.recordings.read import read_recording

LATE = 0.465  # s, more than half of the slowest mode's period
SPEEDS = ("motor_speed", "load_speed")


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize(
    ("sensors", "kind"), [((), "sensor_delay"), (SPEEDS, "clock_offset")], ids=["beside a torque", "all there is"]
)
def test_both_speeds_of_a_late_logger_are_one_cause(sensors: tuple[str, ...], kind: str, tmp_path: Path) -> None:
    """Late beside a torque in time: a delay they share; late as all sensors beside two inputs: their clock."""
    both = "+".join(f"sensors.{name}" for name in SPEEDS)
    scene = scene_of("two_mass", 3, 8.0, 250.0)
    write_recording(tmp_path, scene, [Hidden("clock_offset", both, {"offset": LATE})], sensors)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert [(cause.kind, cause.at) for cause in found.causes] == [(kind, both)]
    (parameter,) = found.causes[0].parameters.values()
    assert parameter.value == pytest.approx(LATE, abs=1e-4)
    assert found.verdict == "explained"


@pytest.mark.long
@needs_compiler
def test_an_input_and_a_sensor_of_a_late_logger_are_one_cause(tmp_path: Path) -> None:
    """Each channel shows the delay in another way: the torque reads late, the brake acts before it is recorded.

    What acted in the last 0.465 s is not recorded, which leaves more than noise there.
    """
    both = "inputs.brake_torque+sensors.link_torque"
    write_recording(tmp_path, scene_of("two_mass", 4, 8.0, 250.0), [Hidden("clock_offset", both, {"offset": LATE})])
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("clock_offset", both)]
    assert found.causes[0].to_dict()["at"] == both.split("+")
    (parameter,) = found.causes[0].parameters.values()
    assert parameter.value == pytest.approx(LATE, abs=1e-4)
    assert found.verdict == "unexplained"
    assert from_dict(tomllib.loads(dumps(found.extended))).effects == found.extended.effects


@needs_compiler
@pytest.mark.long
def test_an_input_that_hardly_acts_is_no_channel_of_a_late_logger(tmp_path: Path) -> None:
    """One speed is 22 ms late beside a torque over the load's speed that no kind describes.

    What is late then is also the brake beside it, for all that can be seen; naming it would invent a fault.
    """
    scene = scene_of("two_mass", 8, 8.0, 250.0)
    reach, torque = 2 * scene.scale.speed["load"], 0.3 * scene.scale.drive_torque["load"]
    share = np.exp(-(((np.linspace(0, 1, 17) - 0.64618) / 0.1) ** 2))
    values = {f"speed_{i}": float(x) for i, x in enumerate(np.linspace(-reach, reach, 17), 1)}
    values |= {f"torque_{i}": float(torque * y) for i, y in enumerate(share, 1)}
    late = Hidden("sensor_delay", "sensors.motor_speed", {"delay": 0.022})
    write_recording(tmp_path, scene, [Hidden("table", "inertias.load", values), late], SPEEDS)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert found.verdict == "unexplained"
    (delay,) = [cause for cause in found.causes if cause.kind in LATE_SIGN]
    assert (delay.kind, delay.at) == ("sensor_delay", "sensors.motor_speed")
    assert delay.parameters["delay"].value == pytest.approx(0.022, abs=5e-4)


MODEL = {
    "inertias": {"rotor": {"J": 0.2, "drag": 0.5}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.01}},
}


@pytest.mark.parametrize(
    ("kind", "guess", "end", "reason"),
    [
        ("lag", {"time_constant": 0.05}, 1.0, "at_bound"),  # 20 times the guess
        ("lag", {"time_constant": 0.05}, 0.9, ""),
        ("sensor_delay", {"delay": 0.05}, 0.0, ""),  # physics lets no delay be less
    ],
)
def test_a_value_where_the_fit_was_not_let_go_on_is_no_cause(kind: str, guess: dict, end: float, reason: str) -> None:
    system = from_dict(MODEL)
    model = ExtendedModel(system, (), {}, {}).with_cause(kind, "sensors.speed", guess, 1e-3)
    time = np.arange(50) * 1e-3
    data = FitData((Segment(time, np.zeros((50, 1)), np.zeros((50, 1)), "made"),), np.array([0.01]))
    problem, v = base_problem(model.system(), data)
    problem.bounds.update(model.bounds)
    problem.__post_init__()
    v = np.concatenate([[end], v])
    fit = Fit(problem, v, np.zeros(50), np.zeros((50, len(v))), 0.0)
    assert model.not_taken(fit) == reason
