"""Figures of a match: every curve the result's own numbers."""

import numpy as np
import pytest

from matching.report.common import LINES
from matching.report.match import (
    CAPTIONS,
    CurveLimit,
    SensitivityCurves,
    in_time_signals,
    page,
    sensitivity_figure,
    signals,
    wrong_values,
)

SYSTEMS = ("vehicle", "rig", "matched", "unmeasured")


def labelled(axes):
    """Lines by their label."""
    return {line.get_label(): line for line in axes.get_lines()}


def ends(values):
    """First, last and largest: enough to tell a curve by."""
    values = np.asarray(values, float)
    return values[0], values[-1], values.max(), values.min()


def test_every_figure_stands_on_the_page_with_its_picture_and_caption(hand_made, as_figures):
    assert set(as_figures) == set(CAPTIONS) - {"beds", "trade"}
    html = page(hand_made, {name: name.encode() for name in as_figures})
    for name in as_figures:
        part = html.split(f'id="figure-{name}"')[1].split("</figure>")[0]
        assert f"<figcaption>{CAPTIONS[name]}" in part
        assert part.count("<img ") == 1


def test_magnitude_and_phase_of_every_function_are_those_of_the_result(hand_made, as_figures):
    panels = as_figures["responses"].axes
    count, across = len(hand_made.case.compared), 3
    inside = [
        hand_made.response_error.band[0] <= f <= hand_made.response_error.band[1] for f in hand_made.curves.frequencies
    ]
    for index in range(count):
        row, column = divmod(index, across)
        upper, lower = (labelled(panels[(2 * row + below) * across + column]) for below in (0, 1))
        assert set(upper) == set(lower)
        reference = lower["vehicle"].get_ydata()
        for who in SYSTEMS:
            values = getattr(hand_made.curves, who)[:, index]
            if LINES[who]["label"] not in upper:
                assert not np.isfinite(values).all() or np.array_equal(values, hand_made.curves.matched[:, index])
                continue
            np.testing.assert_allclose(upper[LINES[who]["label"]].get_ydata(), np.abs(values))
            degrees = lower[LINES[who]["label"]].get_ydata()
            np.testing.assert_allclose(np.exp(1j * np.radians(degrees)), values / np.abs(values), atol=1e-9)
            assert np.abs(np.diff(degrees)).max() < 180
            assert abs(np.mean((degrees - reference)[inside])) <= 180


def test_errors_lie_at_their_values_the_first_function_on_top(hand_made, as_figures):
    axes, rows = as_figures["errors"].axes[0], hand_made.response_error.functions
    lines = labelled(axes)
    for label, key in (("rig without control", "before"), ("matched rig", "after")):
        known = [(len(rows) - 1 - i, getattr(row, key)) for i, row in enumerate(rows) if getattr(row, key) is not None]
        line = lines[label]
        assert list(line.get_ydata()) == [place for place, _ in known]
        assert list(line.get_xdata()) == pytest.approx([max(value, 1e-4) for _, value in known])
    upright = [line.get_xdata()[0] for line in axes.get_lines() if line.get_linestyle() == "--"]
    allowed = (hand_made.case.tolerance, hand_made.case.unmeasured_tolerance)
    assert upright == [value for value in allowed if np.isfinite(value)]


@pytest.mark.parametrize(("name", "source"), [("manoeuvre", signals), ("in_time", in_time_signals)])
def test_traces_are_those_of_the_simulation(hand_made, as_figures, name, source):
    panels = as_figures[name].axes
    of_signals = source(hand_made)
    assert len(panels) == 2 * len(of_signals)
    for signal, whole in zip(of_signals, panels[::2], strict=True):
        lines = labelled(whole)
        assert whole.get_title() == signal.title
        assert whole.get_ylabel() == signal.label
        assert whole.get_xlim() == (signal.time[0], signal.time[-1])
        for who, values in signal.curves.items():
            line = lines[LINES[who]["label"]]
            assert ends(line.get_ydata()) == pytest.approx(ends(values))
            assert ends(line.get_xdata()) == pytest.approx(ends(signal.time))


