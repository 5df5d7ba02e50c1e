"""Time simulation of the full nonlinear model: steps as fine as a tolerance asks, compiled where there is a compiler.

Classical Runge-Kutta of order four, for stiff models a Rosenbrock method. Inputs are samples of a continuous signal
and vary linearly between them; a dead time shifts them exactly, a delayed sensor reads between the steps. Before the
first sample the inputs held their first value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model, compiled
from modelling.model.system import System
from modelling.simulation import step_control
from modelling.simulation.integrator.task import Trajectories, make_task
from modelling.simulation.recorded_inputs import Inputs, checked
from modelling.simulation.result import Sensitivity, Simulation, raise_if_failed
from modelling.simulation.sharper_friction import MOST_RUNS, sharp_enough
from modelling.simulation.start import Start, start_state
from modelling.simulation.step_control import TOLERANCE, Controlled, InitialValueProblem
from modelling.simulation.stepping import Stepping
from modelling.simulation.stick_speed import stick_speed


def simulate(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    values: Mapping[str, float] | None = None,
    start: Start = None,
    sensors: Sequence[str] | None = None,
    *,
    tolerance: float = TOLERANCE,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> Simulation:  # what is simulated and how are different things, all optional
    """Simulate a system on recorded inputs.

    Parameters
    ----------
    model : System or Model
    time : ndarray (t,)
        s, rising; need not be even.
    inputs : mapping of str to ndarray (t,), or ndarray (t, u)
        N·m.
    values : mapping, optional
        Parameters by name that differ from the model's, SI. ``simulation.stick_speed`` (rad/s) among them fixes over
        which speed the sign of dry friction changes; otherwise it is as small as the tolerance asks.
    start : see :func:`modelling.simulation.start.start_state`
    sensors : sequence of str, optional
        Which readings to return; all if not given.
    tolerance : float
        Largest error of the integration and of dry friction's regularisation, as a share of each reading's range.
    steps_per_second : float, optional
        Explicit steps at this rate instead; the error is then not estimated.
    compile : bool, optional
        False: CasADi's virtual machine even if there is a compiler.

    Raises
    ------
    InputError
        If time, inputs, names, tolerance or start do not fit.
    SimulationError
        If a state is not finite, or an eigenvalue is too fast.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    columns = _columns(model, sensors)
    p = with_stick_speed(model, time, u, model.vector(values), start, values or (), compile=compile)
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    fixed = steps_per_second is not None or STICK_SPEED in (values or ())
    blunt = _controlled(problem, tolerance, steps_per_second, compile)
    done, stick = sharp_enough(problem, blunt, tolerance, compile, most_runs=0 if fixed else MOST_RUNS)
    return Simulation(
        time,
        {name: done.trajectories.readings[0, :, j].copy() for name, j in columns.items()},
        done.trajectories.states[0],
        list(model.states),
        {part.name: part.unit for part in model.system.sensors if part.name in columns},
        done.stepping.mean_rate(time),
        stick,
        done.stepping.implicit,
        {name: float(done.error[j]) for name, j in columns.items()},
    )


def _columns(model: Model, sensors: Sequence[str] | None) -> dict[str, int]:
    """Places of the chosen sensors among those of the model, of all by default."""
    for name in sensors or ():
        if name not in model.sensors:
            raise unknown(name, model.sensors, "sensors")
    return {name: model.sensors.index(name) for name in (model.sensors if sensors is None else sensors)}


