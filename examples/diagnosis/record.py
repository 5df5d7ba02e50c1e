"""Recordings of a drive with hard free play, made by SciPy alone: nothing here knows of rigmatch.

python examples/diagnosis/record.py out/diagnosis
"""

import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

TRUTH = {"stiffness": 360.0, "damping": 0.4, "motor_drag": 0.025, "load_drag": 0.12}
MOTOR, LOAD, GAP = 0.08, 1.1, 0.024  # kg·m², kg·m², rad
TIME = np.arange(0, 9, 0.002)
LOGGED = slice(500, None)  # the logger is started after 1 s, in motion
SPEED_NOISE, TORQUE_NOISE = 0.2 * np.pi / 30, 0.1


def reversing(time: np.ndarray) -> np.ndarray:
    """Tip-in and back-out under load of either sign, and a sweep on top: torque passes through zero again and again."""
    steps = 9.0 * np.sign(np.sin(2 * np.pi * time / 2.5 + 0.3))
    return steps + 5.0 * np.sin(2 * np.pi * (0.4 * time + 0.5 * time**2))


def one_way(time: np.ndarray) -> np.ndarray:
    """The same, but always pulling."""
    return 45.0 + 0.5 * reversing(time)


def drive(demand: np.ndarray, gap: float, disturbance: float = 0.0) -> tuple[np.ndarray, ...]:
    """Motor speed, load speed and shaft torque (t,) for a motor torque (t,)."""

    def torque(twist: float, rate: float) -> float:
        if abs(twist) <= gap / 2:
            return 0.0
        side = 1.0 if twist > 0 else -1.0
        pull = TRUTH["stiffness"] * (twist - side * gap / 2) + TRUTH["damping"] * rate
        return pull if pull * side > 0 else 0.0  # flanks push, they do not pull

    def motion(t: float, x: np.ndarray) -> list[float]:
        link = torque(x[0] - x[1], x[2] - x[3])
        motor = np.interp(t, TIME, demand) - TRUTH["motor_drag"] * x[2] - link
        load = link - TRUTH["load_drag"] * x[3] + disturbance * np.sin(2 * np.pi * 7 * t)
        return [x[2], x[3], motor / MOTOR, load / LOAD]

    x = solve_ivp(motion, (0, TIME[-1]), np.zeros(4), "LSODA", TIME, rtol=1e-7, atol=1e-9, max_step=2e-3).y
    link = np.array([torque(twist, rate) for twist, rate in zip(x[0] - x[1], x[2] - x[3], strict=True)])
    return x[2], x[3], link


def recordings() -> dict[str, np.ndarray]:
    """Rows (t, 5) of every recording by name, as a data logger writes them."""
    noise = np.random.default_rng(7)
    out = {}
    for name, demand, gap, disturbance in (
        ("play", reversing(TIME), GAP, 0.0),
        ("play_pulled_one_way", one_way(TIME), GAP, 0.0),
        ("sound", reversing(TIME), 0.0, 0.0),
        ("shaken_from_outside", reversing(TIME), 0.0, 2.0),
    ):
        motor, load, link = drive(demand, gap, disturbance)
        scatter = noise.standard_normal((3, len(TIME)))
        speeds = (np.array([motor, load]) + SPEED_NOISE * scatter[:2]) * 30 / np.pi
        rows = np.column_stack([TIME - TIME[LOGGED][0], demand, *speeds, link + TORQUE_NOISE * scatter[2]])
        out[name] = rows[LOGGED]
    return out


def main(folder: Path) -> None:
    """Write every recording into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    header = "time [s],motor_torque [N*m],motor_speed [1/min],load_speed [1/min],link_torque [N*m]"
    for name, rows in recordings().items():
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.8g")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/diagnosis"))
