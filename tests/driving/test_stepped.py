"""The law over a range of speeds: C, FMU and Python alike; its vehicle is integrated right, and stable at any speed."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving.own_car import FINE, Bed, Car, steady, step
from fmu.slave import slave
from needs import compiles
from scipy.integrate import solve_ivp

from matching.match.case_file import case_files, case_from_tables, load_case
from matching.match.exported import exported_controller
from matching.match.imperfections import bed
from matching.match.operating_range import at_speed, grid
from modelling.bed.nonlinear import BedHardware, NonlinearBeds
from modelling.bed.stepped import Emulation
from modelling.controller.batch import ControllerBatch
from modelling.errors import InputError
from modelling.fmu.export import controller_fmu
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.running.controllers import ControllerRows, Schedule
from modelling.running.run import run

EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away" / "case.toml"
HOLD, EMULATION = 1, 2


@pytest.fixture(scope="module")
def case():
    return load_case(EXAMPLE)


@pytest.fixture(scope="module")
def controller(case):
    """With its start weights, and torques that were learned."""
    time = np.arange(700) * 1e-3
    learned = np.stack([20 * np.sin(20 * time), -15 * np.sin(30 * time)], axis=1)
    made = exported_controller(case)
    # what is commanded is compared, whatever the readings are: none is refused
    never = np.full(len(made.law.sensors), 1e12)
    settings = replace(made.settings, ride_samples=0, unexpected=never, undelivered_share=0.0)
    return replace(made, learned=learned, settings=settings)


def driven(law, samples):
    """Readings, known torques and hold speeds of a drive that never settles: what the law makes of it is compared."""
    random, time = np.random.default_rng(3), np.arange(samples) * 1e-3
    speed = 25 + 20 * np.sin(1.5 * time) + 3 * time
    by_name = {"motor_speed": 10.05 * speed}
    rows = []
    for name in law.sensors:
        torque = name.endswith("torque")
        exact = 60 * np.sin(2 * time) if torque else by_name.get(name, speed)
        rows.append(exact + (0.3 if torque else 0.05) * random.standard_normal(samples))
    known = np.zeros((len(law.known), samples))
    known[law.known.index("motor_torque")] = 20 * np.sin(3 * time)
    known[law.known.index("brake_left")] = 300 * np.clip(np.sin(4 * time), 0, 1)
    return np.array(rows), known, np.stack([speed, speed])


ROAD = np.array([0.7, 1.1, 1.2, 0.03])  # friction of the tyres, mass, grade


@compiles
def test_c_and_python_command_the_same_through_the_range(controller):
    samples = 2500
    readings, known, hold = driven(controller.law, samples)
    running, batch, worst = controller.running(), ControllerBatch(controller, 1), 0.0
    for n in range(samples):
        mode, trigger = HOLD if n < 40 else EMULATION, 900 <= n < 910
        wanted = running.step(readings[:, n], known[:, n], mode, hold[:, n], n, trigger=trigger)
        sent, active, fault = batch.step(
            readings[:, n : n + 1], known[:, n : n + 1], mode, hold[:, n : n + 1], n, trigger=trigger
        )
        assert (active[0], fault[0]) == (wanted.mode, wanted.fault)
        worst = max(worst, float(np.abs(sent[:, 0] - wanted.commands).max()))
    assert worst < 1e-7


@compiles
@pytest.mark.parametrize("share", [0.15, 0.6])
def test_c_and_python_judge_delivered_torque_alike(controller, share):
    judges = replace(controller, settings=replace(controller.settings, undelivered_share=share))
    readings, known, hold = driven(judges.law, 1500)
    running, batch, found = judges.running(), ControllerBatch(judges, 1), set()
    for n in range(1500):
        mode = HOLD if n < 150 else EMULATION
        wanted = running.step(readings[:, n], known[:, n], mode, hold[:, n], n)
        _, _, fault = batch.step(readings[:, n : n + 1], known[:, n : n + 1], mode, hold[:, n : n + 1], n)
        assert fault[0] == wanted.fault
        found.add(wanted.fault)
    assert 7 in found


@compiles
def test_c_and_python_catch_up_alike_with_samples_that_did_not_run(controller):
    samples, rode = 700, replace(controller, settings=replace(controller.settings, ride_samples=20))
    readings, known, hold = driven(rode.law, samples)
    running, batch, worst, missed = rode.running(), ControllerBatch(rode, 1), 0.0, {300: 1, 420: 5, 421: 1, 500: 30}
    life = 2**32 - 350  # it wraps around
    for n in range(samples):
        life += 1 + missed.get(n, 0)
        mode = HOLD if n < 150 else EMULATION
        wanted = running.step(readings[:, n], known[:, n], mode, hold[:, n], life % 2**32)
        sent, _, _ = batch.step(readings[:, n : n + 1], known[:, n : n + 1], mode, hold[:, n : n + 1], life)
        worst = max(worst, float(np.abs(sent[:, 0] - wanted.commands).max()))
    assert running.missed_samples == 7, "thirty are more than are ridden through"
    assert worst < 1e-7


def test_its_fmu_does_what_python_does(controller, tmp_path):
    """Commands, the emulated vehicle and what is tracked, on a road that changes while it drives."""
    soon = replace(
        controller.tracking, block=0.05, settling=0.02, least_blocks=2, prior=100 * controller.tracking.prior
    )
    controller = replace(controller, tracking=soon)
    made = controller_fmu(controller)
    if made.platform is None:
        pytest.skip("no C compiler here")
    (tmp_path / "controller.fmu").write_bytes(made.content)
    law, samples = controller.law, 400
    readings, known, hold = driven(law, samples)
    running, k = controller.running(), len(law.dynamometers)
    road_names = [*(f"{tyre}.friction" for tyre in law.vehicle.tyres), "vehicle.mass", "vehicle.grade"]
    with slave(tmp_path / "controller.fmu") as fmu:
        fmu.begin()
        for n in range(samples):
            mode, trigger = HOLD if n < 40 else EMULATION, n >= 100
            values = dict(zip((*law.sensors, *law.known), (*readings[:, n], *known[:, n]), strict=True))
            values |= {f"{name}.hold_speed": hold[j, n] for j, name in enumerate(law.dynamometers)}
            if n >= 200:
                running.road = ROAD
                values |= dict(zip(road_names, ROAD.tolist(), strict=True))
            before = running.vehicle
            wanted = running.step(readings[:, n], known[:, n], mode, hold[:, n], n, trigger=trigger)
            fmu.set(values | {"mode": float(mode), "life": float(n), "trigger": float(trigger)})
            fmu.step(1e-3)
            sent = fmu.get([f"{name}.command" for name in law.dynamometers])
            np.testing.assert_allclose(sent, wanted.commands, atol=1e-7)
            if n > 40:
                shown = fmu.get(
                    ["vehicle.speed", "vehicle.distance", *(f"{name}.wheel_speed" for name in law.dynamometers)]
                )
                np.testing.assert_allclose(shown[0], 0.3 * law.vehicle.body @ before.vehicle, atol=1e-9)
                np.testing.assert_allclose(shown[1], before.distance, atol=1e-9)
                np.testing.assert_allclose(shown[2:], law.vehicle.wheel @ before.vehicle, atol=1e-9)
        keys = [f"{what}{more}" for what in ("gain", "zero", "delay") for more in ("", "_uncertainty")]
        for name, tracked in zip(law.dynamometers, running.tracked, strict=True):
            got = fmu.get([*(f"{name}.tracked_{key}" for key in keys), f"{name}.drifted"])
            np.testing.assert_allclose(got, [*(getattr(tracked, key) for key in keys), tracked.drifted], rtol=1e-4)
            assert tracked.gain_uncertainty != soon.prior[0, 0], "something was tracked"
    assert k == 2


def test_the_vehicle_is_integrated_right(controller):
    """Against a fine step of SciPy's implicit method, from motions with brake, slip and a grade; 1 % of the change."""
    vehicle, random = controller.law.vehicle, np.random.default_rng(8)
    for speed in (0.5, 20.0, 90.0):
        at = np.array([np.interp(speed, controller.law.speeds, each) for each in vehicle.steady.T])
        cut, own = random.uniform(-200, 400, 2), np.array([300.0, -20.0, 0.0, 30.0])
        road = np.array([0.9, 1.0, 1.1, 0.05])
        exact = solve_ivp(
            lambda _, x, cut=cut, own=own, road=road: vehicle.rates(x, cut, own, road).full()[:, 0], (0, 0.2), at,
            method="Radau", rtol=1e-8, atol=1e-10,
        ).y[:, -1]  # fmt: skip
        found = at
        for _ in range(200):
            found = vehicle.step(found, cut, own, road)
        moved = np.abs(vehicle.wheel @ (exact - at)).max() + 1e-3
        np.testing.assert_allclose(vehicle.wheel @ found, vehicle.wheel @ exact, atol=0.01 * moved)
        np.testing.assert_allclose(vehicle.body @ found, vehicle.body @ exact, atol=0.01 * moved)


