"""Wrong values, drawn: what costs most on top, what makes the loop unstable before all else."""

from matching.match.verify import Deviation
from matching.report.match import robustness_figure

ROWS = [
    Deviation(name, change, stable, -1.0, 0.5, error)
    for name, change, error, stable in (
        ("little", -0.05, 0.11, True), ("little", 0.05, 0.12, True), ("much", -0.05, 0.1, True),
        ("much", 0.05, 0.4, True), ("fatal", -0.05, 0.1, True), ("fatal", 0.05, 3.0, False),
        ("better", 0.05, 0.05, True),
    )
]  # fmt: skip


def test_the_largest_effect_is_on_top_and_unstable_values_reach_the_end():
    figure = robustness_figure(ROWS, 0.1)
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["fatal", "much", "better", "little"]
    ends = [round(bar.get_x() + bar.get_width(), 12) for bar in axes.patches]
    top = 0.5  # a quarter beyond the largest error of a stable loop
    assert ends == [0.1, top, 0.1, 0.4, 0.05, 0.11, 0.12]
    assert [bool(bar.get_hatch()) for bar in axes.patches] == [False, True, False, False, False, False, False]
    assert axes.get_xlim() == (0, top * 1.12)


def test_only_the_first_are_drawn():
    (axes,) = robustness_figure(ROWS, 0.1, most=2).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["fatal", "much"]
