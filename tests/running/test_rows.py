"""Rows in time (:mod:`modelling.running`): C against NumPy, sensors against closed forms, plants of one's own."""

from dataclasses import replace

import numpy as np
import pytest
from plant.marks import needs_compiler
from scipy.integrate import solve_ivp
from small_bed import write

import rigmatch as rm
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection, bed_rows, vehicle_rows
from modelling.running import run as loop
from modelling.running.beds import BedRows
from modelling.running.controllers import ControllerRows, Schedule, unsupervised
from modelling.running.sensors import Sensing, SensorErrors


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return load_case(write(tmp_path_factory.mktemp("rows")))


def drawn_errors(names, rows, random):
    """Every error of a sensor on every row."""
    shape = rows, len(names)
    counts = np.where(["speed" in name for name in names], 2 * np.pi / 512, 0.0)
    out = np.sort(random.integers(300, 800, (2, *shape)), axis=0)
    return SensorErrors(
        tuple(names), 1 + 0.01 * random.normal(size=shape), 0.1 * random.normal(size=shape),
        0.2 * random.normal(size=shape), 0.05 * np.ones(shape), np.broadcast_to(counts, shape).copy(), out, 250, 300,
        120, 7,
    )  # fmt: skip


@needs_compiler
@pytest.mark.parametrize("gap", [0.0, 0.01])
def test_without_a_compiler_the_same_rows_do_the_same(case, gap, monkeypatch):
    """Drawn beds with play, noise, counts, zeros that drift and drop-outs through hold and emulation: to 1e-9."""
    random, controller = np.random.default_rng(3), exported_controller(case)
    rows = [
        Imperfection("", case.uncertainty.at(at), gap=gap * (1 + number), friction=1.0)
        for number, at in enumerate(case.uncertainty.draw(3, 5))
    ]
    names, count = controller.law.sensors, 900
    plant = bed_rows(case, names, rows, drawn_errors(names, 3, random))
    schedule = Schedule.held_first(200, count, np.zeros((1, 1)), plant.beds.trim)
    torque = {"motor_torque": 30.0 * random.normal(size=(9, 3)).repeat(100, axis=0)}

    def done():
        return rm.run(plant, ControllerRows(controller, schedule, 3), torque, torque, every=2, states=True)

    in_c = done()
    monkeypatch.setattr(loop, "compiler", lambda: None)
    in_numpy = done()
    assert (in_c.interpreted, in_numpy.interpreted) == (False, True)
    assert np.abs(in_c.commands).max() > 10
    for name in ("readings", "commands", "states"):
        one, other = getattr(in_c, name), getattr(in_numpy, name)
        # relative to what a signal reaches: an angle's rate times a stiff shaft is rounded where it is largest
        assert np.abs(one - other).max() <= 1e-9 * max(np.abs(other).max(), 1.0)
    np.testing.assert_array_equal(in_c.fault, in_numpy.fault)
    np.testing.assert_array_equal(in_c.fault_at, in_numpy.fault_at)


@pytest.mark.parametrize("compiled", [pytest.param(True, marks=needs_compiler), False])
def test_a_vehicle_moves_as_scipy_integrates_it(case, compiled, monkeypatch):
    """Motor, side shaft, wheel, tyre, body: written down here, integrated by another method."""
    if not compiled:
        monkeypatch.setattr(loop, "compiler", lambda: None)
    time = np.arange(600) * case.loop["sample_time"]
    torque = np.interp(time, [0.05, 0.1, 0.3, 0.31], [0.0, 40.0, 40.0, -10.0])
    found = rm.run(vehicle_rows(case, [Imperfection("")]), None, {"motor_torque": torque})

    def rates(t, x):
        angles, speeds = x[:3], x[3:]
        side = 4000 * (angles[0] - angles[1]) + 2 * (speeds[0] - speeds[1])
        tyre = 8000 * (angles[1] - angles[2]) + 30 * (speeds[1] - speeds[2])
        acting = np.interp(t, time, torque)
        push = [(acting - side - 0.01 * speeds[0]) / 0.5, (side - tyre) / 1.0, (tyre - 0.5 * speeds[2]) / 40]
        return np.concatenate([speeds, push])

    wanted = solve_ivp(rates, (0, time[-1]), np.zeros(6), t_eval=time, rtol=1e-9, atol=1e-11, max_step=1e-3).y
    assert found["motor_speed"][:, 0] == pytest.approx(wanted[3], abs=1e-5 * np.ptp(wanted[3]))


