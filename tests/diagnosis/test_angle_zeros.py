"""Encoders start anywhere: a zero for each angle sensor of a part but the first, on every segment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from matching.diagnosis.data import FitData, Segment, Weighting
from matching.diagnosis.descent import Fit, solve
from matching.diagnosis.problem import base_problem, first_state, sensors_with_zero
from matching.diagnosis.unseen import cut, unseen_errors
from modelling.equations.casadi_code import compiled
from modelling.model_file import from_dict
from modelling.system import System

NOISE, ZERO, STIFFNESS, DAMPING = 1e-3, -6.85, 100.0, 0.2
INERTIAS, DRAG = (0.1, 0.2), 0.05


@pytest.fixture(scope="module")
def system() -> System:
    return from_dict({
        "inertias": {"motor": {"J": INERTIAS[0], "drag": DRAG}, "load": {"J": INERTIAS[1]}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": {"value": 80, "tolerance": 0.5},
                            "damping": DAMPING}},
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {
            "first": {"measures": "angle", "of": "motor", "uncertainty": NOISE},
            "second": {"measures": "angle", "of": "load", "uncertainty": NOISE},
            "speed": {"measures": "speed", "of": "load", "uncertainty": 0.01},
        },
    })  # fmt: skip


@pytest.fixture(scope="module")
def recorded() -> Segment:
    """From scipy.signal, x = angles and speeds of motor and load."""
    time = np.arange(1500) * 2e-3
    torque = 4 * np.sin(2 * np.pi * time * (1 + 2 * time))
    motor, load = INERTIAS
    k, c = STIFFNESS, DAMPING
    torques = np.array([[-k, k, -c - DRAG, c], [k, -k, c, -c]])
    A = np.vstack([np.eye(4)[2:], torques / np.array([[motor], [load]])])
    _, x, _ = lsim(
        (A, [[0], [0], [1 / motor], [0]], np.eye(4), np.zeros((4, 1))), torque, time, X0=[3.0, 3.0, 1.0, 1.0]
    )
    readings = np.column_stack([x[:, 0], x[:, 1] + ZERO, x[:, 3]])
    readings += np.array([NOISE, NOISE, 0.01]) * np.random.default_rng(5).standard_normal(readings.shape)
    return Segment(time, torque[:, None], readings, "one")


@pytest.fixture(scope="module")
def fit(system: System, recorded: Segment) -> Fit:
    data = FitData((recorded.part(0, 1000),), np.array([NOISE, NOISE, 0.01]))
    return solve(*base_problem(system, data))


def test_only_further_angle_sensors_of_a_part_have_a_zero(system: System) -> None:
    assert sensors_with_zero(system) == [1]
    assert sensors_with_zero(replace(system, sensors=system.sensors[1:])) == []


def test_a_zero_is_no_twist(system: System, recorded: Segment, fit: Fit) -> None:
    start = first_state(system, compiled(system), recorded)
    assert start[0] == start[1] == recorded.readings[0, 0]
    assert fit.values["shafts.link.stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert fit.cost == pytest.approx(3000, rel=0.1)


def test_an_unseen_block_keeps_the_zero_of_the_others(recorded: Segment, fit: Fit) -> None:
    """A jump of the encoder within a block is an error there, not another zero."""
    last = 5 * len(recorded.time) // 6
    jumped = recorded.readings.copy()
    jumped[last:, 1] += 20 * NOISE
    for readings, expected in ((recorded.readings, 1.0), (jumped, 20.0)):
        whole = FitData((replace(recorded, readings=readings),), fit.problem.data.noise)
        problem, v = base_problem(fit.problem.system, whole)
        (unseen,) = unseen_errors(solve(problem, v), cut(whole, 6))
        assert np.sqrt(np.mean(unseen[last:, 1] ** 2)) == pytest.approx(expected, rel=0.15)


def test_weighted_residuals_are_free_of_the_zero_too(fit: Fit) -> None:
    problem = replace(fit.problem, weighting=Weighting(np.array([0.9, 0.9, 0.0]), np.ones(3)))
    moved = replace(problem.data.segments[0], readings=problem.data.segments[0].readings + np.array([0, 5.0, 0]))
    other = replace(problem, data=replace(problem.data, segments=(moved,)))
    np.testing.assert_allclose(other.residuals(fit.v[None]), problem.residuals(fit.v[None]), atol=1e-6)
    np.testing.assert_allclose(other.errors(fit.v)[0], fit.errors[0], atol=1e-6)
