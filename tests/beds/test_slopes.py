"""Derivatives of errors, poles, margin, roll-off and noise with respect to the gains, against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from matching.match.beds import (
    GainSlopes,
    command_noise,
    error_slopes,
    loop_curves,
    loop_slopes,
    pole_slopes,
    response_slopes,
)
from matching.match.loop import closed_matrices, errors, frequency_response, of_observer, resolvent
from matching.match.tune_observer import Tuner
from modelling.bed.bed import ObserverController
from modelling.bed.observer import assembled

HALF_STEP = 1e-6  # of the gains' relative change, either way


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
        return share @ errors(beds, frequency_response(of_observer(controller), beds.frequencies, ahead), ()).mean(
            axis=1
        )

    here = changed(0.0)
    slopes = response_slopes(here, gains, beds.frequencies, ahead)
    found = error_slopes(beds, frequency_response(of_observer(here), beds.frequencies, ahead), slopes, share)
    np.testing.assert_allclose(found, [central(cost, changed)], rtol=1e-5)


def test_slopes_of_margin_roll_off_and_noise(search, changed, gains):
    plan, ahead = search.plan, search._ahead[search._of(search.plan.every)]
    f = plan.every.frequencies

    def curves(controller: ObserverController):
        return loop_curves(plan, frequency_response(of_observer(controller), f, ahead))

    here = changed(0.0)
    margin, closed, noise = loop_slopes(plan, curves(here), response_slopes(here, gains, f, ahead))
    for found, of in (
        (margin, lambda own: curves(own).margin),
        (closed, lambda own: curves(own).closed),
        (noise, lambda own: command_noise(curves(own), f)),
    ):
        wanted = central(of, changed)
        np.testing.assert_allclose(found[0], wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max())


def test_slopes_of_poles(search, changed, gains):
    here = changed(0.0)
    z = np.linalg.eigvals(closed_matrices(search.sampled_pool, of_observer(here)))
    swinging = np.abs(z.imag) > 1e-3
    at = np.where(swinging, np.abs(z), 0).argmax(axis=1)
    poles = z[np.arange(len(z)), at]

    def moved(controller: ObserverController) -> np.ndarray:
        there = np.linalg.eigvals(closed_matrices(search.sampled_pool, of_observer(controller)))
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
