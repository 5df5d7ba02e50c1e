"""The fit of an extended model, begun where the fit of its parent ended."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.candidates.carry_over import known_jacobian, start_states, states_from
from matching.diagnosis.candidates.cause import ExtendedModel
from matching.diagnosis.fitting.batch_simulation import steps_and_stick_speed
from matching.diagnosis.fitting.fit import Fit, FitOptions, solve
from matching.diagnosis.fitting.problem import STEPS_PER_RADIAN, FitProblem
from modelling.effects import EFFECTS
from modelling.equations.compiled import compiled

ABRUPT_STEPS = 8  # integration steps a sample where a torque jumps: with fewer, χ² is too rough to descend
SMOOTH_STEPS = 2  # the same for other effects in a search; twice as many in the final fit, as of the fastest mode
MOST_START_STATES = 4  # at which the fastest rate is looked at, besides rest
SEARCH = FitOptions(exact=False)


def fit_extended(
    model: ExtendedModel, parent: Fit, options: FitOptions = SEARCH, steps_per_radian: float = STEPS_PER_RADIAN
) -> Fit:
    """Fit an extended model, beginning at values, start states and Jacobian of the fit it came from.

    Raises
    ------
    FloatingPointError
        If it does not simulate from there.
    """
    problem, p = extended_problem(model, parent, steps_per_radian)
    v = problem.pack(model.values, list(model.starts) or start_states(problem, parent, p))
    v = np.clip(v, problem.lower, problem.upper)
    return solve(problem, v, known_jacobian(problem, parent, v), options)


def extended_problem(
    model: ExtendedModel, parent: Fit, steps_per_radian: float = STEPS_PER_RADIAN
) -> tuple[FitProblem, np.ndarray]:
    """The problem of an extended model on the data of its parent, and its parameters (p,) to begin with."""
    system = model.system()
    equations, data = compiled(system), parent.problem.data
    starts = states_from(parent.starts[:MOST_START_STATES], equations.states, parent)
    rest = np.zeros(len(equations.states))
    sampling = 1 / data.sampling_interval
    p = equations.vector({name: value for name, value in model.values.items() if name in equations.parameters})
    least = SMOOTH_STEPS * steps_per_radian / STEPS_PER_RADIAN * sampling
    if any(EFFECTS[effect.kind].abrupt for effect in system.effects):
        least = ABRUPT_STEPS * sampling
    if np.isfinite(parent.problem.stick_speed):  # friction that had to be sharper stays so
        least = max(least, min(parent.problem.steps_per_second, ABRUPT_STEPS * sampling))
    steps, stick_speed = steps_and_stick_speed(
        equations, p, np.array([*starts, rest]), sampling, steps_per_radian, least
    )
    held = parent.problem.held_states
    held = None if held is None else states_from(held, equations.states, parent)
    return FitProblem(system, data, model.bounds, steps, stick_speed, held, parent.problem.weighting), p
