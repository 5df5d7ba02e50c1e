"""The torque that no cause explains, as a curve, against the torque that made the data."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import solve
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.problem import base_problem
from matching.diagnosis.result import _curve, discrepancy_curves, kept_table
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import UnseenData, cut
from matching.report.diagnosis import discrepancy_figure
from modelling.model_file import dumps, from_dict

NOISE, AMPLITUDE, PERIOD = 0.002, 0.02, 2.0  # rad, N·m, rad
TIME = np.arange(3000) * 2e-3


J, DRAG = 0.1, 0.05  # kg·m², N·m·s/rad


def hypothesis(amplitude):
    """An arm whose motor torque follows from its motion by its equation, with the hidden torque in it."""
    system = from_dict({
        "inertias": {"arm": {"J": J, "drag": {"value": 0.04, "tolerance": 0.5}}},
        "inputs": {"motor": {"on": "arm"}},
        "sensors": {"angle": {"measures": "angle", "of": "arm", "uncertainty": NOISE}},
    })  # fmt: skip
    waves = [(0.7, 2 * np.pi * 0.31), (0.4, 2 * np.pi * 0.87)]
    angle, speed, acceleration = (sum(a * w**k * np.sin(w * TIME + k * np.pi / 2) for a, w in waves) for k in range(3))
    torque = J * acceleration + DRAG * speed + amplitude * np.sin(2 * np.pi * angle / PERIOD + 0.3)
    readings = angle + NOISE * np.random.default_rng(2).standard_normal(len(TIME))
    data = FitData((Segment(TIME, torque[:, None], readings[:, None]),), np.array([NOISE]))
    fit = solve(*base_problem(system, data))
    return Hypothesis(ExtendedModel(system, (), dict(fit.problem.bounds), fit.values), fit)


@pytest.fixture(scope="module")
def curves():
    return discrepancy_curves(hypothesis(AMPLITUDE))


def test_torque_over_the_angle_is_found_with_its_shape(curves):
    best = curves[0]
    assert (best.at, best.over) == ("inertias.arm", "angle")
    truth = -AMPLITUDE * np.sin(2 * np.pi * best.grid / PERIOD + 0.3)
    inside = slice(1, -1)  # the ends of the range are seldom reached
    np.testing.assert_allclose(best.torque[inside], truth[inside], atol=0.3 * AMPLITUDE)
    assert np.corrcoef(best.torque[inside], truth[inside])[0, 1] > 0.97
    assert best.share > 0.95
    assert best.repeats > 0.8
    assert (best.standard_uncertainty > 0).all()


def test_curves_come_by_what_they_would_take(curves):
    shares = [curve.share for curve in curves]
    assert shares == sorted(shares, reverse=True)
    assert {curve.over for curve in curves} <= {"angle", "speed", "load", "twist", "time"}


def test_a_curve_takes_the_whole_of_the_rest_at_most():
    """It may promise more where the excess over the noise is less than what it takes."""
    values = np.linspace(0.0, 1.0, 400)
    screening = SimpleNamespace(
        signature=lambda torques: torques["a"], basis=np.zeros((400, 1)), residual=values, mask=np.ones(400, bool)
    )
    whole, tenth = float(values @ values), 0.1 * float(values @ values)
    curve = _curve(screening, ("a", "time"), values, whole, 1.0)
    assert curve.share == pytest.approx(1.0, abs=0.01)
    assert _curve(screening, ("a", "time"), values, tenth, 1.0).share == 1.0


def test_figure_names_place_variable_and_share(curves):
    fig = discrepancy_figure(curves)
    axes = fig.axes[0]
    assert axes.get_xlabel() == "Angle of arm in rad"
    assert axes.get_ylabel() == "Unexplained on arm in N·m"
    assert axes.get_title() == f"takes {100 * curves[0].share:.0f} % of the rest"


def test_a_curve_is_kept_as_a_table_where_unseen_data_gain(curves):
    """The equation that made the recording has the hidden torque in it."""
    whole = hypothesis(AMPLITUDE)
    (segment,) = whole.fit.problem.data.segments
    first = FitData((segment.part(0, 1500),), whole.fit.problem.data.noise)
    fit = solve(*base_problem(whole.model.base, first))
    final = Hypothesis(ExtendedModel(whole.model.base, (), dict(fit.problem.bounds), fit.values), fit)
    unseen = UnseenData(cut(first, 4), DiagnosisSettings())
    kept = kept_table(final, curves, unseen)
    assert (kept.effect.at, kept.over) == ("inertias.arm", "angle")
    assert kept.nrmse_after < 0.5 * kept.nrmse_before
    extended = whole.model.base.with_values(kept.values).with_effects(kept.effect)
    assert from_dict(tomllib.loads(dumps(extended))) == extended
    assert kept_table(final, [replace(curves[0], repeats=0.1)], unseen) is None
    wrong = replace(curves[0], torque=-curves[0].torque)
    assert kept_table(final, [wrong], unseen) is None
