"""A vehicle that others simulate behind the cuts: the law, the FMU of a controller, the FMU of a vehicle, the case."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from driving.own_bed import Beside, plant, up_and_down
from driving.own_vehicle import own_fmu
from driving.test_stepped import EMULATION, HOLD, driven
from fmu.slave import slave
from needs import compiles

from matching.match.case_file import case_from_tables, case_text, load_case
from matching.match.exported import exported_controller
from matching.match.imperfections import BedRun, Imperfection, bed_motions, vehicle_motions, vehicle_rows
from matching.match.operating_range import at_speed
from matching.match.vehicle_check import check_vehicle
from modelling.bed.foreign_vehicle import RunIn, VehicleTiming, foreign_vehicle_law, run_in_gains
from modelling.controller.batch import ControllerBatch
from modelling.errors import InputError
from modelling.fmu.export import block, controller_fmu, fmu
from modelling.fmu.vehicle import FmuSettings, FmuVehicle
from modelling.model_file import load
from modelling.running.run import run
from modelling.running.vehicles import TimedVehicle
from modelling.toml import read_toml

EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away"
PARTS = ("drive away", "tip-in", "away again")
by_fmpy = pytest.mark.skipif(not find_spec("fmpy"), reason="needs FMPy")
NAMED = (
    {"left": "drive_l", "right": "drive_r"}, {"left": "spin_l", "right": "spin_r"},
    {"brake_left": "brake_l", "brake_right": "brake_r"},
)  # fmt: skip
TABLE = {"fmu": "car.fmu", "torques": NAMED[0], "speeds": NAMED[1], "inputs": NAMED[2]}
INERTIA, WHOLE = np.full(2, 0.69), np.full(2, 91.2)


def of_others(controller, steps=1, late=0):
    """The same designs for a vehicle that is stepped outside."""
    timing = VehicleTiming(steps, late)
    run_in = run_in_gains(INERTIA, WHOLE, np.full(2, 1500.0), timing, 1e-3)
    return replace(controller, law=foreign_vehicle_law(controller.law, timing, run_in))


def started(path, count=1, settings=None):
    run_in = RunIn(np.full(2, 230.0), np.full(2, 140.0), np.full(2, 1500.0))
    return FmuVehicle(path, *NAMED, run_in, 1e-3, count, FmuSettings() if settings is None else settings)


@pytest.fixture(scope="module")
def controller():
    """With the weights of a search's start: none was tuned on these drives."""
    return exported_controller(load_case(EXAMPLE / "case.toml"))


@pytest.fixture(scope="module")
def slow(controller):
    """At 8 ms with the same weights."""
    return exported_controller(load_case(EXAMPLE / "case.toml").with_values({"loop.dead_time": "8 ms"}))


def errors(made, folder, kmh, outside=(1, 0), dead=0.0025, seed=1, draw=None, **more):
    """Errors of the parts of a drive from rest to a speed and back, the car beyond the cuts stepped outside."""
    car = plant(EXAMPLE / "vehicle.toml", EXAMPLE / "rig.toml", dead, draw=draw, extra=more)
    u, parts = up_and_down(kmh, of=car)
    found = (folder if isinstance(folder, Beside) else Beside(of_others(made, *outside), folder)).run(
        car, 0.0, u, outside=outside, seed=seed
    )
    assert not found.faults.any()
    return [found.error(*parts[name]) for name in PARTS], found.error(*parts["braked"])


@compiles
@pytest.mark.parametrize(("outside", "kmh"), [((1, 0), 60), pytest.param((5, 4), 60, marks=pytest.mark.long)])
def test_a_vehicle_of_others_drives_on_the_bed(controller, tmp_path, outside, kmh):
    parts, braked = errors(controller, tmp_path, kmh, outside)
    assert max(parts) <= 0.01
    assert braked <= 0.02


