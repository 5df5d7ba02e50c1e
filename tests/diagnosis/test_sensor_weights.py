"""When causes are searched for a second time, with sensors weighted by what the base model leaves of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import diagnose as module
from matching.diagnosis import selection as hypotheses
from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import LARGEST_MEMORY, FitData, Segment
from matching.diagnosis.fit import balanced_fit, base_problem, innovation_power, iteratively_reweighted, solve
from matching.diagnosis.search import _Screenings as screenings
from matching.diagnosis.selection import Hypothesis
from modelling.model_file import from_dict


def fit(error: float, sensors: int = 2, name: str = "noise") -> SimpleNamespace:
    """A fit whose first sensor errs by so many times its noise."""
    errors = np.ones((100, sensors)) * [error, *[1.0] * (sensors - 1)]
    data = SimpleNamespace(readings_by_sensor=np.full(sensors, 100))
    return SimpleNamespace(errors=[errors], problem=SimpleNamespace(data=data), name=name)


@pytest.fixture
def identified(monkeypatch: pytest.MonkeyPatch):
    """(base error, error left, whether unseen data gain, sensors) → weights of the answer, and of the searches made."""

    def run(base: float, left: float, gains: bool = True, sensors: int = 2) -> tuple[str, list[str]]:
        searches = []

        def search(_system, weighted, _holdout, _progress):
            searches.append(weighted.name)
            return SimpleNamespace(
                state=SimpleNamespace(best=SimpleNamespace(fit=fit(left, sensors))),
                weights=weighted.name,
            )

        monkeypatch.setattr(module, "_identify", search)
        monkeypatch.setattr(module, "_balanced", lambda _system, _base: fit(base, sensors, "balanced"))
        monkeypatch.setattr(module, "scatters_only", lambda best: left == 1.0)
        monkeypatch.setattr(module, "UnseenData", lambda holdout: SimpleNamespace(earns_place=lambda *_: gains))
        answer = module.identify_causes(None, fit(base, sensors), None, lambda _: None)
        return answer.weights, searches

    return run


@pytest.mark.parametrize("angle_uncertainty", [6e-6, 2e-3])
def test_balanced_weights_do_not_depend_on_how_precise_an_encoder_is_said_to_be(angle_uncertainty: float) -> None:
    """The speed channel is filtered, which the model lacks; J = 0.5 kg·m² and drag 0.3 N·m·s/rad are what was made."""
    J, drag, lag = 0.5, 0.3, 0.02
    system = from_dict({
        "inertias": {"rotor": {"J": {"value": J, "tolerance": 0.3}, "drag": {"value": drag, "lower": 0, "upper": 3}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {
            "angle": {"measures": "angle", "of": "rotor", "uncertainty": angle_uncertainty},
            "speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.02},
        },
    })  # fmt: skip
    time = np.arange(0, 4, 2e-3)
    frequencies = 2 * np.pi * np.array([1.5, 4.0, 9.0, 17.0])
    response = 1 / (1j * frequencies * J + drag)
    waves = np.exp(1j * np.outer(time, frequencies))
    torque, speed = waves.real.sum(axis=1), (waves * response).real.sum(axis=1)
    angle = (waves * response / (1j * frequencies)).real.sum(axis=1)
    filtered = (waves * response / (1 + 1j * frequencies * lag)).real.sum(axis=1)
    noise = np.random.default_rng(3).normal(size=(2, len(time)))
    readings = np.stack([angle + 6e-6 * noise[0], filtered + 0.02 * noise[1]], axis=1)
    sensors = np.array([angle_uncertainty, 0.02])
    problem, v = base_problem(system, FitData([Segment(time, torque[:, None], readings)], sensors))
    by_noise = solve(problem, v)
    fit = balanced_fit(by_noise, v)
    assert innovation_power(fit) <= innovation_power(iteratively_reweighted(by_noise)) + 1e-9
    assert fit.values["inertias.rotor.J"] == pytest.approx(J, rel=0.02)
    assert speed.std() > filtered.std()
    assert (fit.problem.weighting.memory <= LARGEST_MEMORY).all()


def test_what_lets_an_angle_drift_away_leads_among_the_slow_candidates() -> None:
    """A constant torque of 0.05 N·m: each sample hardly shows it, the angle is 0.7 rad off at the end."""
    J, drag, torque = 0.5, 0.3, 0.05
    system = from_dict({
        "inertias": {"rotor": {"J": J, "drag": {"value": drag, "lower": 0.2, "upper": 0.4}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {
            "angle": {"measures": "angle", "of": "rotor", "uncertainty": 1e-4},
            "speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.02},
        },
    })  # fmt: skip
    time, rate = np.arange(0, 4, 4e-3), 2 * np.pi * 3
    wave = np.exp(1j * rate * time) / (1j * rate * J + drag)
    noise = np.random.default_rng(5).normal(size=(2, len(time)))
    angle = (wave / (1j * rate)).real - torque / drag * time + np.cumsum(1e-3 * noise[0])
    readings = np.stack([angle, wave.real - torque / drag + 0.1 * noise[1]], axis=1)
    segment = Segment(time, np.cos(rate * time)[:, None], readings)
    problem, v = base_problem(system, FitData([segment], np.array([1e-4, 0.02])))
    by_noise = solve(problem, v)
    model = ExtendedModel(system, (), dict(problem.bounds), by_noise.values)
    slow = screenings({}).slow(Hypothesis(model, balanced_fit(by_noise, v)))
    assert ("constant_torque", "inertias.rotor") in [candidate.kind_and_place for candidate in slow[:2]]
    assert screenings({}).slow(Hypothesis(model, by_noise)) == []


def test_the_pooled_error_is_that_of_readings_over_their_ranges() -> None:
    """Errors of 3 times 0.5 over a range of 8 and of 4 times 0.1 over one of 2; a missing reading does not count."""
    readings = np.array([[-3.0, 0.0, np.nan], [5.0, 2.0, np.nan], [0.0, np.nan, np.nan]])
    errors = np.array([[3.0, 4.0, 9.0], [-3.0, -4.0, 9.0], [3.0, 100.0, 9.0]])
    segment = SimpleNamespace(measured=np.isfinite(readings), readings=readings)
    data = SimpleNamespace(noise=np.array([0.5, 0.1, 1.0]), segments=[segment])
    fit = SimpleNamespace(errors=[errors], problem=SimpleNamespace(data=data))
    assert hypotheses.pooled_error(fit) == pytest.approx(np.sqrt(((1.5 / 8) ** 2 + 0.2**2) / 2), rel=1e-12)
