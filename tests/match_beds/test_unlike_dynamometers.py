"""Dynamometers that are not alike, as a machine in the engine's place: weights and singular values in proportion."""

from pathlib import Path

import numpy as np
import pytest

from matching.match.beds import balanced
from matching.match.case_file import load_case
from matching.match.operating_range import at_speed
from modelling.bed.observer import (
    dynamometer_sizes,
    feedback_on_all,
    feedback_slopes,
    filter_of,
    filter_slopes,
    observer_model,
    predicted,
)

CASE = Path(__file__).parents[1] / "driving" / "engine" / "case.toml"
SMALL = 1e-4  # of a decade


@pytest.fixture(scope="module")
def case():
    return at_speed(load_case(CASE), 12.0)


@pytest.fixture(scope="module")
def model(case):
    return observer_model(case.rig, case.residual_vehicle, case.loop)


def test_gains_change_with_the_weights_as_their_slopes_say(case, model):
    command, change = 3e-11, 4e-7

    def gains(by_command, by_change):
        made = feedback_on_all(model, command * 10**by_command, change * 10**by_change)
        return predicted(model, made.F, made.of_torques)

    found = feedback_slopes(model, feedback_on_all(model, command, change), command, change)
    for slope, way in zip(found, ((SMALL, 0), (0, SMALL)), strict=True):
        exact = (gains(*way) - gains(*(-step for step in way))) / (2 * SMALL)
        np.testing.assert_allclose(slope, exact, atol=1e-4 * np.abs(exact).max())


def test_corrections_change_with_the_weights_as_their_slopes_say(case, model):
    weights, names = dict(case.loop.values), ["dynamometer_drift", "dynamometer_noise", "shaft_noise", "torque_drift"]
    found = filter_slopes(model, filter_of(model, weights), weights, names)
    for name, slope in zip(names, found, strict=True):
        ends = [filter_of(model, {**weights, name: weights[name] * 10**step}).correction for step in (SMALL, -SMALL)]
        exact = (ends[0] - ends[1]) / (2 * SMALL)
        np.testing.assert_allclose(slope, exact, atol=1e-4 * np.abs(exact).max() + 1e-12)


def test_a_loop_in_balance_does_not_depend_on_the_units_of_a_machine(case):
    """A machine of a tenth of the size, whose loop is otherwise the same, has the same singular values."""
    sizes, random = dynamometer_sizes(case.rig, case.loop), np.random.default_rng(3)
    alike = random.normal(size=(4, 3, 3)) + 1j * random.normal(size=(4, 3, 3))
    measured = sizes[:, None] * alike / sizes  # commands in N·m for commands in N·m
    np.testing.assert_allclose(
        np.linalg.svd(balanced(measured, case), compute_uv=False), np.linalg.svd(alike, compute_uv=False)
    )
