"""The rows of the report that say what beds, loop and sensors keep."""

from dataclasses import dataclass

import pytest

from matching.match.beds import BedsCheck, LoopFigures
from matching.match.case import Requirements
from matching.report.match import beds_figure, error_rows, requirement_rows

BEDS = BedsCheck(4, 3, 3, 0.005, 0.01, (0.1, 0.2, 0.3), (0.2, 0.3, 0.4))

LOOP, REQUIRED = (
    LoopFigures(0.49, 20.0, 0.4, {"left": 19.0, "right": 21.0}),
    Requirements(0.01, 0.5, 0.5, 16.0, 0.5, 100.0, 20.0),
)


@dataclass(frozen=True)
class Robust:
    beds: BedsCheck = BEDS
    loop: LoopFigures = LOOP
    required: Requirements = REQUIRED


def test_every_requirement_stands_with_what_is_asked_and_whether_it_holds():
    rows = requirement_rows(Robust())
    assert [row.holds for row in rows] == [False, False, False, True, True, False]
    assert (rows[0].value, rows[2].value, rows[2].asked) == ("3 of 4", "0.49", "at least 0.5")
    assert rows[-1].what == "command of dynamometer right from sensor noise"


def test_median_and_95_percent_of_both_errors():
    (kind, median, high), (other_kind, unmeasured, _) = error_rows(Robust())
    assert (kind, other_kind) == ("measured", "unmeasured")
    assert (median, high, unmeasured) == (pytest.approx(0.2), pytest.approx(0.29), pytest.approx(0.3))


def test_the_figure_draws_both_distributions():
    axes = beds_figure(BEDS, 0.3).axes[0]
    drawn = {line.get_label(): list(line.get_xdata()) for line in axes.lines}
    assert drawn["unmeasured torques"] == [0.2, 0.3, 0.4]
    assert drawn["allowed as planned, unmeasured"] == [0.3, 0.3]
