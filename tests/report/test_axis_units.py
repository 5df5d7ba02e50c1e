"""The unit that an axis names is the unit of what is drawn on it: figures against the ranges of their own data."""

import re

import numpy as np
import pytest

import rigmatch as rm
from matching.report.evidence import delay_curve
from matching.report.motions import plot_response, simulation_figure

BENCH = "examples/diagnosis/model.toml"
UNIT = re.compile(r"(?:\bin |\[)(ms|s|Hz|°|%)(?=\]|$|[\s(])")


def drawn_on(figure):
    """Axis name, unit and the values drawn on every axis of a figure that names one of the units."""
    for axes in figure.axes:
        for name, column in (("x", 0), ("y", 1)):
            unit = UNIT.search(getattr(axes, f"get_{name}label")().replace("\n", " "))
            lines = [np.asarray(line.get_xydata(), float) for line in axes.get_lines()]
            whole = [points[:, column] for points in lines if len(points) > 2]  # not the lines that mark a place
            if unit and whole:
                values = np.concatenate(whole)
                yield name, unit[1], values[np.isfinite(values)]


def check(figure, *, seconds=None, hertz=None):
    """Times end at ``seconds``, frequencies lie in ``hertz``, phases are degrees; how many axes named such a unit."""
    count = 0
    for name, unit, values in drawn_on(figure):
        count += 1
        if unit in ("s", "ms") and name == "x":
            long = seconds * (1e3 if unit == "ms" else 1.0)
            assert long / 30 <= np.ptp(values) <= 1.01 * long  # part of it may be drawn; units are a thousand apart
        elif unit == "Hz":
            assert hertz[0] * 0.999 <= values.min() <= values.max() <= hertz[1] * 1.001
            assert values.max() > hertz[1] / 30
        elif unit == "°":
            assert 30 < np.abs(values).max() < 2000  # radians of a phase stay below some 20
    return count


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
