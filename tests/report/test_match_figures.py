"""Figures of a match: every curve the result's own numbers."""

import numpy as np
import pytest

from matching.report.common import LINES
from matching.report.match import (
    CAPTIONS,
    content,
    in_time_signals,
    pictures,
    report,
    sensitivity_figure,
    signals,
)
from matching.report.page import page

SYSTEMS = ("vehicle", "rig", "matched", "unmeasured")


def labelled(axes):
    """Lines by their label."""
    return {line.get_label(): line for line in axes.get_lines()}


def ends(values):
    """First, last and largest: enough to tell a curve by."""
    values = np.asarray(values, float)
    return values[0], values[-1], values.max(), values.min()


def test_every_figure_stands_on_the_page_with_its_picture_and_caption(hand_made, as_figures):
    assert set(as_figures) == set(CAPTIONS) - {"beds", "trade", "drives", "over_speed"}
    images = {name: f"<i>{name}</i>" for name in as_figures}
    html = page(report(content(hand_made), "OUT", None, hand_made), pictures(hand_made), images)
    for name in as_figures:
        part = html.split(f'id="figure-{name}"')[1].split("</figure>")[0]
        assert f"<figcaption>{CAPTIONS[name]}" in part
        assert part.count(f"&lt;i&gt;{name}") == 1


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


def test_sensitivity_shows_the_modulus_margin_of_the_verification(hand_made, as_figures):
    lines = labelled(as_figures["sensitivity"].axes[0])
    curve = lines["|S|, what a disturbance is multiplied by"]
    S = curve.get_ydata()
    counted = S[curve.get_xdata() >= hand_made.verification.margin_from]
    assert 1 / counted.max() == pytest.approx(hand_made.verification.modulus_margin, rel=2e-3)
    T = lines["|T|, what noise is multiplied by"].get_ydata()
    assert np.abs(S - T).max() <= 1 + 1e-9  # S + T = 1
    assert T[0] == pytest.approx(1, abs=0.1)  # the integrator
    assert T[-1] < 0.1 * T.max()


def test_a_limit_is_drawn_from_where_it_counts_to_the_end():
    f = np.array([0.01, 1.0, 10.0, 200.0])
    allowed = {"|S|": (2.0, 0.0), "|T|": (0.5, 10.0)}
    axes = sensitivity_figure(f, np.full(4, 1.5), np.full(4, 0.5), allowed).axes[0]
    limits = axes.get_lines()[2:]
    assert [line.get_xydata().tolist() for line in limits] == [[[0.01, 2.0], [200, 2.0]], [[10, 0.5], [200, 0.5]]]
    assert [text.get_text() for text in axes.texts] == ["|S| ≤ 2", "|T| ≤ 0.5 from 10 Hz"]
    assert axes.get_ylim() == pytest.approx((0.25, 4.5))


def test_wrong_values_reach_to_their_errors(hand_made, as_figures):
    axes, after = as_figures["robustness"].axes[0], hand_made.response_error.after
    errors = sorted(row.response_error for row in hand_made.verification.robustness if row.stable)
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