def sensing(**changes):
    errors = replace(SensorErrors.none(("n", "M"), 2), **{name: np.array(value) for name, value in changes.items()})
    return Sensing(replace(errors, drift_from=10, drift_samples=20), 1e-3)


def read(sensors, values):
    return np.array([sensors.read(np.array(values, float)) for _ in range(4001)])


def test_an_encoder_counts_and_loses_nothing():
    """A steady speed: each reading within a count a sample, the mean exact."""
    count, speed = 2 * np.pi / 8192, 12.34
    sensors = sensing(count=[[count, 0.0], [0.0, 0.0]])
    found = read(sensors, [[speed, speed], [50.0, 50.0]])
    assert np.abs(found[:, 0, 0] - speed).max() <= 1.001 * count / 1e-3
    assert np.ptp(found[:, 0, 0]) > 0.5
    assert found[:, 0, 0].mean() == pytest.approx(speed, abs=count / 4)
    assert (found[:, 0, 1] == speed).all()


def test_gain_zero_drift_noise_and_a_drop_out_are_what_they_are_called():
    out = np.full((2, 2, 2), 4000)
    out[0, 0, 1] = 3990
    sensors = sensing(
        gain=[[1.0, 1.01], [1.0, 1.0]], zero=[[0.0, 0.5], [0.0, 0.0]], drift=[[0.0, 2.0], [0.0, 0.0]],
        noise=[[0.3, 0.0], [0.0, 0.0]], out=out,
    )  # fmt: skip
    found = read(sensors, [[7.0, 7.0], [50.0, 50.0]])
    torque = found[:, 1, 0]
    assert torque[[0, 10]] == pytest.approx(1.01 * 50 + 0.5)
    assert torque[20] == pytest.approx(1.01 * 50 + 0.5 + 1.0)
    assert torque[30:3990] == pytest.approx(1.01 * 50 + 0.5 + 2.0)
    assert (torque[3990:4000] == 0).all()
    assert torque[4000] > 50
    assert np.std(found[:, 0, 0]) == pytest.approx(0.3, rel=0.05)
    assert (found[:, :, 1] == [7.0, 50.0]).all()


# --- Plants and controllers of one's own.


class Rotor:
    """A rotor of 0.5 kg·m² with drag on which a command and a load act: the exact solution over each span."""

    inputs, sensors, commands, count = ("load",), ("speed",), ("torque",), 2
    J, drag = 0.5, np.array([0.1, 0.4])

    def begin(self, torques):
        self.speed = np.zeros(2)

    def readings(self):
        return self.speed[None]

    def step(self, commands, torques, after, span):
        decay = np.exp(-self.drag / self.J * span)
        steady = (commands[0] + (torques[0] + after[0]) / 2) / self.drag
        self.speed = steady + (self.speed - steady) * decay


class Proportional:
    """Holds a speed; gives up where it is told to."""

    sensors, known = ("speed",), ("aim",)

    def __init__(self, gain, ends=None):
        self.gain, self.ends = gain, ends

    def step(self, sample, readings, known):
        return None if sample == self.ends else self.gain * (known - readings)


def test_a_plant_and_a_controller_of_ones_own_are_rows():
    """The steady speed is that of the closed form: gain times aim less load over gain plus drag."""
    assert isinstance(Rotor(), rm.Plant)
    assert isinstance(Proportional(1.0), rm.Controller)
    aim, load = np.full(4000, 30.0), np.full(4000, -3.0)
    found = rm.run(Rotor(), Proportional(2.0), {"load": load}, {"aim": aim}, sample_time=2e-3)
    assert found["speed"].shape == (4000, 2)
    assert found.time[-1] == pytest.approx(7.998)
    assert found["speed"][-1] == pytest.approx((2.0 * 30 - 3) / (2.0 + Rotor.drag), rel=1e-3)
    assert found["torque"][-1] == pytest.approx(2.0 * (30 - found["speed"][-1]), rel=1e-3)
    ended = rm.run(Rotor(), Proportional(2.0, 100), {"load": load}, {"aim": aim}, sample_time=2e-3)
    assert len(ended["speed"]) == 100


