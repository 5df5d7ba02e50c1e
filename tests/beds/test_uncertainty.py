"""The box of what is not known exactly."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from matching.frequency.case.uncertainty import read_uncertainty
from matching.frequency.studies.tolerance import tolerance
from modelling.common.errors import InputError


def widths(case, table):
    box = read_uncertainty({"uncertainty": table}, case.vehicle, case.rig, case.loop, "case.toml")
    return {one.name: one.half_width for one in box.uncertain}


def test_a_case_that_says_nothing_has_the_default_box(small_case):
    found = widths(small_case, {})
    assert found["rig.inertias.rotor.J"] == pytest.approx(0.05 * 0.9)
    assert found["rig.shafts.side.damping"] == pytest.approx(0.3 * 2)
    assert found["loop.dead_time"] == 5e-4
    assert found["dynamometers.dyno.torque_gain"] == 0.03
    assert found["sensors.flange_torque.gain"] == 0.005
    assert "sensors.rotor_speed.gain" not in found


def test_what_stands_later_counts_and_zero_is_known_exactly(small_case):
    table = {"rig.shafts.*.stiffness": 0.1, "rig.shafts.side.stiffness": 0.0, "loop.dead_time": "1 ms"}
    found = widths(small_case, table | {"loop.torque_gain": 0, "sensors.*.gain": 0.01})
    assert found["rig.shafts.flange.stiffness"] == pytest.approx(1e4)
    assert "rig.shafts.side.stiffness" not in found
    assert found["loop.dead_time"] == pytest.approx(1e-3)
    assert not any(name.endswith("torque_gain") for name in found)
    assert found["sensors.motor_speed.gain"] == 0.01


@pytest.mark.parametrize(
    ("table", "key"), [({"rig.shafts.sied.stiffness": 0.1}, "sied"), ({"loop.inverter_lag": 1.5}, "inverter_lag")]
)
def test_what_cannot_be_is_named(small_case, table, key):
    with pytest.raises(InputError, match=key):
        widths(small_case, table)


def test_draws_fill_the_box_and_come_again_with_their_seed(small_case):
    box = small_case.uncertainty
    drawn = box.draw(500, 3)
    assert np.array_equal(drawn, box.draw(500, 3))
    assert np.abs(drawn).max() <= 1
    assert np.abs(drawn.mean(axis=0)).max() < 0.1
    values = box.at(np.ones(len(box.uncertain)))
    assert values["rig.inertias.rotor.J"] == pytest.approx(0.945)
    assert not any(name.startswith("sensors") for name in (one.name for one in box.without("sensors").uncertain))


def test_the_tolerance_study_refuses_an_observer_in_one_line(small_case):
    with ThreadPoolExecutor(1) as executor, pytest.raises(InputError, match="does not cover 'observer'"):
        tolerance(small_case, 10, executor)


def test_beds_of_the_search_fill_the_box_evenly_whatever_the_seed(small_case):
    box = small_case.uncertainty
    spread = box.spread(64)
    assert np.all(np.abs(spread) <= 1)
    np.testing.assert_array_equal(spread[:20], box.spread(64)[:20])
    # of 64 points of a Sobol sequence, each coordinate has exactly 16 in every quarter
    quarters = np.stack([np.histogram(column, bins=4, range=(-1, 1))[0] for column in spread.T])
    assert np.all(quarters == 16)
