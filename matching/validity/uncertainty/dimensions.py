"""Does the formula make sense in units? Its dimension is worked out from those of the inputs."""

from __future__ import annotations

from typing import Any

import sympy

from modelling.common.errors import InputError
from modelling.units import registry


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

    def walk(node: Any) -> Any:
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
