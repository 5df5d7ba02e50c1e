"""Fits against a closed form: an inertia with drag under a known torque."""

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import solve
from matching.diagnosis.problem import angles_without_reading, base_problem, jacobian
from matching.diagnosis.statistics import estimates
from modelling.equations.casadi_code import compiled
from modelling.errors import FitError
from modelling.model_file import from_dict

J, DRAG, NOISE = 0.5, 0.3, 0.02


def data(seed: int, cut: bool = False) -> FitData:
    """Speed of J·ω̇ = M − drag·ω after a step of 2 N·m, from 1 rad/s: ω = M/b + (1 − M/b)·exp(−b·t/J)."""
    time = np.arange(0, 4, 0.002)
    speed = 2 / DRAG + (1 - 2 / DRAG) * np.exp(-DRAG * time / J)
    measured = speed + NOISE * np.random.default_rng(seed).standard_normal(len(time))
    whole = Segment(time, np.full((len(time), 1), 2.0), measured[:, None], "made")
    parts = (whole.part(0, 900), whole.part(900, 2000)) if cut else (whole,)
    return FitData(parts, np.array([NOISE]))


def system():
    return from_dict(
        {
            "inertias": {"rotor": {"J": {"value": 0.6, "tolerance": 0.5}, "drag": {"value": 0.2, "tolerance": 0.9}}},
            "inputs": {"motor": {"on": "rotor"}},
            "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
        }
    )


@pytest.mark.parametrize("cut", [False, True])
def test_finds_inertia_drag_and_start(cut: bool) -> None:
    problem, start = base_problem(system(), data(0, cut))
    fit = solve(problem, start)
    found = estimates(fit)
    assert abs(found["inertias.rotor.J"].value - J) < 3 * found["inertias.rotor.J"].standard_uncertainty < 0.02
    assert abs(found["inertias.rotor.drag"].value - DRAG) < 3 * found["inertias.rotor.drag"].standard_uncertainty < 0.02
    assert fit.cost / 2000 == pytest.approx(1, abs=0.1)
    assert fit.starts[0][1] == pytest.approx(1, abs=0.02)


def test_uncertainties_are_those_of_repeated_recordings() -> None:
    fits = [estimates(solve(*base_problem(system(), data(seed)))) for seed in range(1, 25)]
    for name in ("inertias.rotor.J", "inertias.rotor.drag"):
        spread = np.std([fit[name].value for fit in fits], ddof=1)
        assert spread == pytest.approx(np.mean([fit[name].standard_uncertainty for fit in fits]), rel=0.4)


def test_jacobian_is_that_of_the_closed_form() -> None:
    problem, _ = base_problem(system(), data(0))
    v = problem.pack({"inertias.rotor.J": J, "inertias.rotor.drag": DRAG}, [np.array([0.0, 1.0])])
    residual = problem.residuals(v[None])[0]
    time = problem.data.segments[0].time
    slope = (1 - 2 / DRAG) * np.exp(-DRAG * time / J) * DRAG * time / J**2
    assert np.allclose(jacobian(problem, v, residual)[:, 0], -slope / NOISE, atol=2e-3 * np.abs(slope / NOISE).max())


def test_one_angle_is_held_unless_a_sensor_tells_it() -> None:
    model = compiled(system())
    assert angles_without_reading(system(), model) == {0}
    told = from_dict(
        {
            "inertias": {"rotor": {"J": 1.0}},
            "inputs": {"motor": {"on": "rotor"}},
            "sensors": {"angle": {"measures": "angle", "of": "rotor", "uncertainty": 0.1}},
        }
    )
    assert angles_without_reading(told, compiled(told)) == set()


def test_bound_is_respected_and_told() -> None:
    narrow = from_dict(
        {
            "inertias": {"rotor": {"J": {"value": 0.6, "tolerance": 0.5}, "drag": {"value": 0.2, "tolerance": 0.1}}},
            "inputs": {"motor": {"on": "rotor"}},
            "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
        }
    )
    fit = solve(*base_problem(narrow, data(0)))
    assert fit.values["inertias.rotor.drag"] == pytest.approx(0.22)
    assert "bound" in estimates(fit)["inertias.rotor.drag"].note


def test_simulation_that_runs_away_beside_the_point_does_not_stop_the_fit(monkeypatch) -> None:
    """Finite readings whose square overflows, on one side of the start: the others are fitted all the same."""
    problem, start = base_problem(system(), data(0))
    at_rest, kept = problem.residuals, start[0]
    monkeypatch.setattr(
        problem, "residuals", lambda v: at_rest(v) + np.where(v[:, :1] > kept, 1e200, 0.0), raising=False
    )
    fit = solve(problem, start)
    assert np.isfinite(fit.cost)
    assert fit.cost < 0.5 * float(np.sum(at_rest(start[None]) ** 2))
    monkeypatch.setattr(problem, "residuals", lambda v: at_rest(v) + 1e200, raising=False)
    with pytest.raises(FitError):
        solve(problem, start)