@pytest.mark.long
@compiles
def test_the_design_vehicle_may_be_coarse(controller, tmp_path):
    """It has half the body, twice the wheels and half the slip stiffness of the vehicle that is emulated."""
    parts, braked = errors(controller, tmp_path, 60, J_body=(180.2, 180.2), J_wheel=(0.345, 0.345), slip=(14400, 14400))
    assert max(parts) <= 0.015
    assert braked <= 0.03, "all three at once; the range of a side shaft is about 100 N·m there"


@compiles
@pytest.mark.long
@pytest.mark.timeout(900)
def test_late_and_slow_vehicles_at_3_and_8_ms(controller, slow, tmp_path):
    for dead, made in ((0.0025, controller), (0.0075, slow)):
        for outside in ((1, 0), (1, 2), (5, 4)):
            beside = Beside(of_others(made, *outside), tmp_path / f"{dead}{outside}")
            for kmh in (30, 60, 95):
                parts, braked = errors(made, beside, kmh, outside, dead)
                print(dead, outside, kmh, np.round(100 * np.array([*parts, braked]), 2))
                # 1 % is reached but for steps that are 4 ms late at 8 ms of dead time, from 30 km/h: 1.02 %
                assert max(parts) <= (0.012 if dead > 0.005 and outside == (5, 4) else 0.01)
                assert braked <= (0.03 if kmh == 30 else 0.02), "from 30 km/h on the range is smaller"


@compiles
@pytest.mark.long
@pytest.mark.timeout(900)
def test_drawn_beds_and_coarse_designs(controller, slow, tmp_path):
    """Twelve drawn beds; then cars of which the design vehicle is off by a factor of two either way."""
    for dead, made in ((0.0025, controller), (0.0075, slow)):
        beside = Beside(of_others(made), tmp_path / f"{dead}")
        drawn = [
            errors(made, beside, 60, dead=dead, seed=n + 1, draw=np.random.default_rng(71500 + n)) for n in range(12)
        ]
        table = np.array([[*parts, braked] for parts, braked in drawn])
        print(dead, np.round(100 * np.median(table, axis=0), 2), np.round(100 * table.max(axis=0), 2))
        assert np.median(table, axis=0)[:3].max() <= 0.015
        assert np.median(table, axis=0)[3] <= 0.02
        car = plant(EXAMPLE / "vehicle.toml", EXAMPLE / "rig.toml", dead)
        for name in ("J_body", "J_wheel", "J_tyre", "k_car", "slip"):
            for factor in (0.5, 2.0):
                more = {name: tuple(factor * each for each in getattr(car, name))}
                parts, braked = errors(made, beside, 60, dead=dead, **more)
                print(dead, name, factor, np.round(100 * np.array([*parts, braked]), 2))
                assert max(parts) <= 0.015


@compiles
@pytest.mark.parametrize(("steps", "late"), [(3, 2), pytest.param(1, 0, marks=pytest.mark.long)])
def test_c_and_python_are_the_same(controller, steps, late):
    """Commands and torques into the vehicle, whatever the wheel speeds are; then one is no number: speeds are held."""
    never = np.full(len(controller.law.sensors), 1e12)
    settings = replace(controller.settings, ride_samples=0, unexpected=never, undelivered_share=0.0)
    made = of_others(replace(controller, settings=settings), steps, late)
    samples, random = 1200, np.random.default_rng(12)
    readings, known, hold = driven(made.law, samples)
    running, batch, worst = made.running(), ControllerBatch(made, 1), 0.0
    wheel = hold.copy()
    for n in range(samples):
        if n % steps == 0:
            wheel[:, n:] = (hold[:, n] + 0.3 * random.standard_normal(2))[:, None]
        if n == 1150:
            wheel[1, n:] = np.nan
        mode = HOLD if n < 60 or 700 <= n < 760 else EMULATION
        wanted = running.step(readings[:, n], known[:, n], mode, hold[:, n], n, wheel=wheel[:, n])
        sent, active, fault = batch.step(
            readings[:, [n]], known[:, [n]], mode, hold[:, [n]], n, wheel=wheel[:, [n]]
        )  # fmt: skip
        assert (active[0], fault[0]) == (wanted.mode, wanted.fault)
        worst = max(worst, float(np.abs(sent[:, 0] - wanted.commands).max()))
        worst = max(worst, float(np.abs(batch.cut_torque[:, 0] - running.cut_torque).max()))
    assert worst < 1e-6
    assert wanted.fault == 6, "unexpected, so the speeds are held"
    assert wanted.mode == HOLD


