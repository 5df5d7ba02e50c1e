"""A diagnosis of a drivetrain that shifts: the gear is told by its number or by the clutches, the motion is our own."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulation.own_gearbox import drawn

import rigmatch as rm
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.gears import in_one_gear, stretches
from modelling.recordings.recording import Recording

SECONDS, STEP, SHIFT = 12.0, 2e-3, 0.25


def _drive(seed: int, wheel_inertia: float = 1.0, step: float = 2e-4):
    """A model, and a recording by rigid friction in which a gearbox shifts up, down and up again under a ringing pull.

    The recorded car has another wheel inertia than the model, by a factor; ``step`` (s) of the integrator.
    """
    rng = np.random.default_rng(seed)
    shift = drawn(rng, 0.01)
    J = shift.own.inertias
    own = replace(shift.own, inertias=(*J[:3], J[3] * wheel_inertia))
    time = np.arange(0, SECONDS, STEP)
    gear = np.where((time > 4) & (time < 6) | (time > 7.5), 2, 1)
    high = np.interp(time, [3.9, 4.2, 5.9, 6.2, 7.4, 7.7], [0, 1, 1, 0, 0, 1])
    pull = 40 + 50 * np.sign(np.sin(2 * np.pi * np.cumsum(rng.uniform(0.2, 2.2, len(time))) * STEP))
    pull = np.convolve(pull, np.ones(30) / 30, mode="same")
    torques = np.column_stack([pull, 800 * (1 - high), 800 * high])
    read = own.simulate(time, torques, step)
    noise = {"motor_speed": 0.3, "wheel_speed": 0.05, "side_torque": 3.0}  # far above the error of the integrator
    channels = {name: read[name] + rng.normal(0, sigma, len(time)) for name, sigma in noise.items()}
    channels |= dict(zip(("motor_torque", "clutch_1", "clutch_2"), torques.T, strict=True))
    text = shift.toml
    for name, sigma in noise.items():
        text = text.replace(f"[sensors.{name}]", f"[sensors.{name}]\nuncertainty = {sigma}")
    return from_dict(tomllib.loads(text)), Recording(time, channels, source="drive"), gear, own


def _by_number(recording: Recording, gear: np.ndarray) -> Recording:
    channels = {name: values for name, values in recording.channels.items() if not name.startswith("clutch")}
    return replace(recording, channels=channels | {"box": gear.astype(float)})


def _written(recording: Recording, file: Path) -> Path:
    rows = np.column_stack([recording.time, *recording.channels.values()])
    np.savetxt(file, rows, "%.9g", ",", header=",".join(["time", *recording.channels]), comments="")
    return file


def test_the_rows_of_the_gear_that_was_driven_most_are_used():
    model, recording, gear, own = _drive(31)
    for told in (recording, _by_number(recording, gear)):
        held, (rows,), () = in_one_gear(model, [told], [])
        assert held["gears.box"].ratio.value == own.ratios[1]
        apart = rows["motor_speed"] - own.ratios[1] * rows["wheel_speed"]
        assert abs(np.median(apart)) < 1.0  # rad/s: nothing slips, twist and noise are left
        assert (np.interp(rows.time, recording.time, gear) == 2).all()
        assert 4.0 < len(rows.time) * STEP < 5.5
        assert not {"box", "clutch_1", "clutch_2"} & {*rows.channels}
        assert "gear 2 of gearboxes.box" in rows.notes[-1]


def test_stretches_in_a_gear_end_at_shifts_and_at_gaps():
    model, recording, gear, _ = _drive(31)
    kept = np.abs(recording.time - 2.0) > 0.2  # in gear 1
    channels = {name: values[kept] for name, values in _by_number(recording, gear).channels.items()}
    parts = stretches(model, [replace(recording, time=recording.time[kept], channels=channels)])
    assert [gears["box"] for gears, _ in parts] == [1, 1, 2], (
        "gear 2 from 4.5 s and gear 1 from 6.5 s last less than a second"
    )
    ends = [(rows.time[0], rows.time[-1]) for _, rows in parts]
    np.testing.assert_allclose(ends, [(0, 1.8), (2.2, 3.5), (8.0, 12.0)], atol=0.01)
    assert all("box" not in rows.channels for _, rows in parts)


def test_a_recording_that_is_never_in_the_gear_is_refused():
    model, recording, gear, _ = _drive(32)
    with pytest.raises(InputError, match=r"drive: is never in gear 2 of gearboxes\.box for longer than 1 s"):
        in_one_gear(model, [recording], [_by_number(recording, np.ones(len(gear)))])


def test_nothing_tells_the_gear():
    model, recording, gear, _ = _drive(33)
    untold = _by_number(recording, gear)
    channels = {name: values for name, values in untold.channels.items() if name != "box"}
    with pytest.raises(InputError, match=r"drive: does not say which gear gearboxes\.box is in; .*'box'"):
        rm.diagnose(model, replace(untold, channels=channels))


@pytest.mark.long
@pytest.mark.parametrize("way", ["number", "clutches"])
def test_a_recording_with_shifts_is_read_and_diagnosed(tmp_path, way):
    """A model that is right is found right, and one whose wheel is half as heavy again is not."""
    for seed, heavier in ((41, 1.0), (42, 1.5)):
        model, recording, gear, _ = _drive(seed, heavier, 2e-5)
        told = _by_number(recording, gear) if way == "number" else recording
        found = rm.diagnose(model, _written(told, tmp_path / f"{seed}.csv"))
        assert any("gear 2 of gearboxes.box" in note for note in found.notes)
        if heavier == 1:
            assert found.verdict == "adequate"
        else:
            assert found.verdict != "adequate"
            assert any(cause.at.startswith("inertias.wheel") for cause in found.causes)
        (other,) = [note for note in found.notes if note.startswith("gear 1 of gearboxes.box was not fitted")]
        left = re.search(r"motor_speed ([\d.]+) rad/s(?: \(([\d.]+) before\))?", other)
        assert float(left[1]) < 1.2 * 0.3, "the noise"
        assert (left[2] is None) == (heavier == 1)
        assert heavier == 1 or float(left[2]) > 20


def test_a_number_is_no_torque_for_a_simulation(tmp_path):
    """The number is read from a file, without the clutches; that a column is missing is said with what would do."""
    model, recording, gear, _ = _drive(34)
    file = _written(_by_number(recording, gear), tmp_path / "drive.csv")
    read = rm.read_recording(file, model)
    assert (read["box"] == gear).all()
    assert not any("box" in note for note in read.notes)
    with pytest.raises(InputError, match=r"drive\.csv: input 'clutch_1' was not recorded; .* does not tell"):
        rm.simulate(model, file)
    file.write_text(file.read_text(encoding="utf-8").replace("box", "gear", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"input 'clutch_1' was not recorded; .*a channel 'box' with the number"):
        rm.diagnose(model, file)