def simulate_batch(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    *,
    tolerance: float = TOLERANCE,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> np.ndarray:  # what is simulated and how are different things
    """Readings (b, t, y) for parameter sets (b, p), SI, all with the same steps.

    ``parameters`` are used as they are, the stick speed included; :func:`with_stick_speed` chooses one. ``start`` may
    be (b, x). The others are as for :func:`simulate`.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    p = np.atleast_2d(np.ascontiguousarray(parameters, dtype=float))
    if p.ndim != 2 or p.shape[1] != len(model.parameters) or not np.isfinite(p).all():
        raise InputError(
            "parameters",
            f"shape {np.shape(parameters)}, or not finite",
            f"(b, {len(model.parameters)}) finite values are needed",
        )
    starts: list[Start] = list(start) if isinstance(start, np.ndarray) and start.ndim == 2 else [start] * len(p)
    if len(starts) != len(p):
        raise InputError("start", f"{len(starts)} rows", f"one a parameter set is needed: {len(p)}")
    states = np.stack([start_state(model, row, u[0], begin) for row, begin in zip(p, starts, strict=True)])
    problem = InitialValueProblem(model, time, u, p, states)
    return _controlled(problem, tolerance, steps_per_second, compile, states=False).trajectories.readings


def sensitivities(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    names: Sequence[str],
    start: Start = None,
    *,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> Sensitivity:  # what is simulated and how are different things
    """Readings and their derivatives by parameters and start states, integrated along (forward sensitivities).

    They are the exact derivatives of the explicit fixed-step scheme, delays included; the start is held while
    parameters move. Time grows linearly with ``names``; the compiled code is the same for all of them.

    Parameters
    ----------
    time : ndarray (t,)
        s.
    parameters : ndarray (p,)
        Used as they are, see :func:`simulate_batch`.
    names : sequence of str
        Parameters (``shafts.link.stiffness``) and start states (``speed(motor)``).
    steps_per_second : float, optional
        Otherwise those of a simulation within the default tolerance, and enough for explicit steps to be stable.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    p = np.ascontiguousarray(parameters, dtype=float)
    if p.shape != (len(model.parameters),):
        raise InputError("parameters", f"shape {p.shape}", f"({len(model.parameters)},) is needed")
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    stepping = Stepping(steps_per_second) if steps_per_second else step_control.explicit_stepping(problem, compile)
    task = make_task(
        model, time, u, p[None], problem.start, stepping.steps_per_second, list(names), refinement=stepping.refinement
    )
    done = step_control.run(task, compile, states=False)
    raise_if_failed(done.failed, time, model.states)
    return Sensitivity(time, done.readings[0], done.derivatives[0], list(model.sensors), list(names))


def with_stick_speed(
    model: Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    fixed: Mapping[str, float] | Sequence[str] = (),
    *,
    compile: bool | None = None,  # noqa: A002
) -> np.ndarray:  # a simulation and what of it is fixed
    """Parameters (p,) with a stick speed that fits the motion, unless ``fixed`` names it or nothing sticks.

    Simulates once where there is dry friction; ``time`` (t,) in s. A fit calls this once.

    Raises
    ------
    InputError, SimulationError
        As :func:`simulate`.
    """
    p = np.array(parameters, dtype=float)
    if STICK_SPEED not in model.parameters or STICK_SPEED in fixed:
        return p
    time, u = checked(model, time, inputs)
    problem = InitialValueProblem(model, time, u, p[None], start_state(model, p, u[0], start)[None])
    states = step_control.first_run(problem, compile).trajectories.states[0]
    p[model.parameters.index(STICK_SPEED)] = stick_speed(model, p, states, 1 / float(np.median(np.diff(time))))
    return p


def _controlled(
    problem: InitialValueProblem,
    tolerance: float,
    steps_per_second: float | None,
    compile: bool | None,  # noqa: A002
    states: bool = True,
) -> Controlled:
    if steps_per_second is None:
        if not 0 < tolerance < 1:
            raise InputError("tolerance", f"{tolerance:g} is not possible", "give a share of the range, e.g. 1e-4")
        return step_control.run_to_tolerance(problem, tolerance, compile)
    stepping = Stepping(steps_per_second)
    done: Trajectories = problem.run(stepping, compile, states)
    raise_if_failed(done.failed, problem.time, problem.model.states)
    return Controlled(done, stepping, np.full(len(problem.model.sensors), np.nan))