@pytest.mark.long
def test_the_controllers_fmu_has_the_cut(controller, tmp_path):
    made = of_others(controller)
    exported = controller_fmu(made)
    if exported.platform is None:
        pytest.skip("no C compiler here")
    (tmp_path / "controller.fmu").write_bytes(exported.content)
    law, samples = made.law, 300
    readings, known, hold = driven(law, samples)
    running = made.running()
    with slave(tmp_path / "controller.fmu") as fmu:
        fmu.begin()
        for n in range(samples):
            mode, wheel = HOLD if n < 40 else EMULATION, hold[:, n] + 0.01 * np.sin(0.1 * n)
            values = dict(zip((*law.sensors, *law.known), (*readings[:, n], *known[:, n]), strict=True))
            values |= {f"{name}.hold_speed": hold[j, n] for j, name in enumerate(law.dynamometers)}
            values |= {f"cut.{name}.speed": wheel[j] for j, name in enumerate(law.dynamometers)}
            running.step(readings[:, n], known[:, n], mode, hold[:, n], n, wheel=wheel)
            fmu.set(values | {"mode": float(mode), "life": float(n)})
            fmu.step(1e-3)
            torque = fmu.get([f"cut.{name}.torque" for name in law.dynamometers])
            np.testing.assert_allclose(torque, running.cut_torque, atol=1e-7)


# --- An FMU of nobody here's making.


@pytest.mark.long
@compiles
@by_fmpy
def test_the_specimen_before_an_fmu_is_the_vehicle_in_one_piece(tmp_path):
    """With the brake: 0.1 % of the range from rest; from 30 km/h on the FMU begins up to 0.05 rad/s off."""
    own_fmu(tmp_path)
    case = _case(tmp_path)
    time = np.arange(2500) * 1e-3
    torques = {"motor_torque": 100 * np.clip((time - 0.2) / 0.05, 0, 1), "brake_left": 200.0 * (time > 1.5)}
    sensors = ["motor_speed", "side_left_torque", "side_right_torque"]
    for speed, most in ((0.0, 0.001), (30 / 3.6, 0.01)):
        at = at_speed(case, speed)
        readings = []
        for one in (at, replace(at, vehicle_in_the_loop=None)):
            rows = vehicle_rows(one, [Imperfection("")])
            found = run(rows, None, torques, samples=len(time), keep=sensors).readings[:, :, 0]
            readings.append(found - rows.beds.steady[[rows.beds.model.sensors.index(name) for name in sensors], 0])
        apart = np.sqrt(np.mean((readings[0] - readings[1])[300:] ** 2, axis=0)) / np.ptp(readings[1], axis=0)
        assert apart.max() < most, (speed, apart)


@compiles
@by_fmpy
@pytest.mark.parametrize("only_once", [False, pytest.param(True, marks=pytest.mark.long)])
def test_it_is_run_to_a_speed_and_rows_are_alone(tmp_path, only_once):
    with started(own_fmu(tmp_path, only_once=only_once), 3) as vehicle:
        speed = np.array([[2.0, 4.0, 6.0], [2.0, 4.0, 6.0]])
        np.testing.assert_allclose(vehicle.begin(speed, 0 * speed), speed, atol=0.06)
        torque = np.array([[0.0, 300.0, 0.0], [0.0, 0.0, 0.0]])
        for _ in range(100):
            after = vehicle.step(torque, np.zeros((2, 3)), 1e-3)
        assert after[0, 1] > 4.1
        assert after[0, 0] < 2.0 > after[1, 0]


