"""Friction and a dead time of the actuator at once: the delay makes friction look as if it fell from rest."""

import math

import numpy as np
import pytest

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import solve
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.moves import Search
from matching.diagnosis.problem import base_problem
from matching.diagnosis.screening import fit_extended
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import UnseenData, blocks_for
from modelling.effects.friction_and_compliance import StribeckFriction
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, FRICTION, DELAY, NOISE = 0.4, 0.3, 0.7, 0.022, 0.02
STEP, EVERY, SECONDS = 4e-4, 10, 10.0
MODEL = {
    "inertias": {"rotor": {"J": {"value": 0.42, "tolerance": 0.2}, "drag": {"value": DRAG, "tolerance": 0.5}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
}


def torque(time: float) -> float:
    return 2.0 * math.sin(1.9 * time) + sum(
        0.7 * math.sin(w * time + w) for w in (0.9, 3.1, 5.3, 8.9, 14.7, 23.0, 37.0)
    )


def recorded() -> Recording:
    """J·ω̇ + DRAG·ω = T(t − DELAY) − FRICTION·tanh(ω/1 mrad/s), by Heun's method in steps of 0.4 ms."""

    def rate(time: float, speed: float) -> float:
        return (torque(time - DELAY) - DRAG * speed - FRICTION * math.tanh(1e3 * speed)) / J

    speeds, speed = [0.0], 0.0
    for i in range(round(SECONDS / STEP)):
        first = rate(i * STEP, speed)
        speed += STEP / 2 * (first + rate((i + 1) * STEP, speed + STEP * first))
        speeds.append(speed)
    time = np.arange(0, SECONDS + STEP / 2, STEP)[::EVERY]
    noisy = np.array(speeds)[::EVERY] + NOISE * np.random.default_rng(4).standard_normal(len(time))
    return Recording(time, {"motor": np.array([torque(t) for t in time]), "speed": noisy}, (), "made", {})


@pytest.fixture(scope="module")
def hypothesis() -> Hypothesis:
    """Friction that seemed to fall from rest until the dead time was added to it."""
    system = from_dict(MODEL)
    base = solve(*base_problem(system, prepare_data(system, [recorded()])[0]))
    model = ExtendedModel(system, (), base.problem.bounds, base.values)
    first = {"torque": 0.7, "breakaway": 0.6, "speed": 0.05}
    for cause in (("stribeck_friction", "inertias.rotor", first), ("dead_time", "inputs.motor", {"delay": 0.02})):
        model = model.with_cause(*cause, STEP * EVERY)
    return Hypothesis(model, fit_extended(model, base))


def test_friction_that_cannot_fall_from_rest_is_plain_beside_the_dead_time(
    hypothesis: Hypothesis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StribeckFriction, "possible", lambda *_: False)  # as where its breakaway is below its sliding
    assert hypothesis.model.not_taken(hypothesis.fit) == "not_physical"
    base = solve(*base_problem(hypothesis.model.base, hypothesis.fit.problem.data))
    unseen = UnseenData(blocks_for(base, DiagnosisSettings()), DiagnosisSettings())
    found = Search(hypothesis.model.base, base, unseen, lambda _: None, ()).simplified(hypothesis)
    assert found.places == {("coulomb_friction", "inertias.rotor"), ("dead_time", "inputs.motor")}
    assert not found.model.not_taken(found.fit)
    values = {name.rsplit(".", 1)[-1]: value for name, value in found.fit.values.items()}
    assert values["torque"] == pytest.approx(FRICTION, rel=0.02)
    assert values["delay"] == pytest.approx(DELAY, abs=5e-4)
