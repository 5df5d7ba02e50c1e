"""A fit that does not exist is on the table of candidates; a fault in a fit ends the program."""

import numpy as np
import pytest
from scipy.signal import lfilter

from matching.diagnosis import moves
from matching.diagnosis.descent import Quadratic
from matching.diagnosis.diagnose import diagnose
from modelling.errors import FitError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

STEP, COUNT, J, FRICTION, NOISE = 4e-3, 1500, 0.4, 0.8, 0.02


@pytest.fixture(scope="module")
def recorded():
    """One inertia that never stops, with dry friction that its model lacks: speed = ∫(torque − friction)/J."""
    rng = np.random.default_rng(3)
    torque = FRICTION + lfilter([0.05], [1, -0.95], 8 * rng.standard_normal(COUNT))
    gained = np.concatenate([[0.0], np.cumsum((torque[1:] + torque[:-1]) / 2 - FRICTION) * STEP]) / J
    speed = 40 + gained + NOISE * rng.standard_normal(COUNT)
    system = from_dict({
        "inertias": {"rotor": {"J": {"value": 0.39, "lower": 0.2, "upper": 0.8}}},
        "inputs": {"torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
    })  # fmt: skip
    return system, Recording(STEP * np.arange(COUNT), {"torque": torque, "speed": speed})


def test_planted_fault_in_a_candidates_fit_ends_the_program(recorded, monkeypatch):
    system, recording = recorded

    def faulty(*_, **__):
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(moves, "fit_extended", faulty)
    with pytest.raises(ValueError, match="broadcast"):
        diagnose(system, [recording])


def test_candidate_without_a_fit_is_on_the_table_with_the_reason(recorded, monkeypatch):
    system, recording = recorded
    sound = moves.fit_extended

    def fit(model, *rest):
        if any(cause.kind == "coulomb_friction" for cause in model.causes):
            raise FitError("the simulation diverges where the fit begins")
        return sound(model, *rest)

    monkeypatch.setattr(moves, "fit_extended", fit)
    rows = [row for row in diagnose(system, [recording]).to_dict()["candidates"] if row["not_taken"] == "no_fit"]
    assert {(row["kind"], row["at"]) for row in rows} == {("coulomb_friction", "inertias.rotor")}
    assert rows[0]["why"] == "the simulation diverges where the fit begins"
    assert rows[0]["misfit"] is None


def test_normal_equations_that_have_no_factor_are_no_fit():
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(FitError):
        Quadratic(np.full((2, 2), 1e200))
