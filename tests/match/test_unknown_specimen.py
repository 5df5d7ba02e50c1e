"""A case whose specimen the controller does not know: what it reads, what its law depends on, what a match states."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.match.case_file import case_files, case_from_tables, load_case
from matching.match.loop import control_law, linear_bed
from matching.match.match import match
from matching.match.operating_range import at_speed, law_over_speed
from matching.match.variables import SearchSettings
from matching.report.match import key_figures
from modelling.bed.vehicle import cut
from modelling.errors import InputError
from modelling.toml import read_toml

EXAMPLES = Path(__file__).parents[2] / "examples"
BEYOND = {"inertias.motor.J": 3.0, "inertias.gearbox.J": 0.3, "shafts.gear_mesh.stiffness": 0.5}  # factors


def case_of(example, **loop):
    file = EXAMPLES / example
    data = read_toml(file)
    data["loop"] |= {"specimen": "unknown"} | loop
    return case_from_tables(data, str(file))


def with_other_specimen(case):
    """The case with another motor and gearbox, in vehicle and rig alike."""
    values = {name: factor * case.rig.parameters[name].value for name, factor in BEYOND.items()}
    vehicle, rig = case.vehicle.with_values(values), case.rig.with_values(values)
    return replace(case, vehicle=vehicle, rig=rig, residual_vehicle=cut(vehicle, rig))


def matrices(law):
    return [getattr(law, name) for name in ("A", "Bw", "Bs", "K", "Dw", "L", "E")]


def test_what_lies_beyond_does_not_reach_the_controller():
    case = case_of("road_to_rig/observer.toml")
    assert case.loop.measured == case.loop.further_sensors == ()
    law = control_law(linear_bed(case))
    assert set(law.sensors) == {
        "flange_left_torque", "flange_right_torque", "rotor_left_speed", "rotor_right_speed",
    }  # fmt: skip
    assert set(law.known) == {"road_left", "road_right"}
    assert case.tolerance == case.unmeasured_tolerance
    (note,) = [one for one in case.notes if "unknown" in one]
    assert "ends at shafts.gear_output, the torque on differential is unmeasured" in note
    assert "motor_torque, motor_speed" in note


def test_the_law_is_the_same_for_any_specimen():
    """Three times the motor's inertia changes nothing of the law, and much of that of a known specimen."""
    for specimen, same in (("unknown", True), ("known", False)):
        case = case_of("road_to_rig/observer.toml", specimen=specimen)
        one, other = (matrices(control_law(linear_bed(each))) for each in (case, with_other_specimen(case)))
        equal = all(np.allclose(a, b, rtol=1e-8, atol=1e-10 * np.abs(a).max()) for a, b in zip(one, other, strict=True))
        assert equal == same, specimen


@pytest.mark.long
def test_the_law_over_a_range_is_the_same_for_any_specimen():
    case = case_of("drive_away/case.toml")
    laws = [law_over_speed(each) for each in (case, with_other_specimen(case))]
    for one, other in zip(laws[0].laws, laws[1].laws, strict=True):
        for a, b in zip(matrices(one), matrices(other), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-8 * np.abs(a).max())
    assert at_speed(case, 10.0).loop.specimen == "unknown"


def test_a_written_case_keeps_it(tmp_path):
    case = case_of("road_to_rig/observer.toml")
    for name, text in case_files(case).items():
        (tmp_path / name).write_text(text)
    again = load_case(tmp_path / "case.toml")
    assert again.loop.specimen == "unknown"
    assert set(again.loop.beyond) == set(case.loop.beyond) == {"motor_torque", "motor_speed"}
    assert again.loop.measured == again.loop.further_sensors == ()


def test_without_a_gear_the_whole_rig_is_known():
    case = case_of("from_recordings/case.toml")
    assert case.loop.specimen == "known"
    assert case.loop.measured == ("motor_torque",)
    assert any("no gear, clutch or converter lies behind" in note for note in case.notes)


def test_a_structure_without_a_model_of_the_rig_is_refused():
    data = read_toml(EXAMPLES / "road_to_rig" / "observer.toml")
    data["loop"] = {"structure": "pi", "specimen": "unknown"}
    with pytest.raises(InputError, match=r"loop\.specimen: is 'unknown', and structure 'pi' has no model of it"):
        case_from_tables(data, str(EXAMPLES / "road_to_rig" / "observer.toml"))


@pytest.mark.long
def test_a_match_states_what_it_costs_not_to_know_the_specimen():
    case = case_of("road_to_rig/observer.toml")
    target = replace(case.targets[1], frequency_tolerance=0.1, damping_tolerance=0.5)
    case = replace(case, targets=(case.targets[0], target), limits={**case.limits, "modulus_margin": 0.4})
    result = match(case, beds=40, settings=SearchSettings(emulated=0.0))
    known = result.response_error.specimen_known
    assert known is not None
    assert known[0] < 0.1 * result.response_error.after
    assert result.to_dict()["response_error"]["specimen_known"] == list(known)
    rows = [row[0] for row in key_figures(result.to_dict())]
    assert "  with the specimen known: measured, unmeasured" in rows
    beds = result.verification.beds
    assert beds is not None
    assert beds.stable == beds.drawn == 40
    assert not result.remedies
