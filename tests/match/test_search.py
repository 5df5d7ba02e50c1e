"""The one search: its first derivatives against differences, what it moves, and that it answers nothing worse."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from matching.match.beds import Judge
from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.loop import controller_on, linear_bed
from matching.match.loop_modes import neutral_motions
from matching.match.objective import Search, SpeedSearch, search_for
from matching.match.opened import SHARES, Opened
from matching.match.order import Delivered, Fresh, contributions, is_better
from matching.match.problem import problem_of
from matching.match.requirements import requirements
from matching.match.responses import error_figures
from matching.match.rounds import end_at
from matching.match.search import Found, solve
from matching.match.targets import target_modes
from matching.match.variables import SearchSettings
from modelling.bed.controllers import STRUCTURES
from modelling.errors import NoDesign
from modelling.linear.resolvent import resolvent

ROAD = Path(__file__).parents[2] / "examples" / "road_to_rig"
GENTLE = {
    "proportional_gain": 60.0, "integral_gain": 60.0, "torque_feed_forward": 0.2, "acceleration_feed_forward": 0.3,
}  # fmt: skip
FEW = SearchSettings(drawn=2, pool=4, rounds=1, steps=2, joint_rounds=1, restarts=0, emulated=0.0, scenarios=0, blind=0)
SWINGS_OPENED = {  # weights that were tuned without opened shafts
    "torque_drift": 21.0, "dynamometer_drift": 3.4, "dynamometer_swing": 14.0, "dynamometer_noise": 0.04,
    "shaft_noise": 0.33, "command_weight": 3.6e-12, "command_change_weight": 1.2e-7,
    "torque_sensor_noise": 1.4, "rotor_speed_noise": 0.59, "further_sensor_noise": 0.075,
}  # fmt: skip
HALF_STEP = 2e-4  # the observer's poles near a target stand close together: curvature is large


def case_in(structure: str):
    """The reference with everything under [move] of case.toml, for every structure."""
    feedback = load_case(ROAD / "case.toml")
    if structure == "observer":
        case = load_case(ROAD / "observer.toml")
        return replace(case, loop=case.loop.with_values(SWINGS_OPENED), moves=feedback.moves)
    return replace(feedback, loop=replace(feedback.loop.with_values(GENTLE), structure=STRUCTURES[structure]))


def search_in(structure: str) -> Search:
    problem = problem_of(case_in(structure))
    return search_for(problem.case, problem.moves, problem.shares, problem.demands, FEW)


def begun(search: Search | SpeedSearch) -> np.ndarray:
    low, high = search.bounds()
    own = {one.name: search.case.loop[one.name[5:]] for one in search.variables if one.name.startswith("loop.")}
    return np.clip(search.begin(own), low + 0.01, high - 0.01)


def test_a_resolvent_is_the_inverse_even_where_a_matrix_has_no_eigenvectors():
    register = np.eye(5, k=-1)
    register[:2, :2] = [[0.9, 0.2], [-0.2, 0.9]]
    z, B = np.exp(1j * np.array([0.1, 1.0, 3.0])), np.arange(10.0).reshape(5, 2)
    inverse = np.linalg.inv(z[:, None, None] * np.eye(5) - register)
    np.testing.assert_allclose(resolvent(register).columns(z, B), inverse @ B, rtol=1e-12)
    np.testing.assert_allclose(resolvent(register).rows(z, B.T), B.T @ inverse, rtol=1e-12)


@pytest.mark.parametrize("structure", ["pi", "model_based", "observer"])
def test_first_derivatives_of_cost_and_requirements(structure):
    """By controller, residual vehicle and adapters: what is worked backwards against differences of the figures."""
    search = search_in(structure).members[0]
    x = begun(search)
    search.activate(x)
    cost, room = search.slopes(x)
    kinds = {one.name.split(".")[0] for one in search.variables}
    assert kinds == {"loop", "residual_vehicle", "rig"}
    steering = search.judged(x).margins < search.settings.largest_room
    inside = steering & (search.judged(x).margins > -50)  # what is missed by more is cut off
    for i, step in enumerate(HALF_STEP * np.eye(len(x))):
        there, back = (search.evaluated_at(side, search.point(side)) for side in (x + step, x - step))
        wanted = (there.cost - back.cost) / (2 * HALF_STEP)
        assert cost[i] == pytest.approx(wanted, rel=2e-3, abs=1e-4 * np.abs(cost).max()), search.names[i]
        rooms = (there.margins - back.margins)[inside] / (2 * HALF_STEP)
        np.testing.assert_allclose(
            room[inside, i], rooms, rtol=5e-3, atol=2e-3 * np.abs(rooms).max() + 1e-6, err_msg=search.names[i]
        )


@cache
def solved(structure: str) -> tuple[Search, Found]:
    search = search_in(structure)
    return search, solve(search)


@pytest.mark.parametrize("structure", ["model_based", "observer"])
def test_the_answer_is_not_worse_than_what_was_given(structure):
    search, found = solved(structure)
    given = end_at(search, search.begin())
    assert found.end.penalised_cost <= search.judged(given.x).penalised_cost * (1 + 1e-9)


def test_the_answer_is_the_same_whenever_it_is_asked():
    assert solve(search_in("model_based")).values == solved("model_based")[1].values


def test_the_search_sees_the_damping_that_the_judge_sees_with_opened_shafts_too():
    search = search_in("observer").members[0]
    x = begun(search)
    case = apply(search.case, search.values(x))
    bed = linear_bed(case)
    judge = Judge(case, controller_on(bed), neutral_motions(bed), search.required)
    openings = [Opened(share) for share in SHARES]
    ratios = judge.opened([way.values(case, {}) for way in openings])
    for way, ratio in zip(openings, ratios, strict=True):
        room = search.damping_margins_at(x, np.zeros((1, search.positions.shape[1])), [way])[0]
        assert (room > -1) == (ratio > 0)
    assert 0 < sum(ratio > 0 for ratio in ratios) < len(SHARES)


def test_a_search_that_sees_opened_beds_sees_them_until_they_are_left_out():
    search = search_in("observer").members[0]
    x = end_at(search, begun(search)).x
    seen = [number for number in search.active if number in search.opened]
    before = search.judged(x)
    assert seen
    search.leave_out_opened()
    assert not search.opened
    assert len(search.judged(x).least_margins) == len(before.least_margins) - len(seen)


def test_a_stated_requirement_is_what_the_search_keeps():
    """Requirements are keys of [limits]: a key that is stated changes what the search has to keep."""
    search = search_in("observer").members[0]
    x = begun(search)
    at, required = search.point(x), search.required
    least = min(mode.damping_ratio for _, mode in target_modes(search.case))
    assert required.damping_ratio == pytest.approx(least / 3)
    assert (required.rolled_off, required.rolled_off_from, required.command_noise) == (0.5, 100.0, (20.0, 20.0))
    stated = {"damping_share": 1 / 6, "rolled_off": 0.25, "command_noise": 10.0}
    other = requirements(replace(search.case, limits={**search.case.limits, **stated}))
    assert other.damping_ratio == pytest.approx(least / 6)
    rooms = search.requirement_margins(x, at)
    search.required = other
    halved = search.requirement_margins(x, at)
    for part in (3, 5):  # noise, roll-off: 1 − figure/allowed
        np.testing.assert_allclose(1 - halved[part], 2 * (1 - rooms[part]), rtol=1e-12)


@pytest.mark.long
def test_a_fixed_observer_stays_and_the_rest_is_tuned_with_it():
    case = case_in("observer")
    moves = tuple(move for move in case.moves if not move.name.startswith("loop."))
    case = replace(case, moves=moves, loop=replace(case.loop, fixed=True))
    problem = problem_of(case)
    search = search_for(case, problem.moves, problem.shares, problem.demands, FEW)
    assert {name.split(".")[0] for name in search.names} == {"residual_vehicle", "rig"}
    found = solve(search)
    assert apply(case, found.values).loop.values == case.loop.values
    assert found.end.penalised_cost < end_at(search, search.begin()).penalised_cost


def test_contributions_are_the_errors_of_what_has_moved():
    (search, found), fresh = solved("observer"), Fresh(4, 0)
    rows = contributions(search, found, fresh, {"all": fresh.delivered(search, found.end)})
    assert [one.moved for one in rows] == ["nothing", "controller alone", "all"]
    for one, x in zip(rows, (search.begin(), found.controller_alone.x, found.end.x), strict=True):
        figures = error_figures(apply(search.case, search.values(x)))
        assert (one.measured, one.unmeasured) == pytest.approx((figures.after, figures.unmeasured), rel=0.02)
        assert one.drawn == 4
    alone, planned = search.values(found.controller_alone.x), search.values(search.begin())
    assert all(alone[name] == planned[name] for name in alone if not name.startswith("loop."))


def delivered(errors, keeps=True) -> Delivered:
    return Delivered(None, np.array(errors), keeps)


def test_better_is_what_gains_more_than_its_scatter():
    random = np.random.default_rng(3)
    planned = 1 + 0.2 * random.random(400)
    noisy = planned * (1 + 0.5 * random.normal(size=400))
    assert is_better(delivered(0.9 * planned), delivered(planned))
    assert not is_better(delivered(0.99 * planned), delivered(planned))  # under 2 %
    assert not is_better(delivered(noisy * 0.97 / noisy.mean() * planned.mean()), delivered(planned))
    assert not is_better(delivered(0.5 * planned, keeps=False), delivered(planned))
    unstable = np.where(np.arange(400) == 7, np.inf, 0.5 * planned)
    assert not is_better(delivered(unstable), delivered(planned))
    assert not is_better(delivered(planned), delivered(unstable))  # one bed of 400 alone is an accident of the draw
    many = np.where(np.arange(400) < 40, np.inf, planned)
    assert is_better(delivered(planned), delivered(many))


def test_a_difference_that_has_no_controller_leaves_the_other_slopes():
    """A rig quantity whose larger value has no controller is differenced downwards; the others stay as they are."""
    whole, search = (search_in("observer").members[0] for _ in range(2))
    x = begun(whole)
    cost, rows = whole.slopes(x)
    i = next(number for number, one in enumerate(search.variables) if one.name.startswith("rig."))
    controller = search.controller

    def only_below(at: np.ndarray):
        if at[i] > x[i]:
            raise NoDesign("there is none here")
        return controller(at)

    search.controller = only_below
    partly, rest = search.slopes(x)
    others = np.arange(len(x)) != i
    np.testing.assert_array_equal(partly[others], cost[others])
    np.testing.assert_array_equal(rest[:, others], rows[:, others])
    assert partly[i] == pytest.approx(cost[i], rel=0.05, abs=1e-3 * np.abs(cost).max())
    assert search.failures == {"there is none here": 1}


def test_a_fault_of_the_program_is_no_missing_controller():
    search = search_in("observer").members[0]

    def wrong(at: np.ndarray):
        raise ValueError("a shape that does not fit")

    search.controller = wrong
    with pytest.raises(ValueError, match="a shape"):
        search.judged(begun(search))
