"""Poles and encirclements against closed forms, against each other, and against the optimiser's loop."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from matching.match.continuous_loop import (
    ExactLoop,
    approximations,
    count,
    encirclements,
    feedback_modes,
    neutral_motions,
    pade,
    phase_error,
    sampled_poles,
)
from matching.match.loop import parts_of, transfer
from matching.match.programme import closed_loop

J, DELAY = 0.9, 0.004  # an inertia under proportional speed control: L = K·e^(−sτ)/(J·s)
CRITICAL = np.pi * J / (2 * DELAY)


def inertia_loop(gain):
    return lambda s: (1 + gain * np.exp(-s * DELAY) / (J * s))[:, None, None]


@pytest.mark.parametrize(("share", "unstable"), [(0.2, 0), (0.98, 0), (1.02, 2), (5.02, 4)])
def test_critical_gain_of_an_inertia_with_dead_time(share, unstable):
    # crossings at K = (π/2 + 2πn)·J/τ: the second pair leaves at five times the first
    found = count(inertia_loop(share * CRITICAL), 0, 1, DELAY, np.zeros(0))
    assert found.unstable == unstable
    assert found.clear


def test_margin_of_an_inertia_with_dead_time():
    share = 0.4
    found = count(inertia_loop(share * CRITICAL), 0, 1, DELAY, np.zeros(0))
    a = share * np.pi / 2
    # |1 + a·e^(−ix)/(ix)|² = 1 − 2a·sin(x)/x + a²/x², x = ωτ
    best = minimize_scalar(
        lambda x: 1 - 2 * a * np.sin(x) / x + (a / x) ** 2, bounds=(0.1, 3), method="bounded", options={"xatol": 1e-12}
    )
    assert found.modulus_margin == pytest.approx(np.sqrt(best.fun), rel=1e-9)
    assert found.margin_frequency == pytest.approx(best.x / (2 * np.pi * DELAY), rel=1e-4)


def test_a_margin_of_one_is_not_stability():
    # 1 + L = (s − 1)/(s + 1): never nearer to 0 than 1, and a pole at +1
    found = count(lambda s: ((s - 1) / (s + 1))[:, None, None], 0, 0, 0.0, np.zeros(0))
    assert found.modulus_margin == pytest.approx(1.0)
    assert found.unstable == 1


def test_unstable_open_loop_made_stable():
    # L = 2/(s − 1): closed-loop pole at −1
    assert count(lambda s: (1 + 2 / (s - 1))[:, None, None], 1, 0, 0.0, np.zeros(0)).unstable == 0


@pytest.mark.parametrize("order", [1, 3, 5, 8, 12])
def test_pade_is_the_textbook_fraction(order):
    A, B, C, D = pade(DELAY, order)
    s = 2j * np.pi * np.array([0.1, 5.0, 80.0, 300.0])
    c = [
        factorial(2 * order - k) * factorial(order) / (factorial(2 * order) * factorial(k) * factorial(order - k))
        for k in range(order + 1)
    ]
    x = s * DELAY
    wanted = np.polyval(c[::-1], -x) / np.polyval(c[::-1], x)
    got = transfer(A, B[:, None], C[None], np.array([[D]]), s)[:, 0, 0]
    np.testing.assert_allclose(got, wanted, rtol=1e-11)
    np.testing.assert_allclose(
        np.abs(np.angle(got * np.exp(x)))[:2], phase_error(DELAY, order, np.array([0.1, 5.0])), atol=1e-10
    )


def test_agrees_with_the_optimisers_loop(reference):
    case = replace(reference, loop=reference.loop.with_values({"dead_time": 0.0043, "lead_time": 0.002}))
    loop, own = ExactLoop(parts_of(case)), closed_loop(case)
    f = np.geomspace(0.05, 300, 25)
    inputs = list(dict.fromkeys(pair.input for pair in case.compared))
    sensors = list(dict.fromkeys(pair.sensor for pair in case.compared))
    H, difference = loop.response(2j * np.pi * f, inputs, sensors), loop.return_difference(2j * np.pi * f)
    for i, frequency in enumerate(f):
        h_re, h_im, d_re, d_im = (
            np.array(part).ravel()
            for function in (own.response, own.difference)
            for part in function(0.0, 2 * np.pi * frequency, own.values)
        )
        mine = [H[i, sensors.index(pair.sensor), inputs.index(pair.input)] for pair in case.compared]
        np.testing.assert_allclose(mine, h_re + 1j * h_im, rtol=1e-8)
        wanted = (d_re + 1j * d_im).reshape(2, 2)
        np.testing.assert_allclose(difference[i], wanted, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("name", ["reference", "compact"])
def test_poles_solve_the_exact_characteristic_equation(name, request):
    parts = parts_of(request.getfixturevalue(name))
    loop = ExactLoop(parts)
    for mode in feedback_modes(parts):
        if 0 < mode.frequency < 150:
            s = np.array([mode.eigenvalue, mode.eigenvalue * (1 + 1e-3)])
            at, beside = np.abs(np.linalg.det(loop.return_difference(s)))
            assert at < 1e-4 * beside, mode.frequency


def test_poles_encirclements_and_sampled_loop_agree(reference):
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(25):
        values = {
            "proportional_gain": float(np.exp(rng.uniform(np.log(5), np.log(400)))),
            "integral_gain": float(rng.choice([0, 1, 100, 3000])),
            "torque_feed_forward": float(rng.uniform(-0.5, 1.5)),
            "acceleration_feed_forward": float(rng.uniform(0, 2)),
            "lead_time": float(rng.choice([0, 0.003, 0.01])),
            "dead_time": float(rng.choice([0.0, 0.0005, 0.003, 0.008, 0.02])),
        }
        parts = parts_of(replace(reference, loop=reference.loop.with_values(values)))
        neutral = neutral_motions(parts)
        best, found = approximations(parts)[-1], encirclements(parts)
        assert found.clear
        assert best.unstable(neutral) == found.unstable, values
        seen.add(min(found.unstable, 1))
    assert seen == {0, 1}


def test_an_apparent_solution_is_found_out(reference):
    values = {
        "proportional_gain": 16.8236, "integral_gain": 100.0, "torque_feed_forward": 1.4399,
        "acceleration_feed_forward": 1.0321, "lead_time": 0.0, "dead_time": 0.0005,
    }  # fmt: skip
    parts = parts_of(replace(reference, loop=reference.loop.with_values(values)))
    found = encirclements(parts)
    assert found.modulus_margin > 0.2
    assert found.unstable > 0
    assert all(own.unstable(0) == found.unstable for own in approximations(parts))
    assert np.abs(sampled_poles(parts)).max() > 1


def test_sampled_poles_tend_to_the_continuous_ones(reference):
    case = replace(reference, loop=reference.loop.with_values({"sample_time": 1e-4}))
    parts = parts_of(case)
    z = sampled_poles(parts)
    slow = np.log(z[np.abs(z) > 0.9].astype(complex)) / 1e-4
    for mode in feedback_modes(parts):
        if 0 < mode.frequency < 50:
            assert np.abs(slow - mode.eigenvalue).min() < 2e-4 * abs(mode.eigenvalue)


def without_drag(case, rig):
    def free(system):
        return system.with_values({name: 0.0 for name in system.parameters if name.endswith(".drag")})

    residual = case.residual_vehicle
    tuned = replace(residual, parts=tuple(free(part) for part in residual.parts))
    return parts_of(replace(case, residual_vehicle=tuned, rig=free(case.rig) if rig else case.rig))


@pytest.mark.parametrize("rig", [False, True])
@pytest.mark.parametrize(("gain", "unstable"), [(100.0, 0), (10.0, 2)])
def test_a_vehicle_without_drag_coasts(reference, rig, gain, unstable):
    """Rigid motions that nothing slows stand at 0: in the vehicle as in the loop, neither stable nor unstable."""
    parts = without_drag(replace(reference, loop=reference.loop.with_values({"proportional_gain": gain})), rig)
    assert neutral_motions(parts) == 2
    assert approximations(parts)[-1].unstable(2) == unstable
    found = encirclements(parts)
    assert found.clear
    assert found.unstable == unstable
    assert found.resting <= 2


def test_a_pole_on_the_axis_is_not_clear():
    found = count(lambda s: ((s**2 + 100) / (s + 5) ** 2)[:, None, None], 0, 0, 0.0, np.zeros(0))
    assert not found.clear


def test_poles_at_the_origin_are_counted_as_such():
    # 1 + L = s·(s − 1)/(s + 2)²: one at 0, one in the right half plane
    found = count(lambda s: (s * (s - 1) / (s + 2) ** 2)[:, None, None], 0, 0, 0.0, np.zeros(0))
    assert (found.resting, found.unstable, found.clear) == (1, 1, True)


@pytest.mark.parametrize("order", [1, 3])
def test_an_approximation_states_its_largest_phase_error_over_the_band(reference, order):
    """Padé's denominator by its coefficients (2n − k)!·n!/((2n)!·k!·(n − k)!); the error grows with frequency."""
    delay, top = 0.02, reference.band[1]
    parts = parts_of(reference)
    (found,) = approximations(parts, delay, (order,))
    weights = [
        factorial(2 * order - k) * factorial(order) / (factorial(2 * order) * factorial(k) * factorial(order - k))
        for k in range(order + 1)
    ]
    omega = 2 * np.pi * np.linspace(0, top, 2000)
    phase = np.unwrap(np.angle(np.polyval(weights[::-1], 1j * omega * delay)))
    error = np.abs(omega * delay - 2 * phase)
    assert found.phase_error == pytest.approx(error[-1], rel=1e-9)
    wanted = np.interp(np.radians(1), error, omega / (2 * np.pi))
    assert wanted <= found.good_up_to < wanted + order / delay / 2000 + top / 2000  # on a grid
