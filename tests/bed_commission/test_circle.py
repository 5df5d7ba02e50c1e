"""A commissioning on a bed that nobody modelled, on a folder, and stopped in between."""

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from needs import compiles
from plant.engine import compiler
from result_schema import check_schema
from small_bed import CASE, write
from virtual_bed.bed import Actuator, Reader, VirtualBed, drive_of
from virtual_bed.reference_circle import HeldSpeed

from matching.bed import commission as circle
from matching.bed.proof import plan_proof
from matching.bed.simulated_bed import FmuBed, FmuController, proof_recording
from matching.cli import main
from matching.export import tuned_case
from matching.match.exported import exported_controller
from modelling.bed.observer import NOISE
from modelling.errors import InputError

pytestmark = [compiles, pytest.mark.skipif(not (find_spec("fmpy") and compiler()), reason="needs FMPy, a C compiler")]
LIMITS = """
[response]
band = [5, 30]
compare = [
    { input = "motor_torque", sensor = "motor_speed" },
    { input = "motor_torque", sensor = "side_torque" },
]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = 50
duration = 2
[limits]
dynamometer_torque = 1500
dynamometer_speed = 120
"""


def match_of(folder, limits):
    """The directory of a match of the small bed, nothing of it tuned; its sensors state the noise that is usual."""
    folder.mkdir()
    write(folder, CASE[: CASE.index("[response]")] + limits)
    rig = (folder / "rig.toml").read_text()
    for kind, noise in NOISE.items():
        rig = rig.replace(f'measures = "{kind}"', f'measures = "{kind}"\nuncertainty = {noise}')
    (folder / "rig.toml").write_text(rig)
    (folder / "result.json").write_text(json.dumps({"status": "matched", "parameters": []}))
    return folder


@pytest.fixture(scope="module")
def matched(tmp_path_factory):
    return match_of(tmp_path_factory.mktemp("circle") / "match", LIMITS)


def bed(folder, gain):
    """The small bed with its true values, its own dead time and lags; ``gain`` of the dynamometer."""
    drive = drive_of(folder / "rig.toml", title="small")
    noise = {"motor_speed": 0.005, "side_torque": 0.2, "flange_torque": 0.2, "rotor_speed": 0.005}
    readers = {name: Reader(noise=size) for name, size in noise.items()}
    readers["flange_torque"].lag = 0.0005
    actuators = {"dyno": Actuator(delay=0.0018, lag=0.002, factor=gain)}
    return VirtualBed(drive, [], actuators, readers).write(folder.parent / f"bed_{gain:g}.fmu")


@pytest.fixture(scope="module")
def proven(matched):
    """Command and directory of a commissioning on a bed like its model."""
    out = matched.parent / "out"
    command = ["commission", str(matched), "--bed", str(bed(matched, 1.0)), "--out", str(out)]
    assert main(command) == 0
    return command, out


def test_a_bed_like_its_model_needs_one_round(proven):
    result = json.loads((proven[1] / "commission.json").read_text(encoding="utf-8"))
    assert result["status"] == "as_predicted"
    assert len(result["rounds"]) == 1
    assert "the match can make it" in result["end"] or "the uncertainty of this one" in result["end"]
    check_schema("commission", result)
    assert "as predicted" in (proven[1] / "report.html").read_text(encoding="utf-8")
    recorded = (proven[1] / "1_verify" / "recording.csv").read_text(encoding="utf-8").splitlines()[0]
    assert recorded.startswith("time [s],motor_torque [N*m],dyno [N*m],")  # the command, for a diagnosis


def test_it_goes_on_where_it_stopped(proven, monkeypatch):
    """What is done is not done again: neither run nor export."""
    command, out = proven
    first = (out / "commission.json").read_bytes()

    def never(*_, **__):
        raise AssertionError("done again")

    monkeypatch.setattr(circle, "proof_recording", never)
    monkeypatch.setattr(circle, "controller_fmu", never)
    assert main(command) == 0
    assert (out / "commission.json").read_bytes() == first


@pytest.mark.parametrize(
    "changed", [lambda folder: ["--bed", str(bed(folder, 0.9))], lambda _: ["--speed", "25"]], ids=["bed", "speed"]
)
def test_another_bed_or_another_speed_is_run_again(changed, proven, matched, tmp_path, monkeypatch, capsys):
    def begun(*_, **__):
        raise InputError("bed", "is run again", "")

    monkeypatch.setattr(circle, "proof_recording", begun)
    command, out = proven
    shutil.copytree(out, tmp_path / "out")  # what is known after each stage is written there
    assert main([*command[:-1], str(tmp_path / "out"), *changed(matched)]) == 2
    assert "is run again" in capsys.readouterr().err


