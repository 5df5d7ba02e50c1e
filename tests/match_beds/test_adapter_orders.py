"""Orders of adapters: what counts as better, both ends of what is no worse, and that curves contradict no order."""

from dataclasses import replace

import numpy as np
import pytest
from independent.dynamic_stiffness import Judge as Independent
from match_beds.other_beds import front_axle, write_models

from matching.match.case_file import load_case
from matching.match.loop import control_law, linear_bed
from matching.match.match import match
from matching.match.order import ORDER, Delivered, _end_of_no_worse, lead

BEDS = 40  # that judge, drawn here


def delivered(errors, keeps_all=True):
    return Delivered(None, np.asarray(errors, float), keeps_all)


@pytest.mark.parametrize("here", [0.2, 0.5, 0.63])
@pytest.mark.parametrize("curvature", [0.3, 3.0, 30.0])
def test_the_ends_lie_where_the_error_is_two_per_cent_larger(here, curvature):
    """Error e·(1 + c·d²) on every bed: worse by more than 2 % of itself from d = √((1/0.98 − 1)/c) on."""
    beds = np.random.default_rng(1).uniform(0.1, 0.2, 50)

    def tried(place, near):
        return delivered(beds * (1 + curvature * (place - here) ** 2))

    apart = np.sqrt((1 / (1 - ORDER.gain) - 1) / curvature)
    for bound in (0.0, 1.0):
        end = _end_of_no_worse(tried, tried(here, None), here, bound, 1.0, ORDER.most_tries)
        true = np.clip(here + np.sign(bound - here) * apart, 0.0, 1.0)
        assert abs(end - here) <= abs(true - here) + 1e-9
        assert abs(end - true) <= max(1.5 * ORDER.resolution, 0.1 * abs(bound - here))


def test_an_order_needs_two_per_cent_more_than_the_scatter_and_every_bed():
    random = np.random.default_rng(2)
    plan = random.uniform(0.1, 0.2, 200)
    assert lead(delivered(0.97 * plan), delivered(plan)) > 1 > lead(delivered(0.985 * plan), delivered(plan))
    scattered = plan * (0.97 + 0.5 * random.standard_normal(200))  # 3 % better, ± 3.5 % of the mean over 200 beds
    assert lead(delivered(scattered), delivered(plan)) < 1
    lost = np.where(np.arange(200) < 1, np.inf, 0.5 * plan)
    assert lead(delivered(lost), delivered(plan)) == -np.inf
    assert lead(delivered(plan), delivered(lost)) < 0  # one bed more of 200 is an accident of the draw
    assert lead(delivered(plan), delivered(plan, keeps_all=False)) == np.inf


@pytest.mark.long
@pytest.mark.parametrize("seed", [5, 83])
def test_no_curve_contradicts_an_order_and_beds_drawn_here_agree(seed, tmp_path):
    """A drawn axle with stiff half shafts, both flanges free: the order gains, by beds of the tests, what it says."""
    vehicle, rig, case = front_axle(half=(6e4, 12.0))
    case["limits"]["damping_share"] = 0.1
    case["move"] = {f"rig.shafts.flange_{side}.stiffness": {"lower": 5e4, "upper": 8e5} for side in "lr"}
    result = match(load_case(write_models(vehicle, rig, case, tmp_path, np.random.default_rng([seed, 50]))))
    assert result.status == "matched"
    for trade in result.adapters:
        least = min(error for _, error in trade.curve)
        assert trade.reason
        if trade.changes:
            assert trade.error_as_ordered < 0.981 * trade.error_as_planned
        assert trade.error_as_ordered < least / (1 - ORDER.gain) + 1e-9 or "scatter" in trade.reason
        low, high = trade.acceptable
        assert low <= trade.ordered <= high
        for value, error in trade.curve:
            if not low <= value <= high:
                assert error > trade.error_as_ordered
    plain = replace(result.case, moves=())
    ordered, planned = (errors_on_drawn_beds(one.tuned, seed) for one in (result, match(plain, ordering=False)))
    if any(trade.changes for trade in result.adapters):
        assert ordered.mean() < (1 - ORDER.gain / 2) * planned.mean()
    else:
        assert ordered.mean() < (1 + ORDER.gain) * planned.mean()


def errors_on_drawn_beds(case, seed):
    """Both errors over their scales as one, of beds drawn here about the case's values."""
    judge = Independent(case, control_law(linear_bed(case)))
    positions = np.random.default_rng(seed).uniform(-1, 1, (BEDS, len(case.uncertainty.uncertain)))
    found = [judge.verdict(case.uncertainty.at(position)) for position in positions]
    assert all(one.stable for one in found)
    return np.array([np.hypot(one.measured / 0.1, one.unmeasured / 0.3) / np.sqrt(2) for one in found])
