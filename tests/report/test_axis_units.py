"""The unit that an axis names is the unit of what is drawn on it: figures against the ranges of their own data."""

import re

import numpy as np
import pytest
from axis_units import UNIT, check

import rigmatch as rm
from matching.report.evidence import delay_curve
from matching.report.motions import plot_response, simulation_figure

BENCH = "examples/diagnosis/model.toml"


def test_responses_of_a_model():
    frequencies = np.geomspace(0.5, 40, 50)
    assert check(plot_response(rm.response(BENCH, frequencies)), hertz=(0.5, 40)) == 2


def test_a_simulation():
    simulated = rm.simulate(BENCH, {"motor_torque": rm.TipIn(amplitude=5, duration=1.7)})
    assert check(simulation_figure(simulated), seconds=1.7) == 1


@pytest.mark.parametrize("name", ["responses", "manoeuvre", "in_time", "overview", "sensitivity"])
def test_a_match(as_figures, case, name):
    longest = max(torque.duration for torque in case.manoeuvre.values())
    assert check(as_figures[name], seconds=longest, hertz=(0.01, 500)) >= 1


def test_a_delay_costs_half_of_the_fidelity_where_the_axis_says():
    """The definition of the figure: R_τ is one half at τ = 1/(6·f_max), whatever the axis counts in."""
    (axes,) = delay_curve(rm.fidelity("examples/fidelity/tab2.toml", draws=200)).axes
    highest = float(re.search(r"f_max = ([\d.]+) Hz", axes.get_title())[1])
    assert UNIT.search(axes.get_xlabel())[1] == "ms"
    delay, fidelity = max((line.get_xydata() for line in axes.get_lines()), key=len).T
    assert np.interp(1e3 / (6 * highest), delay, fidelity) == pytest.approx(0.5, abs=0.02)
