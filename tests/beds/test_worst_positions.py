"""The least damped beds of the box, as the search comes to see them."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import closed_matrices, damping, sampled_beds
from matching.match.tune_observer import (
    DAMPING_RESERVE,
    STABLE_SHARE,
    TuningEffort,
    TuningEnd,
    add_scenarios,
    worst_positions,
)

NOWHERE_HZ = 1e6  # a loop that need not roll off: every mode needs all of the damping that is asked for here


def test_the_room_of_a_plane_is_least_in_its_corner():
    slopes = np.array([0.3, -0.2, 0.01])
    pool = np.array([[0.1, 0.2, 0.3], [-0.4, 0.9, 0.2], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(worst_positions(lambda at: 1 + at @ slopes, pool), [[-1, 1, -1]])


@pytest.fixture
def begun(small_search, small_case):
    """The search on the small bed, and where it begins."""
    search = replace(small_search, known={})
    start = np.log10([small_case.loop.values[name] for name in search.gains.names])
    search.guard(start)
    return search, start


def test_the_search_sees_the_worst_beds_where_they_miss_what_they_need(begun):
    search, start = begun
    effort = TuningEffort(pool=6)
    assert not add_scenarios(
        search, TuningEnd(start, search.judged(start)), effort
    )  # every bed of the box is stable with a reserve
    poles = np.linalg.eigvals(closed_matrices(search.sampled_pool, search.gains.controller(start)))
    least = damping(poles, search.model.sample_time)[1].min()
    # a reserve as large as the least damped bed of the pool has
    needed = least / (STABLE_SHARE * (1 + DAMPING_RESERVE))
    search.required = replace(search.required, damping_ratio=needed, rolled_off_from=NOWHERE_HZ)
    assert add_scenarios(search, TuningEnd(start, replace(search.judged(start), least=-np.ones(4))), effort)
    added = search.positions[6:]
    assert len(added)
    values = [search.case.uncertainty.at(position) for position in added]
    z = np.linalg.eigvals(closed_matrices(sampled_beds(search.case, values), search.gains.controller(start)))
    ratios = damping(z, search.model.sample_time)[1]
    assert ratios.max() < least
    assert set(range(6, 6 + len(added))) <= set(search.guarded)
    room = search.judged(start).least[: len(search.guarded)]
    of_added = room[np.array(search.guarded) >= 6]
    np.testing.assert_allclose(np.sort(of_added), np.sort(STABLE_SHARE * (ratios / least - 1)), rtol=1e-6)
    _, slopes = search.slopes(start)
    assert np.isfinite(slopes).all()


def test_no_bed_is_looked_at_outside_the_box():
    """Also where a descent begins on the box's edge, or passes a corner."""
    looked = []

    def room(at):
        looked.append(at)
        return 1 + (at - 0.3) @ np.array([0.3, -0.2, 0.01])

    worst_positions(room, np.array([[1.0, -1.0, 1.0], [0.5, 1.0, -1.0], [1.0, 1.0, 1.0]]))
    assert np.abs(np.concatenate(looked)).max() <= 1
