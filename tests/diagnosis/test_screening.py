"""The screening's linear algebra against simulation."""

from dataclasses import replace

import numpy as np
import pytest

from matching.diagnosis.causes import torque_balance
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import solve
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import NoiseDraws, ScreenedCandidate, Screening, best_of, without_effects
from matching.diagnosis.simulation import simulate_readings
from modelling.effects import EFFECTS
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.system import Effect, Quantity


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


def readings(model, segment: Segment, p: np.ndarray, start: np.ndarray, steps: float) -> np.ndarray:
    return simulate_readings(model, [segment], p[None], [start[None]], steps)[0][0]


def made(system, seed: int | None = 0) -> FitData:
    time = np.arange(3000) * 1e-3
    model = compiled(system)
    segment = Segment(time, torque(time)[:, None], np.zeros((len(time), 3)))
    y = readings(model, segment, model.p0, np.zeros(len(model.states)), 8000.0)
    noise = np.array([sensor.uncertainty for sensor in system.sensors])
    if seed is not None:
        y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return FitData((Segment(time, segment.inputs, y, "made"),), noise)


@pytest.fixture(scope="module")
def screen(drive) -> Screening:
    return Screening(solve(*base_problem(drive, made(drive))))


def test_response_is_that_of_the_simulation(drive, screen) -> None:
    push = np.random.default_rng(0).standard_normal(3000)
    push[0] = 0.0
    fit = screen.fit
    p, starts = fit.problem.unpack(fit.v)
    segment = fit.problem.data.segments[0]
    more = Segment(segment.time, segment.inputs + push[:, None], segment.readings)
    with_push, without = (
        readings(fit.problem.model, one, p, starts[0], fit.problem.steps_per_second) for one in (more, segment)
    )
    found = screen.response.readings({"motor": push})
    assert np.allclose(found, with_push - without, atol=1e-6 * np.abs(found).max())


def test_pull_is_the_adjoint_of_the_response(screen) -> None:
    push = np.random.default_rng(1).standard_normal(3000)
    direct = float(np.sum(screen.response.readings({"load": push}) / screen.noise * screen.residual.reshape(-1, 3)))
    assert float(push @ screen.motion.torque_gradient["load"]) == pytest.approx(direct, rel=1e-9)


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
    guess = next(iter(EFFECTS[kind].guesses(screen.motion, at)))
    bent = drive.with_values(fit.values).with_effects(
        Effect(kind, at, tuple((key, Quantity(value)) for key, value in parameters.items()))
    )
    p, starts = fit.problem.unpack(fit.v)
    segment, model = fit.problem.data.segments[0], compiled(bent)
    y = readings(model, segment, model.p0, starts[0], fit.problem.steps_per_second)
    base = readings(fit.problem.model, segment, p, starts[0], fit.problem.steps_per_second)
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
        for at in {*own.candidate_places(drive), *(() if own.follows else own.places(drive))}:
            for guess in own.shared_guesses(screen.motion, at):
                found = guess.parameters(np.ones(len(guess.additions)))
                for key, value in (found or {}).items():
                    low, high = own.fit_bounds(key, value, 1e-3)
                    assert low <= value <= high, (kind, key)


def test_noise_seldom_passes_the_threshold(drive) -> None:
    most = []
    for seed in range(2):
        own = Screening(solve(*base_problem(drive, made(drive, seed))))
        own.draws = NoiseDraws(own.mask.ravel(), own.free)
        reductions = [one.reduction for one in own.candidates()]
        most.append(max(reductions) / own.draws.threshold())
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
    spinning = readings(model, still, model.p0, np.array([0, 0, 80.0, 40.0]), 8000.0)
    found, expected = [], []
    for seed in range(8):
        y = spinning + noise * np.random.default_rng(seed).standard_normal(spinning.shape)
        own = Screening(solve(*base_problem(drive, FitData((Segment(time, still.inputs, y, "made"),), noise))))
        own.draws = NoiseDraws(own.mask.ravel(), own.free, seed)
        guesses = [
            guess
            for at in ("inertias.motor", "inertias.load")
            for guess in EFFECTS["torque_ripple"].guesses(own.motion, at)
        ]
        found.append(max(reduction for reduction, _ in own.reductions(guesses)))
        expected += list(np.max(own.draws.decreases, axis=0))
    assert np.mean(found) < np.mean(expected) + 2 * np.std(expected) / np.sqrt(len(found))
    assert np.mean(found) > 0.5 * np.mean(expected)


def test_whole_number_ratios_are_counted_and_not_doubted(drive):
    law = EFFECTS["wrong_parameter"]
    assert "shafts.link.ratio" in law.places(drive)
    assert "shafts.link.ratio" not in law.candidate_places(drive)
    measured = drive.with_values({"shafts.link.ratio": 2.03})
    assert law.candidate_places(measured) == law.places(measured)


def test_readings_that_tell_no_motion_are_refused_in_one_line(drive):
    fit = solve(*base_problem(drive, made(drive)))
    absurd = replace(fit.problem, data=replace(fit.problem.data, noise=np.array([1e-150, 1e150, 1e150])))
    values = {name: quantity.value for name, quantity in drive.parameters.items()}
    with pytest.raises(InputError, match="made: no motion of the model's inertias follows from its readings"):
        torque_balance(replace(fit, problem=absurd), without_effects(drive), values, 5.0)


@pytest.mark.parametrize(("best_of_all", "refined"), [(1000.0, True), (10_000.0, False)])
def test_nearby_guesses_are_made_only_of_kinds_that_may_come_to_matter(screen, monkeypatch, best_of_all, refined):
    """A ripple that takes 500 beside a friction that takes 1000, or 10 000."""
    reductions = {"torque_ripple": 500.0, "coulomb_friction": best_of_all}

    def screened(kind, guesses):
        if kind in reductions and list(guesses):
            yield ScreenedCandidate(kind, "inertias.load", {}, reductions[kind])

    nearby = []
    monkeypatch.setattr(screen, "_screened", screened)
    monkeypatch.setattr(EFFECTS["torque_ripple"], "nearby", lambda motion, at, best: nearby.append(at) or [])
    monkeypatch.setattr(EFFECTS["torque_ripple"], "guesses", lambda motion, at: ["a guess"])
    monkeypatch.setattr(EFFECTS["torque_ripple"], "shared_guesses", lambda motion, at: ["a guess"])
    list(screen.candidates())
    assert nearby == (["inertias.load"] if refined else [])