@compiles
def test_a_run_shows_what_the_emulated_vehicle_does(case, monkeypatch):
    """Compiled and in Python alike; the bed's rotors turn as its wheels do, and the distance is that of its speed."""
    about, samples = at_speed(case, 10.0), 700
    torque = {"motor_torque": 40 * np.clip((np.arange(samples) - 300) / 50, 0, 1)}
    made = exported_controller(case)
    steady = speeds_of(about.vehicle)
    hold = np.array([[steady[f"wheel_{side}"]] for side in ("left", "right")])
    begin = np.array([[torques_of(about.rig)[name]] for name in ("dyno_left", "dyno_right")])
    controller = ControllerRows(made, Schedule.held_first(200, samples, hold, begin))
    known = {"motor_torque": torque["motor_torque"] + torques_of(about.vehicle)["motor_torque"]}
    found = run(bed(about), controller, torque, known)
    monkeypatch.setattr("modelling.running.run.compiler", lambda: None)
    python = run(bed(about), controller, torque, known)
    assert set(found.emulated) == set(python.emulated) >= {"vehicle.speed", "left.wheel_speed", "tyre_body_left.slip"}
    for name, values in found.emulated.items():
        assert np.isnan(values[:200]).all()
        np.testing.assert_allclose(python.emulated[name][201:], values[201:], atol=1e-7)
    np.testing.assert_allclose(found["left.wheel_speed"][300:], found["rotor_left_speed"][300:], atol=0.3)
    np.testing.assert_allclose(
        np.diff(found["vehicle.distance"][210:, 0]), 1e-3 * found["vehicle.speed"][210:-1, 0], rtol=1e-3
    )
    assert found["vehicle.speed"][-1, 0] > found["vehicle.speed"][250, 0] > 9.9


