"""What the controller tracked, read from recordings of its outputs: words, lines, the last recording counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.bed.tracked import outputs_of, tracked_quantities
from matching.match.case_file import load_case
from modelling.recordings.recording import Recording

EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away" / "case.toml"


@pytest.fixture(scope="module")
def case():
    return load_case(EXAMPLE)


def recording(case, last, without=()):
    """Of a second, at whose end the outputs have these values; others are as planned."""
    time, channels = np.linspace(0, 1, 11), {}
    for name in outputs_of(case):
        planned = 1.0 if name.endswith("tracked_gain") else 0.0
        channels[name] = np.linspace(planned, last.get(name, planned), 11)
        channels[name][-1] = last.get(name, planned)
    return Recording(time, {name: values for name, values in channels.items() if name not in without}, source="a.csv")


def test_each_drift_has_its_words_and_its_line(case):
    last = {
        "left.tracked_gain": 0.951, "left.tracked_gain_uncertainty": 0.001, "left.drifted": 3.0,
        "left.tracked_zero": -9.8, "left.tracked_zero_uncertainty": 0.05,
        "right.tracked_delay": 1.02e-3, "right.tracked_delay_uncertainty": 1e-4, "right.drifted": 4.0,
    }  # fmt: skip
    found = tracked_quantities(case, [recording(case, {}), recording(case, last)])
    assert len(found) == 6
    advice = [one.advice for one in found if one.drifted]
    assert advice == [
        "dynamometer left gives 0.9510 ± 0.0020 times what it is asked for: identify it anew, or write "
        "[dynamometers.left] torque_gain = 0.951",
        "flange_left_torque has a zero of -9.80 ± 0.10 N·m, friction of the rotor included: identify it anew",
        "dynamometer right answers 1.02 ± 0.20 ms later than stated: identify it anew, or write "
        "[dynamometers.right] dead_time = 0.00402",
    ]


def test_a_gain_that_was_calibrated_before_is_written_as_a_whole(case):
    """The line holds the gain of the command as sent, the words the one that is more than calibrated."""
    left, right = case.loop.dynamometers
    calibrated = replace(case, loop=replace(case.loop, dynamometers=(replace(left, torque_gain=1.1), right)))
    last = {"left.tracked_gain": 0.95, "left.tracked_gain_uncertainty": 0.001, "left.drifted": 1.0}
    found = tracked_quantities(calibrated, [recording(case, last)])
    assert found[0].line == "[dynamometers.left] torque_gain = 1.045"
    assert "gives 0.9500" in found[0].words


def test_what_no_recording_holds_is_not_told(case):
    assert not tracked_quantities(case, [recording(case, {}, without=outputs_of(case))])
    kept = tracked_quantities(case, [recording(case, {}, without=("left.drifted",))])
    assert {one.dynamometer for one in kept} == {"right"}
    assert not tracked_quantities(case, [recording(case, dict.fromkeys(outputs_of(case), np.nan))])
