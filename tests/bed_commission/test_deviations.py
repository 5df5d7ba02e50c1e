"""What the check of the channels measures, on a bed that is integrated here by the exact solution of its own equations.

The bed of ``small_bed``: motor, adapter, rotor on two shafts; its recording is made by matrix exponentials between
samples, with commands that are late, lags and noise. Nothing of the program's model makes the data.
"""

from pathlib import Path

import numpy as np
import pytest
import small_bed
from scipy.linalg import expm
from virtual_bed.reference_circle import CASE as REFERENCE

from matching.bed import commission as circle
from matching.bed.channels import channel_recording, judge_channels, plan_channels
from matching.bed.excite import bed_inputs
from matching.bed.identify import measured_case
from matching.bed.simulated_bed import FmuBed, bed_system
from matching.bed.stated import Deviation
from matching.cli import main
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from modelling.recordings.read import read_recording
from modelling.recordings.recording import Recording
from tests.campaign.checked_beds import healthy

EXAMPLES = Path(__file__).parents[2] / "examples"
STEP, NOISE = 1e-3, {"speed": 0.02, "torque": 0.2}
LIMIT = "dynamometer_speed = 600\n"


def own_bed(plan, rng, change):
    """Readings by name of a bed whose quantities are all off by up to 4 %; ``change`` moves one of them.

    Dry ``friction`` (N·m) of the motor takes speed from it in every step, and never turns it round.
    """
    true = {"motor": 0.5, "adapter": 0.05, "rotor": 0.9, "side": 4000.0, "flange": 1e5, "gain": 1.0, "late": 1.8e-3,
            "friction": 0.0}  # fmt: skip
    for name in true:
        true[name] *= 1 + (rng.uniform(-0.04, 0.04) if name not in ("gain", "late") else rng.uniform(-0.02, 0.02))
    gains = dict.fromkeys(("motor_speed", "side_torque", "flange_torque", "rotor_speed", "motor_torque"), 1.0)
    change(true, gains)
    J = np.array([true["motor"], true["adapter"], true["rotor"]])
    k, d, drag = (true["side"], true["flange"]), (2.0, 10.0), (0.01, 0.0, 0.1)
    A, B = np.zeros((9, 9)), np.zeros((9, 2))  # angles, speeds, torque of the dynamometer, flange's filter, side's rest
    A[0:3, 3:6] = np.eye(3)
    for i, (a, b) in enumerate(((0, 1), (1, 2))):
        twist = np.zeros(9)
        twist[[a, b, 3 + a, 3 + b]] = k[i], -k[i], d[i], -d[i]
        A[3 + a] -= twist / J[a]
        A[3 + b] += twist / J[b]
    A[[3, 4, 5], [3, 4, 5]] -= np.array(drag) / J
    A[5, 6] += 1 / J[2]
    A[6, 6], B[6, 1] = -1 / 0.002, true["gain"] / 0.002
    flange = np.array([0, k[1], -k[1], 0, d[1], -d[1], 0, 0, 0])
    A[7], A[7, 7] = flange / 0.0005, -1 / 0.0005
    B[3, 0] = gains.pop("motor_torque") / J[0]
    fine = 20
    h = STEP / fine
    M = expm(np.block([[A, B], [np.zeros((2, 11))]]) * h)
    sent = np.stack([plan.torques[:, plan.inputs.index(name)] for name in ("motor_torque", "dyno")], axis=1)
    time = np.arange(len(sent)) * STEP
    middle = (np.arange(len(sent) * fine) + 0.5) * h
    acting = np.stack([np.interp(middle, time, sent[:, 0]), np.interp(middle - true["late"], time, sent[:, 1])], axis=1)
    x, rows = np.zeros(9), []
    for n, now in enumerate(acting):
        if n % fine == 0:
            rows.append(x)
        x = M[:9, :9] @ x + M[:9, 9:] @ now
        x[3] = np.sign(x[3]) * max(abs(x[3]) - true["friction"] * h / J[0], 0.0)
    x = np.array(rows)
    side = x @ np.array([k[0], -k[0], 0, d[0], -d[0], 0, 0, 0, 0])
    truth = {"motor_speed": x[:, 3], "side_torque": side, "flange_torque": x[:, 7], "rotor_speed": x[:, 5]}
    read = {name: gains[name] * values + NOISE[name.split("_")[1]] * rng.standard_normal(len(values))
            for name, values in truth.items()}  # fmt: skip
    commands = dict(zip(("motor_torque", "dyno"), sent.T, strict=True))
    return true, Recording(time, {**commands, **read}, {}, "own")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    return load_case(small_bed.write(folder, small_bed.CASE + LIMIT))


def checked(case, change, seed=5):
    true, recording = own_bed(plan_channels(case), np.random.default_rng(seed), change)
    return true, judge_channels(case, recording)


@pytest.mark.parametrize(
    ("channel", "factor", "words"),
    [
        pytest.param("motor_speed", 0.5, "reads half", marks=pytest.mark.long),
        pytest.param("flange_torque", 0.7375621, "lbf·ft", marks=pytest.mark.long),
        pytest.param("side_torque", 0.6, "times as large", marks=pytest.mark.long),
    ],
)
def test_any_factor_of_a_sensor_is_named(case, channel, factor, words):
    _, found = checked(case, lambda _, gains: gains.update({channel: factor}))
    assert [one.channel for one in found.wrong] == [channel]
    assert words in found.sentence()
    own = next(one for one in found.channels if one.name == channel)
    assert abs(own.gain - factor) < 3 * own.gain_uncertainty


