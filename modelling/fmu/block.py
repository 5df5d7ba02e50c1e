"""One or several systems side by side as what an FMU holds: variables with units, and three CasADi functions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import casadi as ca
import numpy as np

from modelling.common.errors import InputError
from modelling.equations.assembly import SIMULATION_DEFAULTS
from modelling.equations.compiled import Model, compiled
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.fmu import variables
from modelling.fmu.variables import Variable
from modelling.model.system import System
from modelling.simulation.integrator.functions import functions
from modelling.simulation.plan import steps_per_second

STEPS = "simulation.steps_per_second"
ABOUT = (
    "All values in SI. Stepped by classical Runge-Kutta of order four, internal steps no longer than "
    "1/simulation.steps_per_second; a communication step may have any length."
)


class Contents(Protocol):
    """What every FMU says of itself: title, file name, one sentence, and its variables with the time left out."""

    @property
    def title(self) -> str:
        """What it is, for a reader."""
        ...

    @property
    def name(self) -> str:
        """As a file name."""
        ...

    @property
    def about(self) -> str:
        """How it steps, in one sentence."""
        ...

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Inputs."""
        ...

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """Outputs."""
        ...

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All, in the order of their value references, which begin at 1; 0 is the time."""
        ...


@dataclass(frozen=True)
class Block:
    """What an FMU holds.

    Attributes
    ----------
    title, name : str
        What it is, for a reader and as a file name.
    inputs, outputs, parameters, states : tuple of Variable
        The last parameter is :data:`STEPS`.
    constants, field, reading : Function
        (p, contact time) → c, delays of inputs and outputs (s); (x, u, c) → ẋ; (x, u, c, t) → y: those of
        :mod:`modelling.simulation.integrator.functions`.
    contact : float
        s, contact time at the start; NaN where no lash closes.
    delay : float
        s, by which readings look back at most as the model stands; 0 where nothing can be delayed.
    speeds : tuple of int
        For every state that is an angle, which one is its speed; −1 for others.
    """

    title: str
    name: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    states: tuple[Variable, ...]
    constants: ca.Function
    field: ca.Function
    reading: ca.Function
    contact: float
    delay: float
    speeds: tuple[int, ...]

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All, in the order of their value references, which begin at 1; 0 is the time."""
        return (*self.inputs, *self.outputs, *self.parameters, *self.states)

    @property
    def about(self) -> str:
        """How it steps, in one sentence."""
        return ABOUT

    @property
    def steps_per_second(self) -> float:
        """Internal steps a second, at least."""
        return self.parameters[-1].start


def block(
    systems: Sequence[System],
    title: str,
    name: str,
    notes: Mapping[str, str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Block:
    """Put systems that share no name side by side.

    Parameters
    ----------
    systems : sequence of System
    title, name : str
    notes : mapping, optional
        What to say of a variable, by name, after what it is.
    bounds : mapping, optional
        Between what parameters will be set, SI, where they have no range of their own: the steps suffice for all of it.

    Raises
    ------
    InputError
        If a name is taken twice, or a model needs too many steps.
    """
    notes = notes or {}
    models = [compiled(system) for system in systems]
    parameters = {parameter.name: parameter for model in models for parameter in variables.parameters(model)}
    steps = max(steps_per_second(model, _extremes(model, bounds or {})) for model in models)
    parameters[STEPS] = Variable(
        STEPS, "parameter", "1/s", steps, "least number of internal steps a second", 0.0, nonzero=True
    )
    inputs, outputs, states = (
        [variable for model in models for variable in of(model)]
        for of in (variables.inputs, variables.outputs, variables.states)
    )
    groups = inputs, outputs, list(parameters.values()), states
    _distinct([variable.name for group in groups for variable in group])
    noted = [tuple(_noted(variable, notes) for variable in group) for group in groups]
    stacked = _functions(models, list(parameters))
    return Block(
        title, name, noted[0], noted[1], noted[2], noted[3], *stacked, _contact(models), _delay(models), _speeds(models)
    )


def _noted(variable: Variable, notes: Mapping[str, str]) -> Variable:
    if variable.name not in notes:
        return variable
    return replace(variable, description=f"{variable.description}; {notes[variable.name]}")


def _delay(models: list[Model]) -> float:
    """Longest delays of an input and a reading together; a little even where they are 0 now but can be set."""
    longest = 0.0
    for model in models:
        assembly = model.equations.assembly
        delays = [path.delay for path in assembly.inputs.values()] + [path.delay for path in assembly.sensors.values()]
        if any(delay != 0 for delay in delays):
            parts = [np.array(part).max(initial=0.0) for part in model.delays(model.p0)]
            longest = max(longest, 1e-3, float(sum(parts)))
    return longest


def _speeds(models: list[Model]) -> tuple[int, ...]:
    speeds: list[int] = []
    for model in models:
        first = len(speeds) + model.n
        speeds += [*range(first, first + model.n), *([-1] * (len(model.states) - model.n))]
    return tuple(speeds)


def _extremes(model: Model, bounds: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """The values, and with every quantity that has bounds at the end that makes the model fast: (b, p)."""
    p = np.stack([model.p0, model.p0])
    for i, name in enumerate(model.parameters):
        quantity = model.system.parameters.get(name)
        known = (None, None) if quantity is None else (quantity.lower, quantity.upper)
        low, high = bounds.get(name, known)
        if low is not None and high is not None:
            p[1, i] = low if name.endswith(".J") else high
    return p


def _distinct(names: list[str]) -> None:
    taken = [name for name, count in Counter(["time", *names]).items() if count > 1]
    if taken:
        raise InputError(taken[0], "the name would stand twice among the variables of the FMU", "rename one of the two")


def _contact(models: list[Model]) -> float:
    return SIMULATION_DEFAULTS[CONTACT_TIME] if any(CONTACT_TIME in model.parameters for model in models) else math.nan


def _functions(models: list[Model], names: list[str]) -> tuple[ca.Function, ca.Function, ca.Function]:
    """The functions of all models, stacked."""
    made = [functions(model) for model in models]
    p, contact, t = ca.SX.sym("p", len(names)), ca.SX.sym("contact"), ca.SX.sym("t")
    constants, delays = [], []
    for model, function in zip(models, made, strict=True):
        mine = ca.vertcat(*(contact if name == CONTACT_TIME else p[names.index(name)] for name in model.parameters))
        constants.append(function.constants(mine))
        delays.append(model.delays(mine))
    delay = ca.vertcat(*(delay[0] for delay in delays), *(delay[1] for delay in delays))
    x, u, c = (_stacked(what, [functions.field.size1_in(i) for functions in made]) for i, what in enumerate("xuc"))
    rates = [functions.field(*z) for functions, z in zip(made, zip(x, u, c, strict=True), strict=True)]
    values = [functions.reading(*z, t) for functions, z in zip(made, zip(x, u, c, strict=True), strict=True)]
    xs, us, cs = (ca.vertcat(*part) for part in (x, u, c))
    return (
        ca.Function("constants", [p, contact], [ca.densify(ca.vertcat(*constants)), ca.densify(delay)]),
        ca.Function("field", [xs, us, cs], [ca.densify(ca.vertcat(*rates))]),
        ca.Function("reading", [xs, us, cs, t], [ca.densify(ca.vertcat(*values))]),
    )


def _stacked(name: str, sizes: list[int]) -> list[ca.SX]:
    return [ca.SX.sym(f"{name}{i}", size) for i, size in enumerate(sizes)]