@pytest.mark.long
@compiles
@by_fmpy
def test_fmi_2_and_3_are_one_vehicle(tmp_path):
    """The car of the example, exported as both."""
    found = []
    car = block([load(EXAMPLE.parent / "foreign_vehicle" / "car.toml")], "car", "car")
    torques, speeds = ({side: f"{what}_{side}" for side in ("left", "right")} for what in ("torque", "speed"))
    run_in = RunIn(np.full(2, 230.0), np.full(2, 140.0), np.full(2, 1500.0))
    for fmi in ("2.0", "3.0"):
        (tmp_path / "car.fmu").write_bytes(fmu(car, fmi, 1e-3).content)
        with FmuVehicle(tmp_path / "car.fmu", torques, speeds, {}, run_in, 1e-3) as vehicle:
            vehicle.begin(np.full((2, 1), 3.0), np.zeros((2, 1)))
            for _ in range(100):
                after = vehicle.step(np.array([[100.0], [50.0]]), np.zeros((0, 1)), 1e-3)
            found.append(after)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    assert found[0][0] > found[0][1] > 3.0


@compiles
@by_fmpy
def test_steps_and_lateness_are_counted(tmp_path):
    """A step of three samples, two late: what a torque does in the first of them is read in the sixth."""
    with started(own_fmu(tmp_path)) as vehicle:
        timed = TimedVehicle(vehicle, VehicleTiming(3, 2), 1e-3)
        timed.begin(np.zeros((2, 1)))
        seen = []
        for _ in range(8):
            seen.append(timed.read()[0, 0])
            timed.go_on(np.full((2, 1), 100.0), np.zeros((2, 1)))
        assert np.flatnonzero(np.diff(seen)).tolist() == [2, 5]


@compiles
@by_fmpy
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (1, "crashed (SIGABRT)"),
        (3, "not finite"),
        pytest.param(4, "crashed", marks=pytest.mark.long),
        pytest.param(2, "does not answer within 1 s", marks=pytest.mark.long),
    ],
)
def test_an_fmu_that_fails_is_one_line(tmp_path, wrong, said):
    path = own_fmu(tmp_path)
    run_in = RunIn(np.full(2, 230.0), np.full(2, 140.0), np.full(2, 1500.0))
    names = {**NAMED[2], "wrong": "wrong"}
    quick = FmuSettings(answer_within=1.0)
    with FmuVehicle(path, NAMED[0], NAMED[1], names, run_in, 1e-3, 1, quick) as vehicle:
        still = np.zeros((2, 1))
        vehicle.begin(still, still)
        own = np.zeros((3, 1))
        vehicle.step(still, own, 1e-3)
        own[2] = wrong
        with pytest.raises(InputError, match=r"car\.fmu") as fault:
            vehicle.step(still, own, 1e-3)
        assert said in str(fault.value)
        assert "\n" not in str(fault.value)


@compiles
@by_fmpy
def test_an_fmu_that_cannot_be_used_is_one_line(tmp_path, monkeypatch):
    path = own_fmu(tmp_path)
    with pytest.raises(InputError, match="has no input 'torque_l'"):
        FmuVehicle(path, {"left": "torque_l"}, {"left": "spin_l"}, {}, RunIn(*[np.ones(1)] * 3), 1e-3)
    (tmp_path / "none.fmu").write_text("no archive")
    with pytest.raises(InputError, match="is no FMU"):
        started(tmp_path / "none.fmu")
    with pytest.raises(InputError, match="does not start"):
        started(own_fmu(tmp_path, "bare", without_binary=True))
    with pytest.raises(InputError, match="is no file"):
        started(tmp_path / "gone.fmu")
    backwards = FmuVehicle(
        path, {"left": "brake_l"}, {"left": "spin_l"}, {}, RunIn(np.ones(1), np.ones(1), np.ones(1)), 1e-3, 1,
        FmuSettings(longest=0.5),
    )  # fmt: skip
    with backwards, pytest.raises(InputError, match="does not come to 5 rad/s"):
        backwards.begin(np.full((1, 1), 5.0), np.zeros((1, 1)))
    (tmp_path / "fmpy.py").write_text("raise ModuleNotFoundError('none', name='fmpy')")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="needs the package fmpy"):
        started(path)


