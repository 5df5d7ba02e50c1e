"""What to order, drawn: the values tried, what is planned and ordered, and what is as good."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.match.result import AdapterTrade
from matching.report.match import to_do, trade_figure

CURVE = ((1e5, 0.5), (4e5, 0.2), (6e5, 0.19), (1e6, 0.3))
FLANGE = AdapterTrade("rig.shafts.flange.stiffness", "N*m/rad", 4e5, 6e5, (5e5, 7e5), 0.195, 0.19, CURVE, 0.2)
DAMPING = replace(FLANGE, name="rig.shafts.flange.damping", unit="N*m*s/rad", error_all_as_planned=None)


def test_every_quantity_has_its_curve_range_and_values():
    drawn = trade_figure([FLANGE, DAMPING, FLANGE, DAMPING])
    panels = [axes for axes in drawn.axes if axes.get_visible()]
    assert len(panels) == 4
    lines = {line.get_label(): line for line in panels[0].get_lines()}
    np.testing.assert_array_equal(lines["response error, the rest tuned for each value"].get_xydata(), CURVE)
    np.testing.assert_array_equal(lines["ordered"].get_xydata(), [[6e5, 0.19]])
    assert list(lines["as planned"].get_xdata()) == [4e5, 4e5]
    assert list(lines["all adapters as planned, tuned for it"].get_ydata()) == [0.2, 0.2]
    (shade,) = panels[0].patches
    assert (shade.get_x(), shade.get_x() + shade.get_width()) == pytest.approx((5e5, 7e5))
    assert panels[0].get_xscale() == "log"
    assert panels[0].get_xlabel() == "flange, stiffness [N·m/rad]"
    assert "all adapters as planned, tuned for it" not in [line.get_label() for line in panels[1].get_lines()]


def test_an_adapter_planned_without_damping_is_drawn_and_ordered():
    """A planned value of 0 has no relative change."""
    curve = ((0.0, 0.4), (2.0, 0.2), (50.0, 0.3))
    trade = replace(DAMPING, planned=0.0, ordered=2.0, acceptable=(1.0, 3.0), error_as_ordered=0.2, curve=curve)
    panel = trade_figure([trade]).axes[0]
    assert panel.get_xscale() == "linear"  # a logarithmic axis has no place for 0
    first, *_ = to_do(SimpleNamespace(status="matched", adapters=(trade,)), "out")
    assert "flange, damping 2 N·m·s/rad instead of 0 N·m·s/rad" in first.text
