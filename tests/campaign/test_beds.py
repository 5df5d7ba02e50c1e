"""The campaign of beds: what is drawn, and how it is scored."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from matching.match.case_file import load_case
from tests.campaign.beds import truth_case
from tests.campaign.beds_score import line, summary
from tests.campaign.drawn_bed import HELD, draw_bed, write_case


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("model"))


def test_a_bed_is_off_by_up_to_a_tenth_and_drawn_alike_again(path):
    drawn, again = (draw_bed(1, 5, path.parent) for _ in range(2))
    nominal = load_case(path).rig.parameters
    off = [value / nominal[name].value - 1 for name, value in drawn.bed.drive.values.items()
           if name.endswith((".J", ".stiffness"))]  # fmt: skip
    assert 0.02 < np.abs(off).max() <= 0.1
    assert abs(drawn.gain - 1) <= 0.1
    assert len(drawn.hidden) == 2
    assert drawn.bed.drive.values == again.bed.drive.values
    assert [vars(one) for one in drawn.hidden] == [vars(one) for one in again.hidden]


def test_an_effect_less_leaves_the_rest(path):
    drawn = draw_bed(1, 5, path.parent)  # a sensor that is late, another with a gain
    left = drawn.without(drawn.hidden[0])
    changed = [name for name in left.readers if vars(left.readers[name]) != vars(drawn.bed.readers[name])]
    assert changed == [drawn.hidden[0].at.split(".")[1]]


def test_the_truth_has_the_bed_s_values_in_rig_vehicle_and_loop(path):
    drawn = draw_bed(1, 5, path.parent)
    case = truth_case(load_case(path), drawn)
    true = drawn.bed.drive.values["inertias.motor.J"]
    assert case.rig.parameters["inertias.motor.J"].value == case.vehicle.parameters["inertias.motor.J"].value == true
    assert case.loop["dead_time"] == pytest.approx(drawn.bed.actuators["dyno"].delay + HELD)
    assert case.loop.dynamometers[0].torque_gain == drawn.gain


def test_the_score_counts_the_best_controller():
    def row(number, errors, true, best, named):
        hidden = {"kind": "backlash", "size": 0.1, "change": 0.2, "matters": True, "named": named}
        rounds = [{"error": error, "standard_uncertainty": 0.005} for error in errors]
        return {"number": number, "rounds": rounds, "true": {"error": true},
                "best_round": best, "hidden": [hidden], "limits_used": 0.5, "processor_time": 60.0,
                "status": "short"}  # fmt: skip

    rows = [row(0, [0.09, 0.01], 0.008, 2, True), row(1, [0.06, 0.07], 0.01, 1, False),
            row(2, [0.30, 0.02], 0.02, 2, True), {"number": 3, "failed": "gave up"}]  # fmt: skip
    found = summary(rows)
    assert found["factor"] == pytest.approx(0.09 / 0.02)
    assert found["factor_at_least"] == pytest.approx(0.09 / 0.03)
    hidden_by_noise = summary([row(0, [0.09, 0.0], 0.0, 2, True)])
    assert (hidden_by_noise["factor"], hidden_by_noise["last_over_true"]) == (None, None)
    assert hidden_by_noise["factor_at_least"] == pytest.approx(0.09 / 0.01)
    assert found["near_truth"] == pytest.approx(2 / 3)
    assert (found["worse_than_before"], found["named"], found["failed"]) == ([], [2, 3], ["gave up"])
    assert line(rows[0]).startswith("0.0900 → 0.0100, true values 0.0080: backlash")
