"""Recordings of a motor and a load on a shaft, integrated here by Runge-Kutta: no code of the product takes part."""

from pathlib import Path

import numpy as np

STEP, LOGGED, DURATION = 2e-4, 10, 6.0  # s; every so many steps a row; s
TRUTH = {"motor": 0.08, "load": 1.1, "stiffness": 360.0, "damping": 0.4, "motor_drag": 0.025, "load_drag": 0.12}
NOISE = {"motor_speed": 0.02, "load_speed": 0.02, "link_torque": 0.1}  # rad/s, rad/s, N·m; standard deviation
MODEL = """
[inertias.motor]
J = 0.08
drag = { value = 0.02, tolerance = 0.6 }
[inertias.load]
J = 1.1
drag = { value = 0.15, tolerance = 0.6 }
[shafts.link]
between = ["motor", "load"]
stiffness = { value = 380, tolerance = 0.15 }
damping = { value = 0.3, tolerance = 0.6 }
[inputs.motor_torque]
on = "motor"
"""
MODEL += "".join(
    f'[sensors.{name}]\nmeasures = "{name.split("_")[1]}"\nof = "{name.split("_")[0]}"\nuncertainty = {noise}\n'
    for name, noise in NOISE.items()
)


def motor_torque(t: float) -> float:
    """Tip-in and back-out of either sign with a sweep on top, N·m: the shaft's torque reverses again and again."""
    return 9.0 * np.sign(np.sin(2 * np.pi * t / 2.5 + 0.3)) + 5.0 * np.sin(2 * np.pi * (0.4 + 0.5 * t) * t)


def write(folder: Path, gap: float = 0.0, friction: float = 0.0, load: float = TRUTH["load"]) -> tuple[Path, Path]:
    """Model as it is believed and recording of the drive with free play (rad), dry friction (N·m) or another load."""
    own = TRUTH | {"load": load}

    def link(x: np.ndarray) -> float:
        twist, rate = x[0] - x[1], x[2] - x[3]
        if abs(twist) <= gap / 2:
            return 0.0
        side = np.sign(twist)
        pull = own["stiffness"] * (twist - side * gap / 2) + own["damping"] * rate
        return pull if gap == 0 or pull * side > 0 else 0.0  # flanks push, they do not pull

    def slope(x: np.ndarray, torque: float) -> np.ndarray:
        shaft = link(x)
        motor = torque - own["motor_drag"] * x[2] - shaft
        rubbing = friction * np.tanh(x[3] / 1e-3)
        return np.array([x[2], x[3], motor / own["motor"], (shaft - own["load_drag"] * x[3] - rubbing) / own["load"]])

    count = round(DURATION / STEP)
    told = motor_torque(np.arange(count // LOGGED + 1) * STEP * LOGGED)  # linear between the rows
    torque = np.interp(np.arange(2 * count + 1) / (2 * LOGGED), np.arange(len(told)), told)
    x, rows = np.zeros(4), []
    for k in range(count + 1):
        if k % LOGGED == 0:
            rows.append([k * STEP, torque[2 * k], x[2], x[3], link(x)])
        if k < count:
            first, middle, last = torque[2 * k : 2 * k + 3]
            a = slope(x, first)
            b = slope(x + STEP / 2 * a, middle)
            c = slope(x + STEP / 2 * b, middle)
            x = x + STEP / 6 * (a + 2 * b + 2 * c + slope(x + STEP * c, last))
    table = np.array(rows)
    table[:, 2:] += np.random.default_rng(7).normal(size=(len(table), 3)) * list(NOISE.values())
    names = "time [s],motor_torque [N*m],motor_speed [rad/s],load_speed [rad/s],link_torque [N*m]"
    np.savetxt(folder / "recording.csv", table, delimiter=",", header=names, comments="", fmt="%.9g")
    (folder / "model.toml").write_text(MODEL, encoding="utf-8")
    return folder / "model.toml", folder / "recording.csv"
