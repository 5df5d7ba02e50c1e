"""Many parameter sets at once give what each gives alone: state spaces, sampled beds with a dead time, responses."""

import numpy as np
import pytest
from scipy.linalg import expm

from modelling.bed.bed import delayed_beds
from modelling.linear.resolvent import resolvents
from modelling.linear.state_space import state_space, state_spaces
from modelling.model_file import from_dict

STEP = 1e-3


def chain(ratio=3.0):
    return from_dict({
        "inertias": {"motor": {"J": 0.05, "drag": 0.01}, "hub": {"J": 0.3}, "wheel": {"J": 2.0, "drag": 0.1}},
        "shafts": {
            "side": {"between": ["motor", "hub"], "ratio": ratio, "stiffness": 800.0, "damping": 1.0},
            "tyre": {"between": ["hub", "wheel"], "stiffness": 3e3, "damping": 4.0},
        },
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {"speed": {"measures": "speed", "of": "wheel"}, "twist": {"measures": "torque", "of": "side"}},
    })  # fmt: skip


@pytest.mark.parametrize("quantity", ["inertias.wheel.J", "shafts.tyre.stiffness", "shafts.side.ratio"])
def test_a_state_space_of_many_is_that_of_each_system_built_with_the_value(quantity):
    system = chain()
    value = system.parameters[quantity].value
    changed = [{quantity: factor * value} for factor in (0.7, 1.0, 1.6)]
    s = 2j * np.pi * np.array([0.3, 4.0, 30.0])
    for space, values in zip(state_spaces(system, changed), changed, strict=True):
        own = state_space(system.with_values(values))
        for at in s:
            found, wanted = (
                one.C @ np.linalg.solve(at * np.eye(len(one.A)) - one.A, one.B) + one.D for one in (space, own)
            )
            np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_response_of_many_matrices_solves_each():
    random = np.random.default_rng(3)
    A, B = random.normal(size=(5, 7, 7)), random.normal(size=(5, 7, 2))
    z = np.exp(1j * np.linspace(0.1, 3, 6)) * 9
    found = resolvents(A).columns(z, B)
    for b in range(5):
        for f, at in enumerate(z):
            np.testing.assert_allclose(found[b, f], np.linalg.solve(at * np.eye(7) - A[b], B[b]), rtol=1e-9, atol=1e-12)


def test_sampled_beds_of_many_dead_times_move_as_the_plant_does():
    """One command that steps at 0, at instants between the samples from a matrix exponential of the plant alone."""
    random = np.random.default_rng(4)
    dead_times = np.array([[0.0], [0.0004], [0.003], [0.0037]])
    A = random.normal(size=(4, 3, 3)) * 40 - 60 * np.eye(3)
    B, none = random.normal(size=(4, 3, 1)), np.zeros((4, 3, 0))
    for bed, a, b, (late,) in zip(delayed_beds(A, B, none, dead_times, STEP), A, B, dead_times, strict=True):
        x = np.zeros(3)
        for n in range(12):
            x = bed.whole @ x + bed.new[:, 0] * (n >= bed.delay) + bed.old[:, 0] * (n >= bed.delay + 1)
            acting = max((n + 1) * STEP - late, 0.0)
            stepped = np.linalg.solve(a, (expm(a * acting) - np.eye(3)) @ b[:, 0])
            np.testing.assert_allclose(x, stepped, rtol=1e-9, atol=1e-12)
