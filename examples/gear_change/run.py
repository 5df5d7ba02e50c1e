"""A gearbox that shifts on the bed, under a controller that knows nothing of it.

    python examples/gear_change/run.py [DIR]      the figure goes to DIR (default: gear_change_out)

The bed is a simulator of this file: motor, two clutches with dry friction that sticks, each with its own ratio,
differential, side shafts, adapters, flanges, rotors, lags and dead time. The controller is that of case.toml, as
rigmatch exports it; it is not told of the shift from 10.05 to 6.5.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rigmatch as rm
from matching.match.case import whole_loop
from modelling.controller.law import FAULTS
from modelling.running.run import Motion

HERE = Path(__file__).parent
STEP, FINE = 1e-3, 1e-4  # s: of the controller, and of this simulator
LOW, HIGH = 10.05, 6.5  # ratios
LOCKED = 400.0  # N·m that a closed clutch carries
BEHIND = 0.03  # kg·m² behind the clutches
GIVES, SETTLES = 0.02, 2e-5  # rad that a clutch gives way before it slides under its whole torque; s
HOLD, BEGIN, HANDING, TURNING = 1.0, 1.7, 0.15, 0.25  # s: speed hold; begin of the shift; its two phases
DEAD_TIME = 0.0025  # s from a sample to the torque, half a sample of hold not counted
ALL_SENSORS = "flange_left_torque", "flange_right_torque", "rotor_left_speed", "rotor_right_speed", "motor_speed"
SPEEDS = ("motor", "gearbox", "behind", "differential", "adapter_left", "adapter_right", "rotor_left", "rotor_right")
SHAFTS = {  # its two ends
    "gear_mesh": ("motor", "gearbox"), "gear_output": ("behind", "differential"),
    "side_left": ("differential", "adapter_left"), "side_right": ("differential", "adapter_right"),
    "flange_left": ("adapter_left", "rotor_left"), "flange_right": ("adapter_right", "rotor_right"),
}  # fmt: skip


class ShiftingBed:
    """One bed, as :func:`rm.run` steps it; values of inertias and shafts come from the rig's file."""

    inputs = ("motor_torque", "clutch_low", "clutch_high")
    commands = ("left", "right")
    count = 1

    def __init__(self, rig: rm.System, sensors: tuple[str, ...], wheel: float):
        value = {name: quantity.value for name, quantity in rig.parameters.items()}
        self.sensors, self.wheel = sensors, wheel
        inertia = np.array([value.get(f"inertias.{name}.J", BEHIND) for name in SPEEDS])
        drag = np.array([value.get(f"inertias.{name}.drag", 0.0) for name in SPEEDS])
        ends = np.array([[(name == first) - (name == second) for name in SPEEDS] for first, second in SHAFTS.values()])
        self.k = np.array([value[f"shafts.{name}.stiffness"] for name in SHAFTS])
        self.c = np.array([value[f"shafts.{name}.damping"] for name in SHAFTS])
        self.ends, self.inertia, self.drag = ends, inertia, drag
        self.begin(np.zeros((3, 1)))

    def begin(self, torques: np.ndarray) -> None:
        """All turns at the wheel's speed, in the low gear."""
        self.speeds = np.array([LOW, LOW, 1, 1, 1, 1, 1, 1]) * self.wheel
        self.twists, self.stuck = np.zeros(len(SHAFTS)), np.zeros(2)
        self.air, self.read = np.zeros(2), np.zeros(2)
        self.waiting = [np.zeros(2)] * (round(DEAD_TIME / FINE) + 1)

    def readings(self) -> np.ndarray:
        """Lagged flange torques and speeds."""
        known = dict(zip(("flange_left_torque", "flange_right_torque"), self.read, strict=True))
        known |= {f"{name}_speed": speed for name, speed in zip(SPEEDS, self.speeds, strict=True)}
        known |= {f"{name}_torque": torque for name, torque in zip(SHAFTS, self.shafts(), strict=True)} | known
        return np.array([[known[name]] for name in self.sensors])

    def shafts(self) -> np.ndarray:
        """Torques of the shafts, N·m."""
        return self.k * self.twists + self.c * (self.ends @ self.speeds)

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """Runge and Kutta's classical method."""
        pieces = round(span / FINE)
        for piece in range(pieces):
            self.waiting = [commands[:, 0], *self.waiting[:-1]]
            acting = (torques + (after - torques) * (piece + 0.5) / pieces)[:, 0]
            x = np.concatenate([self.speeds, self.twists, self.stuck, self.air, self.read])
            k1 = self.rates(x, acting)
            k2 = self.rates(x + FINE / 2 * k1, acting)
            k3 = self.rates(x + FINE / 2 * k2, acting)
            k4 = self.rates(x + FINE * k3, acting)
            x = x + FINE / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self.speeds, self.twists, self.stuck, self.air, self.read = np.split(x, (8, 14, 16, 18))

    def rates(self, x: np.ndarray, acting: np.ndarray) -> np.ndarray:
        """Of speeds, twists, clutches, air-gap torques and flange readings."""
        speeds, twists, stuck, air, read = np.split(x, (8, 14, 16, 18))
        rate = self.ends @ speeds
        through = self.k * twists + self.c * rate
        ratios = np.array([LOW, HIGH])
        slip = speeds[1] - ratios * speeds[2]
        stuck_rate = slip - np.abs(slip) * stuck / GIVES  # dry friction after Dahl: a spring that slides
        friction = acting[1:] * (stuck + SETTLES * stuck_rate) / GIVES
        torque = -self.ends.T @ through - self.drag * speeds
        torque[0] += acting[0]
        torque[1] -= friction.sum()
        torque[2] += ratios @ friction
        torque[6:] += air
        return np.concatenate([
            torque / self.inertia, rate, stuck_rate, (self.waiting[-1] - air) / 0.002, (through[4:] - read) / 0.0005
        ])  # fmt: skip


