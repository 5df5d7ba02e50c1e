"""Shapes of manoeuvres and what their tables may hold."""

import numpy as np
import pytest

from modelling.bed.manoeuvres import KINDS, BackOut, DriveAway, Kick, Step, Sweep, TipIn, from_table, read_manoeuvre
from modelling.errors import InputError

TIME = np.linspace(0, 3, 3001)


def test_tip_in_and_back_out_mirror_each_other():
    tip_in, back_out = (cls(amplitude=100, offset=-10, at=0.5, rise_time=0.1) for cls in (TipIn, BackOut))
    np.testing.assert_allclose(tip_in.torque([0, 0.5, 0.55, 0.6, 2]), [-10, -10, 40, 90, 90])
    np.testing.assert_allclose(tip_in.torque(TIME) + back_out.torque(TIME), 80.0)


def test_step_and_kick():
    np.testing.assert_allclose(Step(amplitude=5, at=1).torque([0.999, 1.0, 2]), [0, 5, 5])
    kick = Kick(amplitude=7, at=1, rise_time=0.05).torque(TIME)
    assert kick.max() == pytest.approx(7)
    assert kick.min() > -1e-12
    assert TIME[kick.argmax()] == pytest.approx(1.05)
    np.testing.assert_allclose(kick[TIME > 1.1], 0, atol=1e-12)


def test_drive_away_creeps_then_rises():
    torque = DriveAway(amplitude=200, creep=30, at=0.2, hold=0.4, rise_time=1).torque(TIME)
    assert torque[200] == 0
    assert torque[600] == pytest.approx(30)
    assert torque[-1] == pytest.approx(200)
    assert (np.diff(torque) > -1e-9).all()


def test_a_sweep_runs_through_its_band_evenly_in_octaves():
    time = np.linspace(0, 20, 200_001)
    torque = Sweep(amplitude=1, at=0, duration=20, first_frequency=1, last_frequency=16).torque(time)
    crossings = time[1:][np.diff(np.sign(torque)) != 0]
    frequency, middle = 0.5 / np.diff(crossings), (crossings[1:] + crossings[:-1]) / 2
    np.testing.assert_allclose(frequency[3:], 2 ** (middle[3:] / 5), rtol=0.02)


def test_tables_with_units():
    table = {"kind": "tip_in", "amplitude": "0.1 kN*m", "rise_time": "50 ms", "duration": 2}
    got = from_table(table, "case: manoeuvre")
    assert got == TipIn(amplitude=100, rise_time=0.05, duration=2)
    assert len(got.time(500.0)) == 1001
    inputs = got.inputs(got.time(), "motor_torque", {"brake_torque": -20})
    assert set(inputs) == {"motor_torque", "brake_torque"}
    assert (inputs["brake_torque"] == -20).all()


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_begins_at_rest_and_is_finite(kind):
    made = from_table({"kind": kind, "amplitude": 50}, "case")
    torque = made.torque(made.time())
    assert np.isfinite(torque).all()
    assert np.ptp(torque) >= 49
    if kind != "back_out":
        assert torque[0] == 0


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ({"kind": "tipin", "amplitude": 1}, "case.kind: 'tipin'.*did you mean 'tip_in'"),
        ({"amplitude": 1}, "case.kind"),
        ({"kind": "step"}, "'amplitude' is missing"),
        ({"kind": "step", "amplitude": 1, "rise_tme": 1}, "'rise_tme'"),
        ({"kind": "step", "amplitude": "5 kg"}, "case.amplitude: unit 'kg'"),
        ({"kind": "step", "amplitude": float("nan")}, "case.amplitude.*not finite"),
        ({"kind": "tip_in", "amplitude": 1, "rise_time": -1}, "case.rise_time: -1"),
        ({"kind": "step", "amplitude": 1, "at": 5, "duration": 2}, "case.duration: 2 s ends before"),
        ({"kind": "sweep", "amplitude": 1, "first_frequency": 9, "last_frequency": 3}, "is no band"),
        ([1, 2], "list where a table is expected"),
        ({"kind": ["step"], "amplitude": 1}, "case.kind"),
    ],
)
def test_wrong_tables(table, line):
    with pytest.raises(InputError, match=line):
        from_table(table, "case")


