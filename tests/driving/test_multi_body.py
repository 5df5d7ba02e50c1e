"""A multi-body car with tyres that nobody here wrote drives away, corners and brakes on the bed."""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from driving.test_foreign_vehicle import EXAMPLE, of_others
from needs import compiles

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection, bed_rows, known_at_operating_point
from matching.match.operating_range import at_speed
from modelling.bed.foreign_vehicle import RunIn, VehicleTiming
from modelling.bed.nonlinear import NonlinearBeds
from modelling.bed.vehicle import specimen_of
from modelling.fmu.vehicle import FmuVehicle
from modelling.running.beds import BedRows
from modelling.running.controllers import ControllerRows, Schedule
from modelling.running.plant import Vehicle
from modelling.running.run import run
from modelling.running.vehicles import SpecimenAndVehicle, TimedVehicle

pytestmark = [
    compiles, pytest.mark.long, pytest.mark.timeout(900),
    pytest.mark.skipif(not find_spec("vehiclemodels"), reason="needs commonroad-vehicle-models"),
]  # fmt: skip
SENSORS = ("motor_speed", "side_left_torque", "side_right_torque")
PARTS = {"away": (0, 3000), "cornering": (3000, 5500), "braked": (5500, 7000)}
HOLD, SPEED = 300, 0.5  # samples; m/s, for the model is kinematic at rest


def drive(time):
    """Motor torque and brakes, N·m, and the rate at which the front wheels are turned, rad/s."""

    def up(at, over):
        return np.clip((time - at) / over, 0, 1)

    torques = {"motor_torque": 70 * up(0.3, 0.2) - 50 * up(2.7, 0.2) - 20 * up(5.3, 0.1)}
    torques |= dict.fromkeys(("brake_left", "brake_right"), 250 * up(5.5, 0.2))
    return torques, lambda at: 0.12 * (3.0 < at < 3.6) - 0.12 * (4.4 < at < 5.0)


@pytest.mark.parametrize("dead", [0.003, 0.008])
def test_it_drives_away_corners_and_brakes(dead):
    from driving.multi_body import MultiBody

    case = at_speed(load_case(EXAMPLE / "case.toml").with_values({"loop.dead_time": dead}), SPEED)
    made = of_others(exported_controller(load_case(EXAMPLE / "case.toml").with_values({"loop.dead_time": dead})))
    time = np.arange(7000) * 1e-3
    torques, steering = drive(time)
    car = MultiBody(steering)
    assert isinstance(car, Vehicle)
    cuts = case.residual_vehicle.interfaces
    reference = SpecimenAndVehicle(
        BedRows(NonlinearBeds([specimen_of(case.residual_vehicle)], case.loop)),
        car,
        [cut.vehicle_end for cut in cuts],
        1,
    )
    acting = {name: torque for name, torque in torques.items() if name in reference.inputs}
    wanted = run(reference, None, acting, samples=len(time), keep=SENSORS).readings[:, :, 0]
    assert car.x[3] < 5 < 0.344 * wanted[:, 0].max() / 10.05, "it was faster, and is braked"
    assert np.abs(np.diff(wanted[3000:5500, 1:])).max() > 5, "its sides are loaded differently in a corner"

    plant = bed_rows(case, made.law.sensors, [Imperfection("")])
    waiting = {name: np.concatenate([np.zeros(HOLD), torque]) for name, torque in torques.items()}
    count, trim = HOLD + len(time), known_at_operating_point(case)
    known = {name: waiting.get(name, np.zeros(count)) + trim.get(name, 0.0) for name in made.law.known}
    speeds = plant.beds.steady[[plant.beds.model.sensors.index(one.speed_sensor) for one in case.loop.dynamometers]]
    schedule = Schedule.held_first(HOLD, count, speeds, plant.beds.trim)
    rows = ControllerRows(made, schedule, 1, TimedVehicle(MultiBody(steering), VehicleTiming(), 1e-3))
    on_bed = {name: torque for name, torque in waiting.items() if name in plant.inputs}
    found = run(plant, rows, on_bed, known, samples=count, keep=SENSORS)
    assert not found.fault.any()
    got = found.readings[HOLD:, :, 0]
    errors = {
        name: np.sqrt(np.mean((got[a:b] - wanted[a:b]) ** 2, axis=0)) / np.ptp(wanted[a:b], axis=0)
        for name, (a, b) in PARTS.items()
    }
    print(dead, {name: np.round(100 * each, 2) for name, each in errors.items()})
    assert max(each[0] for each in errors.values()) <= 0.015
    # the tyre has no carcass, so the motor rings against wheels that its slip holds, at 9 Hz and hardly damped; braked,
    # the range of a side shaft is 30 N·m
    assert max(each[1:].max() for each in errors.values()) <= {0.003: 0.06, 0.008: 0.12}[dead]


@pytest.mark.skipif(not find_spec("pythonfmu"), reason="needs pythonfmu")
def test_as_an_fmu_it_is_the_same_vehicle(tmp_path):
    """Built by pythonfmu; half a second of torques that differ left and right."""
    from driving.multi_body import MultiBody
    from pythonfmu import FmuBuilder

    FmuBuilder.build_FMU(Path(__file__).with_name("multi_body_slave.py"), dest=tmp_path)
    run_in, named = RunIn(np.full(2, 200.0), np.full(2, 100.0), np.full(2, 900.0)), ("left", "right")
    torques, speeds = ({side: f"{what}_{side}" for side in named} for what in ("torque", "speed"))
    sys.path.append(str(Path(__file__).parents[1]))
    try:
        with FmuVehicle(tmp_path / "MultiBodySlave.fmu", torques, speeds, {}, run_in, 1e-3) as fmu:
            car, none = MultiBody(), np.zeros((2, 1))
            begun = fmu.begin(np.full((2, 1), 5.0), none)
            np.testing.assert_allclose(begun, 5.0, atol=0.06)
            car.begin(begun, none)
            for n in range(500):
                torque = np.array([[100.0], [140.0]]) * (n > 50)
                by_fmu, by_hand = fmu.step(torque, np.zeros((0, 1)), 1e-3), car.step(torque, none, 1e-3)
            np.testing.assert_allclose(by_fmu, by_hand, rtol=0.02)
            assert by_fmu.min() > 5.5
    finally:
        sys.path.pop()