def ramp(time: np.ndarray, begin: float, rise: float) -> np.ndarray:
    """0 to 1, evenly."""
    return np.clip((time - begin) / rise, 0, 1)


def shift(time: np.ndarray, wheel: float, inertia: float) -> dict[str, np.ndarray]:
    """Motor torque and what the clutches carry: handed over in 0.15 s, then the motor comes to its speed in 0.25 s."""
    pull, slide = 100.0, 100.0 + inertia * wheel * (LOW - HIGH) / TURNING
    low = LOCKED + (pull - LOCKED) * ramp(time, BEGIN - 0.05, 0.05)
    high = pull * ramp(time, BEGIN, HANDING) + (slide - pull) * ramp(time, BEGIN + HANDING, 0.05)
    high += (LOCKED - slide) * ramp(time, BEGIN + HANDING + 1.2 * TURNING, 0.05)
    return {
        "motor_torque": pull * ramp(time, HOLD + 0.2, 0.15), "clutch_low": low * (1 - ramp(time, BEGIN, HANDING)),
        "clutch_high": high,
    }  # fmt: skip


def main(out: Path) -> dict[str, Motion]:
    """Play the shift under both controllers, check and draw it."""
    case, time = rm.load_case(HERE / "case.toml"), np.arange(round(3.2 / STEP)) * STEP
    values = {name: quantity.value for name, quantity in case.rig.parameters.items()}
    wheel = 50 / 3.6 / 0.3
    torques = shift(time, wheel, values["inertias.motor.J"] + values["inertias.gearbox.J"])
    found: dict[str, Motion] = {}
    for specimen, one in (("unknown", case), ("known", replace(case, loop=whole_loop(case)))):
        controller = rm.controller(one, hold=HOLD)
        bed = ShiftingBed(case.rig, (*ALL_SENSORS, "side_left_torque"), wheel)
        found[specimen] = rm.run(bed, controller, torques, {"motor_torque": torques["motor_torque"]}, sample_time=STEP)
    motion = found["unknown"]
    emulated = time > HOLD + 0.1
    apart = motion["rotor_left_speed"][:, 0] - motion.emulated["left.wheel_speed"][:, 0]
    over = 100 * np.sqrt(np.mean(apart[emulated] ** 2)) / np.ptp(motion.emulated["left.wheel_speed"][emulated])
    ended = found["known"].fault_at[0]
    print(
        f"specimen unknown: rotor and emulated wheel {over:.2f} % of the range apart, fault: {FAULTS[motion.fault[0]]}"
    )
    print(f"specimen known, in one gear: {FAULTS[found['known'].fault[0]]!r} {1e3 * (time[ended] - BEGIN):.0f} ms "
          "after the shift began")  # fmt: skip
    assert motion.fault[0] == 0
    assert over < 1.0
    assert found["known"].fault[0] > 0
    ratio = motion["motor_speed"][-1, 0] / motion["rotor_left_speed"][-1, 0]
    assert abs(ratio - HIGH) < 0.05
    draw(found, time - BEGIN, ended, out)
    return found


def draw(found: dict[str, Motion], time: np.ndarray, ended: int, out: Path) -> None:
    """Motor, side shaft, rotor with the emulated wheel, and the command."""
    figure, motion = Figure(figsize=(10, 6), layout="constrained"), found["unknown"]
    of_motor, of_shaft, of_wheel, of_command = figure.subplots(2, 2, sharex=True).ravel()
    for axes, name, words in (
        (of_motor, "motor_speed", "motor [rad/s]"), (of_shaft, "side_left_torque", "side shaft [N·m]"),
        (of_wheel, "rotor_left_speed", "left rotor [rad/s]"),
    ):  # fmt: skip
        axes.plot(time, motion[name][:, 0], color="#009E73", label='specimen "unknown"')
        axes.plot(time[:ended], found["known"][name][:ended, 0], "--", color="#D55E00",
                  label='"known", until emulation ends')  # fmt: skip
        axes.set_ylabel(words)
    of_wheel.plot(
        time, motion.emulated["left.wheel_speed"][:, 0], ":", color="#0072B2", linewidth=2.5, label="emulated wheel"
    )
    of_command.plot(time, motion.commands[:, 0, 0], color="#009E73")
    of_command.set_ylabel("command, left [N·m]")
    for axes in (of_motor, of_shaft, of_wheel, of_command):
        axes.grid(alpha=0.3)
        axes.set_xlim(-0.3, 1.0)
    for axes in (of_wheel, of_command):
        axes.set_xlabel("time since the shift began [s]")
    of_wheel.legend(frameon=False, loc="lower left")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "gear_change.png", dpi=90)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "gear_change_out"))