def test_both_margin_figures_show_the_modulus_margin_of_the_verification(hand_made, as_figures):
    margin = hand_made.verification.modulus_margin
    left, right = as_figures["margin"].axes
    curve, required, least = left.get_lines()
    counted = curve.get_ydata()[curve.get_xdata() >= hand_made.verification.margin_from]
    assert counted.min() == pytest.approx(margin, rel=2e-3)
    assert least.get_ydata()[0] == counted.min()
    assert required.get_ydata()[0] == hand_made.case.limits["modulus_margin"] == right.patches[0].get_radius()
    loci = [line.get_xdata() + 1j * line.get_ydata() for line in right.get_lines()[:-1]]
    distance = np.min(np.abs(1 + np.array(loci)), axis=0)  # an eigenvalue is no smaller than the least singular value
    assert np.all((distance >= curve.get_ydata() - 1e-9) | np.isnan(distance))
    assert right.get_lines()[-1].get_xydata().tolist() == [[-1, 0]]
    lines = labelled(as_figures["sensitivity"].axes[0])
    S = lines["|S|, what a disturbance is multiplied by"].get_ydata()
    assert S.max() == pytest.approx(1 / curve.get_ydata().min(), rel=2e-3)
    T = lines["|T|, what noise is multiplied by"].get_ydata()
    assert np.abs(S - T).max() <= 1 + 1e-9  # S + T = 1
    assert T[0] == pytest.approx(1, abs=0.1)  # the integrator
    assert T[-1] < 0.1 * T.max()


def test_a_limit_is_drawn_from_where_it_counts_to_the_end():
    f = np.array([0.01, 1.0, 10.0, 200.0])
    curves = SensitivityCurves(
        f, np.full(4, 1.5), np.full(4, 0.5), (CurveLimit("|S|", 2.0, 0.01), CurveLimit("|T|", 0.5, 10.0))
    )
    axes = sensitivity_figure(curves).axes[0]
    limits = axes.get_lines()[2:]
    assert [line.get_xydata().tolist() for line in limits] == [[[0.01, 2.0], [200, 2.0]], [[10, 0.5], [200, 0.5]]]
    assert [text.get_text() for text in axes.texts] == ["|S| ≤ 2", "|T| ≤ 0.5 from 10 Hz"]
    assert axes.get_ylim() == pytest.approx((0.25, 4.5))


def test_quantities_lie_between_their_bounds(hand_made, as_figures):
    bars, weights = as_figures["quantities"].axes
    for place, row in enumerate(hand_made.parameters):
        at = [(value - row.lower) / (row.upper - row.lower) for value in (row.start, row.tuned)]
        stroke, start, tuned = bars.get_lines()[3 * place : 3 * place + 3]
        assert stroke.get_xydata().tolist() == [[at[0], place], [at[1], place]]
        assert (start.get_xydata().tolist(), tuned.get_xydata().tolist()) == ([[at[0], place]], [[at[1], place]])
        assert start.get_label() == "start"
        assert weights.patches[place].get_width() == row.weight


def test_wrong_values_reach_to_their_errors(hand_made, as_figures):
    axes, after = as_figures["robustness"].axes[0], hand_made.response_error.after
    errors = sorted(row.error for row in wrong_values(hand_made) if row.stable and row.error is not None)
    drawn = sorted(bar.get_x() + bar.get_width() for bar in axes.patches if not bar.get_hatch())
    assert set(np.round(drawn, 9)) <= set(np.round(errors, 9))
    assert drawn[-1] == pytest.approx(errors[-1])
    assert all(bar.get_x() == after or bar.get_x() + bar.get_width() == after for bar in axes.patches)


def test_modes_are_as_high_as_their_frequencies(hand_made, as_figures):
    panels = as_figures["modes"].axes
    for axes, modes in zip(panels[:2], (hand_made.vehicle_modes, hand_made.rig_modes), strict=True):
        assert [bar.get_height() for bar in axes.patches] == pytest.approx([max(mode.frequency, 0.3) for mode in modes])


def test_targets_of_the_overview_are_those_of_the_result(hand_made, as_figures):
    axes = as_figures["overview"].axes[3]
    single = {(x, y) for line in axes.get_lines() for x, y in line.get_xydata() if len(line.get_xydata()) == 1}
    assert single == {
        (getattr(target, who), place)
        for target in hand_made.targets
        for who, place in (("vehicle", 2), ("rig", 1), ("matched", 0))
    }


def curves(figure):
    """Curves of a figure that acts: name → x, y."""
    return {
        own.name: (np.asarray(own.data_source.data["x"]), np.asarray(own.data_source.data["y"]))
        for own in figure.renderers
    }


def labels(figure):
    return figure.title.text, figure.xaxis[0].axis_label, figure.yaxis[0].axis_label
