"""Vehicle and bed from the recordings of the example, whose true values are known."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from result_schema import check_schema

from matching.bed.identify import recorded_vehicle
from matching.bed.measured import MeasuredFunction
from matching.bed.simulated_bed import with_quantities
from matching.bed.verify import Figures, drawn_vehicles, judged
from matching.cli import main
from matching.match.box import Box, Uncertain
from matching.match.case_file import load_case
from matching.match.loop import vehicle_response
from modelling.errors import InputError
from modelling.system import Quantity

FOLDER = Path(__file__).parents[2] / "examples" / "from_recordings"
TRUTH = tomllib.loads((FOLDER / "truth.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify")
    command = ["identify", str(FOLDER / "case.toml"), "--out", str(folder)]
    assert main([*command, "--vehicle", str(FOLDER / "road.csv"), "--bed", str(FOLDER / "bed.csv")]) == 0
    return folder


def test_the_case_holds_the_true_values_within_what_it_states(out):
    """Half-widths are k = 2; thirteen values, three of them of one fit whose errors go together."""
    case = load_case(out / "case.toml")
    box = {own.name: own for own in case.uncertainty.uncertain}
    known = case.rig.parameters
    for name, value in (TRUTH["car"] | TRUTH["bed"]).items():
        own = box.get(f"rig.{name}" if name in known else f"vehicle.{name}")
        if own is not None:
            assert abs(own.value - value) < 2 * own.half_width, name
    assert abs(case.loop.dynamometers[0].torque_gain / TRUTH["loop"]["torque_gain"] - 1) < 0.002
    assert abs(case.loop["dead_time"] - TRUTH["loop"]["dead_time"]) < 2e-5
    assert case.vehicle.parameters["inertias.motor.J"].value == known["inertias.motor.J"].value
    assert box["vehicle.shafts.tyre.stiffness"].half_width < 0.1 * 0.15 * 8000


def test_what_was_not_recorded_is_said_and_every_step_is_kept(out):
    result = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    assert "no recording holds road: it is taken as zero on the road" in result["vehicle"]["notes"]
    assert {path.name for path in (out / "vehicle").iterdir()} >= {"diagnosis.json", "extended.toml", "case.toml"}
    before = {row["name"]: row["before"] for row in result["vehicle"]["values"]}
    assert before["vehicle.inertias.body.J"] == 40
    check_schema("identify", result)


def test_a_diagnosis_whose_time_is_over_says_so_and_leaves_a_case(tmp_path, out):
    """No fit makes a step; the values stay as stated, and the case can be matched all the same."""
    command = ["identify", str(FOLDER / "case.toml"), "--bed", str(FOLDER / "bed.csv"), "--diagnosis-limit", "1e-6"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    early = json.loads((tmp_path / "out" / "identification.json").read_text(encoding="utf-8"))["bed"]
    assert early["ended_early"] == 1e-6
    assert "--diagnosis-limit" in early["notes"][0]
    assert load_case(tmp_path / "out" / "case.toml").rig.parameters
    whole = json.loads((out / "identification.json").read_text(encoding="utf-8"))["bed"]
    assert whole["ended_early"] is None
    assert not any("--diagnosis-limit" in note for note in whole["notes"])


@pytest.mark.long
def test_a_channel_file_reads_what_another_logger_wrote(tmp_path):
    """Other names, a sign and a unit: the errors of the stated model are those of the plain recording."""
    lines = (FOLDER / "bed.csv").read_text(encoding="utf-8").splitlines()
    head, table = [name.split(" ")[0] for name in lines[0].split(",")], np.loadtxt(lines[1:], delimiter=",")
    table[:, head.index("motor_speed")] *= 30 / np.pi
    table[:, head.index("flange_torque")] *= -1
    called = {"motor_speed": "n_EM", "flange_torque": "M_fl"}
    other, file = tmp_path / "other.csv", tmp_path / "channels.toml"
    names = ",".join(called.get(name, name) for name in head)
    np.savetxt(other, table, delimiter=",", header=names, comments="", fmt="%.12g")
    said = 'motor_speed = { channel = "n_EM", unit = "1/min" }\nflange_torque = { channel = "M_fl", sign = -1 }\n'
    file.write_text(f"[channels]\n{said}", encoding="utf-8")

    def errors(out, bed, *more):
        command = ["identify", str(FOLDER / "case.toml"), "--diagnosis-limit", "1e-6", "--bed", str(bed), *more]
        assert main([*command, "--out", str(tmp_path / out)]) == 0
        found = json.loads((tmp_path / out / "bed" / "diagnosis.json").read_text(encoding="utf-8"))
        return {sensor: error["before"] for sensor, error in found["errors"].items()}

    plain = errors("plain", FOLDER / "bed.csv")
    assert errors("mapped", other, "--channels", str(file)) == pytest.approx(plain, rel=1e-6)
    assert set(plain) - set(errors("unmapped", other)) == set(called), "names of another logger are not guessed"


def test_without_a_recording_or_with_nothing_uncertain_one_line_says_so(tmp_path, capsys):
    assert main(["identify", str(FOLDER / "case.toml"), "--out", str(tmp_path / "out")]) == 2
    assert "no recording is given" in capsys.readouterr().err
    case = load_case(FOLDER / "case.toml")
    known = {name: Quantity(quantity.value) for name, quantity in case.vehicle.parameters.items()}
    case = replace(case, vehicle=with_quantities(case.vehicle, known), uncertainty=Box())
    with pytest.raises(InputError, match="nothing of it is uncertain"):
        recorded_vehicle(case, [FOLDER / "road.csv"])


def test_what_is_not_known_of_the_vehicle_widens_a_measured_error():
    """Tyre stiffness known to ±a: a bed that answers exactly like the vehicle has an error within what that makes."""
    case = load_case(FOLDER / "case.toml")
    frequencies = np.geomspace(2, 30, 60)
    H = vehicle_response(case, {}, frequencies)[:, 1]
    measured = MeasuredFunction(frequencies, H, np.zeros((60, 1)), np.ones(60))
    spreads = []
    for share in (0.0, 0.02, 0.04):
        width = share * 8000
        box = Box((Uncertain("vehicle.shafts.tyre.stiffness", 8000.0, width),) if width else ())
        drawn = drawn_vehicles(replace(case, uncertainty=box), frequencies)[:, :, 1]
        figures = Figures.of(measured, H, H, (2.0, 30.0), drawn)
        spreads.append(judged("motor", [figures], 0.1, 0.1).uncertainty)
    assert spreads[0] < 1e-12
    ends = [vehicle_response(case, {"vehicle.shafts.tyre.stiffness": 8000.0 * (1 + s)}, frequencies)[:, 1]
            for s in (-0.04, 0.04)]  # fmt: skip
    largest = max(np.sqrt(np.mean(np.abs(np.log(H / end)) ** 2)) for end in ends)
    assert 0 < spreads[1] < spreads[2] < largest
