"""What is said of drawn beds: damping, the worst bed, the largest error. The loop itself: tests/independent."""

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import Judge, check_beds, largest_error, worst_bed
from matching.match.box import Box, Uncertain
from matching.match.loop import bed_of, closed_poles, sampled_beds, without_limits
from matching.match.requirements import requirements
from modelling.bed.observer import design, observer_model


@pytest.fixture(scope="module")
def controller(small_case):
    model = observer_model(small_case.rig, small_case.residual_vehicle, small_case.loop)
    return without_limits(design(model, small_case.loop.values))


def judged(case, controller, values, damping_ratio=0.0, rolled_off_from=100.0):
    """Verdict on one bed."""
    required = replace(
        requirements(case), damping_ratio=damping_ratio, rolled_off_from=rolled_off_from, vehicle_modes=()
    )
    found = Judge(case, controller, 0, required).verdicts([values])
    return {name: part[0] for name, part in vars(found).items()}


def checked(case, controller, damping_ratio, count, seed):
    required = replace(requirements(case), damping_ratio=damping_ratio, vehicle_modes=())
    return check_beds(case, controller, 0, required, count, seed)


def test_a_mode_of_the_beds_own_beyond_the_roll_off_needs_no_more_damping_than_it_has(small_case, controller):
    """A flange with a hundredth of its damping: 0.014 at 240 Hz of its own, 0.057 here, where 0.07 is asked for.

    Below the roll-off as well: control does not move that mode.
    """
    worn = {"rig.shafts.flange.damping": 0.1}
    verdicts = [judged(small_case, controller, worn, 0.07, rolled_off_from) for rolled_off_from in (100.0, 300.0)]
    assert [verdict["damped"] for verdict in verdicts] == [True, True]
    assert bed_of(small_case, worn).open_loop_damping < 0.02 < verdicts[0]["damping_ratio"] < 0.06
    assert not judged(small_case, controller, worn, 0.09)["damped"]  # slower modes need all of it
    assert bed_of(small_case, {}).open_loop_damping > 0.08


def test_the_search_asks_no_more_of_such_a_mode_either(small_case, small_search):
    search, beds = small_search.members[0], sampled_beds(small_case, [{"rig.shafts.flange.damping": 0.1}, {}])
    poles = closed_poles(beds, search.controller(search.begin()))
    search.required = replace(search.required, damping_ratio=0.06)
    eased, planned_bed = search.damping_margins(poles, beds)
    asked, same = search.damping_margins(
        poles, replace(beds, own_modes=beds.own_modes[:, :0], open_loop_damping=np.ones(2))
    )
    assert asked < 0 < eased
    assert planned_bed == pytest.approx(same)


def test_a_bed_whose_dynamometer_pushes_the_wrong_way_is_found_unstable(small_case, controller):
    assert judged(small_case, controller, {})["stable"]
    assert not judged(small_case, controller, {"dynamometers.dyno.torque_gain": -1.0})["stable"]


def test_every_drawn_bed_counts(small_case, controller):
    found = checked(small_case, controller, 1e-4, 12, 5)
    assert (found.drawn, found.stable, found.damped) == (12, 12, 12)
    assert found.holds
    strict = checked(small_case, controller, found.smallest_damping_ratio * 1.0001, 12, 5)
    assert (strict.damped, strict.holds) == (11, False)
    assert found.to_dict()["unmeasured_95"] == pytest.approx(np.quantile(found.unmeasured, 0.95))


class Plane:
    """A judge whose damping falls evenly: its least value stands in a corner that can be told beforehand."""

    def __init__(self, slopes):
        self.slopes = slopes

    def dampings(self, positions):
        return 0.1 - positions @ np.array([[slope] for slope in self.slopes.values()])


def test_the_worst_bed_of_a_plane_is_its_corner():
    slopes = {"a": 0.02, "b": -0.05, "c": 0.001}
    box = Box(tuple(Uncertain(name, 2.0, 1.0) for name in slopes))
    found = worst_bed(Plane(slopes).dampings, box, box.draw(3, 0))
    assert found.values == pytest.approx({"a": 3.0, "b": 1.0, "c": 3.0})
    assert found.damping_ratio == pytest.approx(0.1 - 0.02 - 0.05 - 0.001)
    assert found.named == ("b", "a", "c")
    assert worst_bed(Plane(slopes).dampings, Box(), np.zeros((3, 0))) is None


@pytest.mark.parametrize("rounding", [1e-15, -1e-15])
def test_a_mode_that_no_bed_moves_hides_no_worst_bed(rounding):
    """A mode with 0.02 in every bed but for rounding; another one is damped by 0.001 in one corner."""
    box = Box((Uncertain("a", 2.0, 1.0), Uncertain("b", 2.0, 1.0)))

    def dampings(positions):
        moved = 0.03 + positions @ [0.02, -0.009]
        return np.sort(np.stack([0.02 + rounding * positions[:, 0], moved], axis=1), axis=1)

    found = worst_bed(dampings, box, box.draw(3, 0))
    assert found.values == pytest.approx({"a": 1.0, "b": 3.0})
    assert found.damping_ratio == pytest.approx(0.001)
    assert found.named == ("a", "b")


def test_the_largest_error_is_climbed_to_and_stops_short_of_beds_that_are_not_stable():
    """Error a + 2·b; beds with a over 2.4 are not stable: of the points on the way to the corner the last below it."""
    box = Box((Uncertain("a", 2.0, 1.0), Uncertain("b", 2.0, 1.0)))
    free = largest_error(lambda positions: 6.0 + positions @ [1, 2], box, np.array([-0.5, 0.2]))
    assert free.unmeasured == pytest.approx(9.0)
    assert free.named == ("b", "a")
    bounded = largest_error(
        lambda positions: np.where(positions[:, 0] <= 0.4, 6.0 + positions @ [1, 2], np.inf),
        box,
        np.array([-0.5, 0.2]),
    )
    assert bounded.values["a"] <= 2.4
    assert 1.5 + 2 * 2.2 < bounded.unmeasured < 9.0


def test_the_worst_bed_is_worse_than_those_drawn_and_is_what_it_says(small_case, controller):
    found = checked(small_case, controller, 1e-4, 6, 5)
    assert found.worst.damping_ratio < found.smallest_damping_ratio
    worst = judged(small_case, controller, found.worst.values)
    assert worst["damping_ratio"] == pytest.approx(found.worst.damping_ratio)
    assert found.largest_error.unmeasured > found.unmeasured[-1]
    verdict = judged(small_case, controller, found.largest_error.values)
    assert verdict["stable"]
    assert verdict["unmeasured"] == pytest.approx(found.largest_error.unmeasured)
    box = {one.name: one for one in small_case.uncertainty.uncertain}
    for name, value in (*found.worst.values.items(), *found.largest_error.values.items()):
        assert abs(value - box[name].value) <= box[name].half_width * (1 + 1e-9)
