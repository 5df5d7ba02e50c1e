"""The box of what is not known exactly."""

import numpy as np
import pytest

from matching.match.box import Box, Uncertain, read_uncertainty, uncertainty_table
from matching.match.case import apply
from modelling.errors import InputError


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


@pytest.mark.parametrize("inertia", [0.7, 0.0947, 1 / 3])
def test_shares_are_written_as_a_person_would(small_case, inertia):
    """Whatever the value that they are of: 0.05, not 0.05000000000000001."""
    case = apply(small_case, {"rig.inertias.rotor.J": inertia})
    table = uncertainty_table(case.uncertainty, case.vehicle, case.rig, case.loop)
    assert {name: share for name, share in table.items() if name.endswith(".J")} == dict.fromkeys(
        [name for name in table if name.endswith(".J")], 0.05
    )
    assert "rig.inertias.rotor.J" in table


@pytest.mark.parametrize(
    ("table", "key"), [({"rig.shafts.sied.stiffness": 0.1}, "sied"), ({"loop.inverter_lag": 1.5}, "inverter_lag")]
)
def test_what_cannot_be_is_named(small_case, table, key):
    with pytest.raises(InputError, match=key):
        widths(small_case, table)


def test_beds_are_drawn_about_what_was_tuned(small_case):
    """An adapter that is ordered three times as heavy is not judged as it was planned."""
    ordered = 3 * small_case.rig.parameters["inertias.adapter.J"].value
    tuned = apply(small_case, {"rig.inertias.adapter.J": ordered, "loop.dead_time": 0.005})
    before, now = (
        {quantity.name: quantity for quantity in box.uncertain} for box in (small_case.uncertainty, tuned.uncertainty)
    )
    changed = {name for name in now if now[name] != before[name]}
    assert changed == {"rig.inertias.adapter.J", "loop.dead_time"}
    assert now["rig.inertias.adapter.J"].value == ordered
    assert now["rig.inertias.adapter.J"].half_width == pytest.approx(0.05 * ordered)
    assert (now["loop.dead_time"].value, now["loop.dead_time"].half_width) == (0.005, 5e-4)
    beds = [tuned.uncertainty.at(position) for position in tuned.uncertainty.draw(20, 1)]
    assert all(0.95 * ordered <= bed["rig.inertias.adapter.J"] <= 1.05 * ordered for bed in beds)


def test_draws_fill_the_box_and_come_again_with_their_seed(small_case):
    box = small_case.uncertainty
    drawn = box.draw(500, 3)
    assert np.array_equal(drawn, box.draw(500, 3))
    assert np.abs(drawn).max() <= 1
    assert np.abs(drawn.mean(axis=0)).max() < 0.1
    values = box.at(np.ones(len(box.uncertain)))
    assert values["rig.inertias.rotor.J"] == pytest.approx(0.945)
    assert not any(name.startswith("sensors") for name in (one.name for one in box.without("sensors").uncertain))


def test_beds_of_the_search_fill_the_box_evenly_whatever_the_seed(small_case):
    box = small_case.uncertainty
    spread = box.spread(64)
    assert np.all(np.abs(spread) <= 1)
    np.testing.assert_array_equal(spread[:20], box.spread(64)[:20])
    # of 64 points of a Sobol sequence, each coordinate has exactly 16 in every quarter
    quarters = np.stack([np.histogram(column, bins=4, range=(-1, 1))[0] for column in spread.T])
    assert np.all(quarters == 16)


def test_a_quantity_keeps_its_sign_over_its_box():
    """A ratio may be negative; a dead time that may be off by more than itself stays at 0."""
    box = Box((Uncertain("rig.gears.reverse.ratio", -3.0, 0.15), Uncertain("loop.dead_time", 2e-4, 5e-4)))
    assert box.at(np.zeros(2)) == {"rig.gears.reverse.ratio": -3.0, "loop.dead_time": 2e-4}
    assert box.at(np.array([1.0, -1.0])) == pytest.approx({"rig.gears.reverse.ratio": -2.85, "loop.dead_time": 0.0})
    assert box.at(np.array([-1.0, 1.0]))["rig.gears.reverse.ratio"] == pytest.approx(-3.15)
