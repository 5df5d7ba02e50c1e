"""Real drives: dry friction of the public EMPS recording; filter and offset of a two-mass bench."""

from dataclasses import replace
from pathlib import Path

import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import load
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording

DATA = Path(__file__).parents[2].parent / "shared" / "data"
EMPS, BENCH = DATA / "emps", DATA / "two_mass_bench"
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not BENCH.exists(), reason="the shared recordings of real drives are not here"),
]


def test_real_drive_has_dry_friction_first_and_something_left_over() -> None:
    system = load(EMPS / "model.toml")
    found = diagnose(system, [read_recording(EMPS / "recording.csv", system)])
    first = found.causes[0]
    assert (first.kind, first.at) == ("coulomb_friction", "inertias.carriage")
    forward, reverse = (first.parameters[key] for key in ("torque", "torque_reverse"))
    for own in (forward, reverse):
        assert 0 < own.standard_uncertainty < 0.1 * own.value
    errors = found.errors["position"]
    assert errors.after_holdout < 0.1 * errors.before_holdout
    assert found.verdict == "unexplained"
    assert found.rest


def reduced(recording: Recording) -> Recording:
    """Every second sample of the first two seconds."""
    few = slice(0, 5000, 2)
    return replace(
        recording, time=recording.time[few], channels={name: v[few] for name, v in recording.channels.items()}
    )


@pytest.mark.parametrize("angle_uncertainty", [6e-6, 2e-3])
def test_filter_of_both_speeds_is_one_cause_and_the_offset_the_other(angle_uncertainty: float) -> None:
    """Encoders against speeds give 7.8 ms; the current has a mean that moves nothing; the zeros are no fault."""
    system = load(BENCH / "model.toml")
    sensors = tuple(
        replace(sensor, uncertainty=angle_uncertainty) if sensor.measures == "angle" else sensor
        for sensor in system.sensors
    )
    system = replace(system, sensors=sensors)
    fitted, unseen = (reduced(read_recording(BENCH / f"recording_{name}.csv", system)) for name in "ab")
    found = diagnose(system, [fitted], unseen)
    causes = {cause.kind: cause for cause in found.causes if cause.in_model}
    assert set(causes) == {"lag", "constant_torque"}
    assert all(cause.confidence < 0.5 for cause in found.causes if not cause.in_model)
    assert causes["lag"].to_dict()["at"] == ["sensors.motor_speed", "sensors.load_speed"]
    constant = causes["lag"].parameters["time_constant"]
    assert constant.standard_uncertainty < 0.7e-3
    assert constant.value == pytest.approx(7.8e-3, abs=2 * constant.standard_uncertainty)
    assert causes["constant_torque"].parameters["torque"].value == pytest.approx(0.033, abs=0.003)
    assert found.gain.nrmse_after < 0.2 * found.gain.nrmse_before
    for name in ("motor_speed", "load_speed"):
        assert found.errors[name].after_holdout < 0.2 * found.errors[name].before_holdout
