"""Fits over windows: joined two by two up to whole segments, and what they say of a parameter's uncertainty."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import holdout
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, solve
from matching.diagnosis.holdout import holdout_residuals, rms_by_sensor, simulate_other
from matching.diagnosis.problem import base_problem
from matching.diagnosis.simulation import fastest_rate
from matching.diagnosis.statistics import estimates
from matching.diagnosis.windows import window_uncertainties
from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict

TIME = np.arange(400) * 5e-3
OFFSET = {"value": 0, "lower": -1, "upper": 1}  # N·m


def window(first, last, name="a"):
    samples = slice(first, last)
    return Segment(TIME[samples], TIME[samples, None], 2 * TIME[samples, None], name)


def rotor(offset=0.0):
    """A rotor with drag under a sine, its torque constant offset hidden from the model."""
    system = from_dict({
        "inertias": {"rotor": {"J": 0.5, "drag": {"value": 0.4, "tolerance": 0.5}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.01}},
        "effects": [{"kind": "constant_torque", "at": "inertias.rotor", "torque": OFFSET}],
    })  # fmt: skip
    w = 2 * np.pi
    speed = 1 + np.sin(w * TIME)
    torque = 0.5 * w * np.cos(w * TIME) + 0.4 * speed + offset
    readings = speed + 0.01 * np.random.default_rng(5).standard_normal(len(TIME))
    return system, FitData((Segment(TIME, torque[:, None], readings[:, None], "made"),), np.array([0.01]))


@pytest.fixture(scope="module")
def fit() -> Fit:
    return solve(*base_problem(*rotor(0.3)))


def test_windows_know_a_smooth_parameter_about_as_well_as_the_whole(fit):
    whole, windows = estimates(fit), window_uncertainties(fit)
    assert set(windows) == set(whole)
    for name, own in whole.items():
        assert 0.9 * own.standard_uncertainty < windows[name] < 20 * own.standard_uncertainty


def test_an_unseen_recording_gets_its_own_zero(fit):
    """The offset of the fitted recording is 0.3 N·m, that of the unseen one -0.2; drag and inertia hold for both."""
    name = "inertias.rotor.constant_torque.torque"
    assert fit.values[name] == pytest.approx(0.3, abs=0.01)
    _, other = rotor(-0.2)
    runs = simulate_other(fit, other)
    assert rms_by_sensor(holdout_residuals(runs)) == pytest.approx(1.0, abs=0.1)
    assert dict(zip(runs[0].problem.free, runs[0].v, strict=False))[name] == pytest.approx(-0.2, abs=0.01)


def test_each_stretch_begins_on_the_flank_that_leaves_least(fit, monkeypatch):
    """Two stretches, two flanks: the first fits the one, the second the other, whatever the signs of the errors."""
    _, other = rotor(-0.2)
    twice = replace(other, segments=(other.segments[0], replace(other.segments[0], name="again")))
    errors = [[np.array([[-3.0]]), np.array([[1.0]])], [np.array([[2.0]]), np.array([[-4.0]])]]
    made = []

    def solved(problem, v, *_):
        number = len(made)
        starts = [np.full_like(start, number) for start in problem.unpack(v)[1]]
        made.append(SimpleNamespace(by_sensor=lambda: errors[number], starts=starts, cost=1.0, values={}))
        return made[-1]

    monkeypatch.setattr(holdout, "flank_shifts", lambda *_: [0.0, 0.0])
    monkeypatch.setattr(holdout, "solve", solved)
    (run,) = simulate_other(fit, twice)
    assert list(run.errors) == [2.0, 1.0]
    assert [start.max() for start in run.problem.unpack(run.v)[1]] == [1.0, 0.0]


def test_the_rate_of_a_slow_rotor_is_its_drag_over_its_inertia():
    model = compiled(from_dict({"inertias": {"rotor": {"J": 2.0, "drag": 0.4}}, "inputs": {"motor": {"on": "rotor"}}}))
    states = np.zeros((1, len(model.states)))
    assert fastest_rate(model, model.p0, states, np.zeros(1)) == pytest.approx(0.2)
