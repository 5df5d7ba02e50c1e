"""The proposed manoeuvre against closed-form responses of every manoeuvre."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.problem import base_problem
from matching.diagnosis.verdict import ProposedManoeuvre, propose_manoeuvre, waveforms
from modelling.model_file import from_dict

NOISE, LARGEST = 0.02, 3.0
STEP = 2e-3


def hypothesis(J: float, drag: float, fastest: float = 1e3) -> Hypothesis:
    """An inertia with drag, recorded with torques between −1 and 3 N·m, at speeds up to a limit."""
    system = from_dict({
        "inertias": {"rotor": {"J": {"value": J, "tolerance": 0.5}, "drag": {"value": drag, "tolerance": 0.5}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
    })  # fmt: skip
    time = np.arange(200) * STEP
    torque = np.linspace(-1.0, LARGEST, 200)[:, None]
    data = FitData((Segment(time, torque, np.linspace(0.0, fastest, 200)[:, None]),), np.array([NOISE]))
    problem, v = base_problem(system, data)
    residual = problem.residuals(v[None])[0]
    fit = Fit(problem, v, residual, np.zeros((len(residual), len(v))), float(residual @ residual))
    return Hypothesis(ExtendedModel(system, (), problem.bounds, fit.values), fit)


def separations(one: tuple[float, float], other: tuple[float, float]) -> dict[str, float]:
    """Root mean square difference in times the noise, by waveform, J·ω̇ + b·ω = M from rest."""
    time = STEP * np.arange(round(8.0 / STEP))
    out = {}
    for name, shape in waveforms(time).items():
        speeds = [lsim(([-b / J], [1 / J], [1.0], [0.0]), LARGEST * shape, time)[1] for J, b in (one, other)]
        out[name] = float(np.sqrt(np.mean((speeds[0] - speeds[1]) ** 2))) / NOISE
    return out


@pytest.mark.parametrize(
    ("one", "other", "best"),
    [
        ((0.5, 0.3), (0.5, 0.36), "a step"),  # another drag shows in the steady speed
        ((0.5, 0.02), (0.6, 0.02), "a step"),  # another inertia without much drag in a speed that grows
        ((0.5, 3.0), (0.9, 3.0), "steps to and fro"),  # with much drag at every change of torque
    ],
)
def test_the_manoeuvre_with_the_largest_difference_is_proposed(one, other, best) -> None:
    expected = separations(one, other)
    found = propose_manoeuvre(hypothesis(*one), hypothesis(*other))
    assert found is not None
    largest = max(expected, key=lambda key: expected[key])
    assert found.waveform == largest == best
    assert found.amplitude == pytest.approx(LARGEST)  # never more than was recorded
    assert found.separation == pytest.approx(expected[largest], rel=1e-3)
    assert (found.input, found.sensor, found.duration) == ("motor", "speed", 8.0)


def test_no_speed_beyond_the_recorded_ones_is_proposed() -> None:
    """Of a step, a speed of M/b·(1 − exp(−b·t/J)) remains: half of it fits below the largest recorded one."""
    steady = LARGEST / 3.0  # within 8 s: b/J is 6 1/s
    found = propose_manoeuvre(hypothesis(0.5, 3.0, fastest=0.7 * steady), hypothesis(0.5, 3.6))
    assert found is not None
    assert (found.waveform, found.amplitude) == ("a step", LARGEST / 2)


def test_rivals_that_no_torque_separates_ask_for_a_sensor() -> None:
    found = propose_manoeuvre(hypothesis(0.5, 0.3), hypothesis(0.5, 0.3))
    assert found is not None
    assert found.separation == 0
    assert found.sentence("a", "b").startswith("no torque on the inputs tells a from b: at best 0 times the noise")


def test_sentence_changes_at_a_difference_of_once_the_noise() -> None:
    made = ProposedManoeuvre("motor", "a step", 6.0, 8.0, 1.0, "speed")
    assert made.sentence("a", "b") == (
        "record a step of 6 N·m on motor for 8 s: a and b would differ by 1 times the noise of speed"
    )
    assert replace(made, separation=0.99).sentence("a", "b").startswith("no torque")


def test_waveforms_stay_within_one_and_have_their_frequencies() -> None:
    time = 1e-3 * np.arange(8000)
    shapes = waveforms(time)
    for shape in shapes.values():
        assert np.abs(shape).max() <= 1
    np.testing.assert_array_equal(shapes["a step"], time > 0.5)
    rising = np.sum(np.diff(shapes["steps to and fro"]) > 0)
    assert rising == 4  # four periods, each ends with a rise
    np.testing.assert_allclose(shapes["a slow sine (0.5 Hz)"], np.sin(np.pi * time), atol=1e-9)
    crossings = np.sum(np.diff(np.sign(shapes["a sweep from 0.5 to 30 Hz"])) != 0)
    assert crossings == pytest.approx(2 * 8 * (0.5 + 30) / 2, abs=3)  # mean frequency times length, twice a period
