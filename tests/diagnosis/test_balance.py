"""The torque balance against two masses by hand, and the smoother against the iterated Riccati equation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from matching.diagnosis.causes import linear_model, torque_balance
from matching.diagnosis.data import FitData, Segment, stationary_smoother
from matching.diagnosis.descent import solve
from matching.diagnosis.problem import base_problem
from modelling.model_file import from_dict

J1, J2, K, C, RATIO = 0.2, 1.5, 300.0, 0.8, 4.0
DRIVE = from_dict({
    "inertias": {"motor": {"J": J1}, "load": {"J": J2}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": K, "damping": C, "ratio": RATIO}},
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {
        "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 1e-3},
        "link_torque": {"measures": "torque", "of": "link", "uncertainty": 1e-3},
        "load_speed": {"measures": "speed", "of": "load", "uncertainty": 1e-3},
    },
})  # fmt: skip


def test_linear_model_of_two_masses_by_hand() -> None:
    """A further torque T in the shaft: −T/ratio on the first inertia, +T on the second, and T in its sensor."""
    value = {name: quantity.value for name, quantity in DRIVE.parameters.items()}
    found = linear_model(DRIVE, value)
    twist = np.array([1 / RATIO, -1.0])
    stiffness, damping = K * np.outer(twist, twist), C * np.outer(twist, twist)
    inverse = np.diag([1 / J1, 1 / J2])
    lower = np.hstack([-inverse @ stiffness, -inverse @ damping])
    np.testing.assert_allclose(found.A, np.vstack([np.eye(4)[2:], lower]), rtol=1e-12)
    speeds = np.array([[1 / J1, 0, -1 / RATIO / J1], [0, 1 / J2, 1 / J2]])
    np.testing.assert_allclose(found.B, np.vstack([np.zeros((2, 3)), speeds]), rtol=1e-12)
    np.testing.assert_allclose(found.C, [[0, 0, 1, 0], [*K * twist, *C * twist], [0, 0, 0, 1]], rtol=1e-12)
    np.testing.assert_allclose(found.D, [[0, 0, 0], [0, 0, 1], [0, 0, 0]], rtol=1e-12)


@pytest.mark.parametrize(("place", "size"), [("motor", 2.0), ("load", 5.0), ("link", 3.0)])
def test_a_torque_that_the_model_lacks_is_found_where_it_acts(place: str, size: float) -> None:
    time = np.arange(2000) * 1e-3
    torque = 20 * np.sin(2 * np.pi * 1.3 * time)
    missing = size * np.sin(2 * np.pi * 4.0 * time)
    value = {name: quantity.value for name, quantity in DRIVE.parameters.items()}
    model = linear_model(DRIVE, value)
    column = {"motor": 0, "load": 1, "link": 2}[place]
    readings = _simulated(model, time, np.column_stack([torque, missing]), [0, column])
    data = FitData((Segment(time, torque[:, None], readings, "made"),), np.full(3, 1e-3))
    problem, start = base_problem(DRIVE, data)
    fit = solve(problem, start)
    fit = replace(fit, residual=problem.residuals(np.zeros((1, problem.size)))[0])  # from rest, as made
    found = torque_balance(fit, DRIVE, value, 20.0)
    parts = {"motor": found.inertias[:, 0], "load": found.inertias[:, 1], "link": found.shafts[:, 0]}
    middle = slice(300, 1700)
    power = missing[middle] @ missing[middle]
    shares = {name: float(own[middle] @ missing[middle] / power) for name, own in parts.items()}
    assert shares.pop(place) == pytest.approx(1.0, abs=0.1)
    assert max(abs(share) for share in shares.values()) < 0.1


def test_unknown_torques_are_stationary_with_a_fifth_of_the_scale(monkeypatch) -> None:
    """An Ornstein-Uhlenbeck process: variance Q/(1 − f²), f its factor from sample to sample."""
    asked = []

    def smoother(*matrices):
        asked.append(matrices)
        return stationary_smoother(*matrices)

    monkeypatch.setattr("matching.diagnosis.causes.stationary_smoother", smoother)
    time = np.arange(100) * 1e-3
    data = FitData((Segment(time, np.zeros((100, 1)), np.zeros((100, 3)), "made"),), np.array([1e-3, 2e-3, 3e-3]))
    value = {name: quantity.value for name, quantity in DRIVE.parameters.items()}
    torque_balance(solve(*base_problem(DRIVE, data)), DRIVE, value, 20.0)
    ((F, _, Q, R),) = asked
    np.testing.assert_allclose(np.diag(F)[4:], np.exp(-1e-3 / 0.01), rtol=1e-9)
    np.testing.assert_allclose(np.diag(Q)[4:] / (1 - np.diag(F)[4:] ** 2), (0.2 * 20.0) ** 2, rtol=1e-9)
    assert not np.diag(Q)[:4].any()
    np.testing.assert_allclose(R, [1e-6, 4e-6, 9e-6, 1.0, 1.0], rtol=1e-12)


def _simulated(model, time: np.ndarray, torques: np.ndarray, columns: list[int]) -> np.ndarray:
    """Readings (t, y) of the linear model from rest: matrix exponential, torques linear between samples."""
    B, D = model.B[:, columns], model.D[:, columns]
    return lsim((model.A, B, model.C, D), torques, time, interp=True)[1]


def test_gains_are_those_of_the_iterated_riccati_equation() -> None:
    rng = np.random.default_rng(4)
    F = np.array([[1, 0.01, 0], [-0.3, 0.99, 0.01], [0, 0, 0.9]])
    H = rng.standard_normal((2, 3))
    Q, R = np.diag([0.0, 0.0, 0.5]), np.array([1e-4, 2.0])
    P = np.eye(3)
    for _ in range(20_000):
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(R))
        filtered = P - gain @ H @ P
        P = F @ filtered @ F.T + Q
    found = stationary_smoother(F, H, Q, R)
    np.testing.assert_allclose(found.gain, gain, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.smoother_gain, filtered @ F.T @ np.linalg.inv(P), rtol=1e-7, atol=1e-10)


def test_smoothed_states_minimise_noise_and_disturbance_together() -> None:
    """A random walk read with noise: far from the ends a two-sided exponential average."""
    q, r = 0.04, 1.0
    P = (q + np.sqrt(q**2 + 4 * q * r)) / 2
    decay = r / (P + r)
    y = np.zeros((401, 1))
    y[200] = 1.0
    found = stationary_smoother(np.eye(1), np.eye(1), np.array([[q]]), np.array([r])).smooth(y)[:, 0]
    k = np.abs(np.arange(401) - 200)
    np.testing.assert_allclose(found, (1 - decay) / (1 + decay) * decay**k, atol=1e-9)
