"""Dry friction is not taken for a kind that holds it as a special case, nor for two causes."""

from pathlib import Path

import numpy as np
import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import FINAL_STEPS, Fit, solve, with_sharper_friction
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.hypotheses import Hypothesis, at_noise
from matching.diagnosis.moves import with_sharpest_friction
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import fit_extended
from matching.diagnosis.statistics import estimates
from modelling.model_file import load
from modelling.recordings.read import read_recording
from modelling.system import System
from tests.benchmarks.diagnosis_growth import chain, hidden_in, made

pytestmark = needs_compiler


def with_friction(system: System, base: Fit, at: str, parameters: dict[str, float]) -> ExtendedModel:
    model = ExtendedModel(system, (), base.problem.bounds, base.values)
    return model.with_cause("coulomb_friction", at, parameters, base.problem.data.sampling_interval)


@pytest.mark.long
def test_friction_of_a_short_recording_is_not_stribeck() -> None:
    """2 s tell the drag badly: the rest drifts away from either kind, from the simpler one by chance a little more."""
    drive = chain(3, 4)
    system, recording = made(drive, hidden_in(drive, "coulomb_friction"), 2.0)
    found = diagnose(system, [recording])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("coulomb_friction", "inertias.part1")]
    own = found.causes[0].parameters["torque"]
    assert abs(own.value - 6.0) < 4 * own.standard_uncertainty < 0.1


def test_sharp_friction_is_not_two_causes(tmp_path: Path) -> None:
    """With few steps a sample the friction turns so smoothly that its fit is not at the noise."""
    case = make_case("two_mass", ["coulomb_friction"], 30.0, "normal", 7, 2.0, 500.0)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    recording = read_recording(tmp_path / "recording.csv", system)
    found = diagnose(system, [recording])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("coulomb_friction", "inertias.motor")]
    for key, value in case.answer["parameters"].items():
        own = found.causes[0].parameters[key]
        assert abs(own.value - value) < 4 * own.standard_uncertainty


def test_friction_is_sharpened_while_that_pays(tmp_path: Path) -> None:
    case = make_case("two_mass", ["coulomb_friction"], 30.0, "normal", 7, 2.0, 500.0)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    data, _ = prepare_data(system, [read_recording(tmp_path / "recording.csv", system)])
    base = solve(*base_problem(system, data))
    assert with_sharper_friction(base) is base  # no friction
    trial = with_friction(system, base, "inertias.motor", {"torque": 0.35, "torque_reverse": 0.65})
    coarse = fit_extended(trial, base)
    fine = with_sharper_friction(coarse, FINAL_STEPS)
    assert fine.problem.stick_speed < coarse.problem.stick_speed / 3
    assert fine.cost < coarse.cost - 50
    assert fine.problem.steps_per_second * np.diff(data.segments[0].time).mean() <= FINAL_STEPS * 1.01
    assert with_sharper_friction(fine, FINAL_STEPS).cost == fine.cost


def test_stick_slip_comes_to_the_noise_before_a_further_cause_is_sought(tmp_path: Path) -> None:
    """A light inertia held by strong friction creeps where the friction turns smoothly."""
    case = make_case("test_bed", ["coulomb_friction"], "plain", "high", 380891909, 4.0, 500.0)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    data, _ = prepare_data(system, [read_recording(tmp_path / "recording.csv", system).cut(0, 2.8)])
    base = solve(*base_problem(system, data))
    truth = case.answer["parameters"]
    near = {key: 1.02 * value for key, value in truth.items()}
    trial = with_friction(system, base, "inertias.differential", near)
    coarse = Hypothesis(trial, fit_extended(trial, base))
    assert not at_noise(coarse)
    sharp = with_sharpest_friction(coarse)
    assert at_noise(sharp)
    assert with_sharpest_friction(sharp) is sharp
    numbers = estimates(sharp.fit)
    for key, value in truth.items():
        own = numbers[f"inertias.differential.coulomb_friction.{key}"]
        assert abs(own.value - value) < 4 * own.standard_uncertainty < 0.05 * value