# --- The case.


def _case(folder, **changes):
    data = dict(read_toml(EXAMPLE / "case.toml"))
    table = {key: value for key, value in {**TABLE, **changes}.items() if value is not None}
    for file in EXAMPLE.glob("*.*"):
        (folder / file.name).write_bytes(file.read_bytes())
    return case_from_tables({**data, "vehicle_in_the_loop": table}, str(folder / "case.toml"))


def test_a_case_names_its_vehicle_and_is_written_again(tmp_path):
    """Nothing is loaded: the file holds no FMU."""
    (tmp_path / "car.fmu").write_text("not looked at")
    case = _case(tmp_path, step="5 ms", late=1)
    assert case.vehicle_in_the_loop.timing(1e-3) == VehicleTiming(5, 1)
    (tmp_path / "again.toml").write_text(case_text(case))
    for name in ("vehicle", "rig"):
        assert (tmp_path / f"{name}.toml").exists()
    again = read_toml(tmp_path / "again.toml")["vehicle_in_the_loop"]
    assert again == {**TABLE, "fmu": str((tmp_path / "car.fmu").resolve()), "step": 0.005, "late": 1}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fmu": None}, "fmu: is missing"),
        ({"step": "1.5 ms"}, "no whole number of samples"),
        ({"step": "5 N"}, "step"),
        ({"late": 0.5}, "late"),
        ({"late": -1}, "late"),
        ({"torques": {"left": "drive_l"}}, "does not name right"),
        ({"speeds": {"left": "spin_l", "rigth": "spin_r"}}, "right"),
        ({"inputs": {"motor_torque": "m"}}, "motor_torque"),
        ({"inputs": ["brake_l"]}, "is no table of names"),
        ({"steps": 5}, "step"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path, changes, said):
    (tmp_path / "car.fmu").write_text("")
    with pytest.raises(InputError, match=r"vehicle_in_the_loop") as fault:
        _case(tmp_path, **changes)
    assert said in str(fault.value)


