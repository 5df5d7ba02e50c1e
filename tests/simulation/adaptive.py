"""The same model by an adaptive solver of SciPy, which shares the equations but no integrator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp

from modelling.equations.casadi_code import Model, compiled
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.simulation.start import Inputs, Start, checked, start_state
from modelling.simulation.stepping import Simulation, SimulationError
from modelling.system import System

SHARP_CONTACT = 1e-6  # s


def simulate_adaptive(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    values: Mapping[str, float] | None = None,
    start: Start = None,
    *,
    method: str = "LSODA",
    tolerance: float = 1e-8,
) -> Simulation:
    """Simulate by ``scipy.integrate.solve_ivp``; slow, for checks. Parameters as ``simulate`` has them.

    No step is longer than a sample, so that no change of the inputs is passed over.

    Parameters
    ----------
    method : str
        LSODA, Radau, BDF, DOP853, RK45.
    tolerance : float
        Relative; the absolute one is a thousandth of it.

    Raises
    ------
    InputError
        If time, inputs, names or start do not fit.
    SimulationError
        If the solver gives up.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    p = model.vector({CONTACT_TIME: SHARP_CONTACT} if CONTACT_TIME in model.parameters else None)
    p = model.vector(dict(zip(model.parameters, p, strict=True)) | dict(values or {}))
    input_delay, sensor_delay = (np.array(part).ravel() for part in model.delays(p))

    def acting(t: float) -> np.ndarray:
        return np.array([np.interp(t - late, time, u[:, i]) for i, late in enumerate(input_delay)])

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        return np.array(model.rates(x, acting(t), p)).ravel()

    def jacobian(t: float, x: np.ndarray) -> np.ndarray:
        return np.array(model.jacobians(x, acting(t), p, t)[0].full())

    x0 = start_state(model, p, u[0], start)
    options = {"jac": jacobian} if method in ("LSODA", "Radau", "BDF") else {}
    longest = float(np.diff(time).max())
    solution = solve_ivp(
        rates, (time[0], time[-1]), x0, method, rtol=tolerance, atol=1e-3 * tolerance, dense_output=True,
        max_step=longest, **options,
    )  # fmt: skip
    if not solution.success or not np.isfinite(solution.y).all():
        raise SimulationError("simulation", f"{method} stopped at {solution.t[-1]:g} s: {solution.message}", "")
    readings = {}
    for j, name in enumerate(model.sensors):
        at = time - sensor_delay[j]
        x = solution.sol(np.maximum(at, time[0]))
        x[: model.n] -= np.maximum(time[0] - at, 0) * x0[model.n : 2 * model.n, None]
        y = model.readings.map(len(time))(
            x, np.array([acting(t) for t in at]).T, np.tile(p[:, None], len(time)), time[None]
        )
        readings[name] = np.array(y)[j]
    units = {part.name: part.unit for part in model.system.sensors}
    unknown = float("nan")
    error = dict.fromkeys(readings, unknown)
    return Simulation(time, readings, solution.sol(time).T, list(model.states), units, unknown, unknown, False, error)