def test_a_folder_says_what_to_record_and_takes_it(proven, matched, tmp_path, capsys):
    out, folder = tmp_path / "out", tmp_path / "recordings"
    folder.mkdir()
    command = ["commission", str(matched), "--bed", str(folder), "--rounds", "1", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert said.startswith("WAITING")
    assert str(folder / "1_channels.csv") in said
    assert (folder / "1_channels_excitation.csv").exists()
    shutil.copy(proven[1] / "1_channels" / "recording.csv", folder / "1_channels.csv")
    assert main(command) == 0
    said = capsys.readouterr().out
    assert str(folder / "1_verify.csv") in said
    assert (folder / "1_verify_excitation.csv").exists()
    shutil.copy(proven[1] / "1_verify" / "recording.csv", folder / "1_verify.csv")
    assert main(command) == 0
    assert capsys.readouterr().out.startswith("AS PREDICTED")
    first, *rows = (folder / "1_verify.csv").read_text(encoding="utf-8").splitlines()
    (folder / "1_verify.csv").write_text("\n".join([first, *rows[: len(rows) // 2]]), encoding="utf-8")
    assert main(command) == 0  # a better, here a shorter, recording in the place of the first is judged
    assert len((out / "1_verify" / "recording.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(rows) // 2
    (folder / "1_verify.csv").unlink()
    assert main(command) == 0
    assert not capsys.readouterr().out.startswith("WAITING")


@pytest.mark.long
def test_recordings_of_other_names_and_signs_are_read_by_a_channel_file(proven, matched, tmp_path, capsys):
    """A flange of the logger's own name and with the other sign: the check ends it, with a channel file all goes on."""
    folder, names = tmp_path / "recordings", tmp_path / "channels.toml"
    folder.mkdir()
    names.write_text('[channels]\nflange_torque = { channel = "M_fl", sign = -1 }\n', encoding="utf-8")

    def recorded(step, called):
        lines = (proven[1] / step / "recording.csv").read_text(encoding="utf-8").splitlines()
        table = np.loadtxt(lines[1:], delimiter=",")
        table[:, lines[0].split(",").index("flange_torque [N*m]")] *= -1
        head = lines[0].replace("flange_torque", called)
        np.savetxt(folder / f"{step}.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")

    def commission(out, *more):
        command = ["commission", str(matched), "--bed", str(folder), "--rounds", "1", "--out", str(tmp_path / out)]
        return main([*command, *more]), capsys.readouterr().out

    recorded("1_channels", "flange_torque")
    done, said = commission("without")
    assert done == 3
    assert "flange_torque has the wrong sign" in said
    recorded("1_channels", "M_fl")
    done, said = commission("out", "--channels", str(names))
    assert done == 0
    assert str(folder / "1_verify.csv") in said, "the channels are right: the proof is asked for"
    recorded("1_verify", "M_fl")
    done, said = commission("out", "--channels", str(names))
    assert done == 0
    assert said.startswith("AS PREDICTED")


def test_a_case_without_a_steady_speed_is_told_before_its_match(tmp_path, monkeypatch):
    monkeypatch.setattr(circle, "match", None)
    (tmp_path / "bed").mkdir()
    begun = circle.Circle(tmp_path / "out", tmp_path / "bed", circle.CommissionOrder())
    with pytest.raises(InputError, match=r"limits\.dynamometer_speed: is missing"):
        begun.run(write(tmp_path))


@pytest.mark.parametrize(("content", "wrong"), [(None, "does not exist"), (b"no archive", "cannot be read as an FMU")])
def test_a_bed_that_is_none(content, wrong, matched, tmp_path, capsys):
    path = tmp_path / "bed.fmu"
    if content is not None:
        path.write_bytes(content)
    assert main(["commission", str(matched), "--bed", str(path), "--out", str(tmp_path / "out")]) == 2
    assert wrong in capsys.readouterr().err


@pytest.mark.long
def test_a_wrong_torque_gain_is_found_and_the_second_round_is_better(tmp_path, monkeypatch):
    """The case allows the error, the bed is worse than it need be: a second round, and a third of the error at most.

    Begun again, nothing is planned.
    """
    matched = match_of(tmp_path / "match", LIMITS)
    out = tmp_path / "out"
    command = ["commission", str(matched), "--bed", str(bed(matched, 1.05)), "--out", str(out)]
    assert main(command) == 0
    result = json.loads((out / "commission.json").read_text(encoding="utf-8"))
    judged = [one.get("against_last_vehicle", one["verification"]) for one in result["rounds"]]
    errors = [one["errors"][0]["error"] for one in judged]
    assert errors[-1] < errors[0] / 3
    assert result["status"] == "as_predicted"
    assert result["best_round"] == len(errors)
    gain = result["rounds"][1]["identification"]["torque_gains"]["dyno"]
    assert gain == pytest.approx(1.05, abs=0.005)
    monkeypatch.delattr(circle, "plan_excitation")
    assert main(command) == 0
    assert json.loads((out / "commission.json").read_text(encoding="utf-8")) == result


def off(columns, name, factor):
    return {**columns, name: factor * columns[name]}


WRONG = {
    "sign of a sensor": (lambda c: off(c, "side_torque [N*m]", -1), "side_torque: has the wrong sign"),
    "sign of the motor": (lambda c: off(c, "motor_torque [N*m]", -1), "motor_torque: has the wrong sign"),
    "unit": (lambda c: off(c, "rotor_speed [rad/s]", 30 / np.pi), "rotor_speed: is probably in 1/min, not in rad/s"),
    "zeros": (lambda c: off(c, "motor_speed [rad/s]", 0), "motor_speed: does not move from 0: it is stuck"),
    "another bed": (lambda c: {**c, "flange_torque [N*m]": 4 * c["flange_torque [N*m]"],
                               "side_torque [N*m]": 4 * c["side_torque [N*m]"]}, "no single channel explains it"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_recording_is_named_and_not_judged(what, proven, matched, tmp_path, capsys):
    change, words = WRONG[what]
    path = proven[1] / "1_verify" / "recording.csv"
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    table = dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    wrong = tmp_path / "wrong.csv"
    rows = np.stack(list(change(table).values()), axis=1)
    np.savetxt(wrong, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    assert main(["verify", str(matched), str(wrong), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.out == ""
    assert not (tmp_path / "out").exists()


def test_another_excitation_is_told(proven, matched, tmp_path, capsys):
    folder = tmp_path / "recordings"
    folder.mkdir()
    lines = (proven[1] / "1_verify" / "recording.csv").read_text(encoding="utf-8").splitlines()
    table = np.loadtxt(lines[1:], delimiter=",")
    table[:, 1:] = table[::-1, 1:]
    np.savetxt(folder / "1_verify.csv", table, delimiter=",", header=lines[0], comments="", fmt="%.9g")
    command = ["commission", str(matched), "--bed", str(folder), "--rounds", "1", "--out", str(tmp_path / "out")]
    assert main([*command, "--skip-channel-check"]) == 2
    assert "is not the torque that was planned" in capsys.readouterr().err


class Deaf(FmuBed):
    """A bed whose dynamometer stays at the torque that it has after a second."""

    seconds, kept = 0.0, 0.0

    def step(self, commands, span):
        self.seconds += span
        if self.seconds < 1.0:
            self.kept = commands[0]
        super().step(np.array([self.kept, *commands[1:]]), span)


class Trusting(FmuController):
    """A controller that does not ask whether its torques are delivered: the recording has to tell."""

    def initialise(self, given):
        super().initialise({"undelivered_share": 0.0} | given)


@pytest.mark.parametrize(
    ("kind", "wrapped", "words"),
    [
        (FmuBed, HeldSpeed, "does not fit this controller: was emulation on"),
        (Deaf, lambda controller: controller, "dyno: was not followed by its dynamometer"),
    ],
)
def test_a_run_without_emulation_or_without_a_dynamometer_is_told(
    kind, wrapped, words, proven, matched, tmp_path, capsys
):
    case = tuned_case(matched).tuned
    law, speed = exported_controller(case).law, circle.plan_speed(case, circle.CommissionOrder())
    with (
        kind(Path(proven[0][3]), ["dyno", "motor_torque"], [sensor.name for sensor in case.rig.sensors]) as one,
        Trusting(proven[1] / "1_export" / "controller.fmu", law) as controller,
    ):
        text = proof_recording(one, case, law, wrapped(controller), plan_proof(case, speed), speed)
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["verify", str(matched), str(path), "--out", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
