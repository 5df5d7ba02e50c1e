"""A motor at each wheel: on the bed both sides stand apart, in the car one body joins them."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from reference.beds import twins

from matching.match.case_file import load_case
from matching.match.damping import is_stable_loop
from matching.match.demands import demands
from matching.match.loop import bed_set, controller_on, frequency_response, linear_bed, responses
from matching.match.loop_modes import ClosedLoop
from matching.match.responses import error_figures
from matching.report.drivetrain import layout
from modelling.errors import InputError
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.modal.modes import modes
from modelling.model_file import from_dict

RATIO = 9.0
GAINS = {"proportional_gain": 20.0, "integral_gain": 20.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Twin drives with a feed-forward."""
    path = twins(tmp_path_factory.mktemp("motors"))
    path.write_text(path.read_text().replace('"observer"', '"model_based"'))
    return path.parent


@pytest.fixture(scope="module")
def case(folder):
    read = load_case(folder / "case.toml")
    return replace(read, loop=read.loop.with_values(GAINS))


@pytest.fixture
def rig(folder):
    """Tables of the rig."""
    return tomllib.loads((folder / "rig.toml").read_text())


def test_two_chains_have_the_modes_of_one_twice(case, rig):
    left = {
        table: {name: entry for name, entry in entries.items() if name.endswith("left")}
        for table, entries in rig.items()
    }
    one = [mode.frequency for mode in modes(from_dict(left))]
    np.testing.assert_allclose([mode.frequency for mode in modes(case.rig)], np.repeat(one, 2), atol=1e-6)


def test_both_motors_hold_the_speed(case):
    body = 50 / 3.6 / 0.3
    assert speeds_of(case.vehicle)["body"] == pytest.approx(body)
    left, right = (torques_of(case.vehicle)[f"torque_{side}"] for side in ("left", "right"))
    assert left == pytest.approx(right)
    wheel = body + 0.4 * body / 1500
    assert left == pytest.approx(0.4 * body / RATIO + 0.002 * RATIO * wheel)


def test_one_motor_moves_the_other_side_through_the_emulated_body(case):
    """On the bed alone no torque crosses over; matched, both sides answer as in the car."""
    parts = linear_bed(case)
    alone = parts.rig.response(2j * np.pi * np.array([2.0]))[0]
    outputs, inputs = parts.rig.space.outputs, parts.rig.space.inputs
    assert abs(alone[outputs.index("speed_right"), inputs.index("torque_left")]) < 1e-12
    controller = controller_on(parts)
    assert is_stable_loop(ClosedLoop.of(parts, controller).poles, 0)
    figures = error_figures(case, parts)
    assert figures.after < 0.05
    beds = bed_set(case, [{}], np.array([2.0]))
    answers = responses(beds, frequency_response(controller, beds.frequencies), case.loop.measured)[0, 0]
    crossed = [pair.input == "torque_left" and pair.sensor == "speed_right" for pair in case.compared].index(True)
    assert abs(answers[crossed]) > 1e-3
    left, right = (part.cuts[0] for part in demands(case).behind)
    assert left.speed.max() > right.speed.max() > right.speed[0] * 1.01


def test_what_nothing_drives_is_still_missing_a_shaft(rig):
    del rig["inputs"]["torque_right"], rig["inputs"]["dyno_right"]
    with pytest.raises(InputError, match="motor_right, adapter_right, rotor_right are not connected to 'motor_left'"):
        from_dict(rig)


def test_parts_that_stand_apart_are_drawn_one_below_the_other(case):
    placed = layout(case.rig)
    assert {name: placed.lane[name] for name in ("motor_left", "rotor_left", "motor_right", "rotor_right")} == {
        "motor_left": 0, "rotor_left": 0, "motor_right": 1, "rotor_right": 1,
    }  # fmt: skip
    assert placed.column["rotor_left"] == placed.column["rotor_right"] == 2
    assert [joint.name for joint in placed.joints] == ["side_left", "flange_left", "side_right", "flange_right"]
