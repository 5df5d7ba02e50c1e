"""The observer against its own definition: one Riccati equation over everything, and the recursion of the filter."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from matching.match.loop import closed_matrices, closed_poles, sampled_beds, without_limits
from modelling.bed.observer import (
    FORGETTING_PER_SAMPLE,
    FREE_COMMAND_WEIGHT,
    NOW,
    STATE_NOISE,
    STATE_WEIGHT,
    design,
    observer_model,
)

STAY = 1 - FORGETTING_PER_SAMPLE


@pytest.fixture(scope="module")
def model(small_case):
    return observer_model(small_case.rig, small_case.residual_vehicle, small_case.loop)


def size_of(model):
    """States of the observer; those of the model that runs ahead follow."""
    return len(model.bed.whole) + len(model.dynamometers) * (model.bed.delay + 1) + model.estimated


@pytest.fixture(scope="module")
def controller(model, small_case):
    return design(model, small_case.loop.values)


def whole_problem(model, controller, command_weight, change):
    """Gain (k, x + fifo + e + w) on everything known, by one Riccati equation."""
    k, w, size = 1, len(model.known), size_of(model)
    A = np.block([[controller.A[:size, :size], controller.Bw[:size] / NOW], [np.zeros((w, size)), STAY * np.eye(w)]])
    B = np.vstack([controller.Bs[:size], np.zeros((w, k))])
    x = model.speed_error.shape[1]
    error, last = np.zeros((k, size + w)), np.zeros((k, size + w))
    error[:, :x], last[:, x : x + k] = model.speed_error, np.eye(k)
    Q = error.T @ error + np.diag(np.r_[np.full(x, STATE_WEIGHT), np.zeros(size + w - x)]) + change * last.T @ last
    R, S = (command_weight + change) * np.eye(k), -change * last.T
    X = solve_discrete_are(A, B, Q, R, s=S)
    return np.linalg.solve(B.T @ X @ B + R, B.T @ X @ A + S.T)


def test_the_gain_solves_the_whole_problem_with_commands_on_their_way_and_torques(model, controller, small_case):
    weights = small_case.loop.values
    F = whole_problem(model, controller, weights["command_weight"], weights["command_change_weight"])
    o = size_of(model)
    assert -controller.K[:, :o] == pytest.approx(F[:, :o], abs=1e-5 * np.abs(F).max())
    free = whole_problem(model, controller, FREE_COMMAND_WEIGHT, 0.0)
    m = o - model.estimated
    ahead = -controller.K[:, o : o + m] - controller.K[:, :m]
    # commands that cost 1e-12 leave SciPy five digits of the larger equation
    assert ahead == pytest.approx(free[:, :m], abs=1e-4 * np.abs(free).max())
    of_torques = pytest.approx(free[:, o:], abs=1e-4 * np.abs(free[:, o:]).max())
    assert of_torques == -controller.Dw / NOW
    assert of_torques == -controller.K[:, o + m :] / (1 - NOW)


def test_the_correction_is_where_the_filters_recursion_ends_residual_vehicle_included(model, controller, small_case):
    weights, n, e = small_case.loop.values, model.states, model.estimated
    x, k = model.speed_error.shape[1], 1
    root = np.sqrt(model.sample_time)
    A = np.block([[model.bed.whole, model.bed.torques[:, :e]], [np.zeros((e, x)), model.wandering]])
    C = np.hstack([model.readings.rows, np.zeros((len(model.readings.rows), x - n + e))])
    white = np.hstack([model.bed.torques[:, [1]], model.noises["shaft_noise"]])
    white = white * [weights["dynamometer_noise"], weights["shaft_noise"]] / root
    Q = np.zeros((x + e, x + e))
    Q[:x, :x] = white @ white.T
    Q[:n, :n] += STATE_NOISE * np.eye(n)
    drifts = [weights["torque_drift"], weights["dynamometer_drift"], *[weights["dynamometer_swing"]] * (e - 2)]
    Q[x:, x:] = np.diag(drifts) ** 2 * model.sample_time
    trust = [weights[f"{name}_noise"] for name in ("torque_sensor", "rotor_speed", "further_sensor")]
    R = np.diag((model.readings.noise * trust) ** 2)
    P = np.eye(x + e)
    P[n:x] = P[:, n:x] = 0.0
    for _ in range(4000):
        L = np.linalg.solve(C @ P @ C.T + R, C @ P).T
        left = np.eye(x + e) - L @ C
        P = A @ (left @ P @ left.T + L @ R @ L.T) @ A.T + Q  # Joseph's form: stays symmetric
    fifo = k * (model.bed.delay + 1)
    here = np.vstack([controller.L[:x], controller.L[x + fifo : size_of(model)]])
    assert not controller.L[size_of(model) :].any()
    assert np.abs(here - L).max() < 1e-4 * np.abs(L).max()
    assert not controller.L[x : x + fifo].any()


def test_poles_on_the_bed_it_believes_in_are_those_of_regulator_and_filter(small_case, model, controller):
    beds = sampled_beds(small_case, [{}])
    closed = np.linalg.eigvals(closed_matrices(beds, without_limits(controller))[0])
    o = size_of(model)
    A, B, C, F, L = controller.A[:o, :o], controller.Bs[:o], controller.E[:, :o], -controller.K[:, :o], controller.L[:o]
    of_regulator, of_filter = np.linalg.eigvals(A - B @ F), np.linalg.eigvals(A @ (np.eye(o) - L @ C))
    # the characteristic polynomials agree where no pole is: commands on their way count once, estimated torques twice
    z = 1.2 * np.exp(1j * np.linspace(0, np.pi, 7))

    def polynomial(poles):
        return np.array([np.prod(at - poles[np.abs(poles) > 1e-4]) / at ** np.sum(np.abs(poles) > 1e-4) for at in z])

    by_themselves = np.linalg.eigvals(model.wandering)  # not controllable from the commands, and not on the bed
    forgotten = np.prod((z[:, None] - by_themselves) / z[:, None], axis=1)
    both = polynomial(of_regulator) * polynomial(of_filter) / forgotten
    vehicle = polynomial(np.linalg.eigvals(model.bed.whole[model.states :, model.states :]))
    assert polynomial(closed) == pytest.approx(both / vehicle, rel=1e-6)


@pytest.mark.parametrize("dead_time", [0.0, 0.0023, 0.009])  # s: shorter than believed, as believed, longer
def test_commands_that_bed_and_controller_hold_both_add_poles_at_0_alone(small_case, model, controller, dead_time):
    beds = sampled_beds(small_case, [{"loop.dead_time": dead_time}, {"loop.dead_time": 0.6 * dead_time}])
    closed, poles = closed_matrices(beds, without_limits(controller)), closed_poles(beds, without_limits(controller))
    twice = closed.shape[1] - poles.shape[1]
    way = beds.A.shape[1] - beds.states
    assert twice == min(way, len(model.dynamometers) * (model.bed.delay + 1)) > 0
    z = 1.1 * np.exp(1j * np.linspace(0.1, np.pi, 9))[:, None]  # determinants there know nothing of eigenvalues
    sign, size = np.linalg.slogdet(z[..., None, None] * np.eye(closed.shape[1]) - closed)
    factors = z[..., None] - poles
    assert np.log(np.abs(factors)).sum(axis=2) + twice * np.log(1.1) == pytest.approx(size, abs=1e-7)
    assert np.prod(factors / np.abs(factors), axis=2) * (z / 1.1) ** twice == pytest.approx(sign, abs=1e-7)


def test_a_bed_that_is_the_model_leaves_nothing_to_correct(small_case, model, controller):
    """A known torque and commands by a dead time of 2.3 samples, stepped by the exact bed."""
    beds = sampled_beds(small_case, [{}])
    A, B, C = beds.A[0], beds.B[0], beds.C[0]
    torque = model.bed.torques[: model.states, 0]
    bed, state, last = np.zeros(len(A)), np.zeros(len(controller.A)), 0.0
    for k in range(80):
        known = np.array([10.0 * np.sin(0.1 * k), 0.0])  # motor torque, road
        assert np.abs(C @ bed - controller.E @ state).max() < 1e-9
        sent, state = controller.step(state, C @ bed, known, np.full(1, np.inf))
        bed = A @ bed + B @ sent
        bed[: model.states] += torque * (NOW * known[0] + (1 - NOW) * last)
        last = known[0]
    assert abs(sent[0]) > 1.0
