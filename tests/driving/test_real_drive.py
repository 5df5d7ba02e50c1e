"""A dynamometer as a drive that nobody here wrote: inverter, current control and field weakening of ``motulator``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from driving.own_car import FINE, Bed, Car, Sensors, drive_car, steady, step, torques_of
from needs import compiles
from scipy.integrate import solve_ivp

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from modelling.controller.batch import ControllerBatch

pytestmark = compiles
EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away"
STEP, HOLD, RADIUS = 1e-3, 0.5, 0.3  # s, s, m
BANDWIDTH = 500.0  # rad/s of the current control: the 2 ms of inverter lag that the case states
VOLTS, AMPERES = 800.0, 300.0
POLES, FLUX = 8, 0.7  # pairs, Vs: without field weakening the voltage suffices up to 75 rad/s, 81 km/h
KNOWN_DELAY = 1.5 * FINE  # s, that the drive's own computing and modulation take


@dataclass
class Machine:
    """A permanent-magnet machine under current control, one control period a step."""

    def __post_init__(self):
        from motulator.drive import model
        from motulator.drive.control import sm
        from motulator.drive.utils import SynchronousMachinePars

        values = SynchronousMachinePars(n_p=POLES, R_s=0.02, L_d=1.0e-3, L_q=1.4e-3, psi_f=FLUX)
        self.speed, self.wanted = 0.0, 0.0
        self.model = model.Drive(
            model.VoltageSourceConverter(u_dc=VOLTS), model.SynchronousMachine(values),
            model.ExternalRotorSpeed(lambda _: self.speed),
        )  # fmt: skip
        weakening = sm.CurrentReferenceCfg(values, max_i_s=AMPERES, nom_w_m=POLES * 75.0, min_psi_s=0.3)
        self.control = sm.CurrentVectorControl(values, weakening, T_s=FINE, alpha_c=BANDWIDTH, sensorless=False)
        self.control.ref.tau_M = lambda _: self.wanted

    def torque(self, wanted: float, speed: float) -> float:
        """N·m at the end of a control period that begins at this speed, rad/s."""
        self.wanted, self.speed, made = wanted, speed, self.model
        span, duty = self.control(made)
        (span,), (switched,) = made.pwm(span, made.delay(duty))
        made.converter.inp.q_cs = switched
        found = solve_ivp(made.rhs, (made.t0, made.t0 + span), made.get_initial_values())
        made.t0 += span
        made.rhs(made.t0, found.y[:, -1])  # outputs at the end
        return float(made.machine.out.tau_M)


@pytest.mark.long
def test_a_tip_in_that_ends_in_field_weakening():
    pytest.importorskip("motulator")
    case = load_case(EXAMPLE / "case.toml")
    controller = exported_controller(case)
    one, speed = np.ones(1), np.array([65 / 3.6 / RADIUS])
    car = Car(EXAMPLE / "vehicle.toml", {}, 1)
    bed = Bed(EXAMPLE / "rig.toml", {}, 1, 0.002 * one, 0.0005 * one, np.ones((2, 1)))
    begin, state, held, wheel = steady(car, bed, speed)
    time = np.arange(4000) * STEP
    torque = held[0] + 150 * np.clip((time - 0.3) / 0.05, 0, 1)[:, None] - 150 * (time > 3.0)[:, None]
    wanted, _ = drive_car(car, begin, torque, STEP)
    law, machines = controller.law, [Machine(), Machine()]
    noise = [0.3 if name.endswith("torque") else 0.05 for name in law.sensors]
    sensors = Sensors(law.sensors, noise, dict.fromkeys(law.sensors, 1.0), STEP, 3)
    batch, before = ControllerBatch(controller, 1), round(HOLD / STEP)
    delay = case.loop["dead_time"] - STEP / 2 - KNOWN_DELAY
    issued = np.zeros((round(delay / FINE) + 1, 2))
    found, delivered = [], []
    for n in range(-before, len(time)):
        now, after = (torque[min(max(i, 0), len(time) - 1)] for i in (n, n + 1))
        known = np.zeros((len(law.known), 1))
        known[law.known.index("motor_torque")] = now
        commands, _, faults = batch.step(
            sensors.read(state, bed.ratio), known, 1 if n < 0 else 2, np.stack([wheel, wheel]), n + before
        )
        assert n < 0 or not faults.any(), n
        if n >= 0:
            found.append(np.vstack([state["motor"][None], torques_of(bed, state, now, commands)])[:, 0])
        for piece in range(round(STEP / FINE)):
            issued = np.vstack([commands[:, 0], issued[:-1]])
            air = [
                machine.torque(asked, float(state[f"rotor_{side}"][0]))
                for machine, asked, side in zip(machines, issued[-1], ("left", "right"), strict=True)
            ]
            for side, value in zip(("left", "right"), air, strict=True):
                state[f"air_{side}"] = np.array([value])
            drive = now + (after - now) * (piece + 0.5) / round(STEP / FINE)
            state = step(bed, state, drive, np.array(air)[:, None])
        delivered.append((commands[0, 0], air[0], machines[0].control.current_reference.ref_i_sd))
    error = np.sqrt(np.mean((np.array(found) - wanted[:, :, 0]) ** 2, axis=0)) / np.ptp(wanted[:, :, 0], axis=0)
    weakened = min(row[2] for row in delivered)
    print("error over range", np.round(error, 4), "least d-current", weakened, "fastest", float(state["rotor_left"][0]))
    assert weakened < -20, "A: the field was weakened"
    assert error[1:].max() < 0.01, "side shafts"
    assert error.max() < 0.03
