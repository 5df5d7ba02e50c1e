"""Derivatives of errors, poles, margin, roll-off and noise with respect to the gains, against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import (
    GainSlopes,
    action,
    action_slopes,
    closed_matrices,
    command_noise,
    error_slopes,
    errors,
    loop_curves,
    loop_slopes,
    pole_slopes,
    resolvent,
)
from matching.match.tune_observer import Tuner
from modelling.bed.bed import ObserverController
from modelling.bed.observer import assembled

HALF_STEP = 1e-6  # of the gains' relative change, either way
HALF_DECADES = 1e-3  # of a weight, either way: Riccati equations are solved to 1e-6 or so


@pytest.fixture(scope="module")
def search(small_search) -> Tuner:
    return replace(small_search, known={})


@pytest.fixture(scope="module")
def start(search) -> np.ndarray:
    return np.log10([search.case.loop.values[name] for name in search.gains.names])


@pytest.fixture(scope="module")
def changed(search, start):
    """The controller with all gains changed by a share, each at random."""
    F, L = search.gains.feedback(start), search.gains.correction(start)
    rng = np.random.default_rng(5)
    dF, dL = (gains * rng.uniform(-1, 1, gains.shape) for gains in (F, L))

    def at(share: float) -> ObserverController:
        return assembled(search.model, search.gains.ahead, F + share * dF, L + share * dL)

    return at


@pytest.fixture(scope="module")
def gains(changed) -> GainSlopes:
    here, there = changed(0.0), changed(1.0)
    o = here.observed
    return GainSlopes((there.F - here.F)[None, :, :o], (there.L - here.L)[None, :o])


def central(of, changed) -> np.ndarray:
    return (of(changed(HALF_STEP)) - of(changed(-HALF_STEP))) / (2 * HALF_STEP)


def test_a_resolvent_is_the_inverse_even_where_a_matrix_has_no_eigenvectors():
    register = np.eye(5, k=-1)
    register[:2, :2] = [[0.9, 0.2], [-0.2, 0.9]]
    z, B = np.exp(1j * np.array([0.1, 1.0, 3.0])), np.arange(10.0).reshape(5, 2)
    inverse = np.linalg.inv(z[:, None, None] * np.eye(5) - register)
    np.testing.assert_allclose(resolvent(register).columns(z, B), inverse @ B, rtol=1e-12)
    np.testing.assert_allclose(resolvent(register).rows(z, B.T), B.T @ inverse, rtol=1e-12)


def test_slopes_of_the_errors(search, changed, gains):
    beds, share = search.beds, np.array([0.5, 1.0, 2.0])
    ahead = search._ahead[search._of(beds)]

    def cost(controller: ObserverController) -> np.ndarray:
        return share @ errors(beds, action(controller, beds.frequencies, ahead), ()).mean(axis=1)

    here = changed(0.0)
    slopes = action_slopes(here, gains, beds.frequencies, ahead)
    found = error_slopes(beds, action(here, beds.frequencies, ahead), slopes, share)
    np.testing.assert_allclose(found, [central(cost, changed)], rtol=1e-5)


def test_slopes_of_margin_roll_off_and_noise(search, changed, gains):
    plan, ahead = search.plan, search._ahead[search._of(search.plan.every)]
    f = plan.every.frequencies

    def curves(controller: ObserverController):
        return loop_curves(plan, action(controller, f, ahead))

    here = changed(0.0)
    margin, closed, noise = loop_slopes(plan, curves(here), action_slopes(here, gains, f, ahead))
    for found, of in (
        (margin, lambda own: curves(own).margin),
        (closed, lambda own: curves(own).closed),
        (noise, lambda own: command_noise(curves(own), f)),
    ):
        wanted = central(of, changed)
        np.testing.assert_allclose(found[0], wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max())


def test_slopes_of_poles(search, changed, gains):
    here = changed(0.0)
    z = np.linalg.eigvals(closed_matrices(search.sampled_pool, here))
    swinging = np.abs(z.imag) > 1e-3
    at = np.where(swinging, np.abs(z), 0).argmax(axis=1)
    poles = z[np.arange(len(z)), at]

    def moved(controller: ObserverController) -> np.ndarray:
        there = np.linalg.eigvals(closed_matrices(search.sampled_pool, controller))
        return there[np.arange(len(z)), np.abs(there - poles[:, None]).argmin(axis=1)]

    found = pole_slopes(search.sampled_pool, here, gains, poles)[0]
    np.testing.assert_allclose(found, central(moved, changed), rtol=1e-4)


def test_slopes_of_cost_and_requirements_with_respect_to_the_weights(search, start):
    search.guard(start, 3)
    cost, room = search.slopes(start)
    step = 1e-2
    there, back = ([search.judged(start + sign * step * unit) for unit in np.eye(len(start))] for sign in (1, -1))
    wanted = np.array([(one.cost - other.cost) / (2 * step) for one, other in zip(there, back, strict=True)])
    np.testing.assert_allclose(cost, wanted, atol=0.02 * np.abs(wanted).max())
    rooms = np.stack([(one.room - other.room) / (2 * step) for one, other in zip(there, back, strict=True)], axis=1)
    np.testing.assert_allclose(np.linalg.norm(room - rooms), 0, atol=0.05 * np.linalg.norm(rooms))


def test_the_search_sees_the_least_damped_beds_of_the_pool(search, start):
    search.guarded = ()
    search.guard(start, 2)
    seen = search.judged(start).least[:2]
    search.guard(start, len(search.pool))
    assert len(search.guarded) == len(search.pool)
    np.testing.assert_allclose(np.sort(search.judged(start).least[:-3])[:2], np.sort(seen))


def test_gains_change_with_the_weights_as_their_slopes_say(search, start):
    """Every weight of filter and feedback, against differences of the whole design."""
    slopes, o = search.gains.slopes(start), search.gains.controller(start).observed
    for i, unit in enumerate(np.eye(len(start))):
        ends = [search.gains.controller(start + side * HALF_DECADES * unit) for side in (1, -1)]
        F, L = [end.F[:, :o] for end in ends], [end.L[:o] for end in ends]
        for change, (there, back) in ((slopes.feedback[i], F), (slopes.correction[i], L)):
            wanted = (there - back) / (2 * HALF_DECADES)
            assert change == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max() + 1e-12), search.gains.names[i]
    assert np.abs(slopes.feedback).max(axis=(1, 2)).astype(bool).sum() == 2
    assert np.abs(slopes.correction).max(axis=(1, 2)).astype(bool).sum() == len(start) - 2
