"""One line of a match on its trial in time: errors to measured and unmeasured torques, and lashes."""

import pytest

from matching.match.in_time import EVERYTHING_STATED
from matching.report.match import in_time_lines

RIGHT = {"what_is_wrong": "as modelled", "measured": {"a": 0.01, "b": 0.02}, "unmeasured": {"a": 0.02, "b": 0.005}}
STATED = {"what_is_wrong": EVERYTHING_STATED, "measured": {"a": 0.015, "b": 0.01}, "unmeasured": {"a": 0.01, "b": 0.02}}
WRONG = {
    "what_is_wrong": "everything at once",
    "measured": {"a": 0.03, "b": 0.015},
    "unmeasured": {"a": 0.25, "b": 0.4},
}
UNSTABLE = {"what_is_wrong": "everything at once", "measured": None, "unmeasured": None}
NO_LASH = {"limit_cycles": 0, "drawn": 4}


@pytest.mark.parametrize(
    ("last", "lash", "said"),
    [
        (WRONG, None, "as modelled 2.00 %; everything at once: 3.00 % (measured torques), 40.00 % (unmeasured)"),
        (UNSTABLE, None, "as modelled 2.00 %; everything at once: not stable"),
        (RIGHT, NO_LASH, "as modelled 2.00 %; as modelled: 2.00 %; open lash: 4 of 4 drawn ones come to rest"),
        (
            RIGHT,
            {"limit_cycles": 3, "drawn": 20},
            "as modelled 2.00 %; as modelled: 2.00 %; "
            "open lash: 3 of 20 drawn ones swing on where the vehicle comes to rest",
        ),
    ],
)
def test_the_largest_error_of_both_kinds_of_torques_and_what_lashes_do(last, lash, said):
    (line,) = in_time_lines({"in_time": {"rows": [RIGHT, last], "duration": 3.0, "open_lash": lash}})
    assert line == f"in time, 3 s on beds that are not the model, largest error over range: {said}"


def test_both_beds_with_everything_wrong_are_stated_and_no_other_row():
    rows = [RIGHT, {**RIGHT, "what_is_wrong": "lash"}, STATED, WRONG]
    (line,) = in_time_lines({"in_time": {"rows": rows, "duration": 3.0, "open_lash": None}})
    assert line.endswith(
        f"as modelled 2.00 %; {EVERYTHING_STATED}: 1.50 % (measured torques), 2.00 % (unmeasured); "
        "everything at once: 3.00 % (measured torques), 40.00 % (unmeasured)"
    )


@pytest.mark.parametrize("result", [{}, {"in_time": None}, {"in_time": {"rows": []}}])
def test_nothing_is_said_where_nothing_was_tried(result):
    assert in_time_lines(result) == []
