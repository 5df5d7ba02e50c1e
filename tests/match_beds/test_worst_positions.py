"""The least damped beds of the box, as the search comes to see them."""

from dataclasses import replace

import numpy as np

from matching.match.rounds import end_at
from matching.match.worst import add_scenarios, worst_positions

WEIGHTS = {
    "torque_drift": 21.0, "dynamometer_drift": 3.4, "dynamometer_swing": 14.0, "dynamometer_noise": 0.04,
    "shaft_noise": 0.33, "command_weight": 3.6e-12, "command_change_weight": 1.2e-7, "torque_sensor_noise": 1.4,
    "rotor_speed_noise": 0.59, "further_sensor_noise": 0.075,
}  # fmt: skip
NOWHERE_HZ = 1e6  # a loop that need not roll off: every mode needs all of the damping that is asked for here


def test_the_room_of_a_plane_is_least_in_its_corner():
    slopes = np.array([0.3, -0.2, 0.01])
    pool = np.array([[0.1, 0.2, 0.3], [-0.4, 0.9, 0.2], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(worst_positions(lambda at: 1 + at @ slopes, pool), [[-1, 1, -1]])


def test_the_search_sees_the_worst_beds_where_they_miss_what_they_need(small_search):
    search, one = small_search, small_search.members[0]
    start = end_at(search, search.begin({f"loop.{name}": value for name, value in WEIGHTS.items()}))
    assert not add_scenarios(search, start)  # every bed of the box is stable with a reserve
    count = len(one.positions)
    room = one.damping_margins_at(start.x, one.positions)
    # a reserve as large as the least damped bed of the pool has
    needed = (1 + room.min()) * one.required.damping_ratio / search.settings.stable_share
    one.required = replace(one.required, damping_ratio=needed, rolled_off_from=NOWHERE_HZ)
    search.forget()
    assert add_scenarios(search, end_at(search, start.x))
    added = one.positions[count:]
    assert len(added)
    assert set(range(count, len(one.positions))) <= set(one.active)
    assert (one.damping_margins_at(start.x, added) < search.settings.stable_share - 1).all()
    _, slopes = search.slopes(start.x)
    assert np.isfinite(slopes).all()


def test_no_bed_is_looked_at_outside_the_box():
    """Also where a descent begins on the box's edge, or passes a corner."""
    looked = []

    def room(at):
        looked.append(at)
        return 1 + (at - 0.3) @ np.array([0.3, -0.2, 0.01])

    worst_positions(room, np.array([[1.0, -1.0, 1.0], [0.5, 1.0, -1.0], [1.0, 1.0, 1.0]]))
    assert np.abs(np.concatenate(looked)).max() <= 1
