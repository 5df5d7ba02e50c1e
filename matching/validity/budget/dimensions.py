"""Does the formula make sense in units? Its dimension is worked out from those of the inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import sympy

from modelling.common.errors import InputError
from modelling.units import Unit, registry, unit_of


def dimension_of(expression: Any, dimensions: dict[str, Any], where: str) -> Any:
    """The dimension (pint's) of a SymPy expression whose symbols have the given dimensions.

    Raises
    ------
    InputError
        Unlike dimensions are added, or a function is taken of something that is no plain number.
    """
    plain = registry().dimensionless.dimensionality

    def need_plain(node: Any) -> Any:
        if walk(node) != plain:
            raise InputError(
                where,
                f"'{node}' must be a plain number, but has dimension {walk(node)}",
                "divide it by a quantity of that dimension",
            )
        return plain

    def alike(nodes: Any) -> Any:
        first, *rest = nodes
        for node in rest:
            if walk(node) != walk(first):
                raise InputError(
                    where,
                    f"'{first}' ({walk(first)}) and '{node}' ({walk(node)}) cannot be added",
                    "give both the same dimension",
                )
        return walk(first)

    known: dict[Any, Any] = {}  # each part once, or nested sums would be worked out again at every level

    def walk(node: Any) -> Any:
        if node not in known:
            known[node] = worked_out(node)
        return known[node]

    def worked_out(node: Any) -> Any:
        if node.is_Symbol:
            return dimensions[node.name]
        if node.is_number:
            return plain
        if node.is_Add:
            return alike(node.args)
        if node.is_Mul:
            product = plain
            for factor in node.args:
                product = product * walk(factor)
            return product
        if node.is_Pow:
            if node.exp.is_number:
                return walk(node.base) ** _exact(node.exp)
            need_plain(node.exp)
            return need_plain(node.base)
        if isinstance(node, sympy.Abs):
            return walk(node.args[0])
        if isinstance(node, sympy.atan2):
            alike(node.args)
            return plain
        for argument in node.args:
            need_plain(argument)
        return plain

    return walk(expression)


def _exact(exponent: Any) -> float:
    value = float(exponent)
    return int(value) if value == int(value) else value


def check_turns(expression: Any, units: Mapping[str, Unit], result: Unit, where: str) -> None:
    """Check that a formula converts between turns, cycles and radians exactly once.

    A speed in 1/min is taken in rad/s, so a factor 2·pi beside it would count it twice; a frequency in Hz is a number
    of cycles, so a torque times it is a power only with that factor.

    Raises
    ------
    InputError
        Naming the input.
    """
    for product in expression.atoms(sympy.Mul):
        factors = {factor.base if factor.is_Pow else factor for factor in product.args}
        counted = {units[symbol.name].counts: symbol for symbol in factors if symbol.is_Symbol}
        if "turns" in counted and sympy.pi in factors:
            name = counted["turns"].name
            raise InputError(
                where,
                f"multiplies {name} by pi, but {name} in {units[name].text} is taken in rad/s already",
                f"leave out the factor 2*pi, or give {name} in Hz",
            )
        torques = [symbol for symbol in factors if symbol.is_Symbol and _is_torque(units[symbol.name])]
        power = unit_of("W", where).dimension
        if "cycles" in counted and torques and result.dimension == power and not expression.has(sympy.pi):
            raise InputError(
                where,
                f"multiplies the torque {torques[0]} by the frequency {counted['cycles']}, which counts cycles",
                "write the factor 2*pi, or give a speed in 1/min or rad/s",
            )
    if _is_rate(result) and not expression.has(sympy.pi):
        _check_rate(expression, units, result, where)


def _check_rate(expression: Any, units: Mapping[str, Unit], result: Unit, where: str) -> None:
    """Check that no frequency in cycles becomes a speed in radians or turns, or the other way, without a factor.

    Raises
    ------
    InputError
        Naming the input.
    """
    cycles = result.counts == "cycles"
    for term in sympy.Add.make_args(sympy.expand(expression)):
        powers = {name: exponent for name, exponent in term.as_powers_dict().items() if name.is_Symbol}
        other = [
            name for name in powers if _is_rate(units[name.name]) and (units[name.name].counts == "cycles") != cycles
        ]
        if sum(powers[name] for name in other) == 1:
            name = str(next(name for name in other if powers[name] > 0))
            counted = ("radians", "cycles") if cycles else ("cycles", "radians")
            raise InputError(
                where,
                f"{name} in {units[name].text} counts {counted[0]}, the result in {result.text} counts {counted[1]}",
                f"{'divide by' if cycles else 'write the factor'} 2*pi, or give both in the same unit",
            )


def _is_rate(unit: Unit) -> bool:
    """Whether it is a frequency or a speed of rotation."""
    return unit.dimension == unit_of("Hz", "").dimension


def result_unit(expression: Any, unit: Unit) -> Unit:
    """The unit of a measurand: 1/min of a formula that divides by pi, as angle/(2·pi·time) does, counts cycles."""
    divides = any(
        factor.is_Pow and factor.base == sympy.pi and factor.exp == -1 for factor in expression.atoms(sympy.Pow)
    )
    if unit.counts != "turns" or not divides:
        return unit
    return replace(unit, scale=unit.scale / (2 * math.pi), counts="cycles")


def _is_torque(unit: Unit) -> bool:
    """Whether it is written as a force times a length; an energy in J is none."""
    return unit.dimension == unit_of("N*m", "").dimension and "N" in unit.text