def test_samples_in_a_row_are_the_same_as_one_by_one(controller):
    vehicle, random = controller.law.vehicle, np.random.default_rng(6)
    torques, own = random.uniform(-200, 400, (40, 2)), np.tile([300.0, -20.0, 0.0, 30.0], (40, 1))
    x = [vehicle.steady[2]]
    for torque, mine in zip(torques, own, strict=True):
        x.append(vehicle.step(x[-1], torque, mine, vehicle.as_planned))
    found = vehicle.drive(vehicle.steady[2], torques, own, vehicle.as_planned)
    np.testing.assert_allclose(found, np.array(x), rtol=1e-9, atol=1e-9)


def test_the_vehicle_is_stable_while_a_wheel_spins(controller):
    """The deflection of a brake stays within what it gives way by, whatever the wheel's speed is (Dahl)."""
    vehicle = controller.law.vehicle
    x = vehicle.steady[-1]
    for _ in range(1500):
        x = vehicle.step(x, np.array([2500.0, 2500.0]), np.array([5.0, 0.0, 5.0, 0.0]), vehicle.as_planned)
    assert (vehicle.wheel @ x).min() > 500, "rad/s: it spins"
    assert np.isfinite(x).all()
    assert np.abs(x).max() < 1.2 * np.abs(vehicle.wheel @ x).max() / np.abs(vehicle.wheel).max(), "speeds only"


def test_about_a_steady_speed_the_linear_law_does_what_the_law_does(controller):
    """Finite differences: a small motion about steady motion, law and vehicle stepped, against one linear law."""
    law, random = controller.law, np.random.default_rng(5)
    speed = float(law.speeds[5])
    linear, k = law.frozen(speed), len(law.dynamometers)
    steady = np.array([np.interp(speed, law.speeds, each) for each in law.vehicle.steady.T])
    begun = Emulation(np.zeros(law.states), np.zeros(k), np.zeros(k), steady)
    balance = np.linalg.lstsq(
        law.vehicle.by_cut,
        -law.vehicle.rates(steady, np.zeros(k), np.zeros(4), law.vehicle.as_planned).full()[:, 0],
        rcond=None,
    )[0]
    now, state, wide = begun, np.zeros(linear.states), (np.full(k, -1e9), np.full(k, 1e9))
    pairs = []
    for _ in range(60):
        readings, known = 1e-3 * random.standard_normal(len(law.sensors)), np.zeros(len(law.known))
        known[0] = 1e-3 * random.standard_normal()
        turned = law.over * (law.vehicle.wheel @ now.vehicle)  # no angle is taken back
        sent, now = law.step(
            now, begun, balance, readings, known, np.zeros(4), wide, law.vehicle.as_planned, turned
        )  # fmt: skip
        wanted, state = linear.step(state, readings, known, np.full(k, 1e9))
        pairs.append((sent, wanted))
    stepped, linear_ones = np.array(pairs).swapaxes(0, 1)
    np.testing.assert_allclose(stepped, linear_ones, rtol=0, atol=1e-3 * np.abs(linear_ones).max())


