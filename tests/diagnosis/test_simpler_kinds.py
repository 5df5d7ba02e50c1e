"""An effect that passes for a simpler one is not named where the simpler one is hidden."""

from pathlib import Path

import numpy as np
import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import solve
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.hypotheses import Hypothesis, at_noise
from matching.diagnosis.moves import Search
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import fit_extended
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import UnseenData, blocks_for
from modelling.effects import EFFECTS
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording

DRIVE = {
    "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": 300, "damping": 0.6}},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {"motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 0.02}},
}


@pytest.mark.parametrize(
    ("kind", "at", "parameters", "wanted"),
    [
        ("hysteresis", "shafts.link", {"torque": 50.0, "angle": 0.5}, [("shafts.link.stiffness", 400.0)]),
        (
            "compliance", "shafts.link", {"stiffness": 600.0, "J": 0.02},
            [("shafts.link.stiffness", 200.0), ("inertias.load.J", 1.02)],
        ),
        (
            "relaxation", "shafts.link", {"stiffness": 100.0, "time_constant": 0.02},
            [("shafts.link.stiffness", 400.0), ("shafts.link.damping", 2.6)],
        ),
        (
            "parameter_drift", "shafts.link.stiffness", {"change": 0.2, "time_constant": 0.1},
            [("shafts.link.stiffness", 360.0)],
        ),
    ],
)  # fmt: skip
def test_springs_and_inertias_in_disguise(kind: str, at: str, parameters: dict, wanted: list) -> None:
    system = from_dict(DRIVE)
    value = {name: quantity.value for name, quantity in system.parameters.items()}
    found = list(EFFECTS[kind].simpler(at, parameters, value, system))
    assert [one[:2] for one in found] == [("wrong_parameter", name) for name, _ in wanted]
    assert [one[2]["value"] for one in found] == pytest.approx([own for _, own in wanted])


def test_simpler_kinds_exist_and_have_fewer_parameters() -> None:
    system = from_dict(DRIVE)
    value = {name: quantity.value for name, quantity in system.parameters.items()}
    for kind, own in EFFECTS.items():
        places = own.places(system)
        if not places:
            continue
        for simpler, at, parameters in own.simpler(places[0], dict.fromkeys(own.parameters, 1.0), value, system):
            assert at in EFFECTS[simpler].places(system), kind
            assert set(parameters) <= set(EFFECTS[simpler].parameters)
            assert len(parameters) < len(own.parameters)


def test_what_is_equal_in_both_directions_or_throughout_is_simpler() -> None:
    for kind, at, parameters, simpler in (
        ("coulomb_friction", "inertias.load", {"torque": 2.0, "torque_reverse": 4.0}, {"torque": 3.0}),
        ("gear_loss", "shafts.link", {"efficiency": 0.9, "efficiency_reverse": 0.8}, {"efficiency": 0.85}),
        ("gain_drift", "inputs.motor_torque", {"change": -0.1, "time_constant": 1.0}, {"factor": 0.9}),
    ):
        (found,) = EFFECTS[kind].simpler(at, parameters, {}, from_dict(DRIVE))
        assert (found.at, found.parameters) == (at, pytest.approx(simpler))
    assert not list(EFFECTS["coulomb_friction"].simpler("inertias.load", {"torque": 2.0}, {}, from_dict(DRIVE)))


ROTOR = {
    "inertias": {"rotor": {"J": {"value": 0.5, "tolerance": 0.4}, "drag": {"value": 0.2, "tolerance": 0.6}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.02}},
}
STEP, EVERY, SECONDS = 5e-4, 10, 12.0


def rotor(sliding: float, breakaway: float, seed: int) -> Recording:
    """A rotor with dry friction, and a torque of eight waves that nobody knows; explicit steps, friction that takes at
    most what turns the rotor within one."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.3, 6.0, (2, 8)), rng.uniform(0, 2 * np.pi, (2, 8))
    time = np.arange(0, SECONDS, STEP)
    put, unknown = np.sin(2 * np.pi * frequency[:, :, None] * time + phase[:, :, None]).sum(axis=1)
    put, unknown = 1.2 * put, 0.06 * unknown
    speeds, speed = [], 0.0
    for torque in put + unknown:
        speeds.append(speed)
        free = speed + STEP * (torque - 0.3 * speed) / 0.4
        rubs = sliding + (breakaway - sliding) * np.exp(-((speed / 0.4) ** 2))
        speed = float(np.sign(free) * max(abs(free) - STEP * rubs / 0.4, 0.0))
    noisy = np.array(speeds)[::EVERY] + 0.02 * rng.standard_normal(len(time[::EVERY]))
    return Recording(time[::EVERY], {"motor": put[::EVERY], "speed": noisy}, (), "made", {})


@needs_compiler
@pytest.mark.parametrize(("breakaway", "wanted"), [(0.8, "coulomb_friction"), (2.0, "stribeck_friction")])
def test_a_kind_yields_to_a_simpler_one_beside_an_error_of_the_model(breakaway: float, wanted: str) -> None:
    """The further parameters take something of the unknown torque, which unseen data do not have."""
    system = from_dict(ROTOR)
    base = solve(*base_problem(system, prepare_data(system, [rotor(0.8, breakaway, 11)])[0]))
    model = ExtendedModel(system, (), base.problem.bounds, base.values)
    first = {"torque": 0.4, "breakaway": 1.2, "speed": 0.2}
    model = model.with_cause("stribeck_friction", "inertias.rotor", first, STEP * EVERY)
    rich = Hypothesis(model, fit_extended(model, base))
    assert not at_noise(rich)
    unseen = UnseenData(blocks_for(base, DiagnosisSettings()), DiagnosisSettings())
    found = Search(system, base, unseen, lambda _: None, ()).simplified(rich)
    assert found.places == {(wanted, "inertias.rotor")}


@pytest.mark.long
@needs_compiler
def test_stiffness_far_off_is_not_taken_for_hysteresis(tmp_path: Path) -> None:
    """From 284 N·m/rad no fit finds to 590; hysteresis of a large angle does, and is told to be the spring it is."""
    case = make_case("two_mass", ["wrong_parameter"], "plain", "high", 47556859, duration=8.0, moving=True, missing=1)
    case.write(tmp_path)
    system = load(tmp_path / "model.toml")
    found = diagnose(system, [read_recording(tmp_path / "recording.csv", system)])
    assert [(cause.kind, cause.at) for cause in found.causes] == [("wrong_parameter", case.answer["at"])]
    own = found.causes[0].parameters["value"]
    assert abs(own.value - case.answer["parameters"]["value"]) < 4 * own.standard_uncertainty
