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
    return _Dimensions(dimensions, where).of(expression)


class _Dimensions:
    """Dimensions of the parts of an expression, each worked out once, however deeply sums are nested."""

    def __init__(self, of_symbols: dict[str, Any], where: str):
        self._of_symbols, self._where = of_symbols, where
        self._plain = registry().dimensionless.dimensionality
        self._known: dict[Any, Any] = {}

    def of(self, node: Any) -> Any:
        if node not in self._known:
            self._known[node] = self._worked_out(node)
        return self._known[node]

    def _worked_out(self, node: Any) -> Any:
        if node.is_Symbol:
            return self._of_symbols[node.name]
        if node.is_number:
            return self._plain
        if node.is_Add:
            return self._alike(node.args)
        if node.is_Mul:
            return math.prod((self.of(factor) for factor in node.args), start=self._plain)
        if node.is_Pow and node.exp.is_number:
            return self.of(node.base) ** _exact(node.exp)
        if isinstance(node, sympy.Abs):
            return self.of(node.args[0])
        if isinstance(node, sympy.atan2):
            self._alike(node.args)
            return self._plain
        for argument in node.args[::-1] if node.is_Pow else node.args:  # of a power the exponent first
            self._need_plain(argument)
        return self._plain

    def _need_plain(self, node: Any) -> None:
        if self.of(node) != self._plain:
            raise InputError(
                self._where,
                f"'{node}' must be a plain number, but has dimension {self.of(node)}",
                "divide it by a quantity of that dimension",
            )

    def _alike(self, nodes: Any) -> Any:
        first, *others = nodes
        for node in others:
            if self.of(node) != self.of(first):
                raise InputError(
                    self._where,
                    f"'{first}' ({self.of(first)}) and '{node}' ({self.of(node)}) cannot be added",
                    "give both the same dimension",
                )
        return self.of(first)


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