@pytest.mark.parametrize(("speed", "bump"), [(None, 1e-3), (12.0, 15.0)], ids=["of the grid", "between"])
def test_emulation_begins_at_speed_without_a_bump(controller, case, speed, bump):
    """Readings of steady motion: the first samples send on what was sent, within a hundredth of the torque limit."""
    own = at_speed(case, float(grid(case.operating_range)[6]) if speed is None else speed)
    loop, law = own.loop, controller.law
    hardware = BedHardware((0.002,) * 2, (0.0005,) * 2, tuple(loop.command_delays()), (1.0, 1.0))
    beds = NonlinearBeds([own.rig], loop, loop.dynamometers, [hardware])
    steady = beds.steady[[beds.model.sensors.index(name) for name in law.sensors], 0]
    held = torques_of(own.rig)
    sent = np.array([held[one.torque_input] for one in loop.dynamometers])
    known = np.array([held.get(name, 0.0) for name in law.known])
    begun, cut = law.begin(steady, sent)
    now, limits, road = begun, (np.full(2, -1e4), np.full(2, 1e4)), law.vehicle.as_planned
    turned = steady[list(law.speed_readings)]
    for _ in range(50):
        added, now = law.step(
            now, begun, cut, np.zeros(len(steady)), np.zeros(len(known)), known[-4:], limits, road, turned
        )  # fmt: skip
        assert np.abs(added).max() < bump


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vehicle_speed": ["50 km/h", "20 km/h"]}, "is no range"),
        ({"vehicle_speed": "50 km/h"}, "no pair of speeds"),
        ({"rolling_radius": 0.0}, "is not above 0"),
        ({"road_load": "100 N", "vehicle_sped": 1}, "vehicle_sped"),
    ],
)
def test_a_wrong_range_is_refused(change, said):
    data = tomllib.loads(EXAMPLE.read_text())
    data["operating_range"] |= change
    with pytest.raises(InputError, match=re.escape(said)):
        case_from_tables(data, str(EXAMPLE))


def test_drives_need_a_range_and_a_range_an_observer():
    data = tomllib.loads(EXAMPLE.read_text())
    with pytest.raises(InputError, match="needs structure"):
        case_from_tables({**data, "loop": {**data["loop"], "structure": "model_based"}}, str(EXAMPLE))
    without = {key: value for key, value in data.items() if key != "operating_range"}
    with pytest.raises(InputError, match="stand without"):
        case_from_tables(without, str(EXAMPLE))


def test_a_written_case_keeps_its_range(case, tmp_path):
    for name, text in case_files(case).items():
        (tmp_path / name).write_text(text)
    again = load_case(tmp_path / "case.toml").operating_range
    assert (again.lowest, again.highest, again.bodies) == (0.0, pytest.approx(100 / 3.6), case.operating_range.bodies)
    for one, other in zip(again.drives, case.operating_range.drives, strict=True):
        time = np.linspace(0, 3, 50)
        for name, torque in other.torques.items():
            np.testing.assert_allclose(one.torques[name].torque(time), torque.torque(time), atol=1e-6)


@pytest.mark.long
def test_the_driver_follows_the_profile(case):
    """The torques of the profile, played to a car of other equations, make it stand where the profile stands."""
    torques = case.operating_range.drives[-1].torques
    car = Car(EXAMPLE.parent / "vehicle.toml", {}, 1)
    bed = Bed(EXAMPLE.parent / "rig.toml", {}, 1, 0.002, 0.0005, np.ones((2, 1)))
    times, kmh, _ = np.loadtxt(EXAMPLE.parent / "stop_and_go.csv", delimiter=",", skiprows=1).T
    state, _, held, _ = steady(car, bed, kmh[:1] / 3.6 / 0.3)
    time = np.arange(round(times[-1] / 1e-3)) * 1e-3
    acting = np.stack([torques[name].torque(time) for name in ("motor_torque", "brake_left", "brake_right")])
    acting[0] += held
    assert acting[1:].min() >= 0
    assert (acting[0] * acting[1] == 0).all(), "one foot"
    driven = []
    for now in acting.T[..., None]:
        for _ in range(round(1e-3 / FINE)):
            state = step(car, state, now)
        driven.append(3.6 * 0.3 * state["body_left"][0])
    wanted = np.interp(time, times, kmh)
    assert np.abs(np.array(driven) - wanted).max() < 3
    assert np.abs(np.array(driven)[(time > 5) & (time < 6)]).max() < 0.05, "it is held"


def test_a_brake_is_never_pushed():
    data = tomllib.loads(EXAMPLE.read_text())
    data["drives"][1]["brake_left"] = {"kind": "step", "amplitude": -200}
    with pytest.raises(InputError, match="0 or more"):
        case_from_tables(data, str(EXAMPLE))


def test_a_driver_pulls_brakes_alone():
    data = tomllib.loads(EXAMPLE.read_text())
    data["drives"][-1]["driver"]["brakes"] = ["road_left"]
    with pytest.raises(InputError, match="no input with a brake"):
        case_from_tables(data, str(EXAMPLE))
