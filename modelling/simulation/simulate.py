"""Time simulation of the full nonlinear model: fixed steps, compiled where there is a C compiler.

Classical Runge-Kutta of order four; the steps follow from the fastest eigenvalue. Inputs are samples of a continuous
signal and vary linearly between them; a dead time shifts them exactly, a delayed sensor reads between the steps.
Before the first sample the inputs held their first value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model, compiled
from modelling.model.system import System
from modelling.simulation.integrator import native, virtual
from modelling.simulation.integrator.task import Task, make_task
from modelling.simulation.plan import steps_per_second as needed_steps
from modelling.simulation.plan import stick_speed
from modelling.simulation.result import Sensitivity, Simulation, SimulationError, raise_if_failed
from modelling.simulation.start import Start, start_state, steady

__all__ = [
    "Sensitivity",
    "Simulation",
    "SimulationError",
    "prepare",
    "sensitivities",
    "simulate",
    "simulate_batch",
    "steady",
]

Inputs = Mapping[str, np.ndarray] | np.ndarray


def simulate(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    values: Mapping[str, float] | None = None,
    start: Start = None,
    sensors: Sequence[str] | None = None,
    *,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> Simulation:
    """Simulate a system on recorded inputs.

    Parameters
    ----------
    model : System or Model
    time : ndarray (t,)
        s, rising; need not be even.
    inputs : mapping of str to ndarray (t,), or ndarray (t, u)
        N·m.
    values : mapping, optional
        Parameters by name that differ from the model's, SI. ``simulation.stick_speed`` (rad/s) among them fixes how
        sharp dry friction turns; otherwise it is chosen from the speeds' range.
    start : see :func:`modelling.simulation.start.start_state`
    sensors : sequence of str, optional
        Which readings to return; all if not given.
    steps_per_second : float, optional
        Otherwise chosen from the fastest eigenvalue along the motion.
    compile : bool, optional
        False: CasADi's virtual machine even if there is a compiler.

    Raises
    ------
    InputError
        If time, inputs, names or start do not fit.
    SimulationError
        If a state is not finite.
    """
    model = compiled(model) if isinstance(model, System) else model
    time, u = checked(model, time, inputs)
    wanted = list(model.sensors) if sensors is None else list(sensors)
    for name in wanted:
        if name not in model.sensors:
            raise unknown(name, model.sensors, "sensors")
    p, steps = prepare(
        model, time, u, model.vector(values), start,
        fixed=values or (), steps_per_second=steps_per_second, compile=compile,
    )  # fmt: skip
    task = make_task(model, time, u, p[None], start_state(model, p, u[0], start)[None], steps)
    states, readings, failed, _ = _run(task, compile)
    raise_if_failed(failed, time, model.states)
    by_name = {name: readings[0, :, model.sensors.index(name)].copy() for name in wanted}
    units = {part.name: part.unit for part in model.system.sensors if part.name in by_name}
    stick = float(p[model.parameters.index(STICK_SPEED)]) if STICK_SPEED in model.parameters else float("nan")
    return Simulation(time, by_name, states[0], list(model.states), units, steps, stick)


def simulate_batch(
    model: System | Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    *,
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> np.ndarray:
    """Readings (b, t, y) for parameter sets (b, p), SI, all with the steps that the fastest of them needs.

    ``parameters`` are used as they are, the stick speed included; :func:`prepare` chooses one. ``start`` may be (b, x).

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
    begin: list[Start] = list(start) if isinstance(start, np.ndarray) and start.ndim == 2 else [start] * len(p)
    if len(begin) != len(p):
        raise InputError("start", f"{len(begin)} rows", f"one a parameter set is needed: {len(p)}")
    starts = np.stack([start_state(model, row, u[0], one) for row, one in zip(p, begin, strict=True)])
    task = make_task(model, time, u, p, starts, steps_per_second or needed_steps(model, p))
    _, readings, failed, _ = _run(task, compile, states=False)
    raise_if_failed(failed, time, model.states)
    return readings


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
) -> Sensitivity:
    """Readings and their derivatives by parameters and start states, integrated along (forward sensitivities).

    They are the exact derivatives of the fixed-step scheme, delays included; the start is held while parameters move.
    Time grows linearly with ``names``; the compiled code is the same for all of them.

    Parameters
    ----------
    parameters : ndarray (p,)
        Used as they are, see :func:`simulate_batch`.
    names : sequence of str
        Parameters (``shafts.link.stiffness``) and start states (``speed(motor)``).

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
    steps = steps_per_second or needed_steps(model, p[None])
    task = make_task(model, time, u, p[None], start_state(model, p, u[0], start)[None], steps, list(names))
    _, readings, failed, slopes = _run(task, compile, states=False)
    raise_if_failed(failed, time, model.states)
    return Sensitivity(time, readings[0], slopes[0], list(model.sensors), list(names))


def prepare(
    model: Model,
    time: np.ndarray,
    inputs: Inputs,
    parameters: np.ndarray,
    start: Start = None,
    *,
    fixed: Mapping[str, float] | Sequence[str] = (),
    steps_per_second: float | None = None,
    compile: bool | None = None,  # noqa: A002
) -> tuple[np.ndarray, float]:
    """Parameters (p,) with a stick speed that fits the motion (unless ``fixed`` names it), and steps a second.

    Runs the motion once where dry friction or a state-dependent stiffness ask for it. A fit calls this once.

    Raises
    ------
    SimulationError
        If the motion stays not finite with sixteen times the steps.
    """
    time, u = checked(model, time, inputs)
    p = np.array(parameters, dtype=float)
    steps = steps_per_second or needed_steps(model, p[None])
    choose = STICK_SPEED in model.parameters and STICK_SPEED not in fixed
    if not choose and (steps_per_second or not any(own.law.state_dependent for own in model.system.effects)):
        return p, steps
    begin = start_state(model, p, u[0], start)[None]
    for attempt in (1, 4, 16):
        task = make_task(model, time, u, p[None], begin, attempt * steps)
        states, _, failed, _ = _run(task, compile, readings=False)
        if failed[0, 0] < 0:
            break
        if attempt == 16:
            raise_if_failed(failed, time, model.states)
    if choose:
        p[model.parameters.index(STICK_SPEED)] = stick_speed(model, p, states[0], 1 / float(np.median(np.diff(time))))
    some = np.linspace(0, len(time) - 1, min(len(time), 48)).astype(int)
    return p, steps_per_second or needed_steps(model, p[None], states[0][some], u[some])


def checked(model: Model, time: np.ndarray, inputs: Inputs) -> tuple[np.ndarray, np.ndarray]:
    """Time (t,) and inputs (t, u), contiguous and checked.

    Raises
    ------
    InputError
        If time does not rise, an input is missing or of another length, or a value is not finite.
    """
    time = np.ascontiguousarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2:
        raise InputError("time", f"shape {time.shape}", "at least two samples are needed")
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise InputError("time", "is not finite or does not rise", "give rising times in s")
    if isinstance(inputs, Mapping):
        for name in model.inputs:
            if name not in inputs:
                raise unknown(name, list(inputs), f"inputs.{name}")
        columns = [np.asarray(inputs[name], dtype=float) for name in model.inputs]
        for name, column in zip(model.inputs, columns, strict=True):
            if column.shape != time.shape:
                raise InputError(
                    f"inputs.{name}", f"shape {column.shape}", f"one value a sample is needed: {time.shape}"
                )
        u = np.stack(columns, axis=1) if columns else np.empty((len(time), 0))
    else:
        u = np.asarray(inputs, dtype=float)
        if u.shape != (len(time), len(model.inputs)):
            raise InputError("inputs", f"shape {u.shape}", f"(t, u) = ({len(time)}, {len(model.inputs)}) is needed")
    if not np.isfinite(u).all():
        sample, column = np.argwhere(~np.isfinite(u))[0]
        raise InputError(
            f"inputs.{model.inputs[column]}", f"is not finite at {time[sample]:g} s", "fill or cut the gap"
        )
    return time, np.ascontiguousarray(u)


def _run(task: Task, compile: bool | None, states: bool = True, readings: bool = True) -> tuple[np.ndarray, ...]:  # noqa: A002
    done = native.run(task, states, readings) if compile is not False else None
    return done if done is not None else virtual.run(task, states, readings)
