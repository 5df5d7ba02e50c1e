"""The stated error bounds the true one, and not by far, of random linear chains whose exact motion is known."""

import numpy as np
from scipy.linalg import expm

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

SAMPLES = 400
ROUNDING = 1e-8  # of a range: what the matrix exponentials lose


def chain(rng):
    """Inertias, stiffnesses and damping; shafts vibrate far below, near and above the sampling rate."""
    count = int(rng.integers(2, 6))
    inertia, frequency = 10 ** rng.uniform(-2, 1, count), 2 * np.pi * 10 ** rng.uniform(0.5, 4.0, count - 1)
    stiffness = frequency**2 * inertia[:-1] * inertia[1:] / (inertia[:-1] + inertia[1:])
    damping = 2 * rng.choice([0, 1e-4, 1e-2, 0.05], count - 1) * stiffness / frequency
    return inertia, stiffness, damping


def system(inertia, stiffness, damping):
    shafts = {
        f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": float(k), "damping": float(d)}
        for i, (k, d) in enumerate(zip(stiffness, damping, strict=True))
    }
    sensors = {f"y{i}": {"measures": "speed", "of": f"i{i}"} for i in range(len(inertia))}
    sensors |= {f"t{i}": {"measures": "torque", "of": f"s{i}"} for i in range(len(stiffness))}
    inertias = {f"i{i}": {"J": float(value)} for i, value in enumerate(inertia)}
    return from_dict({"inertias": inertias, "shafts": shafts, "inputs": {"u": {"on": "i0"}}, "sensors": sensors})


def exact(inertia, stiffness, damping, step, torque):
    """Speeds and shaft torques (t, y) for a torque (t,) that is linear between its samples, by a matrix exponential.

    The states are speeds and twists: angles of a chain that turns would take the twists' digits.
    """
    n, m = len(inertia), 2 * len(inertia) - 1
    twist = np.eye(n)[:-1] - np.eye(n)[1:]
    rates = np.zeros((m + 2, m + 2))
    rates[n:m, :n] = twist
    rates[:n, n:m] = -twist.T * stiffness / inertia[:, None]
    rates[:n, :n] = -(twist.T * damping) @ twist / inertia[:, None]
    rates[0, m] = 1 / inertia[0]
    rates *= step
    rates[m, m + 1] = 1.0
    over_step = expm(rates)[:m]
    states = np.zeros((len(torque), m))
    for i, (now, change) in enumerate(zip(torque, np.diff(torque), strict=False)):
        states[i + 1] = over_step @ np.concatenate([states[i], [now, change]])
    speeds, twists = states[:, :n], states[:, n:]
    return np.hstack([speeds, twists * stiffness + speeds @ twist.T * damping])


def test_the_stated_error_bounds_the_true_one_in_95_of_100_chains_and_not_by_far():
    bounded, ratios = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        parts, step = chain(rng), 10 ** rng.uniform(-3, -2)
        time = np.arange(SAMPLES) * step
        torque = rng.normal(0, 20, SAMPLES) if seed % 2 else 20 * np.sin(2 * np.pi * 3 * time)
        done = simulate(system(*parts), time, {"u": torque}, start={})
        true = exact(*parts, step, torque)
        errors = np.abs(np.stack(list(done.readings.values()), axis=1) - true).max(axis=0) / np.ptp(true, axis=0)
        stated = np.array(list(done.integration_error.values()))
        bounded.append((errors <= np.maximum(stated, ROUNDING)).all())
        ratios += (stated / errors)[errors > ROUNDING].tolist()
    assert np.mean(bounded) >= 0.95
    assert len(ratios) > 100
    assert np.median(ratios) < 10
