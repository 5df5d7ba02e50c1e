"""A drive of the starter's vehicle in the CSV of a German logger, by the tests' own equations.

Motor, gear, side shafts, wheels, tyres and body as a chain, stepped by the matrix exponential of states and of torques
that run straight between samples. The values differ from the starter's files.
"""

from pathlib import Path

import numpy as np
from scipy.linalg import expm

MOTOR, PINION, DIFFERENTIAL, WHEELS, BODY, RATIO = 0.0415, 0.001, 0.06, 2.2, 158.0, 9.7
SIDE, SIDE_DAMPING, TYRES, TYRE_DAMPING, ROTOR, ROTOR_DAMPING = 17250.0, 24.0, 29500.0, 260.0, 9000.0, 0.18
DRAG, STEP, SPEED = 0.002, 0.002, 20 / 0.3
TORQUE = ([0, 0.5, 0.55, 2.5, 2.6, 4.5, 4.55, 6, 6.05, 8, 8.3, 9.5, 9.6, 11],
          [0, 0, 80, 80, -40, -40, 100, 100, -50, -50, 60, 60, -20, -20])  # fmt: skip


def drive(seed: int = 5) -> np.ndarray:
    """Time, motor torque, and readings with noise: motor and body speed (rad/s), side shaft torque (N·m)."""
    inertia = np.diag([MOTOR, PINION + DIFFERENTIAL / RATIO**2, WHEELS, BODY])
    twists = np.array([[1, -1, 0, 0], [0, 1 / RATIO, -1, 0], [0, 0, 1, -1]])
    stiffness = twists.T @ np.diag([ROTOR, SIDE, TYRES]) @ twists
    damping = twists.T @ np.diag([ROTOR_DAMPING, SIDE_DAMPING, TYRE_DAMPING]) @ twists
    damping[0, 0] += DRAG
    A = np.zeros((10, 10))  # angles, speeds, torque, its slope
    A[:4, 4:8] = np.eye(4)
    A[4:8, :8] = -np.linalg.solve(inertia, np.hstack([stiffness, damping]))
    A[4, 8], A[8, 9] = 1 / MOTOR, 1.0
    step = expm(A * STEP)
    time = np.arange(0, TORQUE[0][-1], STEP)
    torque = np.interp(time, *TORQUE)
    state = np.zeros(10)
    state[4:8] = SPEED * np.array([RATIO, RATIO, 1, 1])
    rows = []
    for k, now in enumerate(time):
        state[8] = torque[k]
        state[9] = (torque[k + 1] - torque[k]) / STEP if k + 1 < len(time) else 0.0
        side = SIDE * (twists[1] @ state[:4]) + SIDE_DAMPING * (twists[1] @ state[4:8])
        rows.append([now, torque[k], state[4], state[7], side])
        state = step @ state
    read = np.array(rows)
    rng = np.random.default_rng(seed)
    read[:, 2:] += rng.normal(0, [0.05, 0.02, 2.0], (len(read), 3))
    return read


def german(path: Path) -> Path:
    """The drive as a file with decimal commas, semicolons, 1/min and kN·m."""
    lines = ["Zeit [s];M_EM [Nm];n_EM [1/min];n_Rad [1/min];M_SW [kNm]"]
    turns = 30 / np.pi
    for time, torque, motor, body, side in drive():
        cells = f"{time:.4f};{torque:.6g};{turns * motor:.7g};{turns * body:.7g};{side / 1000:.6g}"
        lines.append(cells.replace(".", ","))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
