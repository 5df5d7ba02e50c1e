"""What the simulation shows is a target's mode only where the loop has no other mode there."""

from dataclasses import replace

import numpy as np
from match import drawn

from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.loop_modes import LoopMode
from matching.match.verify import IdentifiedMode, modes_of_targets, verify
from modelling.modal.ringing import Ringing

# 13 ms of dead time: the loop loses the mode at 8.4 Hz, and its wheel hop moves the sensors much as that mode does
TUNED = {
    "loop.proportional_gain": 28.84, "loop.integral_gain": 1.0, "loop.torque_feed_forward": 0.4082,
    "rig.inertias.adapter.J": 0.15, "residual_vehicle.inertias.body.J": 96.32,
}  # fmt: skip


def loop_mode(number, frequency, damping_ratio):
    omega = 2 * np.pi * frequency
    value = complex(-damping_ratio * omega, omega * np.sqrt(1 - damping_ratio**2))
    return LoopMode(number, frequency, damping_ratio, "feedback", "none", {}, {}, value)


def shown(frequency, damping_ratio=0.06):
    read = Ringing(frequency, damping_ratio, 0.0, 1.0, 0.5)
    return IdentifiedMode(2, replace(read, frequency=8.4), read, "manoeuvre")


def test_another_mode_of_the_loop_is_not_the_targets():
    modes = (loop_mode(1, 8.4, 0.06), loop_mode(2, 25.6, 0.06))
    at = {frequency: modes_of_targets([shown(frequency)], [modes[0]], modes)[0] for frequency in (8.4, 25.5, 12.0)}
    assert at[8.4].matched is not None
    assert at[25.5].matched is None
    assert at[25.5].vehicle is not None
    assert at[12.0].matched is not None, "no mode of the loop: simulation and loop disagree, which has to be seen"
    assert modes_of_targets([shown(8.4)], [None], modes)[0].matched is None


def test_a_target_that_the_loop_lacks_is_not_read_off_its_wheel_hop(tmp_path):
    case = load_case(drawn.draw(210, tmp_path))
    checked = verify(apply(case, TUNED), case.rig, deviations=False)
    assert checked.targets[0].mode is None
    assert checked.identified[0].vehicle is not None
    assert checked.identified[0].matched is None
