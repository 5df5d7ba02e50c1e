"""One controller over a range of speeds, on a bed and beside a car that rigmatch knows nothing of."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from driving.own_car import Bed, Car, Sensors, drive_car, run_bed, steady
from fmu.slave import slave
from needs import compiles

from matching.match.exported import exported_controller
from modelling.controller.batch import ControllerBatch
from modelling.fmu.export import controller_fmu

pytestmark = compiles
EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away"
STEP, BEDS, SEED, SECONDS = 1e-3, 20, 9203, 6.5
RADIUS = 0.3
NOISE = {"flange_left_torque": 0.3445, "flange_right_torque": 0.3385}
SPEED_NOISE = 0.0836  # rad/s


def drawn(count, drives, width, random):
    """Factors (b,) within ± a width: the first bed of every drive is as planned, beds are the same in all drives."""
    return np.tile(1 + width * np.r_[0.0, random.uniform(-1, 1, count)], drives)


def tip_in(time, size, at, over):
    return size * np.clip((time - at) / over, 0, 1)


def drives_over(time):
    """Speeds, km/h, added motor torques (t,) and those of each brake: drive-away to 50 km/h in 6 s, tip-ins, to
    standstill and held by the motor, and braked to standstill, held, and away again."""
    part, free = np.clip((time - 0.8) / 0.3, 0, 1), 0 * time
    slowing = -60 * np.clip(time / 0.3, 0, 1) * (time < 2.35)  # rolling resistance stops it, and holds it
    braked = 750 * (np.clip((time - 0.3) / 0.2, 0, 1) - np.clip((time - 4.5) / 0.2, 0, 1))
    return [
        (0.0, 150 * part**2 * (3 - 2 * part), free),
        *((kmh, tip_in(time, 100, 0.2, 0.05), free) for kmh in (10.0, 30.0, 80.0)),
        (10.0, slowing, free), (20.0, tip_in(time, 140, 4.6, 0.5), braked),
    ]  # fmt: skip


def told(controller, now):
    """What the controller knows (w, b) of motor and brakes (3, b)."""
    known = np.zeros((len(controller.law.known), now.shape[1]))
    for number, name in enumerate(("motor_torque", "brake_left", "brake_right")):
        known[controller.law.known.index(name)] = now[number]
    return known


@pytest.fixture(scope="module")
def controller():
    """Of the example as its run.py matches it, with its figures asserted."""
    return exported_controller(runpy.run_path(str(EXAMPLE / "run.py"))["main"]().tuned)


@pytest.fixture(scope="module")
def motions(controller):
    """Car and bed in all drives: (t, 3, b), commands (t, 2, b), whether emulation lasted (b,), and the speeds."""
    random, time = np.random.default_rng(SEED), np.arange(round(SECONDS / STEP)) * STEP
    drives = drives_over(time)
    count = len(drives) * (BEDS + 1)

    def some(width):
        return drawn(BEDS, len(drives), width, random)

    inertias = ("motor", "gearbox", "differential", "adapter_left", "adapter_right", "rotor_left", "rotor_right")
    shafts = ("gear_mesh", "gear_output", "side_left", "side_right", "flange_left", "flange_right")
    factors = {f"inertias.{name}.J": some(0.05) for name in inertias}
    factors |= {f"shafts.{name}.stiffness": some(0.05) for name in shafts}
    factors |= {f"shafts.{name}.damping": some(0.3) for name in shafts}
    car = Car(EXAMPLE / "vehicle.toml", factors, count)
    gains = np.stack([some(0.03), some(0.03)])
    bed = Bed(EXAMPLE / "rig.toml", factors, count, 0.002 * some(0.2), 0.0005 * some(0.2), gains)
    speed = np.repeat([kmh / 3.6 / RADIUS for kmh, *_ in drives], BEDS + 1)
    of_car, of_bed, held, wheel = steady(car, bed, speed)
    added, brake = (np.repeat(np.stack(each, axis=1), BEDS + 1, axis=1) for each in list(zip(*drives, strict=True))[1:])
    torque = np.stack([added + held, brake, brake], axis=1)
    names = controller.law.sensors
    sensors = Sensors(
        names, [NOISE.get(name, SPEED_NOISE) for name in names], {name: some(0.005) for name in names}, STEP, SEED
    )
    batch = ControllerBatch(controller, count)

    def commands(readings, now, mode, hold, sample):
        sent, _, faults = batch.step(readings, told(controller, now), mode, hold, sample)
        return sent, faults

    wanted, _ = drive_car(car, of_car, torque, STEP)
    delay = 0.0025 + 0.0005 * (some(1.0) - 1)
    found, sent, lasted = run_bed(
        bed, of_bed, torque, commands, sensors, delay, STEP, np.stack([wheel, wheel]), before=1.0
    )
    return wanted, found, sent, lasted, len(drives)


@pytest.mark.long
def test_car_and_bed_drive_alike_through_the_range(motions):
    wanted, found, _, lasted, drives = motions
    assert lasted.all(), "emulation ended by itself"
    errors = np.sqrt(np.mean((found - wanted) ** 2, axis=0)) / np.ptp(wanted, axis=0)
    worst = errors.max(axis=0).reshape(drives, BEDS + 1)
    print(np.round(worst[:, 0], 4), np.round(np.sort(worst[:, 1:], axis=1)[:, [-1, -2]], 4))
    assert worst[:, 0].max() <= 0.03, worst[:, 0]
    assert (worst[:, 1:] <= 0.05).sum(axis=1).min() >= 19, worst


@pytest.mark.long
def test_it_is_quiet_at_rest(motions):
    _, _, sent, _, _ = motions
    at_rest = sent[:500, :, : BEDS + 1]  # before the car drives away
    assert np.std(at_rest, axis=0).max() <= 0.02 * 1500


@pytest.mark.long
def test_the_fmu_drives_the_bed_away(controller, tmp_path):
    """Through the whole manoeuvre on the bed as planned, by another tool."""
    (tmp_path / "controller.fmu").write_bytes(controller_fmu(controller).content)
    law, time = controller.law, np.arange(round(SECONDS / STEP)) * STEP
    car, one = Car(EXAMPLE / "vehicle.toml", {}, 1), np.ones(1)
    bed = Bed(EXAMPLE / "rig.toml", {}, 1, 0.002 * one, 0.0005 * one, np.ones((2, 1)))
    of_car, of_bed, held, wheel = steady(car, bed, np.zeros(1))
    torque = drives_over(time)[0][1][:, None] + held  # of the motor
    noise = [NOISE.get(name, SPEED_NOISE) for name in law.sensors]
    sensors = Sensors(law.sensors, noise, dict.fromkeys(law.sensors, 1.0), STEP, SEED)
    names = [f"{name}.command" for name in law.dynamometers]
    with slave(tmp_path / "controller.fmu") as fmu:
        fmu.begin()

        def commands(readings, now, mode, hold, sample):
            values = dict(zip(law.sensors, readings[:, 0], strict=True)) | {"motor_torque": float(now[0])}
            values |= {f"{name}.hold_speed": hold[j, 0] for j, name in enumerate(law.dynamometers)}
            fmu.set(values | {"mode": float(mode), "life": float(sample)})
            fmu.step(STEP)
            return np.array(fmu.get(names))[:, None], np.array(fmu.get(["fault"]))

        found, _, lasted = run_bed(
            bed, of_bed, torque, commands, sensors, np.array([0.0025]), STEP, np.stack([wheel, wheel]), before=1.0
        )
    wanted, _ = drive_car(car, of_car, torque, STEP)
    assert lasted.all()
    errors = np.sqrt(np.mean((found - wanted) ** 2, axis=0)) / np.ptp(wanted, axis=0)
    assert errors.max() <= 0.03