def torque_at(entry, times, folder=None, **options):
    made = read_manoeuvre(entry, "motor_torque", "case", folder, **options)
    return made, made.torque(np.array(times))


def test_ramps_follow_one_another():
    """Up to 100 N·m in 0.2 s, held 0.8 s, down to −40 N·m in 0.5 s and held there."""
    ramps = [{"to": 100, "over": 0.2, "hold": "800 ms"}, {"to": -40, "over": 0.5, "hold": 0.5}]
    made, torque = torque_at(ramps, [0, 0.1, 0.2, 0.9, 1.0, 1.25, 1.5, 2.0, 9.0])
    np.testing.assert_allclose(torque, [0, 50, 100, 100, 100, 30, -40, -40, -40], atol=1e-12)
    assert made.duration == 2.0
    assert made.amplitude == pytest.approx(140)


def test_segments_of_any_kind_keep_their_own_time():
    tip_in = {"kind": "tip_in", "amplitude": 80, "at": 0.5, "rise_time": 0.1, "duration": 1.5}
    back_out = {"kind": "back_out", "amplitude": 80, "at": 0.5, "rise_time": 0.1, "duration": 2}
    made, torque = torque_at([tip_in, back_out, {"to": 10, "over": 1}], [0.4, 0.55, 1.4, 1.9, 2.05, 3.4, 4.0])
    np.testing.assert_allclose(torque, [0, 40, 80, 80, 40, 0, 5], atol=1e-12)
    assert made.at == 0.5
    assert made.table()[1]["kind"] == "back_out"


def test_a_recorded_torque_is_straight_between_its_samples(tmp_path):
    (tmp_path / "trace.csv").write_text("time [s],motor_torque [kN*m]\n5,0.01\n5.5,0.03\n6.5,0.02\n")
    made, torque = torque_at({"file": "trace.csv"}, [0, 0.25, 0.5, 1.0, 9.0], tmp_path)
    np.testing.assert_allclose(torque, [10, 20, 30, 25, 20])
    assert made.duration == 1.5
    _, less = torque_at({"file": "trace.csv", "absolute": True}, [0, 0.25], tmp_path, held=10.0)
    np.testing.assert_allclose(less, [0, 10])
    (tmp_path / "again.csv").write_text(made.csv("motor_torque"))
    assert torque_at({"file": "again.csv"}, [0], tmp_path)[0] == made


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ([], "case: has no segments"),
        ([{"to": 1, "over": 1}, {"over": 1}], r"case\[2\]: 'to' is missing"),
        ([{"to": 1}], r"case\[1\]: takes no time"),
        ([{"to": 1, "over": -1, "hold": 3}], "takes no time"),
        ([{"to": 1, "ovr": 1}], "'ovr'.*did you mean 'over'"),
        ([3], r"case\[1\]: int where a table"),
        ({"file": "nowhere.csv"}, r"nowhere\.csv: does not exist"),
        ({"file": 3}, "case.file: is no text"),
        ({"file": "speed.csv"}, "has no column 'motor_torque'"),
        ({"file": "wrong.csv"}, "unit 'rad/s'"),
        ({"file": "wrong.csv", "absolute": 1}, "case.absolute"),
    ],
)
def test_wrong_segments_and_files(entry, line, tmp_path):
    (tmp_path / "speed.csv").write_text("time [s],speed [rad/s]\n0,1\n1,2\n")
    (tmp_path / "wrong.csv").write_text("time [s],motor_torque [rad/s]\n0,1\n1,2\n")
    with pytest.raises(InputError, match=line):
        torque_at(entry, [0], tmp_path)
