"""An effect that passes for a simpler one is not named where the simpler one is hidden."""

from pathlib import Path

import pytest
from plant.case import make_case
from plant.marks import needs_compiler

from matching.diagnosis.diagnose import diagnose
from modelling.effects import EFFECTS
from modelling.model_file import from_dict, load
from modelling.recordings.read import read_recording

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
