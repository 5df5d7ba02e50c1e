"""The integrator against closed forms, energy, SciPy and itself with a finer step."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from plant.engine import Chain, Motion, simulate


def two_masses(**more: list) -> Chain:
    chain = Chain(2, 1, 2)
    values = {"J": [0.1, 1.5] * 2, "k": [300.0] * 2, "second": [1], "on": [0, 1]} | more
    for name, value in values.items():
        chain[name][:] = value
    return chain


def four_masses() -> Chain:
    chain = Chain(4, 3, 3)
    chain["J"][:] = [4.0, 0.2, 0.8, 0.9] * 2
    chain["drag"][:] = [1.0, 0.0, 0.3, 0.2] * 2
    chain["k"][:] = [1.5e5, 9e3, 8e3] * 2
    chain["c"][:] = [60, 12, 15] * 2
    chain["first"][:], chain["second"][:] = [0, 1, 1], [1, 2, 3]
    chain["ratio"][:] = [1.3, 1.0, 1.0]
    chain["on"][:] = [0, 2, 3]
    return chain


def wild(samples: int, width: int, scale: float, seed: int = 0) -> np.ndarray:
    rng, time = np.random.default_rng(seed), np.arange(samples) * 1e-3
    tones = [np.sin(2 * np.pi * f * time + p) for f, p in zip((0.7, 3.1, 9.0, 23.0), rng.uniform(0, 6, 4), strict=True)]
    return scale * np.stack([rng.standard_normal(4) @ tones for _ in range(width)], axis=1)


def energy(chain: Chain, motion: Motion) -> np.ndarray:
    twist = motion.angle[:, 0] - motion.angle[:, 1]
    over = np.sign(twist) * np.maximum(np.abs(twist) - chain["gap"][0] / 2, 0)
    return 0.5 * motion.speed**2 @ chain["J"][:2] + 0.5 * chain["k"][0] * over**2 + 0.25 * chain["cubic"][0] * over**4


@pytest.mark.parametrize("law", [{}, {"gap": [0.02]}, {"cubic": [2e5]}])
def test_energy_of_the_lossless_plant_stays(law: dict) -> None:
    chain = two_masses(**law)
    total = energy(chain, simulate(chain, np.zeros((8000, 2)), np.array([0.03, 0, 2.0, -1.0]), 1e-3))
    assert np.ptp(total) < 1e-7 * total[0]


def test_free_oscillation_of_two_masses_follows_the_closed_form() -> None:
    chain = two_masses(c=[0.4] * 2)
    motion = simulate(chain, np.zeros((4000, 2)), np.array([0.05, 0, 0, 0]), 1e-3)
    reduced = 0.1 * 1.5 / 1.6
    natural, decay = np.sqrt(300 / reduced), 0.4 / (2 * reduced)
    damped = np.sqrt(natural**2 - decay**2)
    t = motion.time
    twist = 0.05 * np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))
    assert np.abs(motion.angle[:, 0] - motion.angle[:, 1] - twist).max() < 1e-7 * 0.05


def matrices(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    n = chain.n
    stiff, damp, to = np.zeros((n, n)), np.diag(chain["drag"][:n]), np.zeros((n, chain.u))
    for j in range(chain.s):
        row = np.zeros(n)
        row[chain["first"][j]], row[chain["second"][j]] = 1 / chain["ratio"][j], -1
        stiff += chain["k"][j] * np.outer(row, row)
        damp += chain["c"][j] * np.outer(row, row)
    to[chain["on"], range(chain.u)] = 1
    inverse = np.diag(1 / chain["J"][:n])
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiff, -inverse @ damp]])
    return a, np.vstack([np.zeros((n, chain.u)), inverse @ to])


def exact(chain: Chain, inputs: np.ndarray, start: np.ndarray, dt: float) -> np.ndarray:
    """States (t, 2n) by the matrix exponential, inputs linear between samples."""
    a, b = matrices(chain)
    size, u = len(a), b.shape[1]
    block = np.zeros((size + 2 * u, size + 2 * u))
    block[:size, :size], block[:size, size : size + u] = a * dt, b * dt
    block[size : size + u, size + u :] = np.eye(u)
    big = expm(block)
    states = [start]
    for now, after in itertools.pairwise(inputs):
        states.append((big @ np.concatenate([states[-1], now, after - now]))[:size])
    return np.array(states)


def test_linear_chain_agrees_with_the_matrix_exponential() -> None:
    chain, inputs = four_masses(), wild(6000, 3, 100.0)
    start = np.array([0.01, 0, 0, 0.02, 3, 2, 1, 2.0])
    motion, states = simulate(chain, inputs, start, 1e-3), exact(chain, inputs, start, 1e-3)
    for mine, theirs in ((motion.angle, states[:, :4]), (motion.speed, states[:, 4:])):
        assert np.abs(mine - theirs).max() < 1e-6 * np.ptp(theirs)


def test_series_damper_dahl_and_lag_agree_with_an_independent_solver() -> None:
    chain = two_masses(
        c=[0.4] * 2,
        dahl_torque=[3.0],
        dahl_angle=[0.01],
        lag=[0.02, 0.0],
        quadratic=[0.0, 0.05],
        constant=[0.0, 0.7],
        ripple_order=[3, 0],
        ripple_amplitude=[1.5, 0],
        ripple_phase=[0.4, 0],
    )
    inputs, grid = wild(800, 2, 6.0), np.arange(800) * 1e-3

    def rates(t: float, y: np.ndarray) -> list[float]:
        u = [np.interp(t, grid, inputs[:, j]) for j in (0, 1)]
        rate = y[2] - y[3]
        torque = 300 * (y[0] - y[1]) + 0.4 * rate + y[4]
        return [
            y[2],
            y[3],
            (y[5] + 1.5 * np.sin(3 * y[0] + 0.4) - torque) / 0.1,
            (u[1] - 0.05 * y[3] * abs(y[3]) - 0.7 + torque) / 1.5,
            rate * (1 - np.sign(rate) * y[4] / 3.0) * 3.0 / 0.01,
            (u[0] - y[5]) / 0.02,
        ]

    motion = simulate(chain, inputs, np.array([0.0, 0, 1, 0]), 1e-3)
    there = solve_ivp(
        rates, (0, grid[-1]), [0, 0, 1, 0, 0, inputs[0, 0]], t_eval=grid, rtol=1e-9, atol=1e-10, max_step=1e-3
    )
    assert np.abs(motion.speed - there.y[2:4].T).max() < 1e-5 * np.ptp(there.y[2:4])

    slipping = two_masses(c=[0.4] * 2, series_damper=[40.0])

    def creeping(t: float, y: np.ndarray) -> list[float]:
        u = [np.interp(t, grid, inputs[:, j]) for j in (0, 1)]
        stretch = (40.0 * (y[0] - y[1]) - 300 * y[2]) / 40.4
        torque = 300 * y[2] + 0.4 * stretch
        return [(u[0] - torque) / 0.1, (u[1] + torque) / 1.5, stretch]

    motion = simulate(slipping, inputs, np.array([0.0, 0, 1, 0]), 1e-3)
    there = solve_ivp(creeping, (0, grid[-1]), [1, 0, 0], t_eval=grid, rtol=1e-9, atol=1e-10, max_step=1e-3)
    assert np.abs(motion.speed - there.y[:2].T).max() < 1e-6 * np.ptp(there.y[:2])


def test_stick_is_rest_to_the_bit_and_breaks_away_at_the_breakaway_torque() -> None:
    chain = two_masses(
        k=[0.0] * 2,
        friction=[2.0, 0],
        friction_reverse=[1.5, 0],
        breakaway=[3.0, 0],
        breakaway_reverse=[2.5, 0],
        stribeck_speed=[1.0, 0],
    )
    ramp = np.stack([np.linspace(0, 4, 4001), np.zeros(4001)], axis=1)
    forth = simulate(chain, ramp, np.zeros(4), 1e-3)
    back = simulate(chain, -ramp, np.zeros(4), 1e-3)
    for motion, level in ((forth, 3.0), (back, 2.5)):
        held = np.abs(ramp[:, 0]) < level - 1e-3
        assert np.all(motion.speed[held, 0] == 0)
        assert np.all(motion.acceleration[held, 0] == 0)
        assert np.all(motion.speed[ramp[:, 0] > level + 2e-3, 0] != 0)


def test_sliding_mass_stops_where_coulomb_says() -> None:
    chain = two_masses(
        k=[0.0] * 2, friction=[0.5, 0], friction_reverse=[0.5, 0], breakaway=[0.5, 0], breakaway_reverse=[0.5, 0]
    )
    motion = simulate(chain, np.zeros((1000, 2)), np.array([0, 0, 3.0, 0]), 1e-3)
    assert motion.angle[-1, 0] == pytest.approx(0.1 * 3.0**2 / (2 * 0.5), rel=1e-6)
    assert motion.speed[-1, 0] == 0


def test_stick_slip_under_a_spring_sticks_and_slips() -> None:
    chain = two_masses(
        c=[3.0] * 2, friction=[0, 4.0], friction_reverse=[0, 4.0], breakaway=[0, 4.0], breakaway_reverse=[0, 4.0]
    )
    motion = simulate(chain, wild(4000, 2, 3.0), np.zeros(4), 1e-3)
    stuck = motion.speed[:, 1] == 0
    assert 0.05 < stuck.mean() < 0.95
    balance = motion.torque[:, 0] + motion.input[:, 1]
    assert np.abs(balance[stuck]).max() <= 4.0 * (1 + 1e-9)
    sliding = ~stuck
    law = balance[sliding] - 4.0 * np.sign(motion.speed[sliding, 1])
    np.testing.assert_allclose(1.5 * motion.acceleration[sliding, 1], law, atol=1e-6)


def test_lash_carries_nothing_inside_and_never_pulls() -> None:
    chain = two_masses(c=[0.4] * 2, gap=[0.05])
    motion = simulate(chain, wild(6000, 2, 5.0), np.zeros(4), 1e-3)
    twist, torque = motion.angle[:, 0] - motion.angle[:, 1], motion.torque[:, 0]
    inside = np.abs(twist) < 0.025 - 1e-9
    assert 0.1 < inside.mean() < 0.9
    assert twist.min() < -0.025
    assert twist.max() > 0.025
    assert np.all(torque[inside] == 0)
    assert np.all(torque * np.sign(twist) >= -1e-9)


HARD = {
    "friction": [0.2, 1.0],
    "friction_reverse": [0.2, 1.4],
    "breakaway": [0.2, 1.0],
    "breakaway_reverse": [0.2, 1.4],
}


@pytest.mark.parametrize("law", [{}, {"gap": [0.03]}, HARD, HARD | {"gap": [0.03]}])
def test_halving_the_step_changes_less_than_a_thousandth_of_the_range(law: dict) -> None:
    chain = two_masses(c=[0.4] * 2, drag=[0.02, 0.1] * 2, **law)
    inputs = wild(6000, 2, 5.0)
    coarse, fine = (simulate(chain, inputs, np.zeros(4), 1e-3, step=step) for step in (50e-6, 25e-6))
    for name in ("speed", "torque"):
        a, b = getattr(coarse, name), getattr(fine, name)
        assert np.abs(a - b).max() < 1e-3 * np.ptp(b)


def test_control_closes_the_loop_and_its_record_replays_the_motion() -> None:
    chain = two_masses(c=[0.4] * 2, controlled=[0, 1], gain_p=[0, 4.0], gain_i=[0, 6.0])
    reference = np.stack([np.zeros(5000), np.full(5000, 10.0)], axis=1)
    inputs = wild(5000, 2, 1.0)
    noise = 1e-2 * np.random.default_rng(0).standard_normal(inputs.shape)
    closed = simulate(chain, inputs, np.zeros(4), 1e-3, reference=reference, feedback_noise=noise)
    assert closed.speed[-1000:, 1].mean() == pytest.approx(10, abs=0.5)
    chain["controlled"][:] = 0
    replayed = simulate(chain, closed.input, np.zeros(4), 1e-3)
    assert np.abs(replayed.speed - closed.speed).max() < 1e-10 * np.ptp(closed.speed)


def test_a_motion_that_is_not_finite_is_an_error() -> None:
    chain = two_masses(cubic=[-1e7])
    with pytest.raises(FloatingPointError, match="not finite"):
        simulate(chain, 200 * np.ones((4000, 2)) * [1, -1], np.zeros(4), 1e-3)
