"""The stated error bounds the true one, and not by far, of random chains whose motion is known by another method."""

import numpy as np
import pytest
from scipy.linalg import expm

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate
from tests.simulation import eventwise

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


def errors_of(seed, samples):
    """True and stated errors (y,) of a drawn chain with free play and dry friction."""
    chain_, time, torque = eventwise.drawn(seed, samples)
    done = simulate(from_dict(chain_.as_model()), time, {"u0": torque[:, 0], "u1": torque[:, 1]}, start={})
    true = chain_.readings(time, torque)
    ranges = np.ptp(true, axis=0)
    moves = ranges > 0  # a rotor that friction holds reads 0, and the regularised law lets it creep
    errors = np.abs(np.stack(list(done.readings.values()), axis=1) - true).max(axis=0)[moves] / ranges[moves]
    return errors, np.array(list(done.integration_error.values()))[moves]


@pytest.mark.parametrize(
    ("first", "count", "samples"),
    [(0, 8, 150), *(pytest.param(first, 20, 400, marks=pytest.mark.long) for first in (0, 20, 40))],
)
def test_the_stated_error_holds_with_free_play_and_dry_friction(first, count, samples):
    """Contacts between samples, jumps of the shaft's damping, rotors that stick: event by event."""
    bounded, ratios = [], []
    for seed in range(first, first + count):
        errors, stated = errors_of(seed, samples)
        bounded.append((errors <= np.maximum(stated * 1.001, ROUNDING)).all())
        ratios.append(float(np.median(stated / errors)))
    assert np.mean(bounded) >= 0.95
    assert np.median(ratios) < 10


def test_two_rotors_and_free_play_event_by_event():
    """The other method itself: two free rotors meet; before contact by hand, and energy and momentum after it."""
    chain_ = eventwise.Chain(
        np.array([1.0, 2.0]), np.zeros(2), np.zeros(2), np.array([900.0]), np.zeros(1), np.array([0.2]), [0]
    )
    time = np.arange(4001) * 1e-3
    torque = np.where(time < 0.1, 3.0, 0.0)[:, None]
    first, second, link = chain_.readings(time, torque).T
    np.testing.assert_allclose(first[:90], 3 * time[:90], rtol=1e-9)
    assert np.abs(second[:90]).max() == 0
    momentum = first + 2 * second
    assert np.ptp(momentum[110:]) < 1e-9
    apart = np.flatnonzero((link == 0) & (time > 0.2))
    energy = first[apart] ** 2 / 2 + second[apart] ** 2
    assert len(apart) > 100
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
