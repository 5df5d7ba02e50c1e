"""The variables of an FMU: a model's names, units, start values and physical bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from modelling.effects.kind import SECOND_STATE
from modelling.equations.assembly import RECORDING, STICK_SPEED
from modelling.equations.compiled import Model
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.model.system import System


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU, SI: ``causality`` as FMI says it; ``nonzero`` where 0 itself is impossible."""

    name: str
    causality: str
    unit: str
    start: float = 0.0
    description: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    nonzero: bool = False


def inputs(model: Model) -> list[Variable]:
    """Torques, and motions that are imposed."""
    quantities, units = model.system.input_quantities, model.system.input_units
    return [
        Variable(part.name, "input", units[part.name], 0.0, f"{quantities[part.name]} on {part.on}")
        for part in model.system.inputs
    ]


def outputs(model: Model) -> list[Variable]:
    """Readings of the sensors."""
    return [
        Variable(sensor.name, "output", sensor.unit, 0.0, f"{sensor.measures} of {sensor.of}")
        for sensor in model.system.sensors
    ]


def parameters(model: Model) -> list[Variable]:
    """Every quantity of the model; the contact time of a closing lash is the step's own affair."""
    system, variables = model.system, []
    for name, value in zip(model.parameters, model.p0, strict=True):
        place, _, key = name.rpartition(".")
        if name == CONTACT_TIME:
            continue
        if name == STICK_SPEED:
            meaning = "speed over which the sign of dry friction turns"
            variables.append(Variable(name, "parameter", "rad/s", float(value), meaning, 0.0, nonzero=True))
            continue
        low, high, nonzero = _bounds(system, name)
        if name == RECORDING:
            meaning = "number of the recording whose values hold, from 1; their mean holds at 0"
            variables.append(Variable(name, "parameter", "1", float(value), meaning, 0.0))
            continue
        meaning = f"{key} of {place}"
        variables.append(Variable(name, "parameter", system.units[name], float(value), meaning, low, high, nonzero))
    return variables


def _bounds(system: System, name: str) -> tuple[float, float, bool]:
    """Physical bounds of a parameter, and whether 0 is impossible."""
    place, _, key = name.rpartition(".")
    effect = next((effect for effect in system.effects if effect.name == place), None)
    if effect is None:
        return (-math.inf if key == "ratio" else 0.0), math.inf, key in ("J", "ratio")
    if effect.law.replaces_quantity:
        return _bounds(system, effect.at)
    parameter = effect.law.parameters[key]
    return parameter.lower, parameter.upper, False


def states(model: Model) -> list[Variable]:
    """Angles, speeds and what effects bring along."""
    variables = []
    for name in model.states:
        kind, _, of = name.partition("(")
        if of:
            unit, meaning = ("rad" if kind == "angle" else "rad/s"), f"{kind} of {of[:-1]}"
        else:
            unit, meaning = _further(model.system, name)
        variables.append(Variable(name, "local", unit, 0.0, meaning))
    return variables


def _further(system: System, name: str) -> tuple[str, str]:
    """Unit and meaning of a state that an effect brings along."""
    place, kind = next(
        (place, effect.law)
        for effect in system.effects
        for place in effect.places
        if name.removesuffix(SECOND_STATE) == f"{place}.{effect.kind}"
    )
    assert kind.state is not None
    meaning = kind.second_state if name.endswith(SECOND_STATE) else kind.state.meaning
    return kind.state_unit(place, system), meaning.format(place=place)