def test_a_controller_of_ones_own_drives_the_bed_of_a_case(case):
    class Hold:
        sensors, known = ("rotor_speed",), ()

        def step(self, sample, readings, known):
            return 5.0 * (10.0 - readings)

    found = rm.run(rm.bed(case, drawn=2), Hold(), samples=4000)
    assert found["rotor_speed"].shape == (4000, 3)
    assert found["rotor_speed"][-1] == pytest.approx([10.0] * 3, abs=0.5)


def test_the_exported_controller_drives_a_plant_of_ones_own(case):
    """The bed of the case, wrapped so that nothing of it is known: the same as its own rows."""

    class Wrapped:
        def __init__(self):
            self._own = rm.bed(case)
            self.inputs, self.sensors, self.commands = self._own.inputs, self._own.sensors, self._own.commands
            self.count = 1

        def begin(self, torques):
            self._own.begin(torques)

        def readings(self):
            return self._own.readings()

        def step(self, *arguments):
            self._own.step(*arguments)

    torque = {"motor_torque": np.where(np.arange(500) > 300, 20.0, 0.0)}
    runs = [
        rm.run(plant, rm.controller(case, hold=0.2), torque, torque, sample_time=case.loop["sample_time"])
        for plant in (Wrapped(), rm.bed(case))
    ]
    assert np.abs(runs[1]["dyno"]).max() > 5
    assert runs[0]["dyno"] == pytest.approx(runs[1]["dyno"], abs=1e-9 * np.abs(runs[1]["dyno"]).max())


@pytest.mark.parametrize(
    ("call", "wrong"),
    [
        (lambda: rm.run(Rotor(), samples=5), "how long a sample is"),
        (lambda: rm.run(Rotor(), sample_time=1e-3), "how many samples"),
        (lambda: rm.run(Rotor(), None, {"lod": np.zeros(5)}, sample_time=1e-3), "'lod'.*load"),
        (lambda: rm.run(Rotor(), samples=5, sample_time=1e-3, keep=["sped"]), "'sped'.*speed"),
        (lambda: rm.run(Rotor(), samples=5, sample_time=1e-3)["sped"], "'sped'.*speed"),
    ],
)
def test_what_is_missing_or_wrong_is_said_in_one_line(call, wrong):
    with pytest.raises(rm.InputError, match=wrong):
        call()


def test_a_row_that_runs_away_is_lost_and_those_beside_it_are_not(case, monkeypatch):
    rows = [Imperfection(""), Imperfection("", {"dynamometers.dyno.torque_gain": -3.0})]
    free = {name: value for name, value in case.limits.items() if "torque" not in name}
    controller = unsupervised(exported_controller(replace(case, limits=free)))
    schedule = Schedule.held_first(10, 3000, np.zeros((1, 1)), np.zeros((1, 1)))
    kick = {"motor_torque": np.full(3000, 20.0)}

    def done():
        plant = bed_rows(case, controller.law.sensors, rows)
        return rm.run(plant, ControllerRows(controller, schedule, 2), kick, {})

    for _ in range(2):
        found = done()
        assert found.lost.tolist() == [False, True]
        assert np.isfinite(found["motor_speed"][:, 0]).all()
        assert np.isnan(found["motor_speed"][-1, 1])
        monkeypatch.setattr(loop, "compiler", lambda: None)


def test_rows_know_their_own_span(case):
    plant = vehicle_rows(case, [Imperfection("")])
    assert isinstance(plant, BedRows)
    with pytest.raises(ValueError, match=r"step 0.001 s, not 0.002 s"):
        plant.step(np.zeros((0, 1)), np.zeros((2, 1)), np.zeros((2, 1)), 0.002)
