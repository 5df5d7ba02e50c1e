"""Shapes of manoeuvres and what their tables may hold."""

import numpy as np
import pytest

from modelling.bed.manoeuvres import KINDS, BackOut, DriveAway, Kick, Step, Sweep, TipIn, from_table
from modelling.common.errors import InputError

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
