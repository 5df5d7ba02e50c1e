"""The screening's linear algebra against simulation."""

import numpy as np
import pytest

from matching.diagnosis.candidates.noise_threshold import offer, threshold
from matching.diagnosis.candidates.screening import Screen, best_of
from matching.diagnosis.data.segments import Data, Segment
from matching.diagnosis.fitting import batch_simulation as runs
from matching.diagnosis.fitting.fit import base_problem, solve
from modelling.effects import EFFECTS
from modelling.equations.compiled import compiled
from modelling.model.components import Effect
from modelling.model.files import from_dict
from modelling.model.quantity import Quantity


@pytest.fixture(scope="module")
def drive():
    return from_dict(
        {
            "inertias": {
                "motor": {"J": 0.1, "drag": 0.02},
                "load": {"J": 1.0, "drag": {"value": 0.1, "tolerance": 0.5}},
            },
            "shafts": {"link": {"between": ["motor", "load"], "stiffness": 300, "damping": 0.6, "ratio": 2.0}},
            "inputs": {"motor_torque": {"on": "motor"}},
            "sensors": {
                "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 0.02},
                "load_acceleration": {"measures": "acceleration", "of": "load", "uncertainty": 0.05},
                "link_torque": {"measures": "torque", "of": "link", "uncertainty": 0.05},
            },
        }
    )


def torque(time: np.ndarray) -> np.ndarray:
    return 5 * np.sin(2 * np.pi * (0.5 + 2 * time) * time)


def made(system, seed: int | None = 0) -> Data:
    time = np.arange(3000) * 1e-3
    model = compiled(system)
    segment = Segment(time, torque(time)[:, None], np.zeros((len(time), 3)))
    y = runs.readings(model, segment, model.p0[None], np.zeros((1, len(model.states))), 8000.0)[0]
    noise = np.array([sensor.uncertainty for sensor in system.sensors])
    if seed is not None:
        y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return Data((Segment(time, segment.inputs, y, "made"),), noise)


@pytest.fixture(scope="module")
def screen(drive) -> Screen:
    return Screen(solve(*base_problem(drive, made(drive))))


def test_response_is_that_of_the_simulation(drive, screen) -> None:
    push = np.random.default_rng(0).standard_normal(3000)
    push[0] = 0.0
    fit = screen.fit
    p, starts = fit.problem.unpack(fit.v)
    segment = fit.problem.data.segments[0]
    more = Segment(segment.time, segment.inputs + push[:, None], segment.readings)
    with_push, without = (
        runs.readings(fit.problem.model, one, p[None], starts[0][None], fit.problem.steps)[0] for one in (more, segment)
    )
    found = screen.response({"motor": push})
    assert np.allclose(found, with_push - without, atol=1e-6 * np.abs(found).max())


def test_pull_is_the_adjoint_of_the_response(screen) -> None:
    push = np.random.default_rng(1).standard_normal(3000)
    direct = float(np.sum(screen.response({"load": push}) / screen.noise * screen.residual.reshape(-1, 3)))
    assert float(push @ screen.seen.torque_gradient["load"]) == pytest.approx(direct, rel=1e-9)


SMALL = {
    "hardening": ("shafts.link", {"cubic": 1e-3 * 300}),
    "quadratic_drag": ("inertias.motor", {"coefficient": 1e-6}),
    "constant_torque": ("inertias.load", {"torque": 1e-4}),
    "input_gain": ("inputs.motor_torque", {"factor": 1 + 1e-5}),
    "sensor_gain": ("sensors.link_torque", {"factor": 1 + 1e-5}),
    "sensor_offset": ("sensors.motor_speed", {"offset": 1e-4}),
    "sensor_drift": ("sensors.load_acceleration", {"rate": 1e-4}),
}


@pytest.mark.parametrize("kind", SMALL)
def test_signature_of_a_small_effect_is_the_difference_it_makes(drive, screen, kind: str) -> None:
    at, parameters = SMALL[kind]
    fit = screen.fit
    guess = next(iter(EFFECTS[kind].guesses(screen.seen, at)))
    bent = drive.with_values(fit.values).with_effects(
        Effect(kind, at, tuple((key, Quantity(value)) for key, value in parameters.items()))
    )
    p, starts = fit.problem.unpack(fit.v)
    segment, model = fit.problem.data.segments[0], compiled(bent)
    y = runs.readings(model, segment, model.p0[None], starts[0][None], fit.problem.steps)[0]
    base = runs.readings(fit.problem.model, segment, p[None], starts[0][None], fit.problem.steps)[0]
    wanted = ((y - base) / screen.noise).ravel()
    signature = screen.signature(dict(guess.additions[0]))
    amplitude = float(signature @ wanted) / float(signature @ signature)
    assert np.linalg.norm(wanted - amplitude * signature) < 0.05 * np.linalg.norm(wanted)
    found = guess.parameters(np.array([amplitude]))
    assert found is not None
    for key, value in parameters.items():
        neutral = 1.0 if key == "factor" else 0.0
        assert found[key] - neutral == pytest.approx(value - neutral, rel=0.05)


def test_every_kind_guesses_within_its_bounds(drive, screen) -> None:
    for kind, own in EFFECTS.items():
        for at in own.places(drive):
            for guess in own.guesses(screen.seen, at):
                found = guess.parameters(np.ones(len(guess.additions)))
                for key, value in (found or {}).items():
                    low, high = own.fit_bounds(key, value, 1e-3)
                    assert low <= value <= high, (kind, key)


def test_noise_seldom_passes_the_threshold(drive) -> None:
    most = []
    for seed in range(5):
        own = Screen(solve(*base_problem(drive, made(drive, seed))))
        offer(own)
        reductions = [one.reduction for one in own.candidates()]
        most.append(max(reductions) / threshold(own))
    assert max(most) < 1
    assert max(most) > 0.2


def test_best_of_many_guesses() -> None:
    """One guess's χ² made as rare as the best of forty is distributed like the largest of forty."""
    rng = np.random.default_rng(5)
    most = rng.chisquare(2, (20_000, 40)).max(axis=1)
    found = best_of(40, rng.chisquare(2, 20_000), 2)
    np.testing.assert_allclose(
        np.quantile(found, [0.1, 0.5, 0.9, 0.99]), np.quantile(most, [0.1, 0.5, 0.9, 0.99]), rtol=0.05
    )


def test_orders_that_the_noise_chose_count_as_chosen(drive) -> None:
    """What noise gives to a torque ripple whose order was chosen by that noise is what the bootstrap expects of it."""
    time = np.arange(3000) * 1e-3
    noise = np.array([sensor.uncertainty for sensor in drive.sensors])
    model = compiled(drive)
    still = Segment(time, 8 + torque(time)[:, None], np.zeros((len(time), 3)))
    spinning = runs.readings(model, still, model.p0[None], np.array([[0, 0, 80.0, 40.0]]), 8000.0)[0]
    found, expected = [], []
    for seed in range(8):
        y = spinning + noise * np.random.default_rng(seed).standard_normal(spinning.shape)
        own = Screen(solve(*base_problem(drive, Data((Segment(time, still.inputs, y, "made"),), noise))))
        offer(own, seed)
        guesses = [
            guess
            for at in ("inertias.motor", "inertias.load")
            for guess in EFFECTS["torque_ripple"].guesses(own.seen, at)
        ]
        found.append(max(own.reduction(guess)[0] for guess in guesses))
        expected += list(np.max(own.taken, axis=0))
    assert np.mean(found) < np.mean(expected) + 2 * np.std(expected) / np.sqrt(len(found))
    assert np.mean(found) > 0.5 * np.mean(expected)
