"""One controller forwards and backwards, on a bed and beside a car that rigmatch knows nothing of."""

from pathlib import Path

import numpy as np
import pytest
from driving.own_car import Bed, Car, Sensors, drive_car, run_bed, steady
from driving.test_range import NOISE, RADIUS, SPEED_NOISE, STEP, told
from needs import compiles

from matching.match.case_file import case_from_tables
from matching.match.exported import exported_controller
from matching.match.match import match
from matching.match.operating_range import grid
from modelling.controller.batch import ControllerBatch
from modelling.toml import read_toml

pytestmark = [compiles, pytest.mark.long]
EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away"
SECONDS, SEED = 6.0, 5
#           km/h, added motor torque over time
DRIVES = [
    (-15.0, ([0.2, 0.25], [0, -80])),  # tip-in while rolling backwards
    (-8.0, ([0.3, 0.6], [0, 110])),  # from backwards through standstill to forwards
    (0.0, ([0.5, 0.8], [0, -90])),  # drive-away backwards
    (12.0, ([0.2, 0.5], [0, -100])),  # from forwards through standstill to backwards
]


@pytest.fixture(scope="module")
def tuned():
    data = read_toml(EXAMPLE / "case.toml")
    data["operating_range"]["vehicle_speed"] = ["-25 km/h", "60 km/h"]
    del data["drives"]
    return match(case_from_tables(data, str(EXAMPLE / "case.toml"))).tuned


def test_it_is_designed_both_ways(tuned):
    speeds = grid(tuned.operating_range) * 3.6
    assert (speeds.min(), speeds.max()) == (pytest.approx(-25), pytest.approx(60))
    assert (np.diff(speeds) > 0).all()


def test_car_and_bed_drive_alike_backwards_and_through_standstill(tuned):
    controller, time = exported_controller(tuned), np.arange(round(SECONDS / STEP)) * STEP
    count = len(DRIVES)
    one = np.ones(count)
    car = Car(EXAMPLE / "vehicle.toml", {}, count)
    bed = Bed(
        EXAMPLE / "rig.toml", {"inertias.motor.J": 1.02 * one}, count, 0.0021 * one, 0.0005 * one, np.ones((2, 1))
    )
    of_car, of_bed, held, wheel = steady(car, bed, np.array([kmh for kmh, _ in DRIVES]) / 3.6 / RADIUS)
    added = np.stack([np.interp(time, *points) for _, points in DRIVES], axis=1)
    torque = np.stack([added + held, 0 * added, 0 * added], axis=1)
    names, batch = controller.law.sensors, ControllerBatch(controller, count)
    sensors = Sensors(names, [NOISE.get(name, SPEED_NOISE) for name in names], dict.fromkeys(names, 1.0), STEP, SEED)

    def commands(readings, now, mode, hold, sample):
        sent, _, faults = batch.step(readings, told(controller, now), mode, hold, sample)
        return sent, faults

    wanted, _ = drive_car(car, of_car, torque, STEP)
    found, _, lasted = run_bed(
        bed, of_bed, torque, commands, sensors, 0.0025 * one, STEP, np.stack([wheel, wheel]), before=1.0
    )
    assert lasted.all()
    assert wanted[0, 0, 1] < 0 < wanted[-1, 0, 1], "through standstill"
    assert wanted[0, 0, 3] > 0 > wanted[-1, 0, 3], "through standstill"
    errors = np.sqrt(np.mean((found - wanted) ** 2, axis=0)) / np.ptp(wanted, axis=0)
    assert errors.max() <= 0.03, errors
