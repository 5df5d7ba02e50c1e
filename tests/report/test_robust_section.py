"""The rows of the report that say what beds, loop and sensors keep."""

from dataclasses import dataclass

from matching.match.beds import BedsCheck, LoopFigures
from matching.match.requirements import Requirements
from matching.match.verify import OwnMode
from matching.report.match import bed_errors, beds_figure, requirement_rows

BEDS = BedsCheck(4, 3, 3, 0.005, 0.01, (0.1, 0.2, 0.3), (0.2, 0.3, 0.4))

LOOP, REQUIRED = (
    LoopFigures(0.49, 20.0, 0.4, {"left": 19.0, "right": 21.0}),
    Requirements(0.01, 0.5, 0.5, 16.0, 0.5, 100.0, (20.0, 20.0), ()),
)


@dataclass(frozen=True)
class Robust:
    beds: BedsCheck = BEDS
    loop: LoopFigures = LOOP
    required: Requirements = REQUIRED
    slowest_own: OwnMode | None = None


def test_every_requirement_stands_with_what_is_asked_and_whether_it_holds():
    rows = [tuple(row.values()) for row in requirement_rows(Robust())]
    assert [row[-1].startswith("✓") for row in rows] == [False, False, False, True, True, False]
    assert (rows[0][1], rows[2][1], rows[2][2]) == ("3 of 4", "0.49", "at least 0.5")
    assert rows[-1][0] == "command of dynamometer right from sensor noise"


def test_median_and_95_percent_of_both_errors():
    measured, unmeasured = (tuple(row.values()) for row in bed_errors(BEDS))
    assert measured == ("measured torques", "0.2", "0.29")
    assert unmeasured[:2] == ("unmeasured torques", "0.3")


def test_the_figure_draws_both_distributions():
    axes = beds_figure(BEDS, 0.3).axes[0]
    drawn = {line.get_label(): list(line.get_xdata()) for line in axes.lines}
    assert drawn["unmeasured torques"] == [0.2, 0.3, 0.4]
    assert drawn["allowed as planned, unmeasured"] == [0.3, 0.3]