def test_a_wrong_channel_is_exit_code_3_with_its_figure(case, tmp_path, capsys):
    _, recording = own_bed(
        plan_channels(case), np.random.default_rng(7), lambda _, gains: gains.update(motor_speed=0.5)
    )
    names = ["time", *recording.channels]
    table = np.column_stack([recording.time, *recording.channels.values()])
    np.savetxt(tmp_path / "check.csv", table, delimiter=",", header=",".join(names), comments="")
    command = ["verify", str(case.path), str(tmp_path / "check.csv"), "--channel-check", "--out", str(tmp_path / "out")]
    assert main(command) == 3
    assert "motor_speed reads half" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "What a wrong channel reads in the check" in page


def test_a_signal_ends_a_commissioning_with_what_is_known(case, tmp_path, monkeypatch):
    told = list[int]()
    (tmp_path / "bed").mkdir()
    monkeypatch.setattr(circle, "interrupted", told.append)

    def signalled(*_):
        raise KeyboardInterrupt(15)

    monkeypatch.setattr(circle.Circle, "_checked", signalled)
    found = circle.Circle(tmp_path / "out", tmp_path / "bed", circle.CommissionOrder()).run(Path(case.path))
    assert told == [15]
    assert not found.rounds
    assert "ended from outside" in found.end


@pytest.mark.long
def test_a_torque_that_is_not_given_is_a_wrong_channel(case):
    _, found = checked(case, lambda _, gains: gains.update(motor_torque=0.0))
    assert [one.channel for one in found.wrong] == ["motor_torque"]
    assert not found.right


def test_nothing_is_invented_on_a_bed_within_its_tolerances(case):
    true, found = checked(case, lambda *_: None)
    assert found.right
    assert found.explained
    assert not found.off
    for name in ("motor", "rotor"):
        own = next(one for one in found.measured if one.name == f"rig.inertias.{name}.J")
        assert abs(own.value - true[name]) < 3 * own.uncertainty


@pytest.mark.long
def test_a_late_dynamometer_enters_the_first_match(case):
    true, found = checked(case, lambda true, _: true.update(late=true["late"] + 3e-3))
    assert [one.name for one in found.off] == ["dynamometers.dyno.dead_time"]
    made, rows = measured_case(case, found.measured)
    own = next(row for row in rows if row.name == "dynamometers.dyno.dead_time")
    expected = true["late"] + STEP / 2  # and half a step of hold
    assert abs(made.loop["dead_time"] - expected) < 1.5 * own.half_width
    assert own.half_width < 2e-4


def test_a_dynamometer_that_is_not_told_keeps_its_dead_time():
    case = load_case(EXAMPLES / "road_to_rig" / "observer.toml")
    seen = Deviation("dynamometers.right.dead_time", 0.003, 0.006, 3e-4, 5e-4, beyond=True)
    made, rows = measured_case(case, [seen])
    assert [row.name for row in rows] == [seen.name]
    assert [part.dead_time for part in made.loop.dynamometers] == [0.003, 0.006]


@pytest.mark.parametrize(
    ("seed", "friction", "late"),
    [
        pytest.param(11, 1.3, 1.2e-3),
        pytest.param(12, 0.6, 0.0, marks=pytest.mark.long),
        pytest.param(13, 2.5, 2.5e-3, marks=pytest.mark.long),
    ],
)
def test_dry_friction_bends_nothing_and_hides_nothing(case, seed, friction, late):
    def change(true, _):
        true.update(friction=friction, late=true["late"] + late)

    true, found = checked(case, change, seed)
    assert [one.name for one in found.off] == ["dynamometers.dyno.dead_time"] * (late > 0)
    names = {"motor": "rig.inertias.motor.J", "rotor": "rig.inertias.rotor.J", "side": "rig.shafts.side.stiffness",
             "gain": "dynamometers.dyno.torque_gain", "friction": "inertias.motor.friction"}  # fmt: skip
    for name, told in names.items():
        own = next(one for one in found.measured if one.name == told)
        assert abs(own.value - true[name]) < 3 * own.uncertainty, name


@pytest.mark.long
def test_a_soft_shaft_is_named_with_its_stiffness(case):
    true, found = checked(case, lambda true, _: true.update(side=0.3 * true["side"]))
    (own,) = found.off
    assert own.name == "rig.shafts.side.stiffness"
    assert abs(own.value - true["side"]) < 3 * own.uncertainty


@pytest.mark.long
@pytest.mark.parametrize(("shaft", "factor"), [("flange_left", 0.1), ("side_right", 0.3), ("flange_right", 0.25)])
def test_a_soft_shaft_of_two_in_a_row_is_not_taken_for_its_neighbour(shaft, factor, tmp_path):
    """Rubber for steel at one flange: side shaft and flange on either side of a light adapter look nearly alike."""
    drawn = np.random.default_rng([7, len(shaft), round(100 * factor)])
    reference = load_case(REFERENCE)
    virtual = healthy(reference, drawn, 3)
    name = f"shafts.{shaft}.stiffness"
    virtual.drive.values[name] *= factor
    plan, made = plan_channels(reference), exported_controller(reference)
    path = virtual.write(tmp_path / "bed.fmu", reference.loop["sample_time"])
    with FmuBed(path, bed_inputs(reference), [part.name for part in reference.rig.sensors]) as running:
        text, tripped = channel_recording(running, reference, made.law, made.running(), plan)
    (tmp_path / "recording.csv").write_text(text)
    found = judge_channels(
        reference, read_recording(tmp_path / "recording.csv", bed_system(reference)), tripped
    )  # fmt: skip
    assert found.right
    assert [one.name for one in found.off] == [f"rig.{name}"]
    assert abs(found.off[0].value - virtual.drive.values[name]) < 3 * found.off[0].uncertainty