def test_it_needs_a_range(tmp_path):
    data = dict(read_toml(EXAMPLE.parent / "road_to_rig" / "case.toml"))
    for file in (EXAMPLE.parent / "road_to_rig").glob("*.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(InputError, match="without"):
        case_from_tables({**data, "vehicle_in_the_loop": TABLE}, str(tmp_path / "case.toml"))


@pytest.mark.long
@compiles
@by_fmpy
def test_driven_alone_it_shows_how_coarse_the_design_is(tmp_path):
    """Its body is 1.6 times that of the design vehicle; the lines that are proposed hold that."""
    own_fmu(tmp_path, BODY=144.0)
    check = check_vehicle(_case(tmp_path))
    np.testing.assert_allclose(check.vehicle.whole.sum(), 2 * (144.0 + 0.69 + 0.456), rtol=0.02)
    np.testing.assert_allclose(check.vehicle.at_cut, check.design.at_cut, rtol=0.02)
    said = " ".join(check.remarks())
    bodies = [float(word.split("=")[1]) for word in said.replace(" = ", "=").replace(",", "").split() if "body" in word]
    np.testing.assert_allclose(bodies, 144.0, rtol=0.02)
    assert "wheel_left" not in said.split("nearer")[1]


@compiles
@by_fmpy
def test_a_wheel_without_inertia_is_refused(tmp_path):
    own_fmu(tmp_path, MASSLESS=1)
    with pytest.raises(InputError, match="algebraic loop"):
        check_vehicle(_case(tmp_path))
    own_fmu(tmp_path, "car")
    with pytest.raises(InputError, match="does not turn its wheel"):
        check_vehicle(_case(tmp_path, torques={"left": "drive_r", "right": "drive_l"}))


# --- Whole beds in the FMU's process, in C: the same as sample by sample from here.


def _runs(case, count=2, samples=1500, **torques):
    time = np.arange(samples) * 1e-3
    acting = {"motor_torque": 100 * np.clip((time - 0.2) / 0.05, 0, 1), **torques}
    return [BedRun(Imperfection("", poor_sensors=number == 0), acting, case.loop.measured) for number in range(count)]


@compiles
@by_fmpy
@pytest.mark.long
@pytest.mark.parametrize("timing", [{"step": "5 ms", "late": 3}, {}, {"late": 2}])
def test_in_c_and_from_here_are_the_same(tmp_path, monkeypatch, timing):
    own_fmu(tmp_path)
    case = _case(tmp_path, **timing)
    at, controller = at_speed(case, 30 / 3.6), exported_controller(case)
    runs = _runs(case, brake_left=200.0 * (np.arange(1500) > 900))
    sensors = ["motor_speed", "side_left_torque", "side_right_torque"]
    found = []
    for in_c in (True, False):
        monkeypatch.setattr(FmuVehicle, "in_c", in_c)
        called, step = [], FmuVehicle.step
        monkeypatch.setattr(
            FmuVehicle, "step", lambda *given, step=step, called=called: called.append(1) or step(*given)
        )
        beds = bed_motions(at, controller, runs, sensors)
        every = [*vehicle_motions(at, runs, sensors), *(one.readings for one in beds), *(one.commands for one in beds)]
        assert bool(called) != in_c
        monkeypatch.undo()
        found.append(every)
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7 * np.ptp(other))


@compiles
@by_fmpy
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (1, "crashed (SIGABRT)"),
        (3, "not finite after"),
        pytest.param(4, "answers a step with an error", marks=pytest.mark.long),
        pytest.param(2, "does not answer within 3 s", marks=pytest.mark.long),
    ],
)
def test_an_fmu_that_fails_in_a_run_is_one_line(tmp_path, wrong, said):
    """From 0.5 s on; a run that takes longer than an answer may, and goes on, is none that hangs."""
    own_fmu(tmp_path)
    case = _case(tmp_path, inputs={"brake_left": "wrong"})
    count = 40000 if wrong == 2 else 800
    time = np.arange(count) * 1e-3
    rows = vehicle_rows(case, [Imperfection("")] * (10 if wrong == 2 else 1))
    assert rows.vehicle.in_c
    rows.vehicle._processes[0].settings = FmuSettings(answer_within=3.0)
    if wrong == 2:
        assert np.isfinite(run(rows, None, {}, samples=count, keep=["motor_speed"]).readings).all()
    with pytest.raises(InputError, match=r"car\.fmu") as fault:
        run(rows, None, {"brake_left": wrong * (time >= 0.5)}, samples=count, keep=["motor_speed"])
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


@compiles
@by_fmpy
def test_a_process_serves_the_next_vehicle_unless_it_owes_an_answer(tmp_path):
    """The next one begins anew; a process that was left in the middle of a step ends with its vehicle."""
    path, still = own_fmu(tmp_path), np.zeros((2, 1))
    first = started(path)
    begun = first.begin(still + 3.0, still)
    first.step(still + 400.0, still, 1e-3)
    child = first._processes[0]
    first.close()
    second = started(path)
    assert second._processes == [child]
    np.testing.assert_array_equal(second.begin(still + 3.0, still), begun)
    child.send(b"s", np.r_[1e-3, np.zeros(4)])  # as an interrupt leaves it: asked, and not answered
    second.close()
    with started(path) as third:
        assert third._processes[0] is not child
        np.testing.assert_array_equal(third.begin(still + 3.0, still), begun)
    assert child._child.poll() is not None
