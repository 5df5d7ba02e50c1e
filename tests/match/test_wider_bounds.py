"""A bound of the case that stands in the way is named, with a value beyond it that was solved."""

import re
from dataclasses import replace

import pytest
from small_bed import CASE, FEEDBACK_GAINS, write

from matching.match.case_file import load_case
from matching.match.match import match


def loaded(folder, written, narrow, more=""):
    text = CASE.replace('measures = ["motor_speed"]\n', "").replace('"observer"', '"pi"') + FEEDBACK_GAINS + more
    return load_case(write(folder, text.replace(f"{written} }}", f"{narrow} }}")))


@pytest.mark.parametrize(
    ("name", "written", "narrow", "largest"),
    [
        ("proportional_gain", "upper = 300", "upper = 10", 10),
        pytest.param("acceleration_feed_forward", "upper = 1.2", "upper = 0.3", 0.3, marks=pytest.mark.long),
    ],
)
def test_a_narrow_bound_is_named_with_a_value_that_meets_the_targets(name, written, narrow, largest, tmp_path):
    case = loaded(tmp_path, written, narrow)
    result = match(case, starts=1)
    assert result.status == "limited"
    (said,) = [sentence for sentence in result.limits if "bounds under [move]" in sentence]
    value = float(re.search(rf"loop\.{name} at ([\d.]+)", said)[1])
    assert value > largest
    assert f"({largest} is the largest allowed)" in said
    # with a bound there, everything else as it was, it is matched
    moves = tuple(replace(move, upper=1.01 * value) if name in move.name else move for move in case.moves)
    assert all(target.met for target in match(replace(case, moves=moves), starts=1).targets)


@pytest.mark.long
def test_no_bound_is_named_where_a_wider_one_does_not_help(tmp_path):
    """A dead time of 30 ms: no gain brings the mode back."""
    case = loaded(tmp_path, "upper = 300", "upper = 10")
    result = match(replace(case, loop=case.loop.with_values({"dead_time": 0.03})), starts=1)
    assert result.status == "limited"
    assert not any("bounds under [move]" in sentence for sentence in result.limits)
